//! `synth trial`, `trial --find-window`, `plot`, `report` and `batch --figures`.
use std::fs;
use std::path::Path;
use std::process::Output;

use log_file::checksum;
use log_file::{Log, LogFormat, Mapping};
use serde_json::Value;
use system_tests::program;

fn shellcal(folder: &Path, arguments: &[&str]) -> Output {
    program::command(folder).args(arguments).output().unwrap()
}

fn run(folder: &Path, arguments: &[&str], code: i32) -> (String, String) {
    let output = shellcal(folder, arguments);
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let (printed, said) = (text(&output.stdout), text(&output.stderr));
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {printed}{said}");
    (printed, said)
}

fn json(folder: &Path, arguments: &[&str]) -> Value {
    let printed = run(folder, &[&["--json"], arguments].concat(), 0).0;
    serde_json::from_str(&printed).unwrap()
}

/// A calibration of the trials' unit, and two trials of each condition.
fn set() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    run(path, &["synth", "train", "--rows", "4000", "--output", "train.csv"], 0);
    run(path, &["fit", "train.csv", "--model", "cubic", "--output", "calibration.json"], 0);
    run(path, &["synth", "trials", "set", "--per-condition", "2"], 0);
    folder
}

#[test]
fn a_synthetic_trial_is_a_telemetry_log_and_the_same_every_time() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    for name in ["a", "b"] {
        let (log, truth) = (format!("{name}.txt"), format!("{name}.json"));
        run(path, &["synth", "trial", "--seed", "5", "--output", &log, "--truth", &truth], 0);
    }
    let read = |name: &str| fs::read(path.join(name)).unwrap();
    assert!(read("a.txt") == read("b.txt") && read("a.json") == read("b.json"));
    let printed = run(path, &["synth", "trial", "--seed", "5"], 0).0;
    assert!(printed.as_bytes() == read("a.txt"));

    let log = Log::open(&path.join("a.txt"), &Mapping::default()).unwrap();
    assert_eq!((log.format(), log.channels(), log.columns().len()), (LogFormat::Telemetry, 8, 24));
    let truth: Value = serde_json::from_slice(&read("a.json")).unwrap();
    let rows = printed.lines().filter(|line| !line.starts_with('%')).count() as f64;
    // 1 kHz (a row every 1001 µs) until 0.8 s after the robot has left the channel.
    let expected = (truth["t_exit_s"].as_f64().unwrap() + 0.8) / 1001e-6;
    assert!((rows - expected).abs() < 2.0);
    // Sensors are fresh ten times less often.
    let info = &json(path, &["info", "a.txt"])[0];
    let share = info["repeated_rows"].as_f64().unwrap() / rows;
    assert!((share - 0.9).abs() < 0.002, "{share}");
}

#[test]
fn omitted_parts_are_missing_in_a_synthetic_trial() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let columns = |options: &[&str]| {
        run(path, &[&["synth", "trial", "--output", "t.txt"], options].concat(), 0);
        let log = Log::open(&path.join("t.txt"), &Mapping::default()).unwrap();
        let text = fs::read_to_string(path.join("t.txt")).unwrap();
        let rows = text.lines().filter(|line| line.starts_with(|c: char| c.is_ascii_digit()));
        (log.format(), log.channels(), log.columns().len(), rows.count() as f64)
    };
    let (_, _, _, all) = columns(&[]);
    let (format, channels, count, _) = columns(&["--no-sensors"]);
    assert_eq!((format, channels, count), (LogFormat::Telemetry, 0, 16));
    let (format, channels, count, frames) = columns(&["--no-telemetry"]);
    assert_eq!((format, channels, count), (LogFormat::Csv, 8, 9));
    assert!((all / frames - 10.0).abs() < 0.05);
    let (_, _, _, kept) = columns(&["--missing", "0.1"]);
    // Binomial: five standard deviations of √(9000 · 0.09) rows.
    assert!((kept - 0.9 * all).abs() < 5.0 * (0.09 * all).sqrt(), "{kept} of {all}");
    let (_, said) = run(path, &["synth", "trial", "--missing", "1"], 2);
    assert!(said.contains("a share of 1"), "{said}");
    let (_, said) = run(path, &["synth", "trial", "--stride-frequency", "0"], 2);
    assert!(said.contains("0 strides per second"), "{said}");
}

