//! Against a reference solution in 40-digit arithmetic, printed to 15 digits.
use std::fs;
use std::path::PathBuf;

use beam_channel::{Angle, Channel, Model, Normal, Plateau, Rules, Setup, Turn, Wall};
use serde_json::Value;

/// The reference is printed to 15 digits; ten more roundings lie within this.
const RELATIVE: f64 = 1e-12;
/// In SI: a decimal position rounds by up to 5e-17 m, and near a release a force changes by 1 N/m and
/// more. It shows where the forces of the reference all but cancel.
const ABSOLUTE: f64 = 2e-16;

#[track_caller]
fn assert_close(what: &str, found: f64, expected: f64) {
    let tolerance = RELATIVE * expected.abs() + ABSOLUTE;
    assert!((found - expected).abs() <= tolerance, "{what}: {found:e}, expected {expected:e}");
}

struct Reference {
    semi_width_m: f64,
    width_m: f64,
    phi_e: f64,
    u_e: f64,
    phi_f: f64,
    u_f: f64,
    mean_drag: f64,
    energy_crossing_j: f64,
    peak: f64,
    minimum: f64,
    contacts: [u32; 2],
    /// Position, F_drag, beams in contact per side.
    totals: &'static [(f64, f64, u32)],
}

const REFERENCES: [Reference; 6] = [
    Reference {
        semi_width_m: 0.05,
        width_m: 0.08,
        phi_e: 0.927295218001612,
        u_e: 0.054,
        phi_f: 2.15651600615654,
        u_f: -0.0590886561661408,
        mean_drag: 0.108734173433852,
        energy_crossing_j: 0.0304455685614785,
        peak: 0.111822637901606,
        minimum: 0.10570012052088,
        contacts: [4, 5],
        totals: &[
            (-0.05, -0.00702387648674651, 1),
            (0.0, -0.068625661996187, 3),
            (0.05, -0.109028518037253, 5),
            (0.1, -0.108027904215598, 5),
            (0.14, -0.10775878987026, 4),
            (0.18, -0.111084157272534, 5),
            (0.22, -0.108101978684278, 4),
            (0.26, -0.0672051857331116, 3),
            (0.3, -0.0173115251262085, 1),
            (0.34, 0.0, 0),
        ],
    },
    Reference {
        semi_width_m: 0.05,
        width_m: 0.06,
        phi_e: 0.643501108793284,
        u_e: 0.072,
        phi_f: 2.39713813460982,
        u_f: -0.080133851152808,
        mean_drag: 0.21708288510962,
        energy_crossing_j: 0.0607832078306936,
        peak: 0.2208980351056,
        minimum: 0.208232176342079,
        contacts: [5, 6],
        totals: &[
            (-0.05, -0.0356075936549079, 1),
            (0.0, -0.139363350290871, 3),
            (0.05, -0.211110403781611, 5),
            (0.1, -0.217349097902083, 6),
            (0.14, -0.219965534082441, 6),
            (0.18, -0.212694765795989, 6),
            (0.22, -0.198234144792425, 5),
            (0.26, -0.116248733848979, 3),
            (0.3, -0.0421829732432685, 2),
            (0.34, 0.0, 0),
        ],
    },
    Reference {
        semi_width_m: 0.05,
        width_m: 0.04,
        phi_e: 0.411516846067488,
        u_e: 0.0824863625092051,
        phi_f: 2.57783396439855,
        u_f: -0.0938956008077225,
        mean_drag: 0.305874279216731,
        energy_crossing_j: 0.0856447981806846,
        peak: 0.310132163311934,
        minimum: 0.292582648748931,
        contacts: [6, 7],
        totals: &[
            (-0.05, -0.0748725201547083, 2),
            (0.0, -0.211585583892601, 4),
            (0.05, -0.295264595319012, 6),
            (0.1, -0.308697846654257, 7),
            (0.14, -0.302717296506676, 7),
            (0.18, -0.310029561903644, 7),
            (0.22, -0.25066045720062, 6),
            (0.26, -0.148186133848877, 4),
            (0.3, -0.0574700796034283, 2),
            (0.34, -0.00188385929579153, 1),
        ],
    },
    Reference {
        semi_width_m: 0.055,
        width_m: 0.08,
        phi_e: 0.814339942126525,
        u_e: 0.0617713726522152,
        phi_f: 2.25016630374334,
        u_f: -0.0684968563491989,
        mean_drag: 0.157769174648912,
        energy_crossing_j: 0.0441753689016953,
        peak: 0.160725111826088,
        minimum: 0.152727214100426,
        contacts: [5, 6],
        totals: &[],
    },
    Reference {
        semi_width_m: 0.055,
        width_m: 0.06,
        phi_e: 0.576931345236457,
        u_e: 0.07543263646876,
        phi_f: 2.44656120451931,
        u_f: -0.085083650206759,
        mean_drag: 0.259985267887742,
        energy_crossing_j: 0.0727958750085678,
        peak: 0.263893235403165,
        minimum: 0.254825515952729,
        contacts: [6, 7],
        totals: &[],
    },
    Reference {
        semi_width_m: 0.055,
        width_m: 0.04,
        phi_e: 0.372168533960326,
        u_e: 0.083838688085124,
        phi_f: 2.60425810927112,
        u_f: -0.0966491815251532,
        mean_drag: 0.303291858884217,
        energy_crossing_j: 0.0849217204875808,
        peak: 0.311473812270834,
        minimum: 0.287361619286759,
        contacts: [7, 8],
        totals: &[],
    },
];

