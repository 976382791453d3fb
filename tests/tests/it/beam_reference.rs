//! Comparison with a complete reference solution in 40-digit arithmetic; the tests of
//! `beam-channel` contain its main figures.

use beam_channel::{Angle, BeamPlateau, Channel, Model, Normal, Setup, Wall};
use serde_json::Value;
use system_tests::{program, real_recording};

#[path = "../../../beam-channel/tests/it/closeness.rs"]
mod closeness;

use closeness::assert_close;

#[test]
#[ignore = "needs the reference values beside the recordings"]
fn every_reference_value_is_met() {
    let document = program::document(&real_recording("../oracles"), "beam.json");
    for (name, semi_width_m) in [("A_Rx9_Ry5.0", 0.05), ("B_Rx9_Ry5.5", 0.055)] {
        for (depth, width_m) in [("d1", 0.08), ("d2", 0.06), ("d3", 0.04)] {
            let mut setup = Setup::default();
            setup.ellipse.semi_width_m = semi_width_m;
            setup.channel.width_m = width_m;
            let values = &document[name][depth];
            check_all(&setup, values, &format!("{name} {depth}"));
        }
    }
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
        // The same position, possibly some beams further on.
        let spacings = (number(&values[what]["X_r"]) - extreme.x_m) / pitch;
        assert!((spacings - spacings.round()).abs() * pitch < 1e-12, "{name}: {what} {spacings}");
        assert_eq!(extreme.is_limit, values[what]["kind"] != "interior", "{name}: {what}");
    }
    for (x, total) in values["F_drag"].as_object().unwrap() {
        let found = model.total(x.parse().unwrap());
        close(&format!("F_drag at {x}"), found.fx_n, &total["F"]);
        assert_eq!(u64::from(found.contacts[0]), total["contacts"].as_u64().unwrap());
    }
    for (ahead, beam) in values["beam"].as_object().unwrap() {
        let ahead: f64 = ahead.parse().unwrap();
        let contact = side.contact_after(side.engagement_m - ahead).unwrap();
        close(&format!("phi {ahead}"), side.place_rad(&contact), &beam["phi"]);
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
    let smooth = mean(&|setup| setup.beam.friction = 0.0);
    let rough = mean(&|setup| setup.beam.friction = 1.0);
    close("no friction", smooth, &values["mean_drag_normal_part"]);
    close("per friction", rough - smooth, &values["mean_drag_friction_per_mu"]);
    close("reversed", 2.0 * smooth - plateau.mean_drag_n, &variants["mu_reversed"]);
    let pushed = plateau.mean_drag_n + pulled_work(setup, side.first_touch_rad) / pitch;
    close("ungated", pushed, &variants["ungated"]);
}

/// Returns the work that a pair of beams would do before they bend forward, J, if an approaching
/// body had drawn their tips back: the reference calls this ungated, and the model leaves it out.
/// Only the position where the beams begin to bend forward is taken from the model.
fn pulled_work(setup: &Setup, first_touch_rad: f64) -> f64 {
    let Setup { ellipse, beam, .. } = setup;
    let (rx, ry, length) = (ellipse.semi_length_m, ellipse.semi_width_m, beam.length_m);
    let stiffness = beam.torsional_stiffness() / length;
    // With φ = first touch + z²: the slope of the travel in z, times the drag.
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
    // The tip leaves where the travel turns.
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

fn plateau_of(setup: &Setup, change: &dyn Fn(&mut Setup)) -> BeamPlateau {
    let mut changed = *setup;
    change(&mut changed);
    Model::new(&changed).unwrap().plateau().unwrap()
}
