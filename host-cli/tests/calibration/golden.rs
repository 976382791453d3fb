//! Documents of every released version, which later versions read.

use std::fs;
use std::path::{Path, PathBuf};

use calibration::Basis;
use calibration::uncertainty::CoefficientCovariance;
use calibration::validation::grouped::GroupKind;
use calibration_file::{CalibrationFile, PartialFit};
use system_tests::program;
use trial::manifest::{Entry, Manifest};

fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/calibration/golden").join(name)
}

/// A document without a checksum, as an earlier version wrote it.
fn as_before(document: &str, version: u64) -> String {
    let (content, checksum) = document.rsplit_once(",\n  \"checksum\": ").unwrap();
    assert!(checksum.starts_with("\"xxh128:") && checksum.ends_with("\"\n}\n"), "{checksum}");
    let content =
        content.replacen("schema_version\": 4", &format!("schema_version\": {version}"), 1);
    format!("{content}\n}}\n")
}

/// A field that was renamed, added or left out would change the written document.
#[test]
fn golden_calibrations_are_read_and_written_unchanged() {
    for name in ["calibration-v1.json", "calibration-v1-rows.json"] {
        let path = golden(name);
        // They have no checksum yet.
        CalibrationFile::read(&path).unwrap_err();
        let file = CalibrationFile::read_edited(&path).unwrap();
        assert_eq!(as_before(&file.to_json(), 1), fs::read_to_string(&path).unwrap(), "{name}");
    }
}

#[test]
fn the_parts_of_a_calibration_are_where_they_belong() {
    let file = CalibrationFile::read_edited(&golden("calibration-v1.json")).unwrap();
    let diagnostics = file.origin.diagnostics.unwrap();
    assert_eq!(file.origin.sensor_serial.as_deref(), Some("shell 7"));
    assert_eq!(file.calibration.channels(), 3);
    assert_eq!((diagnostics.rows, diagnostics.rank), (2500, 4));
    assert_eq!(diagnostics.cross_validation.unwrap().groups, 125);
    let selection = diagnostics.selection.unwrap();
    assert_eq!(selection.candidates[selection.chosen].basis, Basis::Linear);
    let covariance = file.calibration.covariance.unwrap();
    assert!(matches!(covariance.coefficients, CoefficientCovariance::Groups { groups: 125, .. }));

    let file = CalibrationFile::read_edited(&golden("calibration-v1-rows.json")).unwrap();
    assert_eq!(file.origin.solver.unwrap().truncate, Some(1e-6));
}

#[test]
fn golden_partial_fits_are_read_and_written_unchanged() {
    let path = golden("partial-v1.json");
    PartialFit::read(&path).unwrap_err();
    let partial = PartialFit::read_edited(&path).unwrap();
    assert_eq!(as_before(&partial.to_json(), 1), fs::read_to_string(&path).unwrap());
    assert_eq!((partial.model.basis, partial.sums.rows()), (Basis::Cubic, 299));
}

#[test]
fn golden_partial_fits_with_groups_are_read_and_written_unchanged() {
    let path = golden("partial-v2.json");
    let partial = PartialFit::read(&path).unwrap();
    let text = fs::read_to_string(&path).unwrap();
    let (content, _) = text.rsplit_once(",\n  \"checksum\": ").unwrap();
    assert_eq!(as_before(&partial.to_json(), 2), format!("{content}\n}}\n"));
    let groups = partial.groups.unwrap();
    assert_eq!((groups.by, groups.split.folds, groups.split.held_out), (GroupKind::Column, 10, 2));
    assert_eq!(groups.groups.len(), 4);
    assert_eq!((groups.groups[3].source, groups.groups[3].position), (1, 0));
}

#[test]
fn golden_manifests_keep_their_meaning() {
    let text = |name| fs::read_to_string(golden(name)).unwrap();
    let csv = Manifest::parse(&text("manifest-v1.csv"), false).unwrap();
    let toml = Manifest::parse(&text("manifest-v1.toml"), true).unwrap();
    assert_eq!(toml.conditions, Some(vec!["free".to_owned(), "3 cm".to_owned()]));
    for manifest in [csv, toml] {
        let [first, second] = <[Entry; 2]>::try_from(
            manifest.rows.into_iter().collect::<Result<Vec<_>, _>>().unwrap(),
        )
        .unwrap();
        assert_eq!(
            (first.trial.file.as_str(), first.trial.condition.as_str()),
            ("free-1.txt", "free")
        );
        assert_eq!((first.enter.value, first.exit.value), (Some(2.218), Some(8.008)));
        let constants =
            [first.trial.velocity_m_s, first.trial.mass_kg, first.trial.channel_length_m];
        assert_eq!(constants.map(Option::unwrap), [0.048, 0.0416, 0.28]);
        assert!(first.trial.notes.is_none() && !first.exclude);
        assert_eq!((second.enter.value, second.exit.value), (None, None));
        assert_eq!(second.trial.notes.as_deref(), Some("slow, at first"));
        assert!(second.exclude && second.trial.mass_kg.is_none());
    }
}

fn columns(text: &str, names: &[&str]) -> Vec<Vec<String>> {
    let mut lines = text.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let header = lines.next().unwrap();
    let positions: Vec<usize> =
        names.iter().map(|name| header.iter().position(|column| column == name).unwrap()).collect();
    lines.map(|row| positions.iter().map(|&at| row[at].to_owned()).collect()).collect()
}

/// A recording of the first program with this protocol: its board sent no sampling times and no
/// state, and its log has no columns for them.
#[test]
fn golden_recordings_are_converted_and_replayed_unchanged() {
    let dir = tempfile::tempdir().unwrap();
    let name = |name| golden(name).display().to_string();
    let run = |arguments: &str| {
        let output = program::output(dir.path(), arguments);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        output
    };
    let text = |path: &Path| fs::read_to_string(path).unwrap();
    let recorded = text(&golden("recording-v2.csv"));
    let names: Vec<&str> = recorded.lines().next().unwrap().split(',').collect();
    assert_eq!(names[names.len() - 4..], ["index", "missing", "dropped", "flags"]);

    let calibration = name("recording-v2-calibration.json");
    let log = name("recording-v2.csv");
    let arguments = format!("convert {calibration} {log} --edited -o forces.csv");
    run(&arguments);
    let forces = text(&dir.path().join("forces.csv"));
    let before = text(&golden("recording-v2-forces.csv"));
    let axes: Vec<&str> = before.lines().next().unwrap().split(',').collect();
    assert!(axes.contains(&"fx_n") && axes.contains(&"mz_nm"), "{axes:?}");
    assert_eq!(columns(&forces, &axes), columns(&before, &axes));

    run(&format!("record --replay {} -o log.csv", name("recording-v2.raw")));
    let replayed = text(&dir.path().join("log.csv"));
    assert_eq!(columns(&replayed, &names), columns(&recorded, &names));
    for name in ["temperature_c", "vrefint", "dark8", "sync", "sync_s"] {
        assert!(columns(&replayed, &[name]).iter().all(|row| row[0].is_empty()), "{name}");
    }
}