fn setup(semi_width_m: f64, width_m: f64) -> Setup {
    let mut setup = Setup::default();
    setup.ellipse.semi_width_m = semi_width_m;
    setup.channel.width_m = width_m;
    setup
}

#[test]
fn the_constants_of_the_paper_give_its_stiffness() {
    assert_close("k_t", Setup::default().beam.torsional_stiffness(), 8.48e-4);
}

#[test]
fn the_reference_solution_is_met() {
    for reference in &REFERENCES {
        let model = Model::new(&setup(reference.semi_width_m, reference.width_m)).unwrap();
        let side = model.side(Wall::Left).unwrap();
        assert_close("phi_e", side.first_touch_rad(), reference.phi_e);
        assert_close("u_e", side.engagement_m(), reference.u_e);
        assert_close("u_f", side.release_m(), reference.u_f);
        let release = side.contact_after(side.travel_m()).unwrap();
        assert_close("phi_f", side.place_rad(&release), reference.phi_f);
        assert_close("energy", model.energy(), reference.energy_crossing_j);
        let plateau = model.plateau().unwrap();
        assert_close("mean", plateau.mean_drag_n, reference.mean_drag);
        assert_close("peak", plateau.peak.drag_n, reference.peak);
        assert_close("minimum", plateau.minimum.drag_n, reference.minimum);
        let [least, greatest] = reference.contacts;
        assert_eq!((plateau.min_contacts, plateau.max_contacts), ([least; 2], [greatest; 2]));
        for &(x_m, force, contacts) in reference.totals {
            let total = model.total(x_m);
            assert_close(&format!("F_drag at {x_m} m"), total.fx_n, force);
            assert_eq!(total.contacts, [contacts; 2], "at {x_m} m");
            assert_eq!((total.fy_n, total.mz_nm), (0.0, 0.0), "two equal sides");
        }
    }
}

/// The whole of the reference solution, where its file lies beside the real recordings.
#[test]
fn every_reference_value_is_met() {
    let Some(path) = reference_file() else {
        println!("skipped: no reference values beside SHELLCAL_REAL_DATA");
        return;
    };
    let document: Value = serde_json::from_slice(&fs::read(path).unwrap()).unwrap();
    for (name, semi_width_m) in [("A_Rx9_Ry5.0", 0.05), ("B_Rx9_Ry5.5", 0.055)] {
        for (depth, width_m) in [("d1", 0.08), ("d2", 0.06), ("d3", 0.04)] {
            let values = &document[name][depth];
            check_all(&setup(semi_width_m, width_m), values, &format!("{name} {depth}"));
        }
    }
}

fn reference_file() -> Option<PathBuf> {
    let data = PathBuf::from(std::env::var_os("SHELLCAL_REAL_DATA")?);
    let path = data.parent()?.join("oracles/beam.json");
    path.exists().then_some(path)
}

