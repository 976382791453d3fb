//! `shellcal simulate` as a user meets it.
//!
//! Figures are those of the reference solution in 40-digit arithmetic that
//! `beam-channel/tests/it/reference.rs` has.

use std::fs;
use std::path::Path;

use serde_json::Value;
use system_tests::program::{self, ended, refused};

const MEANS: [f64; 3] = [0.108734173433852, 0.21708288510962, 0.305874279216731];

/// Fifteen digits were printed; ten roundings lie within this.
const RELATIVE: f64 = 1e-12;

/// What it prints, and what it says.
fn simulate(dir: &Path, arguments: &str) -> (String, String) {
    ended(dir, &format!("simulate {arguments}"), 0)
}

fn json(arguments: &str) -> Value {
    let dir = tempfile::tempdir().unwrap();
    program::json(&dir, &format!("simulate --json {arguments}"))
}

#[track_caller]
fn assert_close(found: &Value, expected: f64) {
    let found = found.as_f64().unwrap();
    assert!((found / expected - 1.0).abs() < RELATIVE, "{found} {expected}");
}

#[test]
fn the_papers_channels_have_the_reference_drags() {
    let document = json("");
    let contacts = [(4, 5), (5, 6), (6, 7)];
    for (i, channel) in document["channels"].as_array().unwrap().iter().enumerate() {
        assert_close(&channel["mean_drag_n"], MEANS[i]);
        assert_close(&channel["energy_j"], MEANS[i] * 0.28);
        assert_eq!(channel["min_contacts"][0], contacts[i].0);
        assert_eq!(channel["max_contacts"][1], contacts[i].1);
    }
    assert_close(&document["torsional_stiffness_nm_rad"], 8.48e-4);
}

#[test]
fn variants_of_the_equations_have_the_reference_drags() {
    for (arguments, expected) in [
        ("--as-printed", [0.172204607944712, 0.314629820331108, 0.412832708715332]),
        ("--true-angle", [0.108734173433852, 0.21708288510962, 0.317807830866657]),
        ("--as-printed --true-angle", [0.172204607944712, 0.314629820331108, 0.433628539116622]),
        ("--spacing 25mm", [0.110711158405376, 0.221029846657067, 0.311435629747944]),
    ] {
        let document = json(arguments);
        for (channel, expected) in document["channels"].as_array().unwrap().iter().zip(expected) {
            assert_close(&channel["mean_drag_n"], expected);
        }
    }
}

#[test]
fn a_sweep_is_written_with_the_time_of_a_body_at_a_given_speed() {
    let dir = tempfile::tempdir().unwrap();
    let arguments = "--width 8cm --from 0.05 --to 0.15 --step 5cm --speed 0.5 --output sweep.csv \
                     --beam-forces beams.csv";
    simulate(dir.path(), arguments);
    let text = fs::read_to_string(dir.path().join("sweep.csv")).unwrap();
    let mut lines = text.lines();
    let header = "width_m,t_s,x_m,drag_n,fy_n,mz_nm,contacts_left,contacts_right";
    assert_eq!(lines.next().unwrap(), header);
    let rows: Vec<Vec<f64>> =
        lines.map(|line| line.split(',').map(|field| field.parse().unwrap()).collect()).collect();
    assert_eq!(rows.len(), 3);
    assert_eq!(rows[1][..3], [0.08, 0.1, 0.1]);
    for (row, expected) in rows.iter().zip([0.109028518037253, 0.108027904215598]) {
        assert!((row[3] / expected - 1.0).abs() < RELATIVE, "{row:?}");
    }
    assert_eq!(rows[0][6..], [5.0, 5.0]);
    // The beams of a position add up to its drag.
    let beams = fs::read_to_string(dir.path().join("beams.csv")).unwrap();
    let at_first = beams.lines().filter(|line| line.starts_with("0.08,0,0.05,"));
    let forces: Vec<f64> =
        at_first.map(|line| line.split(',').nth(8).unwrap().parse().unwrap()).collect();
    assert_eq!(forces.len(), 10);
    assert!((-forces.iter().sum::<f64>() / rows[0][3] - 1.0).abs() < RELATIVE);
}

