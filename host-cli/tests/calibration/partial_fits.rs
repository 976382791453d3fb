//! `fit --partial` and `merge`: merged parts equal the whole fit.

use std::fs;
use std::process::Output;

use system_tests::program::{self, document, ended, refused, succeed};
use tempfile::TempDir;

use crate::sealed::sealed;

fn recordings() -> TempDir {
    let dir = tempfile::tempdir().unwrap();
    for (seed, rows) in [(1, 900), (2, 1700), (3, 400)] {
        succeed(&dir, &format!("synth train --rows {rows} --rate 10 --seed {seed} -o {seed}.csv"));
    }
    dir
}

#[test]
fn merged_parts_are_the_fit_over_all_files_bit_for_bit_in_any_grouping() {
    let dir = recordings();
    for model in ["--model cubic", "--model poly3", "--model quadratic --no-intercept"] {
        // These partial fits contain no groups.
        let by_rows = "--covariance rows -o whole.json";
        succeed(&dir, &format!("fit 1.csv 2.csv 3.csv {model} {by_rows}"));
        for file in 1..=3 {
            succeed(&dir, &format!("fit {file}.csv {model} --partial {file}.json"));
        }
        succeed(&dir, "merge 1.json 2.json 3.json -o all.json");
        succeed(&dir, "merge 3.json 2.json --partial late.json");
        succeed(&dir, "merge late.json 1.json -o other.json");
        succeed(&dir, &format!("fit 3.csv 1.csv {model} --threads 1 --partial two.json"));
        succeed(&dir, "merge 2.json two.json -o third.json");
        let whole = document(&dir, "whole.json");
        for name in ["all.json", "other.json", "third.json"] {
            let merged = document(&dir, name);
            for field in ["model", "terms", "scaling", "coefficients", "valid_range"] {
                assert!(whole[field] == merged[field], "{model}: {field} of {name}");
            }
            // Sums do not contain the distribution of errors.
            for field in ["residual", "degrees_of_freedom", "coefficients"] {
                let of = |file: &serde_json::Value| file["covariance"][field].clone();
                assert!(of(&whole) == of(&merged), "{model}: covariance {field} of {name}");
            }
            for field in ["rows", "rank", "condition", "repeated_rows", "skipped_rows"] {
                assert_eq!(whole["diagnostics"][field], merged["diagnostics"][field]);
            }
            for axis in 0..6 {
                let figures = |file: &serde_json::Value, figure: &str| {
                    file["diagnostics"]["train"][axis][figure].as_f64().unwrap()
                };
                for figure in ["rms", "r_squared"] {
                    let (from_rows, from_sums) =
                        (figures(&whole, figure), figures(&merged, figure));
                    // The whole fit's errors come from `f64` predictions, row by row.
                    assert!((from_rows - from_sums).abs() < 1e-9 * from_rows, "{figure}");
                }
                let difference = figures(&whole, "bias") - figures(&merged, "bias");
                assert!(difference.abs() < 1e-9 * figures(&whole, "rms"));
                assert!(merged["diagnostics"]["train"][axis]["max"].is_null());
            }
        }
        assert_eq!(sources(&document(&dir, "all.json")), sources(&whole));
    }
}

#[test]
fn a_part_that_could_not_be_fitted_alone_can_be_merged() {
    let dir = recordings();
    succeed(&dir, "synth train --rows 20 --seed 4 -o 4.csv");
    assert!(refused(&dir, "fit --model cubic 4.csv").contains("too few"));
    succeed(&dir, "fit 4.csv --partial 4.json");
    succeed(&dir, "fit 1.csv --partial 1.json");
    assert!(refused(&dir, "merge 4.json -o cal.json").contains("too few"));
    succeed(&dir, "merge 4.json 1.json -o cal.json");
    succeed(&dir, "eval cal.json 3.csv");
}

