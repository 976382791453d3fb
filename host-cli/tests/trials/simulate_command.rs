//! `shellcal simulate`, against the reference solution in 40-digit arithmetic of
//! `beam-channel/tests/it/reference.rs`.

use std::fs;
use std::path::Path;

use serde_json::Value;
use system_tests::program::{self, ended, refused};

const MEANS: [f64; 3] = [0.108734173433852, 0.21708288510962, 0.305874279216731];

/// Fifteen digits were printed; ten roundings lie within this.
const RELATIVE: f64 = 1e-12;

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

/// The elastica's equation, shot at the tip's position by SciPy 1.17.1 (three digits were kept).
#[test]
fn clamped_beams_have_the_drags_of_the_elastica() {
    let document = json("--beam clamped");
    assert_eq!(document["beam"], "clamped");
    let channels = document["channels"].as_array().unwrap();
    for (channel, expected) in channels.iter().zip([0.276, 0.597, 1.219]) {
        let found = channel["mean_drag_n"].as_f64().unwrap();
        assert!((found - expected).abs() < 5.1e-4, "{found} {expected}");
    }
}

/// Shooting with SciPy 1.17.1, and chains of twelve hinges in MuJoCo 4.0.0: 0.2725 and 0.869 N.
#[test]
fn plates_also_touch_with_their_faces_and_jam_a_body_that_reaches_past_their_bases() {
    let document = json("--beam plate --deflection 1cm,2cm");
    let channels = document["channels"].as_array().unwrap();
    for (channel, expected) in channels.iter().zip([0.2763, 0.8884]) {
        let found = channel["mean_drag_n"].as_f64().unwrap();
        assert!((found / expected - 1.0).abs() < 5e-4, "{found} {expected}");
    }
    let dir = tempfile::tempdir().unwrap();
    let error = refused(&dir, "simulate --beam plate");
    assert!(error.contains("a channel 4 cm wide: the body jams: it reaches 30.00 mm"), "{error}");
    assert!(error.contains("hint: give a wider channel"), "{error}");
}

#[test]
fn results_outside_the_models_validity_warn_and_a_jam_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let warning = "warning: channel of 4 cm: the body reaches past the line of the bases";
    assert!(simulate(dir.path(), "").1.contains(warning));
    assert_eq!(simulate(dir.path(), "--deflection 1cm,2cm").1, "");
    let error = refused(&dir, "simulate --ry 9cm --deflection 55mm --output x.csv");
    assert!(
        error.starts_with("error: a channel 7 cm wide: the body jams: it reaches 55.00 mm"),
        "{error}"
    );
    assert!(error.contains("hint: give a wider channel"), "{error}");
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0);
    let error = refused(&dir, "simulate --friction -1");
    assert!(error.contains("the friction coefficient is -1: expected 0 to 100"), "{error}");
    let error = refused(&dir, "simulate --rx 8furlongs");
    assert!(error.contains("expected a length such as `8cm`"), "{error}");
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
fn beams_that_are_closer_together_have_the_reference_drags() {
    let expected = [0.110711158405376, 0.221029846657067, 0.311435629747944];
    let document = json("--spacing 25mm");
    for (channel, expected) in document["channels"].as_array().unwrap().iter().zip(expected) {
        assert_close(&channel["mean_drag_n"], expected);
    }
}

#[test]
fn a_sweep_has_every_millimetre_of_the_way_with_the_reference_drags() {
    let dir = tempfile::tempdir().unwrap();
    simulate(dir.path(), "--deflection 1cm --output sweep.csv");
    let text = fs::read_to_string(dir.path().join("sweep.csv")).unwrap();
    let mut lines = text.lines();
    let header = "width_m,x_m,drag_n,fy_n,mz_nm,contacts_left,contacts_right";
    assert_eq!(lines.next().unwrap(), header);
    let rows: Vec<Vec<f64>> =
        lines.map(|line| line.split(',').map(|field| field.parse().unwrap()).collect()).collect();
    for (x_m, expected) in [(0.05, 0.109028518037253), (0.1, 0.108027904215598)] {
        // Positions are whole steps but for rounding, and the drag is as smooth as that.
        let row = rows.iter().find(|row| (row[1] - x_m).abs() < 1e-12).unwrap();
        assert!((row[2] / expected - 1.0).abs() < 1e-9, "{row:?}");
        assert_eq!((row[0], row[5], row[6]), (0.08, row[5], row[5]));
    }
    assert!(rows.windows(2).all(|pair| (pair[1][1] - pair[0][1] - 0.001).abs() < 1e-12));
}

#[test]
fn the_figure_is_drawn() {
    let dir = tempfile::tempdir().unwrap();
    simulate(dir.path(), "--plot drag.svg");
    let svg = fs::read_to_string(dir.path().join("drag.svg")).unwrap();
    for label in ["1 cm deflection", "3 cm deflection", "drag (N)", "beams per side"] {
        assert!(svg.contains(label), "{label}");
    }
    simulate(dir.path(), "--plot drag.png");
    assert!(fs::read(dir.path().join("drag.png")).unwrap().starts_with(b"\x89PNG"));
}

#[test]
fn a_channel_wider_than_the_body_has_no_contact() {
    let document = json("--deflection=-1cm");
    let channel = &document["channels"][0];
    assert_eq!(channel["mean_drag_n"], 0.0);
    assert_eq!(channel["max_contacts"][0], 0);
    assert_eq!(channel["first_contact_m"], Value::Null);
    let positions = channel["positions"].as_array().unwrap();
    assert!(positions.len() > 3 && positions.iter().all(|row| row["drag_n"] == 0.0));
}