#[test]
fn the_figure_is_drawn_with_a_measured_trace() {
    let dir = tempfile::tempdir().unwrap();
    fs::write(dir.path().join("run7.csv"), "x_m,drag_n\n0,0.01\n0.1,0.15\n").unwrap();
    simulate(dir.path(), "--plot drag.svg --overlay run7.csv");
    let svg = fs::read_to_string(dir.path().join("drag.svg")).unwrap();
    for label in ["1 cm deflection", "3 cm deflection", "run7", "drag (N)", "beams per side"] {
        assert!(svg.contains(label), "{label}");
    }
    fs::write(dir.path().join("run8.csv"), "t_s,fx_n\n3,-0.01\n4,-0.15\n").unwrap();
    simulate(dir.path(), "--plot drag.svg --overlay run8.csv --speed 0.2 --entry 3");
    assert!(fs::read_to_string(dir.path().join("drag.svg")).unwrap().contains("run8"));
    let error = refused(&dir, "simulate --plot drag.svg --overlay run8.csv");
    assert!(error.contains("`run8.csv`, line 1: no column `x_m`; found `t_s`, `fx_n`"), "{error}");
    simulate(dir.path(), "--plot drag.png");
    assert!(fs::read(dir.path().join("drag.png")).unwrap().starts_with(b"\x89PNG"));
}

#[test]
fn what_is_outside_the_models_validity_is_said_and_what_jams_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let warning = "warning: channel of 4 cm: the body reaches farther past the tips than a beam is";
    assert!(simulate(dir.path(), "").1.contains(warning));
    assert_eq!(simulate(dir.path(), "--deflection 1cm,2cm").1, "");
    let error = refused(&dir, "simulate --ry 9cm --width 7cm --output x.csv");
    assert!(
        error.starts_with("error: a channel 7 cm wide: the body jams: it reaches 55.00 mm"),
        "{error}"
    );
    assert!(error.contains("hint: give a wider channel"), "{error}");
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0);
    let error = refused(&dir, "simulate --friction -1");
    assert!(error.contains("the friction coefficient is -1: expected 0 to 100"), "{error}");
    let error = refused(&dir, "simulate --width 8furlongs");
    assert!(error.contains("expected a length such as `8cm`"), "{error}");
}

#[test]
fn a_channel_wider_than_the_body_has_no_contact() {
    let document = json("--width 12cm --step 5cm");
    let channel = &document["channels"][0];
    assert_eq!(channel["mean_drag_n"], 0.0);
    assert_eq!(channel["max_contacts"][0], 0);
    assert_eq!(channel["first_contact_m"], Value::Null);
    let positions = channel["positions"].as_array().unwrap();
    assert!(positions.len() > 3 && positions.iter().all(|row| row["drag_n"] == 0.0));
}

#[test]
fn a_body_off_the_middle_feels_a_side_force_and_a_moment() {
    let document = json("--deflection 1cm --off-centre 5mm --yaw 5deg --at 0.1");
    let at = &document["channels"][0]["at"];
    // Deeper in on the left, whose beams push it to the right.
    assert!(at["fy_n"].as_f64().unwrap() < -0.01);
    assert!(at["mz_nm"].as_f64().unwrap() != 0.0);
    let beams = at["beams"].as_array().unwrap();
    let left = beams.iter().filter(|beam| beam["wall"] == "left").count();
    assert!(left > beams.len() - left);
    // The same to the right.
    let mirrored = json("--deflection 1cm --off-centre -5mm --yaw -5deg --at 0.1");
    let mirrored = &mirrored["channels"][0]["at"];
    assert_close(&mirrored["fy_n"], -at["fy_n"].as_f64().unwrap());
    assert_close(&mirrored["drag_n"], at["drag_n"].as_f64().unwrap());
}

