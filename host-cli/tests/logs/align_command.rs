//! `shellcal align` and `shellcal synth pair` from the command line.
use std::path::Path;

use serde_json::Value;
use system_tests::program::{ended, json, refused, succeed};

const PAIR: &str = "synth pair ref.csv log.csv --duration 30 --rate 100 --reference-rate 1000";

#[test]
fn a_pair_becomes_a_training_log_that_can_be_fitted() {
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    succeed(at, &format!("{PAIR} --offset -75.5 --skew 120 --loss 0.02 --truth truth.json"));
    let truth: Value =
        serde_json::from_slice(&std::fs::read(at.join("truth.json")).unwrap()).unwrap();
    let report = succeed(at, "align ref.csv log.csv -o train.csv --plot match.svg --json");
    let report: Value = serde_json::from_str(&report).unwrap();
    let clock = |name: &str| report["clock"][name].as_f64().unwrap();
    let offset_s = truth["offset_s"].as_f64().unwrap() + 120e-6 * clock("pivot_s");
    assert!((clock("offset_s") - offset_s).abs() < 200e-6);
    assert!((report["skew_ppm"].as_f64().unwrap() - 120.0).abs() < 4.0 * 1e6 * clock("skew_se"));
    assert_eq!(report["rows"]["uncovered"], 0);
    assert_eq!(report["rows"]["written"], truth["log_rows"]);

    // The training log has every frame, unchanged, and a wrench from which a calibration can be fitted.
    let training = std::fs::read_to_string(at.join("train.csv")).unwrap();
    let log = std::fs::read_to_string(at.join("log.csv")).unwrap();
    let mut lines = training.lines();
    assert_eq!(
        lines.next().unwrap(),
        "t_s,s1,s2,s3,s4,s5,s6,s7,s8,fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm"
    );
    for (row, frame) in lines.zip(log.lines().skip(1)) {
        let row: Vec<f64> = row.split(',').map(|field| field.parse().unwrap()).collect();
        let frame: Vec<f64> = frame.split(',').map(|field| field.parse().unwrap()).collect();
        assert_eq!(row[..9], frame);
    }
    assert!(std::fs::read_to_string(at.join("match.svg")).unwrap().ends_with("</svg>\n"));
    succeed(at, "fit --model cubic train.csv --output cal.json");
}

#[test]
fn units_and_names_of_either_file_can_be_given() {
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    succeed(at, PAIR);
    let plain = succeed(at, "align ref.csv log.csv --quiet");
    // The reference gets times in ms and moments in mN·m under other names, the log times in µs.
    let rewrite = |from: &str, to: &str, header: &str, scale: &[f64]| {
        let text = std::fs::read_to_string(at.join(from)).unwrap();
        let row = |line: &str| {
            let fields = line.split(',').zip(scale);
            let fields = fields.map(|(field, scale)| {
                let scaled = field.parse::<f64>().unwrap() * scale;
                format!("{scaled:.6}")
            });
            fields.collect::<Vec<_>>().join(",")
        };
        let rows: Vec<String> = text.lines().skip(1).map(row).collect();
        std::fs::write(at.join(to), format!("{header}\n{}\n", rows.join("\n"))).unwrap();
    };
    let milli = [1e3, 1.0, 1.0, 1.0, 1e3, 1e3, 1e3];
    rewrite("ref.csv", "ref2.csv", "clock,a,b,c,d,e,f", &milli);
    rewrite("log.csv", "log2.csv", "tick,p,q,r,s,t,u,v,w", &[1e6, 1., 1., 1., 1., 1., 1., 1., 1.]);
    let told = succeed(
        at,
        "align ref2.csv log2.csv --quiet --reference-time clock --reference-time-unit ms \
         --wrench a,b,c,d,e,f --moment-unit mN·m --time tick --time-unit us --sensors 2-9",
    );
    let numbers = |text: &str| -> Vec<f64> {
        text.lines().skip(1).flat_map(|l| l.split(',')).map(|f| f.parse().unwrap()).collect()
    };
    let (plain, told) = (numbers(&plain), numbers(&told));
    assert_eq!(plain.len(), told.len());
    for (a, b) in plain.into_iter().zip(told) {
        // Values in other units, and thus their sums, have other rounding errors.
        assert!((a - b).abs() < 1e-5, "{a} {b}");
    }
}