#[test]
fn parts_of_different_fits_are_refused() {
    let dir = recordings();
    succeed(&dir, "fit 1.csv --partial 1.json");
    succeed(&dir, "fit 2.csv --model linear --partial linear.json");
    succeed(&dir, "fit 2.csv --no-intercept --partial bare.json");
    succeed(&dir, "fit 2.csv --sensors 2-8 --partial seven.json");
    let cases = [
        ("linear.json", "`linear.json`: it is for `linear + offset`, expected `cubic + offset`"),
        ("bare.json", "it is for `cubic`, expected `cubic + offset`"),
        ("seven.json", "it has `7` channels, expected `8`"),
        ("1.json", "counted already"),
        ("1.csv", "not valid JSON"),
        ("missing.json", "cannot read it"),
    ];
    for (other, expected) in cases {
        let error = refused(&dir, &format!("merge 1.json {other} -o cal.json"));
        assert!(error.contains(expected), "{other}: {error}");
    }
    assert!(!dir.path().join("cal.json").exists());
}

/// Parts that repeat rows under another name, and parts with other columns or of another sensor.
#[test]
fn parts_of_other_columns_or_of_the_same_rows_are_refused() {
    let dir = recordings();
    succeed(&dir, "fit 1.csv --model linear --partial 1.json --serial A7");
    let fit = |log: &str, flags: &str| {
        succeed(&dir, &format!("fit {log} --model linear --partial other.json {flags}"));
    };
    let text = fs::read_to_string(dir.path().join("1.csv")).unwrap();
    let write = |name: &str, text: &[u8]| fs::write(dir.path().join(name), text).unwrap();
    let mut gzip = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    std::io::Write::write_all(&mut gzip, text.as_bytes()).unwrap();
    write("1b.csv.gz", &gzip.finish().unwrap());
    write("line.csv", format!("{text}\n").as_bytes());
    write("quoted.csv", text.replacen("t_s", "\"t_s\"", 1).as_bytes());
    let mut lines: Vec<&str> = text.lines().collect();
    lines[1..].reverse();
    write("reversed.csv", (lines.join("\n") + "\n").as_bytes());
    for copy in ["1b.csv.gz", "line.csv", "quoted.csv", "reversed.csv"] {
        fit(copy, "");
        let error = refused(&dir, "merge 1.json other.json -o cal.json");
        assert!(
            error.contains(&format!("its rows of `{copy}` have been counted already")),
            "{error}"
        );
    }
    for (flags, expected) in [
        ("--sensors s5,s2,s3,s4,s1,s6,s7,s8", "its column 1 is `s5`, expected `s1`"),
        ("--wrench fx_n,fz_n,fy_n,mx_nm,my_nm,mz_nm", "its column 10 is `fz_n`, expected `fy_n`"),
        ("--moment-unit mNm", "its column 12 is `mx_nm in mN·m`, expected `mx_nm`"),
        ("--serial B2", "it is of the sensor `B2`, expected `A7`"),
    ] {
        fit("2.csv", flags);
        let error = refused(&dir, "merge 1.json other.json -o cal.json");
        assert!(error.contains(expected), "{flags}: {error}");
    }
    for flags in ["--sensors s1,s2,s3,s4,s5,s6,s7,s8", "--serial A7", ""] {
        fit("2.csv", flags);
        succeed(&dir, "merge 1.json other.json -o cal.json");
        assert_eq!(document(&dir, "cal.json")["sensor_serial"], "A7");
    }
    assert!(refused(&dir, "merge 1.json --serial C3").contains("of the sensor `A7`"));
}

