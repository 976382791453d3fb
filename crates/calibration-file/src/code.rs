//! Exports calibrations as Python and MATLAB functions, for programs without `shellcal`.
//!
//! Constants and a fixed body (`assets/export`) compute the same as
//! [`Calibration::wrench`](calibration::Calibration::wrench): polynomials on standardised readings,
//! in the order of [`Model::terms`](calibration::Model::terms). Memory terms need the times of the
//! frames and a state that the caller passes from call to call.

use calibration::memory::{MemoryTerms, TimeBase};
use calibration::model::Term;
use calibration::physics::{PhysicsModel, Sensor};
use calibration::{Kind, Polynomial};
use shell_data::escape;
use shell_data::wrench::Axes;

use super::CalibrationFile;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Language {
    Python,
    /// MATLAB or Octave.
    Matlab,
}

type Constant = (&'static str, &'static str, Vec<Vec<f64>>);

/// The calibration as a function. `name` must be an identifier, and for MATLAB also the name of the
/// file.
pub fn to_code(file: &CalibrationFile, language: Language, name: &str) -> String {
    let axes = file.calibration.axes;
    let memory = file.calibration.memory.as_ref();
    let (mut constants, python_body, matlab_body) = match &file.calibration.kind {
        Kind::Polynomial(polynomial) => (
            polynomial_constants(polynomial, axes),
            include_str!("../assets/export/polynomial.py"),
            include_str!("../assets/export/polynomial.m"),
        ),
        Kind::Physics(physics) => (
            physics_constants(physics.model()),
            include_str!("../assets/export/physics.py"),
            include_str!("../assets/export/physics.m"),
        ),
    };
    constants.extend(memory.into_iter().flat_map(memory_constants));
    let (columns, head) = (axes.columns(), head(file));
    let (arguments, results, python_memory, matlab_memory) = match memory {
        None => ("readings", "w", "", ""),
        Some(_) => (
            "readings, times, state",
            "[w, state]",
            include_str!("../assets/export/memory.py"),
            include_str!("../assets/export/memory.m"),
        ),
    };
    match language {
        Language::Python => {
            let head = python(&constants, &escape::python(&head), &columns, (name, arguments));
            head + python_body + python_memory
        }
        Language::Matlab => {
            let signature = format!("{results} = {name}({arguments})");
            let head = escape::matlab_comment(&head);
            matlab(&constants, &head, &columns, (name, &signature)) + matlab_memory + matlab_body
        }
    }
}

fn memory_constants(memory: &MemoryTerms) -> [Constant; 3] {
    let (unit, by_time) = match memory.time_base {
        TimeBase::Seconds => ("s", 1.0),
        TimeBase::Rows => ("rows", 0.0),
    };
    [
        ("TIME_CONSTANTS", unit, vec![memory.time_constants.clone()]),
        ("GAP", unit, vec![vec![memory.gap.unwrap_or(f64::MAX)]]),
        ("BY_TIME", "whether these are by time, not by row", vec![vec![by_time]]),
    ]
}

fn head(file: &CalibrationFile) -> String {
    let model = file.calibration.name();
    let serial = file.origin.sensor_serial.as_ref();
    let of = serial.map_or(String::new(), |serial| format!(" of the sensor `{serial}`"));
    format!(
        "{model} calibration{of}, exported by {}, fitted on {}",
        file.origin.made_by, file.origin.date
    )
}

fn polynomial_constants(polynomial: &Polynomial, axes: Axes) -> Vec<Constant> {
    let model = polynomial.model();
    let none = model.columns() as f64;
    let positions = |term: &Term| {
        let positions = term.factors().iter().map(|&channel| f64::from(channel));
        positions.chain(std::iter::repeat(none)).take(model.basis.degree()).collect()
    };
    let scaling = polynomial.scaling();
    let factors = model.terms().iter().map(positions).collect();
    let products = "a row for each feature: the channels it is a product of, from 0";
    let coefficients = polynomial.coefficients.iter().map(|row| axes.of(row)).collect();
    vec![
        ("CENTRE", "counts", vec![scaling.centre.clone()]),
        ("SCALE", "counts", vec![scaling.scale.clone()]),
        ("FACTORS", products, factors),
        ("COEFFICIENTS", "a row for each feature: N and N*m", coefficients),
    ]
}

