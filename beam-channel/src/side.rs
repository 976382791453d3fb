//! The contacts of one wall's beams with the body.

use core::ops::Range;

use libm::{atan2, cos, sin, sqrt};

use crate::arc::Arc;
use crate::bending::Bending;
use crate::bisection::turn;
use crate::elastica::Failure;
use crate::path::{Contact, Path};
use crate::{Normal, Setup, SetupError, Wall};

/// First touch, position, and release of one wall's beams on the body.
///
/// A beam touches from the moment the body reaches its tip until the ellipse, seen from its base,
/// falls away, at the maximum of the body's travel `s(z)`. On the way in, `s` may fall on one
/// interval of `z` if the body reaches farther beyond the tips than a beam's length (`d > L`) or is
/// yawed. A tip cannot stay there and snaps across ([`snaps`](Self#structfield.snaps)).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Side {
    pub(crate) path: Path,
    /// In the order of travel, without gaps; `z` has a gap where the tip snaps.
    arcs: [Arc; 4],
    count: usize,
    /// True if tips snap across a part of the body where they cannot rest.
    pub snaps: bool,
    /// Distance of a beam's base ahead of the body's middle at the first touch, `u_e = x(τ_e)`, m.
    pub engagement_m: f64,
    /// Position of the first touch on the ellipse, `φ_e`, rad from the nose towards the wall.
    pub first_touch_rad: f64,
}

impl Side {
    /// Creates the side of `wall`; `None` if the body does not reach its beams.
    ///
    /// # Errors
    /// [`SetupError::BeyondTips`] if the body's middle is beyond the tips; [`SetupError::Jams`] if
    /// the body reaches two beam lengths or more beyond them.
    pub(crate) fn new(setup: &Setup, wall: Wall) -> Result<Option<Self>, SetupError> {
        let beam_length_m = setup.beam.length_m;
        let half_width_m = 0.5 * setup.channel.width_m;
        let (offset_m, yaw) = (setup.pose.offset_m, wall.sign() * setup.pose.yaw_rad);
        let gap = half_width_m - wall.sign() * offset_m;
        if gap <= 0.0 {
            return Err(SetupError::BeyondTips { wall, offset_m, half_width_m });
        }
        let (rx, ry) = (setup.ellipse.semi_length_m, setup.ellipse.semi_width_m);
        // The body's position φ is τ − lead.
        let (half_length, shear, half_width, lead) = if yaw == 0.0 {
            (rx, 0.0, ry, 0.0)
        } else {
            let (sin, cos) = (sin(yaw), cos(yaw));
            let half_width = sqrt(rx * rx * sin * sin + ry * ry * cos * cos);
            let shear = (rx - ry) * (rx + ry) * sin * cos / half_width;
            (rx * ry / half_width, shear, half_width, atan2(rx * sin, ry * cos))
        };
        let depth_m = half_width - gap;
        if depth_m <= 0.0 {
            return Ok(None);
        }
        if depth_m >= 2.0 * beam_length_m {
            return Err(SetupError::Jams { wall, depth_m, beam_length_m });
        }
        let sin_e = gap / half_width;
        let cos_e = sqrt(depth_m * (half_width + gap)) / half_width;
        let mut path = Path {
            half_length,
            shear,
            half_width,
            beam: beam_length_m,
            sin_e,
            cos_e,
            bending: None,
        };
        if let normal @ (Normal::Elastica | Normal::Plate) = setup.rules.normal {
            let friction = setup.beam.friction;
            let bending = Bending::new(&path, friction, normal == Normal::Plate);
            path.bending = Some(bending.map_err(|failure| match failure {
                Failure::Flattened => SetupError::Flattens { wall, depth_m, beam_length_m },
                Failure::Locked | Failure::Released => SetupError::Locks { wall, friction },
            })?);
        }
        let mut side = Self {
            path,
            arcs: [Arc::default(); 4],
            count: 0,
            snaps: false,
            engagement_m: half_length * cos_e + shear * sin_e,
            first_touch_rad: atan2(sin_e, cos_e) - lead,
        };
        side.find_arcs();
        Ok(Some(side))
    }

    fn find_arcs(&mut self) {
        let path = self.path;
        let [slowest, moving, last] = path.landmarks();
        let steepness = |z| path.position(z).steepness;
        let release = turn(steepness, moving, last);
        if steepness(slowest) < 0.0 {
            let stop = turn(steepness, 0.0, slowest);
            let stopped = path.position(stop).travel;
            self.snaps = true;
            self.add_smooth(0.0, stop);
            if path.position(release).travel > stopped {
                // Resume where the travel, after a fall, is back at its earlier maximum.
                let again = turn(|z| -steepness(z), slowest, moving);
                let resume = turn(|z| stopped - path.position(z).travel, again, release);
                self.add_smooth(resume, release);
            }
        } else {
            self.add_smooth(0.0, release);
        }
    }

