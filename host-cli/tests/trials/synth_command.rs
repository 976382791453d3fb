//! `shellcal synth`, and the data sets that it ships.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Output, Stdio};

use sha2::{Digest, Sha256};
use system_tests::program;

fn synth(args: &[&str]) -> Output {
    program::command(Path::new(".")).arg("synth").args(args).output().expect("a program to run")
}

fn stdout(args: &[&str]) -> String {
    let output = synth(args);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("text")
}

fn shipped() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../calibration-data")
}

fn shipped_commands() -> Vec<Vec<String>> {
    let readme = fs::read_to_string(shipped().join("README.md")).expect("a README");
    let lines = readme.lines().filter_map(|line| line.trim().strip_prefix("shellcal synth "));
    lines.map(|line| line.split_whitespace().map(str::to_owned).collect()).collect()
}

#[test]
fn shipped_sets_are_made_again_byte_for_byte_by_the_commands_in_their_readme() {
    let commands = shipped_commands();
    assert_eq!(commands.len(), 3);
    for mut command in commands {
        let file = command.pop().unwrap();
        assert_eq!(command.pop().as_deref(), Some("--output"));
        let args: Vec<&str> = command.iter().map(String::as_str).collect();
        let shipped = fs::read_to_string(shipped().join(&file)).unwrap();
        assert!(stdout(&args) == shipped, "`{file}` differs from what its command makes");
    }
}

#[test]
fn shipped_sets_have_their_checksums() {
    let sums = fs::read_to_string(shipped().join("SHA256SUMS")).unwrap();
    assert_eq!(sums.lines().count(), 3);
    for line in sums.lines() {
        let (sum, file) = line.split_once("  ").unwrap();
        let digest = Sha256::digest(fs::read(shipped().join(file)).unwrap());
        let found: String = digest.iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(found, sum, "{file}");
    }
}

#[test]
fn layouts_carry_the_same_rows_in_their_own_order() {
    let of = |layout| -> Vec<String> {
        let text = stdout(&["train", "--rows", "150", "--layout", layout]);
        text.lines().map(str::to_owned).collect()
    };
    let [shellcal, peer, training] = ["shellcal", "peer", "training"].map(of);
    assert_eq!(shellcal[0], "t_s,s1,s2,s3,s4,s5,s6,s7,s8,fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm,group");
    assert_eq!(peer[0], "Timestamp,Fx,Fy,Fz,Mx,My,Mz,s0,s1,s2,s3,s4,s5,s6,s7");
    assert_eq!((shellcal.len(), peer.len(), training.len()), (151, 151, 150));
    for row in 0..150 {
        let fields: Vec<&str> = shellcal[row + 1].split(',').collect();
        assert_eq!(training[row], fields[..15].join(","));
        let peer_order = [&fields[..1], &fields[9..15], &fields[1..9]].concat();
        assert_eq!(peer[row + 1], peer_order.join(","));
    }
}

#[test]
fn a_zero_load_recording_has_no_poses_to_group_by() {
    let text = stdout(&["zero", "--rows", "3"]);
    assert_eq!(
        text.lines().next(),
        Some("t_s,s1,s2,s3,s4,s5,s6,s7,s8,fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm")
    );
    assert!(text.lines().all(|line| line.split(',').count() == 15));
}

#[test]
fn without_rows_the_sizes_equal_those_of_the_paper() {
    assert_eq!(stdout(&["train"]).lines().count(), 1 + 77_522);
    assert_eq!(stdout(&["test"]).lines().count(), 1 + 19_932);
}

#[test]
fn time_starts_at_zero_and_advances_by_the_rate() {
    let text = stdout(&["zero", "--rows", "3", "--rate", "1000"]);
    let times: Vec<&str> = text.lines().skip(1).filter_map(|l| l.split(',').next()).collect();
    assert_eq!(times, ["0.000000", "0.001000", "0.002000"]);
}

#[test]
fn no_row_holds_a_negative_zero() {
    let text = stdout(&["zero", "--rows", "2000"]);
    assert!(!text.contains("-0.00000,") && !text.contains("-0.00000000"));
}

#[test]
fn json_describes_the_recording_and_the_file_is_complete() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("rows.csv");
    let path_arg = path.to_str().unwrap();
    let told = stdout(&["train", "--rows", "2500", "--output", path_arg, "--json"]);
    let told: serde_json::Value = serde_json::from_str(&told).unwrap();
    assert_eq!(told["rows"], 2500);
    assert_eq!(told["bytes"], fs::metadata(&path).unwrap().len());
    assert_eq!(fs::read_to_string(&path).unwrap(), stdout(&["train", "--rows", "2500"]));
}

#[test]
fn impossible_settings_are_refused_before_any_output() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("rows.csv");
    let path_arg = path.to_str().unwrap();
    let missing = dir.path().join("missing/rows.csv");
    let many = "10000000";
    let cases: [(&[&str], &str); 7] = [
        (&["train", "--rows", "0", "-o", path_arg], "0 is not in 1.."),
        (&["train", "--rate", "0", "-o", path_arg], "rate 0 Hz"),
        (&["train", "--rate", "nan", "-o", path_arg], "rate NaN Hz"),
        (&["train", "--noise-scale", "-1", "-o", path_arg], "noise"),
        (&["train", "--json"], "`--json` needs `--output`"),
        (&["train", "--rows", "10000001", "-o", path_arg], "at most 1e7 are made"),
        // So many rows that the test would take long if the work began.
        (&["train", "--rows", many, "-o", missing.to_str().unwrap()], "cannot write"),
    ];
    for (args, expected) in cases {
        let output = synth(args);
        assert_eq!(output.status.code(), Some(2), "{args:?}");
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(said.contains(expected), "{args:?}: {said}");
    }
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0);
}

#[test]
fn a_reader_that_goes_away_is_no_error() {
    let mut command = program::command(Path::new("."));
    command.args(["synth", "train", "--rows", "10000000"]);
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
}