fn number(value: &Value) -> f64 {
    value.as_str().unwrap().parse().unwrap()
}

fn check_all(setup: &Setup, values: &Value, name: &str) {
    let model = Model::new(setup).unwrap();
    let side = model.side(Wall::Left).unwrap();
    let plateau = model.plateau().unwrap();
    let close = |what: &str, found: f64, expected: &Value| {
        assert_close(&format!("{name}: {what}"), found, number(expected));
    };
    close("contact_travel", side.travel_m(), &values["contact_travel"]);
    close("mean contacts", plateau.mean_contacts[0], &values["mean_contacts_per_side"]);
    close("steady from", plateau.extent_m[0], &values["steady_X_r"][0]);
    close("steady to", plateau.extent_m[1], &values["steady_X_r"][1]);
    let inside = model.work(0.09, 0.19) / 0.1;
    close("mean, 9 to 19 cm", inside, &values["mean_drag_inside_9to19cm"]);

    let pitch = setup.channel.pitch_m;
    for (what, extreme) in [("peak_drag", plateau.peak), ("min_drag", plateau.minimum)] {
        close(what, extreme.drag_n, &values[what]["value"]);
        // The same place, perhaps some beams further on.
        let spacings = (number(&values[what]["X_r"]) - extreme.x_m) / pitch;
        assert!((spacings - spacings.round()).abs() * pitch < 1e-12, "{name}: {what} {spacings}");
        let turn = if values[what]["kind"] == "interior" { Turn::Smooth } else { Turn::Limit };
        assert_eq!(extreme.turn, turn, "{name}: {what}");
    }
    for (x, total) in values["F_drag"].as_object().unwrap() {
        let found = model.total(x.parse().unwrap());
        close(&format!("F_drag at {x}"), found.fx_n, &total["F"]);
        assert_eq!(u64::from(found.contacts[0]), total["contacts"].as_u64().unwrap());
    }
    for (ahead, beam) in values["beam"].as_object().unwrap() {
        let ahead: f64 = ahead.parse().unwrap();
        let contact = side.contact(ahead).unwrap();
        close(&format!("phi {ahead}"), side.place_rad(&contact), &beam["phi"]);
        // The first beam's base is at 0.
        let (_, _, force) = model.beams(Wall::Left, -ahead).find(|beam| beam.0 == 0).unwrap();
        close(&format!("dtheta {ahead}"), force.deflection_rad, &beam["dtheta"]);
        close(&format!("Fx {ahead}"), force.fx_n, &beam["Fx"]);
        close(&format!("Fy {ahead}"), force.fy_n, &beam["Fy"]);
    }

    let mean = |change: &dyn Fn(&mut Setup)| plateau_of(setup, change).mean_drag_n;
    let variants = &values["variants_mean_drag"];
    let printed = |setup: &mut Setup| setup.rules.normal = Normal::AsPrinted;
    let unfolded = |setup: &mut Setup| setup.rules.angle = Angle::True;
    close("printed", mean(&printed), &variants["printed_norm"]);
    close("true angle", mean(&unfolded), &variants["true_angle"]);
    let both = mean(&|setup| {
        printed(setup);
        unfolded(setup);
    });
    close("both", both, &variants["printed_norm_true_angle"]);
    let spaced = mean(&|setup| setup.channel = Channel { pitch_m: 0.025, ..setup.channel });
    close("spacing", spaced, &variants["spacing_2p5cm"]);
    close("one side", 0.5 * plateau.mean_drag_n, &variants["one_side"]);
    // The drag is linear in the friction.
    let smooth = mean(&|setup| setup.beam.friction = 0.0);
    let rough = mean(&|setup| setup.beam.friction = 1.0);
    close("no friction", smooth, &values["mean_drag_normal_part"]);
    close("per friction", rough - smooth, &values["mean_drag_friction_per_mu"]);
    close("reversed", 2.0 * smooth - plateau.mean_drag_n, &variants["mu_reversed"]);
    let pushed = plateau.mean_drag_n + pulled_work(setup, side.first_touch_rad()) / pitch;
    close("ungated", pushed, &variants["ungated"]);
}