#[test]
fn a_match_that_is_not_clear_writes_nothing_and_exits_with_1() {
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    succeed(at, &format!("{PAIR} --no-load"));
    let (_, message) = ended(at, "align ref.csv log.csv -o train.csv", 1);
    assert!(message.starts_with("error: cannot align `log.csv` with `ref.csv`: "), "{message}");
    assert!(message.contains("\nhint: "), "{message}");
    assert!(!at.join("train.csv").exists());
}

/// Writes the header and the rows with times (s) from `from_s` on and before `to_s`, with times in units of `unit_s`.
fn cut(at: &Path, (from, to): (&str, &str), [from_s, to_s]: [f64; 2], unit_s: f64) {
    let text = std::fs::read_to_string(at.join(from)).unwrap();
    let (header, rows) = text.split_once('\n').unwrap();
    let row = |line: &str| {
        let (time, rest) = line.split_once(',').unwrap();
        let time_s: f64 = time.parse().unwrap();
        let is_in = (from_s..to_s).contains(&time_s);
        is_in.then(|| format!("{:.6},{rest}", time_s / unit_s))
    };
    let rows: Vec<String> = rows.lines().filter_map(row).collect();
    std::fs::write(at.join(to), format!("{header}\n{}\n", rows.join("\n"))).unwrap();
}

#[test]
fn recordings_of_different_times_are_refused() {
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    // The reference's clock is 10 s ahead. Its first 15 s end before the log's last 15 s begin.
    succeed(
        at,
        "synth pair ref.csv log.csv --duration 40 --rate 100 --reference-rate 1000 --offset 10",
    );
    cut(at, ("ref.csv", "early.csv"), [0.0, 25.0], 1.0);
    cut(at, ("log.csv", "late.csv"), [25.0, 40.0], 1.0);
    let (_, message) = ended(at, "align early.csv late.csv -o train.csv", 1);
    assert!(message.contains("one session"), "{message}");
    // Another session of the same length, with the same kind of loads.
    succeed(
        at,
        "synth pair ref2.csv log2.csv --duration 40 --rate 100 --reference-rate 1000 --seed 2",
    );
    ended(at, "align ref.csv log2.csv -o train.csv", 1);
    assert!(!at.join("train.csv").exists());
}

#[test]
fn times_in_another_unit_are_named_as_the_cause() {
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    succeed(at, PAIR);
    cut(at, ("ref.csv", "ms.csv"), [f64::NEG_INFINITY, f64::INFINITY], 1e-3);
    let (_, message) = ended(at, "align ms.csv log.csv -o train.csv", 1);
    assert!(message.contains("one has times in another unit"), "{message}");
    assert!(message.contains("--reference-time-unit ms"), "{message}");
    succeed(at, "align ms.csv log.csv -o train.csv --reference-time-unit ms");
}

#[test]
fn unreadable_logs_exit_with_2() {
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    succeed(at, PAIR);
    for (arguments, expected) in [
        ("align log.csv ref.csv -o train.csv", "no columns"),
        ("align ref.csv missing.csv -o train.csv", "cannot read `missing.csv`"),
        ("align ref.csv log.csv -o log.csv", "would replace the input"),
        ("align ref.csv log.csv --json", "needs `--output`"),
        ("align ref.csv log.csv --plot match.jpg", "expected `.svg`, `.pdf` or `.png`"),
        ("align ref.csv log.csv --averaging -1", "unexpected argument"),
        ("synth pair a.csv b.csv --loss 1", "share of 1"),
        ("synth pair a.csv b.csv --rate 0", "rate 0 Hz"),
    ] {
        let message = refused(at, arguments);
        assert!(message.contains(expected), "{arguments}: {message}");
    }
    assert!(!at.join("train.csv").exists() && !at.join("a.csv").exists());
}

#[test]
fn the_same_command_makes_the_same_pair() {
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    succeed(at, "synth pair a.csv b.csv --duration 3 --seed 7");
    succeed(at, "synth pair c.csv d.csv --duration 3 --seed 7");
    let read = |name: &str| std::fs::read(at.join(name)).unwrap();
    assert!(read("a.csv") == read("c.csv") && read("b.csv") == read("d.csv"));
    succeed(at, "synth pair c.csv d.csv --duration 3 --seed 8");
    assert!(read("b.csv") != read("d.csv"));
}

