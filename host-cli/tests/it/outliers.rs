//! Suspicious rows: spikes, shifted columns and swapped bytes are named by their lines, and no row that is as it was recorded.

use std::fs;

use serde_json::Value;
use system_tests::program::{self, json, refused, succeed};
use system_tests::random::Random;
use system_tests::real_recording;
use tempfile::TempDir;

/// The fields of a row of the shell's logs: time, eight readings, six axes, group.
const READINGS: std::ops::Range<usize> = 1..9;
const LOADS: std::ops::Range<usize> = 9..15;

fn report(dir: &TempDir, arguments: &str) -> Value {
    json(dir, &format!("{arguments} --json"))
}

/// The lines that a report names.
fn lines(report: &Value, what: &str) -> Vec<usize> {
    let rows = report[what].as_array().map_or(&[][..], Vec::as_slice);
    rows.iter().map(|row| row["line"].as_u64().unwrap() as usize).collect()
}

/// What can happen to a row on its way.
#[derive(Clone, Copy, Debug)]
enum Fault {
    /// A channel is off by eight standard deviations of the differences of neighbouring rows.
    Spike,
    /// All columns have moved by one.
    Shift,
    /// The two bytes of a reading have changed places.
    Swap,
}

const FAULTS: [Fault; 3] = [Fault::Spike, Fault::Shift, Fault::Swap];

/// Columns of a log, and how much those of the readings differ from row to row.
struct Planter {
    readings: std::ops::Range<usize>,
    values: std::ops::Range<usize>,
    sd: Vec<f64>,
}

impl Planter {
    /// Of lines of numbers, of which the first names the columns.
    fn new(
        lines: &[String],
        readings: std::ops::Range<usize>,
        values: std::ops::Range<usize>,
    ) -> Self {
        let number =
            |line: &String, at: usize| -> f64 { line.split(',').nth(at).unwrap().parse().unwrap() };
        let sd = |at: usize| {
            let column: Vec<f64> = lines[1..].iter().map(|line| number(line, at)).collect();
            let squares = column.windows(2).map(|pair| (pair[1] - pair[0]).powi(2)).sum::<f64>();
            (squares / (column.len() - 1) as f64).sqrt()
        };
        Self { sd: readings.clone().map(sd).collect(), readings, values }
    }

    fn plant(&self, line: &str, fault: Fault, random: &mut Random) -> String {
        let mut fields: Vec<String> = line.split(',').map(str::to_owned).collect();
        let channel = random.below(self.readings.len() as u64) as usize;
        let at = self.readings.start + channel;
        let value: f64 = fields[at].parse().unwrap();
        match fault {
            Fault::Spike => {
                let sign = if random.percent(50) { 8.0 } else { -8.0 };
                fields[at] = (value + sign * self.sd[channel]).to_string();
            }
            Fault::Shift => fields[self.values.clone()].rotate_right(1),
            Fault::Swap => fields[at] = (value as i16).swap_bytes().to_string(),
        }
        fields.join(",")
    }
}

/// Plants so many faults of each kind in rows that are not neighbours; returns their lines by kind.
fn plant(
    lines: &mut [String],
    planter: &Planter,
    count: usize,
    random: &mut Random,
) -> Vec<(Fault, usize)> {
    let mut planted: Vec<(Fault, usize)> = Vec::new();
    for fault in FAULTS {
        while planted.len() < count * (1 + fault as usize) {
            let place = 1 + random.below(lines.len() as u64 - 1) as usize;
            let dirty = planter.plant(&lines[place], fault, random);
            let is_beside = |&(_, line): &(Fault, usize)| (place + 1).abs_diff(line) < 3;
            if dirty != lines[place] && !planted.iter().any(is_beside) {
                lines[place] = dirty;
                planted.push((fault, place + 1));
            }
        }
    }
    planted
}