#[test]
fn a_damaged_or_foreign_part_is_refused() {
    let dir = recordings();
    succeed(&dir, "fit 1.csv --model linear --partial 1.json");
    let text = fs::read_to_string(dir.path().join("1.json")).unwrap();
    let cases = [
        ("\"partial_schema_version\": 4", "\"partial_schema_version\": 5", "schema version is `5`"),
        ("\"channels\": 8", "\"channels\": 7", "`moments` are not those of `model`"),
        ("\"rows\": 900,\n    \"channels\"", "\"rows\": 901,\n    \"channels\"", "sum of ones"),
        ("\"moments\"", "\"sums\"", "missing field `moments`"),
    ];
    for (from, to, expected) in cases {
        assert!(text.contains(from), "{from} in {}", &text[..600]);
        fs::write(dir.path().join("bad.json"), text.replacen(from, to, 1)).unwrap();
        let error = refused(&dir, "merge bad.json");
        assert!(error.contains(expected), "{error}");
    }
}

/// Removes the figures that need another pass over the rows. Everything else equals one fit over
/// all files.
fn without_rows(file: &serde_json::Value) -> serde_json::Value {
    let mut file = file.clone();
    for figure in ["train", "excitation"] {
        file["diagnostics"].as_object_mut().unwrap().remove(figure);
    }
    if let Some(covariance) = file["covariance"].as_object_mut() {
        covariance.remove("shape");
    }
    file["sources"] = sources(&file);
    file["checksum"].take();
    file
}

/// Sources without their digests. Only partial fits have digests, to recognise repeated rows.
fn sources(file: &serde_json::Value) -> serde_json::Value {
    let mut sources = file["sources"].clone();
    for source in sources.as_array_mut().unwrap() {
        source.as_object_mut().unwrap().remove("digest");
    }
    sources
}

#[test]
fn merged_parts_with_groups_validate_as_one_fit_does_bit_for_bit_in_any_order() {
    let dir = recordings();
    let cases = [
        // Poses of one label are one group, also across files.
        ("--groups", "cubic", "--cv", "--cv"),
        ("--groups=column", "linear", "--cv", "--cv"),
        ("--groups=file", "linear", "--cv=file --covariance groups", "--cv --covariance groups"),
        // Parts keep no order of rows, which a lag or memory needs.
        ("--groups", "auto", "--cv=10 --lag 0 --memory-terms none", "--cv=10"),
    ];
    for (keep, model, fit, merge) in cases {
        let model = format!("--model {model}");
        succeed(&dir, &format!("fit 1.csv 2.csv 3.csv {model} {fit} -o whole.json"));
        for file in 1..=3 {
            succeed(&dir, &format!("fit {file}.csv {model} {keep} --partial {file}.json"));
        }
        succeed(&dir, &format!("fit 3.csv 1.csv {model} {keep} --threads 1 --partial two.json"));
        succeed(&dir, "merge 3.json 2.json --partial late.json");
        let fitted = model.clone();
        let model = if model.ends_with("auto") { "--model auto" } else { "" };
        let whole = document(&dir, "whole.json");
        succeed(&dir, &format!("fit 2.csv 1.csv 3.csv {fitted} {keep} --partial sums.json"));
        succeed(&dir, "merge late.json 1.json --partial merged.json");
        let read = |name| fs::read(dir.path().join(name)).unwrap();
        assert!(read("merged.json") == read("sums.json"), "{keep}");
        let mut bytes = Vec::new();
        for parts in
            ["1.json 2.json 3.json", "3.json 1.json 2.json", "late.json 1.json", "2.json two.json"]
        {
            succeed(&dir, &format!("merge {parts} {model} {merge} -o merged.json"));
            let merged = document(&dir, "merged.json");
            assert!(merged["diagnostics"]["cross_validation"]["grouped"].is_array());
            assert_eq!(without_rows(&merged), without_rows(&whole), "{keep} {parts}");
            bytes.push(fs::read(dir.path().join("merged.json")).unwrap());
        }
        assert!(bytes.windows(2).all(|pair| pair[0] == pair[1]), "{keep}");
    }
}

