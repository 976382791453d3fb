use core::ops::Range;

use crate::force::{BeamForce, Law};
use crate::path::Contact;
use crate::{Normal, Setup, SetupError, Side, Wall};

const PLACES: u32 = 64;

/// A body in a channel, with values that do not depend on its position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Model {
    setup: Setup,
    pub(crate) law: Law,
    sides: [Option<Side>; 2],
    pub(crate) mirrored: bool,
}

/// Sum of the forces of all beams on the body.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Total {
    /// Forward force, N, the paper's `F_drag`: negative resists.
    pub fx_n: f64,
    /// Force to the left, N.
    pub fy_n: f64,
    /// Moment about the body's middle, N·m, positive from x to y.
    pub mz_nm: f64,
    /// Number of beams in contact, on the left and the right wall.
    pub contacts: [u32; 2],
}

impl Model {
    /// # Errors
    /// [`SetupError`] if a quantity is out of range, or the body jams.
    pub fn new(setup: &Setup) -> Result<Self, SetupError> {
        setup.check()?;
        let mirrored = setup.pose.offset_m == 0.0 && setup.pose.yaw_rad == 0.0;
        let left = Side::new(setup, Wall::Left)?;
        let right = if mirrored { left } else { Side::new(setup, Wall::Right)? };
        let model = Self { setup: *setup, law: Law::new(setup), sides: [left, right], mirrored };
        if setup.rules.normal == Normal::MomentBalance {
            model.check_sliding()?;
        }
        Ok(model)
    }

    fn check_sliding(&self) -> Result<(), SetupError> {
        for wall in Wall::BOTH {
            let Some(side) = self.side(wall) else { continue };
            let ends = side.arcs().iter().map(|arc| arc.z);
            // The force across the bar is smooth in z; without friction, it may be zero at the ends.
            let positions = ends.flat_map(|[from, to]| {
                (1..PLACES).map(move |i| from + (to - from) * f64::from(i) / f64::from(PLACES))
            });
            for z in positions {
                if !self.law.slides(&side.path, &side.path.position(z)) {
                    return Err(SetupError::Locks { wall, friction: self.setup.beam.friction });
                }
            }
        }
        Ok(())
    }

    pub fn setup(&self) -> &Setup {
        &self.setup
    }

    /// Returns one wall's side; `None` if the body does not touch its beams.
    pub fn side(&self, wall: Wall) -> Option<&Side> {
        self.sides[wall as usize].as_ref()
    }

    pub(crate) fn solved(&self) -> impl Iterator<Item = &Side> {
        self.sides[..if self.mirrored { 1 } else { 2 }].iter().flatten()
    }

    /// Returns the weight of a solved side: a body in the middle has two equal sides.
    pub(crate) fn weight(&self) -> f64 {
        if self.mirrored { 2.0 } else { 1.0 }
    }

    /// Returns the position of the base of beam `i`, m from the first, `l_i`.
    pub fn base_m(&self, beam: u32) -> f64 {
        self.setup.channel.pitch_m * f64::from(beam)
    }

    /// Returns a wall's beams, from 0, that touch a body whose middle is at `x_m`.
    pub fn touching(&self, wall: Wall, x_m: f64) -> Range<u32> {
        let channel = &self.setup.channel;
        self.side(wall).map_or(0..0, |side| side.touching(x_m, channel.beams, channel.pitch_m))
    }

    /// Returns index, contact and force of beams that touch a body whose middle is at `x_m`.
    pub fn beams(
        &self,
        wall: Wall,
        x_m: f64,
    ) -> impl Iterator<Item = (u32, Contact, BeamForce)> + '_ {
        let side = self.side(wall);
        self.touching(wall, x_m).filter_map(move |beam| {
            let side = side?;
            let contact = side.contact_after(side.travel_at(x_m, self.base_m(beam)))?;
            Some((beam, contact, self.law.force(&side.path, &contact, wall)))
        })
    }

    /// Returns the total force on a body whose middle is at `x_m`, m past the first beam.
    ///
    /// The cost is proportional to the beams in contact; in the middle, one wall suffices.
    pub fn total(&self, x_m: f64) -> Total {
        let mut total = Total::default();
        self.add_wall(&mut total, Wall::Left, x_m);
        if self.mirrored {
            let Total { fx_n, contacts: [touching, _], .. } = total;
            return Total { fx_n: 2.0 * fx_n, fy_n: 0.0, mz_nm: 0.0, contacts: [touching; 2] };
        }
        self.add_wall(&mut total, Wall::Right, x_m);
        total
    }

    fn add_wall(&self, total: &mut Total, wall: Wall, x_m: f64) {
        let Some(side) = self.side(wall) else { return };
        let touching = self.touching(wall, x_m);
        total.contacts[wall as usize] = touching.end - touching.start;
        // The processor overlaps the work of three beams; a fourth would wait.
        for first in touching.clone().step_by(3) {
            let beams = (first..touching.end).take(3);
            // For fewer beams, the last one is solved again, at no cost.
            let beam = |i: u32| (first + i).min(touching.end - 1);
            let travels = [0, 1, 2].map(|i| side.travel_at(x_m, self.base_m(beam(i))));
            for (_, contact) in beams.zip(side.contacts(travels)) {
                let BeamForce { fx_n, fy_n, mz_nm, .. } =
                    self.law.force(&side.path, &contact, wall);
                total.fx_n += fx_n;
                total.fy_n += fy_n;
                total.mz_nm += mz_nm;
            }
        }
    }

    /// Returns the position of the body's middle at the first touch and at the last release, m.
    pub fn extent_m(&self) -> Option<[f64; 2]> {
        let last = self.base_m(self.setup.channel.beams - 1);
        let ends = self.solved().map(|side| [-side.engagement_m, last - side.release_m()]);
        ends.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Angle, Rules};

    /// The work on a beam equals the energy of its spring at the release.
    #[test]
    fn without_friction_the_work_on_a_beam_is_the_energy_of_its_spring() {
        for (width_m, offset_m, yaw_rad) in [
            (0.08, 0.0, 0.0),
            (0.06, 0.0, 0.0),
            (0.04, 0.0, 0.0),
            (0.07, 0.004, 0.2),
            (0.07, -0.004, -0.3),
        ] {
            let mut setup = Setup::default();
            setup.channel.width_m = width_m;
            (setup.pose.offset_m, setup.pose.yaw_rad) = (offset_m, yaw_rad);
            setup.rules = Rules { angle: Angle::True, normal: Normal::MomentBalance };
            let mut model = Model::new(&setup).unwrap();
            setup.beam.friction = 0.0;
            model.law = Law::new(&setup);
            for side in model.solved() {
                let end = side.contact_after(side.travel_m()).unwrap();
                let deflection = model.law.force(&side.path, &end, Wall::Left).deflection_rad;
                let energy = 0.5 * setup.beam.torsional_stiffness() * deflection * deflection;
                let work = model.passage(side);
                // The travel is stationary at the release: the angle has half the digits.
                assert!((work / energy - 1.0).abs() < 1e-7, "{width_m} {yaw_rad}: {work} {energy}");
            }
        }
    }
}