/// How many of the planted lines of each kind are named, and which others are.
fn found(planted: &[(Fault, usize)], named: &[usize]) -> ([usize; 3], Vec<usize>) {
    let of_kind = |fault: Fault| {
        let is_found = |(kind, line): &&(Fault, usize)| {
            *kind as usize == fault as usize && named.contains(line)
        };
        planted.iter().filter(is_found).count()
    };
    let is_other = |line: &&usize| planted.iter().all(|(_, planted)| planted != *line);
    (FAULTS.map(of_kind), named.iter().filter(is_other).copied().collect())
}

fn write(dir: &TempDir, name: &str, lines: &[String]) {
    fs::write(dir.path().join(name), lines.join("\n") + "\n").unwrap();
}

/// Five logs of 20,000 rows, 20 faults of each kind in each.
#[test]
fn planted_faults_are_named_and_no_other_row() {
    let dir = tempfile::tempdir().unwrap();
    let mut random = Random(16);
    let (mut named, mut wrong) = ([0; 3], Vec::new());
    for log in 0..5 {
        succeed(
            &dir,
            &format!("synth train --rows 20000 --rate 10 --seed {log} --output clean.csv"),
        );
        let text = fs::read_to_string(dir.path().join("clean.csv")).unwrap();
        let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
        let planter = Planter::new(&lines, READINGS, READINGS.start..LOADS.end);
        let planted = plant(&mut lines, &planter, 20, &mut random);
        write(&dir, "dirty.csv", &lines);
        let report = report(&dir, "fit dirty.csv");
        let (of_log, others) = found(&planted, &self::lines(&report, "outliers"));
        named.iter_mut().zip(of_log).for_each(|(all, more)| *all += more);
        wrong.extend(others.into_iter().map(|line| (log, line)));
    }
    println!("of 100 of each kind: {named:?}; wrong {wrong:?}");
    assert!(named.iter().all(|&count| count >= 95), "{named:?}");
    // One of 100,000 may be.
    assert!(wrong.len() <= 1, "{wrong:?}");
}

#[test]
fn rows_that_belong_are_not_named_and_a_slip_deep_in_a_long_log_has_its_line() {
    let dir = tempfile::tempdir().unwrap();
    let mut wrong = 0;
    for seed in 1..4 {
        succeed(&dir, &format!("synth train --seed {seed} --output clean.csv"));
        for model in ["linear", "cubic", "quadratic"] {
            wrong +=
                lines(&report(&dir, &format!("fit clean.csv --model {model}")), "outliers").len();
        }
    }
    // Three models on 232,566 rows.
    assert_eq!(wrong, 0);
    let text = fs::read_to_string(dir.path().join("clean.csv")).unwrap();
    let mut dirty: Vec<String> = text.lines().map(str::to_owned).collect();
    let mut fields: Vec<&str> = dirty[60_000].split(',').collect();
    fields[3] = "30000";
    dirty[60_000] = fields.join(",");
    // A blank line is no row and still a line.
    dirty.insert(100, String::new());
    write(&dir, "dirty.csv", &dirty);
    let found = report(&dir, "fit dirty.csv");
    assert_eq!(lines(&found, "outliers"), [60_002]);
    let row = &found["outliers"][0]["columns"][0];
    assert_eq!((&row["name"], &row["value"]), (&"s3".into(), &30_000.0.into()));
    assert!(row["before"].as_f64() < Some(5000.0) && row["after"].as_f64() < Some(5000.0));
    let output = program::output(dir.path(), "fit dirty.csv");
    let talk = String::from_utf8_lossy(&output.stderr);
    assert!(
        talk.contains("`dirty.csv` line 60002 is suspicious: `s3` is 30000 (neighbouring rows: "),
        "{talk}"
    );
    assert_eq!(report(&dir, "fit dirty.csv --outliers keep").get("outliers"), None);
}