#[test]
fn the_example_set_goes_through_a_batch_to_its_truth() {
    let folder = set();
    let path = folder.path();
    let batch = json(path, &["batch", "set/manifest.csv", "--calibration", "calibration.json"]);
    let trials = batch["trials"].as_array().unwrap();
    assert_eq!(trials.len(), 10);
    for trial in trials {
        let stem = trial["file"].as_str().unwrap().strip_suffix(".txt").unwrap();
        let truth = fs::read(path.join(format!("set/{stem}.truth.json"))).unwrap();
        let truth: Value = serde_json::from_slice(&truth).unwrap();
        assert_eq!(trial["condition"], truth["settings"]["condition"]["name"]);
        let ratio =
            |name: &str| trial[name].as_f64().unwrap() / truth[name].as_f64().unwrap() - 1.0;
        // Noise of the telemetry averages out over 6,000 rows; g is 9.81 against 9.80665 m/s².
        assert!(ratio("specific_resistance").abs() < 0.005);
        assert!(ratio("electrical_energy_j").abs() < 0.005);
        let strides = truth["strides"].as_array().unwrap().len();
        // A turn may end within the encoder's noise of the window's end.
        assert!(trial["strides"].as_u64().unwrap().abs_diff(strides as u64) <= 1);
    }
}

#[test]
fn a_window_is_proposed_drawn_or_refused() {
    let folder = set();
    let path = folder.path();
    let with = |log| {
        ["trial", log, "--find-window", "--calibration", "calibration.json", "--plot", "w.svg"]
    };
    let found = &json(path, &with("set/3cm-1.txt"))[0];
    assert_eq!(found["good"], true);
    let (enter, exit) = (&found["t_enter_s"], &found["t_exit_s"]);
    let svg = fs::read_to_string(path.join("w.svg")).unwrap();
    for time in [enter, exit] {
        assert!(svg.contains(&format!(">{:.3} s<", time.as_f64().unwrap())), "{time}");
    }
    fs::write(
        path.join("auto.csv"),
        "file,condition,t_enter_s,t_exit_s\nset/3cm-1.txt,3 cm,auto,auto\n",
    )
    .unwrap();
    let batch = json(path, &["batch", "auto.csv", "--calibration", "calibration.json"]);
    assert_eq!((&batch["trials"][0]["t_enter_s"], &batch["trials"][0]["t_exit_s"]), (enter, exit));

    let (printed, said) = run(path, &with("set/free-1.txt"), 1);
    assert!(printed.is_empty() && said.contains("set/free-1.txt: "), "{printed}{said}");
    assert!(fs::read_to_string(path.join("w.svg")).unwrap().contains("no window: "));
    let (_, said) = run(path, &["trial", "set/free-1.txt", "--find-window"], 2);
    assert!(said.contains("--calibration"), "{said}");
}

#[test]
fn every_kind_of_figure_is_drawn_as_svg_and_png() {
    let folder = set();
    let path = folder.path();
    let calibration = ["--calibration", "calibration.json"];
    let window = ["--enter", "2.3", "--exit", "8.4"];
    for (kind, input, options, words) in [
        ("drag", "set/3cm-1.txt", &window[..], &["fully inside", "force (N)", "lift Fz"][..]),
        (
            "telemetry",
            "set/3cm-1.txt",
            &window,
            &["Fx (N)", "Fz (N)", "leg angle (rad)", "power (W)"],
        ),
        ("phase", "set/manifest.csv", &[], &["3 cm: ", "right leg angle (rad)", "lift (N)"]),
        (
            "boxes",
            "set/manifest.csv",
            &[],
            &["drag energy Fx·l (mJ)", "per stride", "n = 2", "3 cm"],
        ),
    ] {
        for extension in ["svg", "png"] {
            let file = format!("{kind}.{extension}");
            let arguments = [&["plot", kind, input, "--output", &file], options, &calibration];
            run(path, &arguments.concat(), 0);
            let bytes = fs::read(path.join(&file)).unwrap();
            match extension {
                "png" => assert!(bytes.starts_with(b"\x89PNG\r\n\x1a\n")),
                _ => {
                    let svg = String::from_utf8(bytes).unwrap();
                    for word in words {
                        assert!(svg.contains(word), "{kind}: {word}");
                    }
                    assert!(!svg.contains("NaN") && !svg.contains("inf"), "{kind}");
                }
            }
        }
    }
    // Without sensors there is telemetry to draw, but no drag.
    run(path, &["synth", "trial", "--no-sensors", "--output", "bare.txt"], 0);
    let bare = |kind| {
        [&["plot", kind, "bare.txt", "--output", "bare.svg"], &window[..], &calibration].concat()
    };
    run(path, &bare("telemetry"), 0);
    let svg = fs::read_to_string(path.join("bare.svg")).unwrap();
    assert!(svg.contains("power (W)") && !svg.contains("Fx (N)"));
    let (_, said) = run(path, &bare("drag"), 2);
    assert!(said.contains("no forces to draw"), "{said}");
    let (_, said) = run(path, &["plot", "drag", "set/3cm-1.txt", "--output", "drag.jpg"], 2);
    assert!(said.contains("`.svg`, `.pdf` or `.png`"), "{said}");
}