    /// Adds a part of the path, cut where the beam is at 90°, a kink of the folded angle, or
    /// contact changes between tip and face.
    fn add_smooth(&mut self, from: f64, to: f64) {
        let path = self.path;
        let mut start = from;
        let is_deep = path.depth() > path.beam;
        let cuts = match &path.bending {
            None if is_deep => path.at_rise(path.beam),
            None => [0.0; 2],
            Some(bending) => bending.changes(),
        };
        for cut in cuts {
            if cut > start && cut < to {
                self.add(start, cut);
                start = cut;
            }
        }
        self.add(start, to);
    }

    fn add(&mut self, from: f64, to: f64) {
        let mut arc = Arc::new(&self.path, [from, to]);
        if self.count > 0 {
            // Keeps the travel without gaps, to the last bit.
            arc.travel[0] = self.arcs[self.count - 1].travel[1];
            arc.travel[1] = arc.travel[1].max(arc.travel[0]);
        }
        self.arcs[self.count] = arc;
        self.count += 1;
    }

    pub(crate) fn arcs(&self) -> &[Arc] {
        &self.arcs[..self.count]
    }

    /// Returns the travel of the body from the first touch of a beam to its release, m.
    pub fn travel_m(&self) -> f64 {
        self.arcs[self.count - 1].travel[1]
    }

    /// Distance of a beam's base ahead of the body's middle at the release, `u_f`, m; negative.
    pub fn release_m(&self) -> f64 {
        self.engagement_m - self.travel_m()
    }

    /// Returns true if beams turn past 90°, where the body is nearer to the wall than their bases
    /// and real beams bend differently.
    pub fn turns_past_a_right_angle(&self) -> bool {
        self.path.depth() > self.path.beam
    }

    /// Returns true if a clamped beam's face meets the body, whose force on faces is not modelled.
    pub fn beams_lie_against_body(&self) -> bool {
        self.path.bending.is_some_and(|bending| bending.lies_against_body)
    }

    /// Returns true if a yawed body meets faces before tips; the model has no forces on faces.
    pub fn meets_faces_first(&self) -> bool {
        self.path.shear * self.path.cos_e > self.path.half_length * self.path.sin_e
    }

    /// Returns the position of `contact` on the ellipse, `φ`, rad from the nose towards the wall.
    pub fn place_rad(&self, contact: &Contact) -> f64 {
        self.first_touch_rad + contact.turn()
    }

    /// Returns the contact with a beam touched `travel_m` ago; `None` outside touch and release.
    pub fn contact_after(&self, travel_m: f64) -> Option<Contact> {
        let touches = travel_m >= 0.0 && travel_m <= self.travel_m();
        touches.then(|| self.arc_at(travel_m).locate(&self.path, travel_m))
    }

    /// Returns the contacts with beams by the travel since each was touched; all must still touch.
    #[inline]
    pub(crate) fn contacts<const N: usize>(&self, travels: [f64; N]) -> [Contact; N] {
        Arc::locate_all(travels.map(|travel| self.arc_at(travel)), &self.path, travels)
    }

    #[inline]
    fn arc_at(&self, travel: f64) -> &Arc {
        let arcs = self.arcs();
        arcs.iter().find(|arc| travel <= arc.travel[1]).unwrap_or(&arcs[arcs.len() - 1])
    }

    /// Returns the beams that touch a body whose middle is at `x_m`; the row's first base is at 0.
    pub(crate) fn touching(&self, x_m: f64, beams: u32, pitch: f64) -> Range<u32> {
        let nose = x_m + self.engagement_m;
        let travel = |i: u32| nose - pitch * f64::from(i);
        // The quotients may round across an integer.
        let first = libm::ceil((nose - self.travel_m()) / pitch);
        let mut first = (first as u32).min(beams);
        while first < beams && travel(first) > self.travel_m() {
            first += 1;
        }
        while first > 0 && travel(first - 1) <= self.travel_m() {
            first -= 1;
        }
        let mut end = (libm::floor(nose / pitch) + 1.0).max(0.0).min(f64::from(beams)) as u32;
        while end < beams && travel(end) >= 0.0 {
            end += 1;
        }
        while end > first && travel(end - 1) < 0.0 {
            end -= 1;
        }
        first..end.max(first)
    }

    /// Returns the travel of the body at `x_m` since it touched a beam whose base is at `base_m`.
    pub(crate) fn travel_at(&self, x_m: f64, base_m: f64) -> f64 {
        x_m + self.engagement_m - base_m
    }
}