#[test]
fn a_smaller_model_is_fitted_to_the_sums_of_a_larger_one() {
    let dir = recordings();
    succeed(&dir, "fit --model cubic 1.csv 2.csv --cv -o whole.json");
    succeed(&dir, "fit 1.csv 2.csv --model poly3 --groups --partial all.json");
    succeed(&dir, "merge all.json --model cubic --cv -o merged.json");
    let (whole, merged) = (document(&dir, "whole.json"), document(&dir, "merged.json"));
    assert_eq!(without_rows(&merged), without_rows(&whole));
    succeed(&dir, "fit 1.csv --model linear --partial linear.json");
    let error = refused(&dir, "merge linear.json --model cubic");
    assert!(
        error.contains("the sums are for `linear + offset` features, not for `cubic + offset`"),
        "{error}"
    );
}

#[test]
fn options_that_need_groups_are_refused_without_them() {
    let dir = recordings();
    succeed(&dir, "fit 1.csv --partial bare.json");
    succeed(&dir, "fit 2.csv --groups --partial two.json");
    succeed(&dir, "fit 3.csv --groups=file --partial three.json");
    fs::create_dir(dir.path().join("b")).unwrap();
    fs::copy(dir.path().join("1.csv"), dir.path().join("b/3.csv")).unwrap();
    // Another file of the same name, as another machine may have.
    succeed(&dir.path().join("b"), "fit 3.csv --groups=file --partial 3.json");
    let cases = [
        ("merge bare.json --cv", "keep no sums of groups"),
        ("merge bare.json --model auto", "--partial --groups"),
        ("merge bare.json --covariance groups", "keep no sums of groups"),
        ("merge bare.json two.json", "`two.json`: it keeps the sums of groups, expected no"),
        ("merge two.json bare.json", "it keeps no sums of groups, expected the"),
        ("merge two.json three.json", "its groups are those of `file`, expected `column`"),
        ("merge three.json b/3.json", "another file with other rows is called `3.csv`"),
        ("merge three.json --cv", "at least `2` groups are needed, found `1`"),
        ("merge two.json --cv=1", "a number of folds from 2 up"),
        ("fit 1.csv --groups", "--partial"),
        ("fit 1.csv --model auto --partial x.json", "`--groups`"),
        ("fit 1.csv --model physics --groups --partial x.json", "physics has no sums"),
    ];
    for (arguments, expected) in cases {
        let error = refused(&dir, arguments);
        assert!(error.contains(expected), "{arguments}: {error}");
    }
}

#[test]
fn groups_that_were_tampered_with_are_refused() {
    let dir = recordings();
    succeed(&dir, "fit 1.csv --model linear --groups --partial 1.json");
    let text = fs::read_to_string(dir.path().join("1.json")).unwrap();
    assert_eq!(sealed(&text), text);
    let groups = text.find("\"sums\"").unwrap();
    let label = "\"label\": \"";
    let second = text[groups..].match_indices(label).nth(1).unwrap().0 + groups + label.len();
    let second = &text[second..][..text[second..].find('"').unwrap()];
    let first = text[groups..].find(label).unwrap() + groups + label.len();
    let first = &text[first..][..text[first..].find('"').unwrap()];
    let random = text.find("\"random\"").unwrap();
    let rows = text[random..].find("\"rows\": ").unwrap() + random + "\"rows\": ".len();
    let of_random = &text[rows..][..text[rows..].find(',').unwrap()];
    let more = (of_random.parse::<u64>().unwrap() + 1).to_string();
    let cases = [
        ("\"place\": 0", "\"place\": 1", "label or place is taken"),
        ("\"source\": 0", "\"source\": 1", "of no source"),
        ("\"by\": \"column\"", "\"by\": \"colour\"", "unknown variant `colour`"),
        ("\"held_out_folds\": 2", "\"held_out_folds\": 3", "that are held out"),
        (&format!("{label}{second}\""), &format!("{label}{first}\""), "label or place is taken"),
        (&format!("\"rows\": {of_random}"), &format!("\"rows\": {more}"), "the sum of ones"),
    ];
    for (from, to, expected) in cases {
        assert!(text.contains(from), "{from}");
        fs::write(dir.path().join("bad.json"), sealed(&text.replacen(from, to, 1))).unwrap();
        let error = refused(&dir, "merge bad.json");
        assert!(error.contains(expected), "{from}: {error}");
        fs::write(dir.path().join("bad.json"), text.replacen(from, to, 1)).unwrap();
        refused(&dir, "merge bad.json");
    }
    // The sums of one group replaced by those of another with as many rows.
    let mut document: serde_json::Value = serde_json::from_str(&text).unwrap();
    let sums = document["groups"]["sums"].as_array_mut().unwrap();
    let (a, b) = (sums[0]["moments"].clone(), sums[1]["moments"].clone());
    assert!(a != b);
    sums[0]["moments"] = b;
    let swapped = serde_json::to_string_pretty(&document).unwrap() + "\n";
    let (content, _) = swapped.rsplit_once(",\n  \"checksum\"").unwrap_or((&swapped, ""));
    fs::write(dir.path().join("bad.json"), content).unwrap();
    refused(&dir, "merge bad.json");
    // A file without its checksum is not read, even if the rest is right.
    let (content, _) = text.rsplit_once(",\n  \"checksum\"").unwrap();
    fs::write(dir.path().join("bad.json"), format!("{content}\n}}\n")).unwrap();
    assert!(refused(&dir, "merge bad.json").contains("its last line but one is no checksum"));
}