#[test]
fn dropped_rows_are_listed_and_the_rest_is_fitted_as_if_they_were_not_there() {
    let dir = tempfile::tempdir().unwrap();
    succeed(&dir, "synth train --rows 2500 --rate 10 --output clean.csv");
    let text = fs::read_to_string(dir.path().join("clean.csv")).unwrap();
    let clean: Vec<String> = text.lines().map(str::to_owned).collect();
    let mut dirty = clean.clone();
    let mut random = Random(3);
    for (place, at, value) in [(700, 4, "20000"), (1500, 9, "55.5"), (2000, 1, "-3")] {
        let mut fields: Vec<&str> = dirty[place].split(',').collect();
        fields[at] = value;
        dirty[place] = fields.join(",");
    }
    let places = [700, 1500, 2000];
    let rest: Vec<String> = (0..clean.len())
        .filter(|line| !places.contains(line))
        .map(|line| clean[line].clone())
        .collect();
    write(&dir, "dirty.csv", &dirty);
    write(&dir, "rest.csv", &rest);
    let options = "--cv --model quadratic";
    let dropped =
        report(&dir, &format!("fit dirty.csv --outliers drop --dropped d.csv -o a.json {options}"));
    let expected = report(&dir, &format!("fit rest.csv -o b.json {options}"));
    assert_eq!(lines(&dropped, "dropped"), [701, 1501, 2001]);
    assert_eq!(dropped["rows"], 2497);
    assert_eq!(dropped["cross_validation"], expected["cross_validation"]);
    let coefficients = |name: &str| -> Value {
        let text = fs::read_to_string(dir.path().join(name)).unwrap();
        serde_json::from_str::<Value>(&text).unwrap()["coefficients"].clone()
    };
    assert_eq!(coefficients("a.json"), coefficients("b.json"));
    let list = fs::read_to_string(dir.path().join("d.csv")).unwrap();
    assert!(list.starts_with("file,line,reason,jump_in_sd,column,value,before,after\n"));
    assert_eq!(list.lines().count(), 4);
    assert!(list.contains("dirty.csv,701,jump,"), "{list}");
    // Nothing is left out without a list, and nothing but what the range says.
    for arguments in ["--outliers drop", "--valid-range 0:4095", "--dropped d.csv"] {
        let said = refused(dir.path(), &format!("fit dirty.csv {arguments}"));
        assert!(said.contains("--dropped"), "{said}");
    }
    let ranged = report(&dir, "fit dirty.csv --valid-range 0:4095 --dropped d.csv");
    assert_eq!(lines(&ranged, "dropped"), [701, 2001]);
    assert_eq!(ranged["dropped"][0]["reason"], "out_of_range");
    assert_eq!(lines(&ranged, "outliers"), [1501]);
    for arguments in ["--valid-range 5:1", "--valid-range x", "--outliers perhaps"] {
        refused(dir.path(), &format!("fit dirty.csv --dropped d.csv {arguments}"));
    }
    // `info` names them, too.
    let info: Value = serde_json::from_str(&succeed(&dir, "info dirty.csv --json")).unwrap();
    assert_eq!(lines(&info[0], "outliers"), [701, 1501, 2001]);
    // Half of the rows are no slips.
    let mut mixed = clean.clone();
    let planter = Planter::new(&clean, READINGS, READINGS.start..LOADS.end);
    for line in 1..1250 {
        let fault = FAULTS[random.below(3) as usize];
        mixed[line] = planter.plant(&clean[line], fault, &mut random);
    }
    write(&dir, "mixed.csv", &mixed);
    let found = report(&dir, "fit mixed.csv");
    assert!(lines(&found, "outliers").len() < 50);
}

#[test]
fn a_row_is_named_by_its_line_with_decimal_commas_too() {
    let dir = tempfile::tempdir().unwrap();
    succeed(&dir, "synth train --rows 2500 --output train.csv");
    let text = fs::read_to_string(dir.path().join("train.csv")).unwrap();
    let mut rows: Vec<String> = text.lines().map(str::to_owned).collect();
    let mut fields: Vec<&str> = rows[701].split(',').collect();
    fields[READINGS.start] = "9999";
    rows[701] = fields.join(",");
    let rows: Vec<String> =
        rows.iter().map(|row| row.replace(',', ";").replace('.', ",")).collect();
    write(&dir, "german.csv", &rows);
    assert_eq!(lines(&report(&dir, "fit german.csv"), "outliers"), [702]);
}

