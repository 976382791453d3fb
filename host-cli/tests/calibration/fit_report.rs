//! `shellcal fit --report`: the content of the page. Browser tests check its appearance.

use std::fs;
use std::path::Path;

use calibration::fit::{
    HeldOut, HeldOutModels, ModelRule, Workers, group_errors, label_poses_or_files,
};
use calibration::quality::{self, AxisQuality};
use calibration::{Basis, FitOptions, fit};
use log_file::{Log, Mapping, ReadOptions};
use shell_data::dataset::Dataset;
use shell_data::wrench::PerAxis;
use shellcal::workflow::fit::FitData;
use system_tests::program::run;

fn data(name: &str) -> String {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../calibration-data")
        .join(name)
        .display()
        .to_string()
}

fn text(dir: &Path) -> String {
    let html = fs::read_to_string(dir.join("fit.html")).unwrap();
    let body = html.split_once("<main id=\"main\">").unwrap().1;
    let words = body.split('<').skip(1).filter_map(|part| part.split_once('>'));
    words.map(|(_, text)| text).collect::<Vec<_>>().join("")
}

#[test]
fn the_report_states_range_and_use() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let (train, test) = (data("synthetic-train.csv"), data("synthetic-test.csv"));
    run(dir, &format!("fit {train} --model cubic --test {test} --cv --report fit.html"), 0);
    let page = text(dir);
    assert!(page.contains("OK: use it within the calibrated range"), "{page}");
    assert!(page.contains("cubic + offset, judged by 125 groups, each held out once"), "{page}");
    assert!(page.contains("error on new groups") && page.contains("±0.2"), "{page}");
    assert!(
        page.contains("Loads beyond these were never shown to it: Fx −2.83 … 2.86 N"),
        "{page}"
    );
    assert!(page.contains("Moments are about the origin of the reference sensor"));
    assert!(!page.contains("must not be trusted"));
    assert!(page.contains("the 10 groups of rows with the largest"), "{page}");
    // The poses by their errors while they were held out, and residuals of the held-out rows.
    assert!(page.contains("held out"), "{page}");
    assert!(page.contains("2500 held-out rows"), "{page}");
    assert!(page.contains("Residuals of held-out rows over time:"), "{page}");
    assert!(page.contains("best on new groups: cubic"), "{page}");
    assert!(page.contains("None was found."), "{page}");
    assert!(page.contains("shellcal fit") && page.contains("xxh128:"), "{page}");
}

#[test]
fn the_report_names_missing_data() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let table = fs::read_to_string(data("synthetic-train.csv")).unwrap();
    // Upward forces in a few poses, one of which has markup as its name; and one outlier.
    let mut lines = table.lines();
    let mut log = format!("{}\n", lines.next().unwrap());
    let mut rows = 0;
    for line in lines {
        let mut fields: Vec<String> = line.split(',').map(str::to_owned).collect();
        if fields[11].parse::<f64>().unwrap() < 0.3 {
            continue;
        }
        rows += 1;
        if rows == 100 {
            fields[9] = "40".to_owned();
        }
        if fields[15] == "3" {
            fields[15] = "<img src=x>".to_owned();
        }
        log += &format!("{}\n", fields.join(","));
    }
    fs::write(dir.join("up.csv"), log).unwrap();
    run(dir, "fit up.csv --model quadratic --report fit.html", 0);
    let page = text(dir);
    assert!(page.contains("must not be trusted with loads that it has not seen"), "{page}");
    assert!(page.contains("not judged: nothing was held out"), "{page}");
    assert!(page.contains("few loads towards −Fz"), "{page}");
    assert!(page.contains("suspicious"), "{page}");
    assert!(page.contains("up.csv") && page.contains("standard deviations"), "{page}");
    let html = fs::read_to_string(dir.join("fit.html")).unwrap();
    assert!(!html.contains("<img"), "a name has become markup");

    // A partial fit has no rows to report, and a report never replaces an input.
    let said = run(dir, "fit up.csv --partial part.json --report other.html", 2);
    assert!(said.contains("--report"), "{said}");
    let said = run(dir, "fit --model cubic up.csv --report up.csv", 2);
    assert!(said.contains("up.csv"), "{said}");
    assert!(fs::read_to_string(dir.join("up.csv")).unwrap().starts_with("t_s,"));
}