fn piped(dir: &TempDir, arguments: &str, input: &[u8]) -> Output {
    use std::io::Write;
    let mut child = program::command(dir.path())
        .args(arguments.split_whitespace())
        .stdin(std::process::Stdio::piped())
        .stdout(std::process::Stdio::piped())
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    // A program that ends early reads no more, so that the write may fail.
    let _ = child.stdin.take().unwrap().write_all(input);
    child.wait_with_output().unwrap()
}

#[test]
fn partial_fits_pass_through_pipes() {
    let dir = recordings();
    let mut stream = Vec::new();
    for file in [2, 3, 1] {
        let (printed, said) = ended(&dir, &format!("fit {file}.csv --groups --partial -"), 0);
        assert!(said.contains("cubic + offset: sums over"), "{said}");
        stream.extend(printed.into_bytes());
        succeed(&dir, &format!("fit {file}.csv --groups --partial {file}.json"));
    }
    let expected = succeed(&dir, "merge 1.json 2.json 3.json --partial all.json -q");
    assert!(!expected.is_empty());
    let output = piped(&dir, "merge - --partial -", &stream);
    assert_eq!(output.status.code(), Some(0));
    assert!(output.stdout == fs::read(dir.path().join("all.json")).unwrap());
    // A file and the stream together: the first part of the stream repeats the rows of the file.
    assert_eq!(piped(&dir, "merge - -o cal.json", &stream).status.code(), Some(0));
    let twice = piped(&dir, "merge 2.json -", &stream);
    let said = String::from_utf8_lossy(&twice.stderr).into_owned();
    assert_eq!(twice.status.code(), Some(2));
    assert!(said.contains("`-`, partial fit 2: its rows of `2.csv` have been counted"), "{said}");
    let skipped = piped(&dir, "merge 2.json - --skip-counted -o again.json", &stream);
    let said = String::from_utf8_lossy(&skipped.stderr).into_owned();
    assert!(said.contains("left out, `2.csv` has been counted already"), "{said}");
    let read = |name| fs::read(dir.path().join(name)).unwrap();
    assert!(read("again.json") == read("cal.json"));
    for (input, expected) in [
        (&b""[..], "no partial fits were given"),
        (b"nonsense\n", "`-`: line 1, column 2: not valid JSON"),
        (&stream[..stream.len() - 9], "not valid JSON"),
    ] {
        let output = piped(&dir, "merge - -o none.json", input);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2));
        assert!(said.contains(expected), "{said}");
    }
    assert!(refused(&dir, "fit 1.csv --partial - --json").contains("leave out `--json`"));
}