#[test]
fn measured_trials_stand_beside_the_model() {
    let dir = tempfile::tempdir().unwrap();
    // The paper's means.
    let table = "trial,condition,drag_mean_n\n1,1 cm,0.02\n2,1 cm,0.04\n3,2 cm,0.08\n\
                 4,tight,0.13\n5,free,0.001\n";
    fs::write(dir.path().join("trials.csv"), table).unwrap();
    let arguments = "--json --compare trials.csv --condition tight=4cm";
    let document = program::json(&dir, &format!("simulate {arguments}"));
    let rows = document["comparison"].as_array().unwrap();
    // From the first contact to the last, as a trial is: work over way.
    let channels = document["channels"].as_array().unwrap();
    let number = |channel: &Value, key: &str| channel[key].as_f64().unwrap();
    let mean = |channel: &Value| {
        let way = number(channel, "last_contact_m") - number(channel, "first_contact_m");
        number(channel, "energy_j") / way
    };
    for ((row, channel), (expected, measured)) in
        rows.iter().zip(channels).zip([0.083, 0.149, 0.199].into_iter().zip([0.03, 0.08, 0.13]))
    {
        let mean = mean(channel);
        // Three digits are known.
        assert!((mean - expected).abs() < 5e-4, "{mean}");
        assert_close(&row["simulated_drag_n"], mean);
        assert_close(&row["over_prediction_n"], mean - measured);
        assert_close(&row["ratio"], mean / measured);
    }
    assert_eq!((&rows[0]["trials"], &rows[0]["condition"]), (&2.into(), &"1 cm".into()));
    assert_eq!((&rows[3]["simulated_drag_n"], &rows[3]["width_m"]), (&0.0.into(), &Value::Null));
    let error = refused(&dir, "simulate --compare trials.csv");
    assert!(error.contains("condition `tight` is neither `free` nor a deflection"), "{error}");
    let error = refused(&dir, "simulate --compare trials.csv --condition loose=9cm");
    assert!(error.contains("has no condition `loose`"), "{error}");
}

#[test]
fn a_grid_has_every_combination() {
    let dir = tempfile::tempdir().unwrap();
    let arguments = "--deflection 1cm --grid friction=0,0.53 --grid beam-length=1mm,27mm";
    simulate(dir.path(), &format!("{arguments} --output grid.csv"));
    let text = fs::read_to_string(dir.path().join("grid.csv")).unwrap();
    let lines: Vec<_> = text.lines().collect();
    let header =
        "width_m,friction,beam_length_m,mean_drag_n,minimum_drag_n,peak_drag_n,energy_j,error";
    assert_eq!((lines[0], lines.len()), (header, 5));
    assert!(lines[3].starts_with("0.08,0.53,0.001,,,,,\"the body jams"), "{}", lines[3]);
    let mean: f64 = lines[4].split(',').nth(3).unwrap().parse().unwrap();
    assert!((mean / MEANS[0] - 1.0).abs() < RELATIVE);
    let (table, warning) = simulate(dir.path(), arguments);
    assert_eq!(table.lines().count(), 6);
    assert!(warning.contains("2 combinations make no sense, or the body jams"), "{warning}");
}

#[test]
fn uncertain_parameters_give_intervals_around_the_figures() {
    let document = json("--deflection 1cm --step 5cm --uncertain modulus=10% --draws 400 --seed 3");
    let interval = &document["channels"][0]["uncertainty"]["mean_drag_n"];
    // The drag is proportional to the modulus: 10 % s.d., of which 400 draws know 3.5 % (1 s.d.).
    let sd = interval["sd"].as_f64().unwrap();
    assert!((sd / (0.1 * MEANS[0]) - 1.0).abs() < 0.11, "{sd}");
    let [low, high] = ["low", "high"].map(|end| interval[end].as_f64().unwrap());
    assert!(low < 0.9 * MEANS[0] && high > 1.1 * MEANS[0]);
}
