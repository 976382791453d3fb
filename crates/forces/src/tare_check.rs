//! Whether the frames of a tare were unloaded, judged by what the calibration knows of its training data.

use calibration::quality::AxisQuality;
use calibration::validation::excitation::Excitation;
use shell_data::wrench::{Axis, AxisValues, PerAxis};

use super::TareResult;

/// Share of the largest training load. A zero that has drifted is nearer, and so is the noise of frames at rest.
const LOADED: f64 = 0.1;

/// How many times the error of the calibration: less than that is no load that it can tell.
const ERRORS: f64 = 4.0;

const CONSEQUENCE: &str = "every force of this log is relative to it";

/// Why the frames of a tare are not to be taken as unloaded.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum TareDoubt {
    /// Their mean wrench is far from the zero of the calibration: axis, and mean in N or N·m.
    #[error(
        "the frames of the tare are loaded, it seems: {} is {:.3} {} there; {CONSEQUENCE}",
        .0.name(), .1, .0.unit()
    )]
    Loaded(Axis, f64),
    /// The wrench changes while they are taken: axis, and standard deviation in N or N·m.
    #[error(
        "the load changes during the tare: {} varies by {:.3} {} (standard deviation); {CONSEQUENCE}",
        .0.name(), .1, .0.unit()
    )]
    NotQuiet(Axis, f64),
}

impl TareResult {
    /// The most serious reason not to take its frames as unloaded, if there is any.
    ///
    /// `errors` and `loads` are those of the calibration's training data.
    pub fn doubt(&self, errors: &PerAxis<AxisQuality>, loads: &Excitation) -> Option<TareDoubt> {
        let largest = loads.largest_loads();
        let excess = |of: &AxisValues<f64>| {
            let limit = |axis: Axis| {
                (LOADED * largest[axis.index()]).max(ERRORS * errors[axis.index()].rms)
            };
            let over = of.iter().map(|&(axis, value)| (axis, value, value.abs() / limit(axis)));
            let known = over.filter(|(_, _, excess)| excess.is_finite());
            let (axis, value, excess) = known.max_by(|a, b| a.2.total_cmp(&b.2))?;
            (excess > 1.0).then_some((axis, value))
        };
        let loaded = excess(&self.wrench).map(|(axis, mean)| TareDoubt::Loaded(axis, mean));
        loaded.or_else(|| excess(&self.sd).map(|(axis, sd)| TareDoubt::NotQuiet(axis, sd)))
    }
}

#[cfg(test)]
mod tests {
    use calibration::validation::excitation::AxisExcitation;

    use super::*;

    /// Loads up to 10 N and 1 N·m, errors of 0.1 and 0.01.
    fn doubt(wrench: [f64; 2], sd: [f64; 2]) -> Option<TareDoubt> {
        let scale = |axis: Axis| if axis.is_moment() { 0.1 } else { 1.0 };
        let axis = |axis| AxisExcitation { max: 10.0 * scale(axis), ..AxisExcitation::default() };
        let error = |axis| AxisQuality { rms: 0.1 * scale(axis), ..AxisQuality::default() };
        let loads = Excitation {
            axes: Axis::ALL.map(axis),
            correlation: PerAxis::default(),
            condition: Some(1.0),
        };
        let values = |[fz, mx]: [f64; 2]| vec![(Axis::Fz, fz), (Axis::Mx, mx)];
        let tare = TareResult {
            frames: 50,
            start_s: None,
            end_s: None,
            wrench: values(wrench),
            sd: values(sd),
            rests: None,
            last_rest_s: None,
        };
        tare.doubt(&Axis::ALL.map(error), &loads)
    }

    #[test]
    fn a_load_or_a_change_beyond_a_tenth_of_the_range_is_told() {
        assert_eq!(doubt([0.9, 0.09], [0.9, 0.0]), None, "a zero that has drifted");
        assert_eq!(doubt([-2.0, 0.3], [0.0, 0.0]), Some(TareDoubt::Loaded(Axis::Mx, 0.3)));
        assert_eq!(doubt([0.0, 0.0], [1.2, 0.0]), Some(TareDoubt::NotQuiet(Axis::Fz, 1.2)));
        let text = doubt([-2.0, 0.0], [0.0, 0.0]).unwrap().to_string();
        assert!(text.contains("Fz is -2.000 N"), "{text}");
    }
}