/// The work in J that a pair of beams would do before they bend forward, had their tips been drawn
/// back by a body that is only coming: what the reference calls ungated, and the model leaves out. By
/// the formulas, with nothing of the model but the place where they begin to bend forward.
fn pulled_work(setup: &Setup, first_touch_rad: f64) -> f64 {
    let Setup { ellipse, beam, .. } = setup;
    let (rx, ry, length) = (ellipse.semi_length_m, ellipse.semi_width_m, beam.length_m);
    let stiffness = beam.torsional_stiffness() / length;
    // With φ = first touch + z²: travel's slope in z, and drag's product with it.
    let at = |z: f64| {
        let (phi, half) = (first_touch_rad + z * z, 0.5 * z * z);
        let rise = 2.0 * ry * (first_touch_rad + half).cos() * half.sin();
        let reach = (rise * (2.0 * length - rise)).sqrt();
        let (back, out) = (rx * phi.sin(), ry * phi.cos());
        let reach_slope = if reach > 0.0 {
            (length - rise) * out / reach * 2.0 * z
        } else {
            // The limit for z → 0, where reach = z·√(2L·out).
            (2.0 * length * out).sqrt()
        };
        let slope = reach_slope - 2.0 * z * back;
        let angle = reach.atan2((length - rise).abs());
        let drag = -stiffness * angle * (out + beam.friction * back) / back.hypot(out);
        (slope, drag * slope)
    };
    // The tip leaves where travel turns, found by bisection.
    let (mut low, mut high) = (0.0, (0.5 * std::f64::consts::PI - first_touch_rad).sqrt());
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if at(middle).0 > 0.0 { low = middle } else { high = middle }
    }
    // Simpson's rule; the integrand is smooth in z.
    let steps = 4096;
    let step = low / f64::from(steps);
    let sum: f64 = (0..=steps)
        .map(|i| {
            let weight = if i == 0 || i == steps {
                1.0
            } else if i % 2 == 1 {
                4.0
            } else {
                2.0
            };
            weight * at(step * f64::from(i)).1
        })
        .sum();
    2.0 * sum * step / 3.0
}

fn plateau_of(setup: &Setup, change: &dyn Fn(&mut Setup)) -> Plateau {
    let mut changed = *setup;
    change(&mut changed);
    Model::new(&changed).unwrap().plateau().unwrap()
}

/// Mean drag where the moment of a force about its beam's base is that of the spring, of the paper's robot: by
/// an independent quadrature over the place of the tip (numpy, 400 nodes of Gauss and Legendre), whose figures
/// of the paper's force are those above.
#[test]
fn forces_that_balance_their_springs_have_the_means_of_an_independent_computation() {
    for (width_m, expected) in
        [(0.08, 0.100_279_455_449), (0.06, 0.197_335_571_349), (0.04, 0.332_538_541_772)]
    {
        let mut setup = Setup::default();
        setup.channel.width_m = width_m;
        setup.rules = Rules { angle: Angle::True, normal: Normal::MomentBalance };
        let plateau = Model::new(&setup).unwrap().plateau().unwrap();
        // Its stiffness was 8.48·10⁻⁴ N·m/rad; the digits given are twelve.
        assert!((plateau.mean_drag_n / expected - 1.0).abs() < 1e-10, "{plateau:?}");
        let (low, high) = (plateau.minimum.drag_n, plateau.peak.drag_n);
        assert!(low < plateau.mean_drag_n && plateau.mean_drag_n < high, "{plateau:?}");
        // The slope that extremes are roots of is that of the drag.
        let model = Model::new(&setup).unwrap();
        for step in 0..400 {
            let x = plateau.extent_m[0] + f64::from(step) / 400.0 * setup.channel.pitch_m;
            let drag = -model.total(x).fx_n;
            assert!((low - 1e-12..=high + 1e-12).contains(&drag), "{x}: {drag} {low} {high}");
        }
    }
}

/// Friction that holds the tips is named.
#[test]
fn a_body_that_friction_holds_is_refused() {
    let rules = Rules { angle: Angle::True, normal: Normal::MomentBalance };
    let mut setup = Setup { rules, ..Setup::default() };
    setup.beam.friction = 0.0;
    let error = Model::new(&setup).unwrap_err();
    assert!(error.to_string().contains("friction coefficient is 0"), "{error}");
}