#[test]
fn a_partial_fit_that_contradicts_the_others_is_named() {
    let dir = tempfile::tempdir().unwrap();
    for part in 1..=5 {
        succeed(&dir, &format!("synth train --rows 600 --rate 10 --seed {part} -o {part}.csv"));
    }
    let spoil = |change: &dyn Fn(&mut Vec<String>)| {
        let text = fs::read_to_string(dir.path().join("3.csv")).unwrap();
        let (header, rows) = text.split_once('\n').unwrap();
        let columns: Vec<&str> = header.split(',').collect();
        let first = columns.iter().position(|name| *name == "fx_n").unwrap();
        let changed = |row: &str| {
            let mut fields: Vec<String> = row.split(',').map(str::to_owned).collect();
            let mut wrench: Vec<String> = fields.drain(first..first + 6).collect();
            change(&mut wrench);
            fields.splice(first..first, wrench);
            fields.join(",")
        };
        let rows: Vec<String> = rows.lines().map(changed).collect();
        fs::write(dir.path().join("spoilt.csv"), format!("{header}\n{}\n", rows.join("\n")))
            .unwrap();
    };
    let merged = |third: &str| {
        let mut parts = String::new();
        for log in ["1.csv", "2.csv", third, "4.csv", "5.csv"] {
            succeed(&dir, &format!("fit {log} --model cubic --partial {log}.json"));
            parts += &format!(" {log}.json");
        }
        ended(&dir, &format!("merge{parts} -o cal.json"), 0).1
    };
    assert!(!merged("3.csv").contains("times as much as the other partial fits"));
    let in_mm = |load: &mut String| *load = (1e3 * load.parse::<f64>().unwrap()).to_string();
    type Spoiling<'a> = &'a dyn Fn(&mut Vec<String>);
    let spoilings: [Spoiling<'_>; 2] =
        [&|wrench| wrench.swap(0, 1), &|wrench| wrench[3..].iter_mut().for_each(in_mm)];
    for change in spoilings {
        spoil(change);
        let said = merged("spoilt.csv");
        assert!(said.contains("`spoilt.csv.json` errs "), "{said}");
        assert_eq!(said.matches("times as much as the other partial fits").count(), 1, "{said}");
    }
}

/// Memory holds the sum, one partial fit and the first hundred, while 10,000 are 34 MB of text.
#[cfg(target_os = "linux")]
#[test]
fn ten_thousand_partial_fits_are_merged_in_flat_memory() {
    use std::io::Write;
    let dir = tempfile::tempdir().unwrap();
    succeed(&dir, "synth train --rows 60 --rate 10 -o 1.csv");
    succeed(&dir, "fit 1.csv --model linear --partial 1.json");
    let text = fs::read_to_string(dir.path().join("1.json")).unwrap();
    // Each part needs its own checksum and digest, since the same rows count once.
    let own = |begin: &str| {
        let start = text.find(begin).unwrap() + begin.len();
        text[start..start + 32].to_owned()
    };
    let (checksum, digest) = (own("xxh128:"), own("\"digest\": \"rows:60:"));
    let mut child = program::command(dir.path())
        .args(["merge", "-", "-o", "cal.json", "--json"])
        .stdin(std::process::Stdio::piped())
        .stdout(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    let mut input = child.stdin.take().unwrap();
    for part in 0..10_000u32 {
        let part = format!("{part:032x}");
        let part = text.replace(&checksum, &part).replace(&digest, &part);
        input.write_all(sealed(&part).as_bytes()).unwrap();
    }
    let status = fs::read_to_string(format!("/proc/{}/status", child.id())).unwrap();
    drop(input);
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap();
    let kilobytes: u64 = peak.trim().trim_end_matches(" kB").parse().unwrap();
    assert!(kilobytes < 24_000, "{kilobytes} kB");
    let output = child.wait_with_output().unwrap();
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(report["partial_fits"], 10_000);
    assert_eq!(report["rows"], 600_000);
}