fn physics_constants(model: &PhysicsModel) -> Vec<Constant> {
    let of = |value: fn(&Sensor) -> f64| model.sensors.iter().map(value).collect();
    let factors = model.factor_count();
    let parameters = model.sensors.iter().map(|sensor| sensor.parameters.to_vec()).collect();
    let gains = model.sensors.iter().map(|sensor| {
        sensor.parameters[1..7].iter().chain(&sensor.loadings[..factors]).copied().collect()
    });
    // Precisions of the loads first; the shared factors have unit variance.
    let prior = |i: usize, j: usize| match model.load_precision.get(i).and_then(|row| row.get(j)) {
        Some(x) => model.lambda * x,
        None => f64::from(u8::from(i == j)),
    };
    let unknowns = 0..6 + factors;
    let prior = unknowns.clone().map(|i| unknowns.clone().map(|j| prior(i, j)).collect());
    let noise = vec![model.noise.reading, model.noise.displacement];
    let displaces =
        "a row for each sensor: a, then what each factor that the sensors share displaces";
    let covariances = model.sensors.iter().flat_map(|sensor| &sensor.covariance);
    let covariances = covariances.map(|row| row.to_vec()).collect();
    vec![
        ("CHANNELS", "of a frame", vec![vec![model.channels as f64]]),
        ("CHANNEL", "of each sensor, from 0", vec![of(|sensor| sensor.channel as f64)]),
        ("LEAST", "counts", vec![of(|sensor| sensor.least)]),
        ("RANGE", "counts", vec![of(|sensor| sensor.range)]),
        ("WRENCH_SCALE", "N and N*m", vec![model.wrench_scale.to_vec()]),
        ("PRIOR", "P", prior.collect()),
        ("NOISE", "sigma**2, tau**2", vec![noise]),
        ("PARAMETERS", "a row for each sensor: b, a (six), lo, ln h, ln nu", parameters),
        ("GAINS", displaces, gains.collect()),
        ("COVARIANCE", "of the parameters, ten rows for each sensor", covariances),
    ]
}

fn python(
    constants: &[Constant],
    head: &str,
    columns: &[&str],
    (name, arguments): (&str, &str),
) -> String {
    let mut text = format!(
        "\"\"\"{head}.\n\n    from {name} import wrench\n    forces = wrench({arguments})\n\nNeeds numpy.\n\"\"\"\n\n\
         import numpy as np\n\nAXES = {columns:?}\n"
    );
    for (name, comment, rows) in constants {
        text += &format!("# {comment}\n");
        match &rows[..] {
            [row] if row.len() == 1 => text += &format!("{name} = {:?}\n", row[0]),
            [row] => text += &format!("{name} = np.array({row:?})\n"),
            rows => {
                text += &format!("{name} = np.array([\n");
                rows.iter().for_each(|row| text += &format!("    {row:?},\n"));
                text += "])\n";
            }
        }
    }
    text + "\n\n"
}

fn matlab(
    constants: &[Constant],
    head: &str,
    columns: &[&str],
    (name, signature): (&str, &str),
) -> String {
    let columns = columns.join(", ");
    let mut text = format!(
        "function {signature}\n%{}  {head}.\n%\n%   {signature}: a row for each frame; {columns}, N and \
         N*m. readings\n%   has a column for each channel, in counts.\n\n",
        name.to_uppercase()
    );
    let of_row =
        |row: &Vec<f64>| row.iter().map(|value| format!("{value:?}")).collect::<Vec<_>>().join(" ");
    for (name, comment, rows) in constants {
        let rows: Vec<String> = rows.iter().map(of_row).collect();
        text += &format!("    % {comment}\n    {name} = [{}];\n", rows.join("\n        "));
    }
    text + "\n"
}