/// Adds a sync signal to a pair of logs. The signal is high for 50 ms from each of `edges_s` (reference clock) on; the
/// board log gets the times at which the board sees the edges.
fn add_edges(at: &Path, edges_s: &[f64], offset_s: f64, skew: f64) {
    let text = std::fs::read_to_string(at.join("ref.csv")).unwrap();
    let mut lines = text.lines();
    let mut reference = format!("{},ttl_v\n", lines.next().unwrap());
    for line in lines {
        let time_s: f64 = line.split(',').next().unwrap().parse().unwrap();
        let is_high = edges_s.iter().any(|edge| (*edge..edge + 0.05).contains(&time_s));
        reference += &format!("{line},{}\n", if is_high { 4.9 } else { 0.1 });
    }
    std::fs::write(at.join("ref.csv"), reference).unwrap();
    let text = std::fs::read_to_string(at.join("log.csv")).unwrap();
    let mut lines = text.lines();
    let mut log = format!("{},sync,sync_s\n", lines.next().unwrap());
    // t_reference = t_log · (1 + skew) + offset; the board's clock counts µs.
    let seen = edges_s.iter().map(|edge| (edge - offset_s) / (1.0 + skew)).enumerate();
    let mut seen = seen.filter(|(number, _)| number % 5 != 3).peekable();
    for line in lines {
        let time_s: f64 = line.split(',').next().unwrap().parse().unwrap();
        match seen.next_if(|(_, edge_s)| *edge_s <= time_s) {
            Some((number, edge_s)) => log += &format!("{line},{number},{edge_s:.6}\n"),
            None => log += &format!("{line},,\n"),
        }
    }
    std::fs::write(at.join("log.csv"), log).unwrap();
}

#[test]
fn edges_of_a_common_signal_align_recordings_that_loads_do_not() {
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    let (offset_s, skew) = (-75.5, 1.2e-4);
    let edges_s: Vec<f64> =
        [1.300_4, 4.101_1, 5.202_9, 9.703_3, 14.904_7, 17.005_2, 21.606_6, 27.507_8]
            .map(|t: f64| t + offset_s)
            .to_vec();
    for (load, by_loads) in [("", true), ("--no-load", false)] {
        succeed(at, &format!("{PAIR} --offset {offset_s} --skew 120 {load}"));
        add_edges(at, &edges_s, offset_s, skew);
        let report = json(at, "align ref.csv log.csv -o train.csv --sync ttl_v --json");
        let clock = |name: &str| report["clock"][name].as_f64().unwrap();
        // The board missed one of the eight edges.
        assert_eq!(report["edges"]["matched"], 7, "{report}");
        assert_eq!(report["edges"]["by_loads"].is_object(), by_loads);
        assert_eq!(report["explained"].is_number(), by_loads);
        // The bounds are a sample period of the reference over √12, for an error common to all edges, and the error of
        // the mean of seven edges.
        let sample_s = 1e-3 / 12_f64.sqrt();
        let range = sample_s / 8_f64.sqrt()..sample_s;
        assert!(range.contains(&clock("offset_se_s")), "{report}");
        let error_s = clock("offset_s") - (offset_s + skew * clock("pivot_s"));
        assert!(error_s.abs() < 3.0 * clock("offset_se_s"), "{error_s} of {report}");
        assert!((clock("skew") - skew).abs() < 3.0 * clock("skew_se"), "{report}");
        assert!(report["rows"]["written"].as_u64().unwrap() > 2_900);
    }
    // Clocks fitted to the loads agree with clocks from the edges within their errors. They are the same without
    // `--sync`.
    succeed(at, &format!("{PAIR} --offset {offset_s} --skew 120"));
    let plain = json(at, "align ref.csv log.csv -o plain.csv --json");
    assert!(plain["edges"].is_null());
    add_edges(at, &edges_s, offset_s, skew);
    let with = json(at, "align ref.csv log.csv -o train.csv --sync ttl_v --json");
    assert_eq!(with["edges"]["by_loads"], plain["clock"]);
    let unasked = json(at, "align ref.csv log.csv -o again.csv --json");
    assert_eq!(unasked["clock"], plain["clock"]);
}

#[test]
fn a_signal_without_edges_changes_nothing_and_a_missing_one_is_named() {
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    succeed(at, PAIR);
    let plain = json(at, "align ref.csv log.csv -o plain.csv --json");
    add_edges(at, &[], 0.0, 0.0);
    let align = "align ref.csv log.csv -o train.csv --sync ttl_v --json";
    let (printed, said) = ended(at, align, 0);
    assert!(said.contains("the clocks are by the loads"), "{said}");
    let report: Value = serde_json::from_str(&printed).unwrap();
    assert_eq!(report["clock"], plain["clock"]);
    let said = refused(at, "align ref.csv log.csv -o train.csv --sync gate");
    assert!(said.contains("gate") && said.contains("ttl_v"), "{said}");
}
