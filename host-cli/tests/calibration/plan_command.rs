//! `shellcal plan`: orders of loads, before and after a session.

use std::fs;

use load_table::{HungLoad, HungLoads};
use system_tests::program::{json, refused, succeed};

const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../calibration-data");
const RIG: &str =
    "--masses 0.1kg,200g --point 0,0,40 --point 30,0,40 --directions +x,-x,+y,-y,down,30:-45";

#[test]
fn a_plan_before_anything_is_recorded_is_a_table_that_is_read_again() {
    let dir = tempfile::tempdir().unwrap();
    let said = succeed(&dir, &format!("plan {RIG} -n 10 -o plan.csv --plot plan.svg"));
    assert!(said.starts_with("10 of 24 loads, by D-optimal on 1, w and w·w\n"), "{said}");
    let table =
        HungLoads::parse(&fs::read_to_string(dir.path().join("plan.csv")).unwrap()).unwrap();
    assert_eq!(table.loads().len(), 10);
    let gains: Vec<f64> =
        table.column("plan_gain_nats").unwrap().map(|gain| gain.parse().unwrap()).collect();
    // The information gain of a load never grows with further loads.
    assert!(gains.is_sorted_by(|before, after| before >= after), "{gains:?}");
    let document = json(&dir, "plan --rig plan.csv --json");
    assert_eq!(document["loads"].as_array().unwrap().len(), 10);
    let wrench: [f64; 6] = serde_json::from_value(document["loads"][0]["wrench"].clone()).unwrap();
    let known: Vec<[f64; 6]> = table.loads().iter().map(HungLoad::wrench).collect();
    assert!(known.contains(&wrench));
    assert!(
        fs::read_to_string(dir.path().join("plan.svg")).unwrap().contains("in those of one pose")
    );
    let said = succeed(&dir, "plan --box fx=-5..5,my=-0.2..0.2 -n 9");
    assert!(said.starts_with("9 of 9 loads"), "{said}");
}

#[test]
fn loads_that_all_couple_two_axes_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let said = succeed(&dir, "plan --masses 0.1kg,0.2kg --point 0,0,40 --directions +x,-x");
    let expected = "Fx and My move together in all loads of the rig (correlation 1.00)";
    assert!(said.contains(expected) && said.contains("pull at another point"), "{said}");
}

#[test]
fn after_a_session_the_error_is_predicted_and_the_plan_ends_where_it_is_small_enough() {
    let dir = tempfile::tempdir().unwrap();
    let rig = "--box fx=-2..2,fy=-2..2,fz=-2..1,mx=-0.05..0.05,my=-0.05..0.05,mz=-0.05..0.05";
    let document = json(&dir, &format!("plan {DATA}/synthetic-train.csv {rig} -n 4 --json"));
    assert_eq!(document["criterion"], "information gain");
    let error = |of: &serde_json::Value| of["wrench"][0].as_f64().unwrap();
    let before = error(&document["error_before"]);
    let after = error(&document["loads"][3]["predicted_error"]);
    assert!(0.0 < after && after < before && before < 0.5, "{document}");
    succeed(&dir, &format!("fit {DATA}/synthetic-train.csv --model physics -o cal.json"));
    let met = succeed(&dir, &format!("plan cal.json {rig} --until 5N"));
    assert!(met.contains("no more loads are needed"), "{met}");
    let document = json(&dir, &format!("plan cal.json {rig} --until 0.0001N --json -n 3"));
    assert_eq!((&document["reached"], &document["recorded_poses"]), (&false.into(), &0.into()));
}

#[test]
fn impossible_plans_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let rig = dir.path().join("rig.csv");
    fs::write(&rig, "mass_kg,x_mm,y_mm,z_mm\n0.1,1,0,0\nO.2,1,0,0\n").unwrap();
    for (arguments, message) in [
        ("plan", "no loads given"),
        ("plan --rig rig.csv", "`rig.csv`: line 3, column `mass_kg`: `O.2` is not a number"),
        ("plan --box fx=1..0", "is not a range"),
        ("plan --masses 5 --directions down", "expected a mass with its unit"),
        ("plan --masses 5g --directions sideways", "expected down, up"),
        ("plan --box fx=0..1 --until 1N", "`--until` takes a model of the sensors"),
        ("plan --box fx=0..1 --until 1kg", "expected an error with its unit"),
    ] {
        let said = refused(&dir, arguments);
        assert!(said.contains(message), "{arguments}: {said}");
    }
    succeed(&dir, &format!("fit {DATA}/synthetic-train.csv --model cubic -o cubic.json"));
    let said = refused(&dir, "plan cubic.json --box fx=0..1");
    assert!(said.contains("`cubic.json` is a polynomial"), "{said}");
}
