//! The positions at which the body is completely among the beams.
//!
//! There the drag is periodic with the spacing of the beams, and its mean is the work on one beam
//! over the spacing. It is smooth except for corners, where a beam is first touched or is at 90°,
//! and jumps, where one slips off or snaps. Between these known positions the extremes are roots of
//! the derivative.

use crate::bisection::turn;
use crate::force::Law;
use crate::path::{Contact, Path};
use crate::{Model, Side, Wall};

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BeamPlateau {
    /// Position of the body's middle at the first beam's release and at the last one's first touch,
    /// m. The drag takes all its values only if they are at least one spacing apart.
    pub extent_m: [f64; 2],
    pub mean_drag_n: f64,
    pub peak: Extreme,
    pub minimum: Extreme,
    /// Left and right.
    pub mean_contacts: [f64; 2],
    /// Left and right.
    pub min_contacts: [u32; 2],
    /// Left and right.
    pub max_contacts: [u32; 2],
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extreme {
    pub drag_n: f64,
    /// First position on the plateau, m; repeats at every spacing.
    pub x_m: f64,
    /// True for a one-sided limit at a corner or jump; otherwise the slope is zero.
    pub is_limit: bool,
}

/// Maximum number of corners and jumps in one spacing: two sides with five ends of arcs each, and both ends.
const BREAKS: usize = 12;

/// Number of intervals between two breaks, at whose ends the sign of the derivative is checked.
const SAMPLES: u32 = 16;

impl Model {
    /// Returns the plateau of the drag; `None` without a touch or in a channel that is too short.
    pub fn plateau(&self) -> Option<BeamPlateau> {
        let channel = &self.setup().channel;
        let last = self.base_m(channel.beams - 1);
        let ends = self.solved().map(|side| [-side.release_m(), last - side.engagement_m]);
        let extent_m = ends.reduce(|a, b| [a[0].max(b[0]), a[1].min(b[1])])?;
        if extent_m[0] > extent_m[1] {
            return None;
        }
        let start = extent_m[0];
        let passages: f64 = self.solved().map(|side| self.passage(side)).sum();
        let mean_drag_n = self.weight() * passages / channel.pitch_m;
        let limit = |drag_n| Extreme { drag_n, x_m: start, is_limit: true };
        let mut plateau = BeamPlateau {
            extent_m,
            mean_drag_n,
            peak: limit(f64::NEG_INFINITY),
            minimum: limit(f64::INFINITY),
            mean_contacts: Wall::BOTH
                .map(|wall| self.side(wall).map_or(0.0, |side| side.travel_m() / channel.pitch_m)),
            min_contacts: [u32::MAX; 2],
            max_contacts: [0; 2],
        };
        let (breaks, count) = self.breaks(start);
        for ends in breaks[..count].windows(2) {
            let smooth = Smooth { model: self, from: ends[0], to: ends[1] };
            smooth.count(&mut plateau);
            smooth.search(&mut plateau);
        }
        Some(plateau)
    }

    /// Returns the corners and jumps of the drag within one spacing from `start`, in order.
    fn breaks(&self, start: f64) -> ([f64; BREAKS], usize) {
        let pitch = self.setup().channel.pitch_m;
        let mut breaks = [f64::INFINITY; BREAKS];
        breaks[0] = start;
        breaks[1] = start + pitch;
        let mut count = 2;
        for side in self.solved() {
            let ends = side.arcs().iter().map(|arc| arc.travel[1]);
            for travel in core::iter::once(0.0).chain(ends) {
                let past = travel - side.engagement_m - start;
                let position = start + (past - pitch * libm::floor(past / pitch));
                if position > start && position < start + pitch {
                    breaks[count] = position;
                    count += 1;
                }
            }
        }
        breaks[..count].sort_unstable_by(f64::total_cmp);
        (breaks, count)
    }
}

/// The drag between two breaks; at the ends its limits from within.
struct Smooth<'a> {
    model: &'a Model,
    from: f64,
    to: f64,
}

impl Smooth<'_> {
    fn middle(&self) -> f64 {
        0.5 * (self.from + self.to)
    }

    /// Sums `of` over the beams in contact, on their arcs, in the middle of an endless channel.
    fn sum(&self, x: f64, of: impl Fn(&Law, &Path, &Contact) -> f64) -> f64 {
        let (law, pitch) = (&self.model.law, self.model.setup().channel.pitch_m);
        let of_side = |side: &Side| {
            let travel = |x: f64, beam: f64| x + side.engagement_m - pitch * beam;
            let (first, count) = self.touching(side);
            let of_beams = (0..count).map(|i| first + f64::from(i)).filter_map(|beam| {
                let in_middle = travel(self.middle(), beam);
                let arc = side.arcs().iter().find(|arc| in_middle <= arc.travel[1])?;
                Some(of(law, &side.path, &arc.locate(&side.path, travel(x, beam))))
            });
            of_beams.fold(0.0, |sum, of_beam| sum + of_beam)
        };
        self.model.solved().map(of_side).sum()
    }

    /// Returns the first beam in contact in the middle, possibly negative, and their number.
    fn touching(&self, side: &Side) -> (f64, u32) {
        let pitch = self.model.setup().channel.pitch_m;
        let nose = self.middle() + side.engagement_m;
        let first = libm::ceil((nose - side.travel_m()) / pitch);
        (first, (libm::floor(nose / pitch) + 1.0 - first).max(0.0) as u32)
    }

    fn drag(&self, x: f64) -> f64 {
        self.model.weight() * self.sum(x, Law::drag)
    }

    fn slope(&self, x: f64) -> f64 {
        self.sum(x, Law::drag_slope)
    }

    fn count(&self, plateau: &mut BeamPlateau) {
        let touching = |wall| self.model.side(wall).map_or(0, |side| self.touching(side).1);
        for (i, touching) in Wall::BOTH.map(touching).into_iter().enumerate() {
            plateau.min_contacts[i] = plateau.min_contacts[i].min(touching);
            plateau.max_contacts[i] = plateau.max_contacts[i].max(touching);
        }
    }

    fn search(&self, plateau: &mut BeamPlateau) {
        for x in [self.from, self.to] {
            plateau.offer(Extreme { drag_n: self.drag(x), x_m: x, is_limit: true });
        }
        let at = |i: u32| {
            // Denser towards the ends, where a jump of the slope may have an extreme; not at the
            // ends, where a released beam has no slope.
            let share = f64::from(i) / f64::from(SAMPLES);
            let share = (share * share * (3.0 - 2.0 * share)).clamp(1e-9, 1.0 - 1e-9);
            self.from + share * (self.to - self.from)
        };
        let mut before = (at(0), self.slope(at(0)));
        for i in 1..=SAMPLES {
            let after = (at(i), self.slope(at(i)));
            if before.1 * after.1 < 0.0 {
                let sign = before.1.signum();
                let x_m = turn(|x| sign * self.slope(x), before.0, after.0);
                plateau.offer(Extreme { drag_n: self.drag(x_m), x_m, is_limit: false });
            }
            before = after;
        }
    }
}

impl BeamPlateau {
    fn offer(&mut self, extreme: Extreme) {
        if extreme.drag_n > self.peak.drag_n {
            self.peak = extreme;
        }
        if extreme.drag_n < self.minimum.drag_n {
            self.minimum = extreme;
        }
    }
}