/// Models that are refitted without each fold have the errors on it that cross-validation derived from sums.
#[test]
fn residuals_of_held_out_rows_add_up_to_the_cross_validation() {
    let path = data("synthetic-train.csv");
    let logs = [Log::open(Path::new(&path), &Mapping::default()).unwrap()];
    for model in [ModelRule::from(Basis::Cubic), ModelRule::Physics] {
        let cross_validation = Some(HeldOut::Column);
        let options = FitOptions { model, cross_validation, ..FitOptions::default() };
        let read = ReadOptions::default();
        let data = FitData::read(&logs, &[], (&options, false), &read).unwrap().train;
        let fitted = fit(data, Dataset::default(), &options).unwrap();
        let workers = Workers::default();
        let models = HeldOutModels::new(&fitted, workers).unwrap().unwrap();
        let mut all = PerAxis::default();
        let groups = models.errors(&fitted, 100, workers).unwrap().groups;
        groups.iter().for_each(|group| quality::merge(&mut all, &group.errors));
        let known = fitted.cross_validation.unwrap();
        assert_eq!(groups.len(), known.groups);
        for (errors, known) in all.iter().zip(known.grouped) {
            let found = errors.quality().unwrap();
            // Coefficients have at least ten digits, the physics model is the same.
            assert!((found.rms / known.rms - 1.0).abs() < 1e-8, "{} {}", found.rms, known.rms);
        }
    }
}

/// The groups contain every row once, so the squares of their errors add up to those of the fit.
#[test]
fn errors_by_group_add_up_to_those_of_the_fit() {
    let path = data("synthetic-train.csv");
    let logs = [Log::open(Path::new(&path), &Mapping::default()).unwrap()];
    let read = ReadOptions::default();
    let options = FitOptions { model: Basis::Cubic.into(), ..FitOptions::default() };
    let data = FitData::read(&logs, &[], (&options, false), &read).unwrap().train;
    let fitted = fit(data.clone(), Dataset::default(), &options).unwrap();
    let labelled = label_poses_or_files(&data);
    let grouped = group_errors(&fitted.calibration, &labelled, 100, Workers::default()).unwrap();
    assert_eq!(grouped.groups.len(), 125);
    assert_eq!(grouped.groups.iter().map(|group| group.rows).sum::<u64>(), 2500);
    assert!((90..=150).contains(&grouped.loads.len()), "{}", grouped.loads.len());
    let mut all = PerAxis::default();
    grouped.groups.iter().for_each(|group| quality::merge(&mut all, &group.errors));
    for (errors, AxisQuality { rms, bias, .. }) in all.iter().zip(fitted.train) {
        let found = errors.quality().unwrap();
        // Sums of 2,500 terms in another order.
        assert!((found.rms / rms - 1.0).abs() < 1e-12, "{} {rms}", found.rms);
        assert!((found.bias - bias).abs() < 1e-12 * rms.max(1.0), "{} {bias}", found.bias);
    }
    let table = fs::read_to_string(&path).unwrap();
    let label = &grouped.groups[7].label;
    let of_pose = table.lines().skip(1).filter(|line| line.ends_with(&format!(",{label}")));
    let fz: Vec<f64> =
        of_pose.map(|line| line.split(',').nth(11).unwrap().parse().unwrap()).collect();
    let mean = fz.iter().sum::<f64>() / fz.len() as f64;
    assert!((grouped.groups[7].load[2] - mean).abs() < 1e-12, "{mean}");
}