/// The shell's data sets as they are shipped.
#[test]
fn no_row_of_the_shipped_sets_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../calibration-data");
    for name in ["synthetic-train.csv", "synthetic-test.csv"] {
        let path = folder.join(name);
        let found = report(&dir, &format!("fit {}", path.display()));
        assert_eq!(lines(&found, "outliers"), [0; 0], "{name}");
    }
}

#[test]
#[cfg_attr(not(real_data), ignore = "SHELLCAL_REAL_DATA does not name the recordings")]
fn no_row_of_the_real_recordings_is_named_wrongly() {
    let dir = tempfile::tempdir().unwrap();
    let tongs = |set: &str| {
        let file = |what: &str| real_recording(&format!("others/tongs/{set}_{what}_train.csv"));
        format!("{} --wrench-from {}", file("pose").display(), file("FT").display())
    };
    let recording = |file: &str| real_recording(file).display().to_string();
    let coinft: Vec<String> = COINFT.iter().map(|name| recording(&coinft(name))).collect();
    for arguments in [
        format!("{} --moment-unit mNm", recording("skinproc/behavior4_2Hz.csv")),
        recording("others/photointerrupters/poses.csv"),
        tongs("baseline"),
        tongs("internal"),
        coinft.join(" "),
    ] {
        for model in ["linear", "cubic"] {
            let found = report(&dir, &format!("fit {arguments} --model {model}"));
            assert_eq!(lines(&found, "outliers"), [0; 0], "{arguments}");
        }
    }
    // The seventh pose begins with rows of another one.
    let poses = recording("others/photointerrupters/poses.csv");
    let output = program::output(dir.path(), &format!("fit {poses} --model cubic"));
    let talk = String::from_utf8_lossy(&output.stderr);
    assert_eq!(talk.matches("the model does not follow these rows").count(), 1, "{talk}");
}

/// Recordings of continuous motion of a capacitive sensor.
const COINFT: [&str; 8] =
    ["110451", "110601", "110700", "110801", "110856", "111359", "111610", "111755"];

fn coinft(time: &str) -> String {
    format!("others/coinft/CFT24_calibrationData_20251219_{time}_train.h5")
}

/// In one real file of 2,676 rows, ten faults of two kinds in turn; its readings are small fractions about zero.
#[test]
#[cfg_attr(not(real_data), ignore = "SHELLCAL_REAL_DATA does not name the recordings")]
fn faults_that_are_planted_in_real_motion_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let mut random = Random(29);
    let (mut named, mut count, mut wrong) = (0, 0, Vec::new());
    for time in &COINFT[1..] {
        let path = real_recording(&coinft(time).replace(".h5", ".csv.gz"));
        let mut text = String::new();
        let packed = flate2::read::MultiGzDecoder::new(fs::File::open(path).unwrap());
        std::io::Read::read_to_string(&mut { packed }, &mut text).unwrap();
        let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
        let planter = Planter::new(&lines, 0..12, 0..18);
        let mut planted: Vec<usize> = Vec::new();
        while planted.len() < 16 {
            let place = 1 + random.below(lines.len() as u64 - 1) as usize;
            if planted.iter().any(|&line| (place + 1).abs_diff(line) < 3) {
                continue;
            }
            let fault = if planted.len() < 12 { Fault::Spike } else { Fault::Shift };
            lines[place] = planter.plant(&lines[place], fault, &mut random);
            planted.push(place + 1);
        }
        write(&dir, "dirty.csv", &lines);
        let found = self::lines(&report(&dir, "fit dirty.csv"), "outliers");
        named += planted.iter().filter(|line| found.contains(line)).count();
        count += planted.len();
        wrong.extend(found.into_iter().filter(|line| !planted.contains(line)));
    }
    println!("{named} of {count}; wrong {wrong:?}");
    assert!(100 * named >= 95 * count, "{named} of {count}");
    assert!(wrong.is_empty(), "{wrong:?}");
}
