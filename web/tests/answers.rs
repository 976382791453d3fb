//! The answers to the page, without a browser.

use std::io::Write;
use std::sync::Arc;

use flate2::Compression;
use flate2::write::GzEncoder;
use serde_json::{Value, json};
use shellcal_web::{Answer, Progress, answer};

const TRAIN: &[u8] = include_bytes!("../../calibration-data/synthetic-train.csv");
const ZERO: &[u8] = include_bytes!("../../calibration-data/synthetic-zero.csv");
const PARQUET: &[u8] = include_bytes!("../../crates/table-file/tests/nested.parquet");

const UNWATCHED: Progress<'_> = Progress { bytes: &|_| (), folds: &|_, _| () };

fn ask(request: &Value, files: &[&[u8]]) -> Answer {
    let files: Vec<Arc<[u8]>> = files.iter().map(|&bytes| bytes.into()).collect();
    answer(request.to_string().as_bytes(), &files, UNWATCHED)
}

fn examine(name: &str, bytes: &[u8]) -> Value {
    ask(&json!({ "task": "examine", "log": { "name": name, "file": 0 } }), &[bytes]).document
}

fn fit(columns: &Value, log: &[u8]) -> Answer {
    let request = json!({
        "task": "fit", "train": [{ "name": "a.csv", "file": 0 }], "columns": columns, "model": "linear",
        "date": "2026-01-01T00:00:00Z",
    });
    ask(&request, &[log])
}

#[test]
fn files_are_recognised_by_their_bytes() {
    let plain = examine("a.csv", TRAIN);
    assert_eq!(plain["columns"][1], json!({ "name": "s1", "meaning": "sensor 1" }));
    assert_eq!((&plain["fits"], &plain["has_readings"]), (&json!(true), &json!(true)));
    let mut packed = GzEncoder::new(Vec::new(), Compression::fast());
    packed.write_all(TRAIN).unwrap();
    let packed = examine("a", &packed.finish().unwrap());
    assert_eq!(packed["columns"], plain["columns"]);
    assert!(packed["kind"].as_str().unwrap().ends_with("gzip"), "{packed}");
    assert_eq!(examine("b", PARQUET)["kind"], "Parquet file");
    let broken = examine("b", &PARQUET[..400]);
    assert!(broken["findings"][0]["seen"].as_str().unwrap().contains("`b`"), "{broken}");
}

#[test]
fn a_fit_makes_a_calibration_that_converts() {
    let Answer { document, files } = fit(&json!({}), TRAIN);
    assert!(document["verdict"].to_string().contains("linear + offset"), "{document}");
    assert_eq!(
        document["command"],
        "shellcal fit 'a.csv' --model linear --output calibration.json --report report.html"
    );
    let names: Vec<&str> = files.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["calibration.json", "report.html"]);
    assert!(examine("c", &files[0].1)["kind"].as_str().unwrap().starts_with("calibration of 8"));
    let request = json!({
        "task": "convert", "calibration": { "name": "c", "file": 0 }, "log": { "name": "z.txt.gz", "file": 1 },
    });
    let converted = ask(&request, &[&files[0].1, ZERO]);
    assert_eq!(converted.document["frames"], 500);
    assert!(converted.document["figure"].as_str().unwrap().contains("<svg"));
    let (name, table) = &converted.files[0];
    assert_eq!(name, "z.wrench.csv");
    assert!(table.starts_with(b"t_s,fx_n,fy_n"));
}

#[test]
fn columns_that_were_assigned_count_and_are_remembered() {
    let text = String::from_utf8(TRAIN.to_vec()).unwrap();
    let (_, rows) = text.split_once('\n').unwrap();
    let unknown = format!("a,b,c,d,e,f,g,h,i,j,k,l,m,n,o,p\n{rows}");
    let columns = json!({
        "time": 1, "sensors": [2, 3, 4, 5, 6, 7, 8, 9], "wrench": [10, 11, 12, 13, 14, 15], "group": 16,
        "moments_in_mnm": false,
    });
    let Answer { files, document } = fit(&columns, unknown.as_bytes());
    let file: Value =
        serde_json::from_slice(&files.first().unwrap_or_else(|| panic!("{document}")).1).unwrap();
    assert_eq!(file["columns"]["sensors"][0], "b");
    let named: Value = serde_json::from_slice(&fit(&json!({}), TRAIN).files[0].1).unwrap();
    assert_eq!(file["coefficients"], named["coefficients"]);
}

#[test]
fn impossible_requests_are_refused() {
    let error = |answer: Answer| answer.document["error"].as_str().unwrap().to_owned();
    assert!(error(answer(b"{", &[], UNWATCHED)).contains("EOF"));
    assert_eq!(error(fit(&json!({}), b"")), "`a.csv` is empty");
    let request = json!({ "task": "examine", "log": { "name": "x", "file": 3 } });
    assert_eq!(error(ask(&request, &[])), "`x` did not come with the request");
    let no_wrench = fit(&json!({}), b"t_s,s1,s2\n0,1,2\n1,2,3\n");
    assert!(no_wrench.document["hint"].is_string(), "{}", no_wrench.document);
    assert!(examine("c", b"{}")["error"].as_str().unwrap().contains("schema_version"));
}