#[test]
fn a_batch_draws_all_of_its_figures() {
    let folder = set();
    let path = folder.path();
    let manifest = fs::read_to_string(path.join("set/manifest.csv")).unwrap();
    fs::write(path.join("set/manifest.csv"), manifest + "gone.txt,free,1,2\n").unwrap();
    let with = |more: &[&'static str]| {
        [&["batch", "set/manifest.csv", "--calibration", "calibration.json"], more].concat()
    };
    run(path, &with(&["--figures", "figures", "--figure-format", "svg", "--traces", "traces"]), 1);
    let mut names: Vec<_> = fs::read_dir(path.join("figures"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    assert_eq!(names.len(), 2 + 2 * 10);
    for name in ["boxes.svg", "phase.svg", "3cm-2.11.drag.svg", "3cm-2.11.telemetry.svg"] {
        assert!(names.iter().any(|found| found == name), "{name} in {names:?}");
    }
    // Traces cover the windows, though figures show the whole log. They differ by the rounding of a
    // filter that starts elsewhere, some 1e-15 N.
    run(path, &with(&["--traces", "alone"]), 1);
    for name in ["free-1.2.csv", "3cm-2.11.csv"] {
        let read = |folder: &str| -> Vec<Vec<f64>> {
            let text = fs::read_to_string(path.join(folder).join(name)).unwrap();
            let numbers =
                |line: &str| line.split(',').map(|field| field.parse().unwrap()).collect();
            text.lines().skip(1).map(numbers).collect()
        };
        let (with_figures, alone) = (read("traces"), read("alone"));
        assert_eq!(with_figures.len(), alone.len());
        for (a, b) in with_figures.iter().flatten().zip(alone.iter().flatten()) {
            assert!((a - b).abs() < 1e-13, "{name}: {a} {b}");
        }
    }
}

#[test]
fn a_report_lists_its_inputs_and_is_reproducible() {
    let folder = set();
    let path = folder.path();
    let arguments =
        ["report", "set/manifest.csv", "--calibration", "calibration.json", "--reference", "free"];
    run(path, &arguments, 0);
    let html = fs::read_to_string(path.join("report.html")).unwrap();
    for file in ["set/manifest.csv", "calibration.json", "set/2cm-1.txt"] {
        let bytes = fs::read(path.join(file)).unwrap();
        let checksum = checksum::of(&bytes);
        assert!(html.contains(&checksum), "{file}");
        assert!(html.contains(&format!("<td class=\"text\">{file}</td><td>{}</td>", bytes.len())));
    }
    let command = "<code>shellcal report set/manifest.csv --calibration calibration.json --reference free</code>";
    assert!(html.contains(command));
    assert!(html.contains("2017-07-14T02:40:00Z") && html.contains("difference from free"));
    // The page fetches nothing: no attribute that loads has an address.
    for loading in ["src=\"http", "href=\"http", "@import", "url(http"] {
        let own = html.split("<script>").next().unwrap();
        assert!(!own.contains(loading), "{loading}");
    }
    run(path, &arguments, 0);
    assert!(fs::read_to_string(path.join("report.html")).unwrap() == html);

    let (_, said) = run(path, &["report", "set/manifest.csv", "--reference", "fre"], 2);
    assert!(said.contains("did you mean `free`?"), "{said}");
    let (_, said) = run(path, &["report", "nowhere.csv", "--output", "r.html"], 2);
    assert!(said.contains("nowhere.csv") && !path.join("r.html").exists(), "{said}");
}

#[test]
#[cfg_attr(not(real_data), ignore = "SHELLCAL_REAL_DATA does not name the recordings")]
fn a_real_trial_is_drawn_and_its_unclear_window_refused() {
    let log = "velociroach_s=10cm_w=5.5cm_h=27cm_layer=3_ply=6_f=13Hz_beetleshell_run3.txt";
    let (log, matrix) = (
        system_tests::real_recording(&format!("skinproc/{log}")),
        system_tests::real_recording("skinproc/N_matrix_trial9.csv"),
    );
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    fs::copy(log, path.join("run3.txt")).unwrap();
    run(path, &["import", matrix.to_str().unwrap(), "--output", "lab.json"], 0);
    // The legs start after 0.1 s and drag varies all the time, so no window for a tare is quiet.
    let with = ["--calibration", "lab.json", "--tare-time", "0:0.09"];
    let (_, said) = run(path, &[&["trial", "run3.txt", "--find-window"], &with[..]].concat(), 1);
    assert!(said.contains("run3.txt: "), "{said}");
    let window = ["--enter", "3", "--exit", "9"];
    for kind in ["drag", "telemetry"] {
        let arguments =
            [&["plot", kind, "run3.txt", "--output", "f.svg"], &window[..], &with].concat();
        run(path, &arguments, 0);
        let svg = fs::read_to_string(path.join("f.svg")).unwrap();
        assert!(svg.contains("fully inside") && !svg.contains("NaN"));
    }
    let manifest = "file,condition,t_enter_s,t_exit_s\nrun3.txt,3 cm,3,9\n";
    fs::write(path.join("manifest.csv"), manifest).unwrap();
    run(path, &[&["report", "manifest.csv"], &with[..]].concat(), 0);
    let html = fs::read_to_string(path.join("report.html")).unwrap();
    assert!(html.contains("rows are missing") && html.contains("duplicates of the previous frame"));
}

/// 89 and 183 mm, by each format's statement of its size.
#[test]
fn figures_are_as_wide_as_the_columns_of_a_paper() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    program::run(dir, "synth trials trials --per-condition 2", 0);
    program::run(dir, "synth train --rows 5000 -o train.csv", 0);
    program::run(dir, "fit --model cubic train.csv -o cal.json", 0);
    let trials = "trials/manifest.csv --calibration cal.json";
    for (size, width_mm) in [("single", 89.0), ("double", 183.0)] {
        let size = format!("--size {size}");
        for format in ["svg", "pdf", "png"] {
            program::run(dir, &format!("plot boxes {trials} {size} -o boxes.{format}"), 0);
        }
        program::run(dir, &format!("plot phase {trials} {size} -o phase.svg"), 0);
        program::run(dir, &format!("fit --model cubic train.csv {size} --plot fit.svg"), 0);
        program::run(dir, &format!("eval cal.json train.csv {size} --plot eval.svg"), 0);
        program::run(
            dir,
            &format!("convert cal.json train.csv -o out.csv {size} --plot trace.svg"),
            0,
        );
        program::run(
            dir,
            &format!("batch {trials} --figures figures --figure-format svg {size}"),
            0,
        );
        for name in ["boxes", "phase", "fit", "eval", "trace", "figures/boxes", "figures/phase"] {
            let svg = fs::read_to_string(dir.join(format!("{name}.svg"))).unwrap();
            let head = svg.lines().next().unwrap();
            assert!(head.contains(&format!(" width=\"{width_mm}mm\"")), "{name}: {head}");
            // Letters are text, as large as they are drawn.
            assert!(svg.contains("<text "), "{name}");
        }
        // 72 points to the inch; written to a hundredth.
        let pdf = fs::read(dir.join("boxes.pdf")).unwrap();
        let pdf = String::from_utf8_lossy(&pdf).into_owned();
        let page = pdf.split("/MediaBox [0 0 ").nth(1).unwrap().split(' ').next().unwrap();
        assert!((page.parse::<f64>().unwrap() - width_mm / 25.4 * 72.0).abs() < 0.006, "{page}");
        // 600 pixels to the inch, rounded up.
        let png = fs::read(dir.join("boxes.png")).unwrap();
        let width = u32::from_be_bytes(png[16..20].try_into().unwrap());
        assert_eq!(f64::from(width), (width_mm / 25.4 * 600.0_f64).ceil(), "{size}");
    }
}
