//! Calibrations as functions in Python and MATLAB, for programs without `shellcal`.
//!
//! A file is a head of constants and a fixed body (`assets/export`), which computes what
//! [`Calibration::wrench`](calibration::Calibration::wrench) does: of polynomials on standardised readings,
//! in the order of [`Model::terms`](calibration::Model::terms); of the physics model by the same steps. Memory terms
//! take the times of the frames, and a state that is passed on from call to call.

use calibration::memory::{MemoryTerms, TimeBase};
use calibration::physics::PhysicsModel;
use calibration::{Kind, Polynomial};
use shell_data::escape;
use shell_data::wrench::Axes;

use super::CalibrationFile;

/// A language.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Language {
    /// With numpy.
    Python,
    /// With MATLAB or Octave.
    Matlab,
}

/// A matrix by the name that the body has for it, row by row.
struct Constant {
    name: &'static str,
    comment: &'static str,
    rows: Vec<Vec<f64>>,
}

impl Constant {
    fn row(name: &'static str, comment: &'static str, row: Vec<f64>) -> Self {
        Self { name, comment, rows: vec![row] }
    }
}

/// The function `name` of a calibration. `name` has to be an identifier, which MATLAB wants to be the name
/// of the file.
pub fn to_code(file: &CalibrationFile, language: Language, name: &str) -> String {
    let axes = file.calibration.axes;
    let memory = file.calibration.memory.as_ref();
    let (mut constants, python_body, matlab_body) = match file.calibration.kind() {
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
    let arguments = if memory.is_some() { "readings, times, state" } else { "readings" };
    match language {
        Language::Python => {
            let head = python(&constants, &escape::python(&head), &columns, (name, arguments));
            let of_memory = memory.map_or("", |_| include_str!("../assets/export/memory.py"));
            head + python_body + of_memory
        }
        Language::Matlab => {
            let results = if memory.is_some() { "[w, state]" } else { "w" };
            let signature = format!("{results} = {name}({arguments})");
            let head = escape::matlab_comment(&head);
            let head = matlab(&constants, &head, &columns, (name, &signature));
            let of_memory = memory.map_or("", |_| include_str!("../assets/export/memory.m"));
            head + of_memory + matlab_body
        }
    }
}

fn memory_constants(memory: &MemoryTerms) -> [Constant; 3] {
    let by_time = memory.time_base == TimeBase::Seconds;
    let unit = if by_time { "s" } else { "rows" };
    [
        Constant::row("TIME_CONSTANTS", unit, memory.time_constants.clone()),
        Constant::row("GAP", unit, vec![memory.gap.unwrap_or(f64::MAX)]),
        Constant::row(
            "BY_TIME",
            "whether these are by time, not by row",
            vec![f64::from(u8::from(by_time))],
        ),
    ]
}

/// What the function is, in a line; whatever the file says, as it says it.
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
    let positions = |term: &calibration::model::Term| {
        let mut positions: Vec<f64> =
            term.factors().iter().map(|&channel| f64::from(channel)).collect();
        positions.resize(model.basis.degree(), none);
        positions
    };
    let scaling = polynomial.scaling();
    vec![
        Constant::row("CENTRE", "counts", scaling.centre.clone()),
        Constant::row("SCALE", "counts", scaling.scale.clone()),
        Constant {
            name: "FACTORS",
            comment: "a row for each feature: the channels it is a product of, from 0",
            rows: model.terms().iter().map(positions).collect(),
        },
        Constant {
            name: "COEFFICIENTS",
            comment: "a row for each feature: N and N*m",
            rows: polynomial.coefficients().iter().map(|row| axes.of(row)).collect(),
        },
    ]
}

fn physics_constants(model: &PhysicsModel) -> Vec<Constant> {
    let of =
        |value: fn(&calibration::physics::Sensor) -> f64| model.sensors.iter().map(value).collect();
    let factors = model.factor_count();
    let gains = model.sensors.iter().map(|sensor| {
        sensor.parameters[1..7].iter().chain(&sensor.loadings[..factors]).copied().collect()
    });
    // Loads, and then factors of variance one.
    let prior = |i: usize, j: usize| match model.load_precision.get(i).and_then(|row| row.get(j)) {
        Some(x) => model.lambda * x,
        None => f64::from(u8::from(i == j)),
    };
    let unknowns = 6 + factors;
    let covariances = model.sensors.iter().flat_map(|sensor| &sensor.covariance);
    vec![
        Constant::row("CHANNELS", "of a frame", vec![model.channels as f64]),
        Constant::row("CHANNEL", "of each sensor, from 0", of(|sensor| sensor.channel as f64)),
        Constant::row("LEAST", "counts", of(|sensor| sensor.least)),
        Constant::row("RANGE", "counts", of(|sensor| sensor.range)),
        Constant::row("WRENCH_SCALE", "N and N*m", model.wrench_scale.to_vec()),
        Constant {
            name: "PRIOR",
            comment: "P",
            rows: (0..unknowns).map(|i| (0..unknowns).map(|j| prior(i, j)).collect()).collect(),
        },
        Constant::row(
            "NOISE",
            "sigma**2, tau**2",
            vec![model.noise.reading, model.noise.displacement],
        ),
        Constant {
            name: "PARAMETERS",
            comment: "a row for each sensor: b, a (six), lo, ln h, ln nu",
            rows: model.sensors.iter().map(|sensor| sensor.parameters.to_vec()).collect(),
        },
        Constant {
            name: "GAINS",
            comment: "a row for each sensor: a, then what each factor that the sensors share displaces",
            rows: gains.collect(),
        },
        Constant {
            name: "COVARIANCE",
            comment: "of the parameters, ten rows for each sensor",
            rows: covariances.map(|row| row.to_vec()).collect(),
        },
    ]
}

/// A module of Python; `head` is [escaped](escape::python).
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
    for Constant { name, comment, rows } in constants {
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

/// A function of MATLAB; `head` is [escaped](escape::matlab_comment).
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
    for Constant { name, comment, rows } in constants {
        text += &format!("    % {comment}\n    {name} = [");
        for (position, row) in rows.iter().enumerate() {
            if position > 0 {
                text += "\n        ";
            }
            let values: Vec<String> = row.iter().map(|value| format!("{value:?}")).collect();
            text += &values.join(" ");
        }
        text += "];\n";
    }
    text + "\n"
}
