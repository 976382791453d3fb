//! The payload of a sensor as a JSON document.
//!
//! | field | content |
//! |---|---|
//! | `kind`, `schema_version` | `payload`, [`SCHEMA_VERSION`] |
//! | `made_by`, `date`, `sources` | program and version, UTC, the logs and their rows |
//! | `mass_kg`, `centre_m`, `force_bias_n`, `moment_bias_nm` | see [`forces::payload::Payload`] |
//! | `standard_errors` | for each of these |
//! | `residual_rms_n`, `residual_rms_nm`, `poses`, `spread_rad` | see [`PayloadFit`] |
//! | `gravity_m_s2` | gravity used to find the mass; 9.80665 in earlier documents, which do not state it |
//! | `accelerometer` | see [`Accelerometer`]; `null` without one |

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::input::{self, DocumentKind};
use crate::origin::as_unicode;
use crate::{CalibrationFileError, JsonFault, LARGEST, Problem};
use forces::payload::{Accelerometer, Payload, PayloadFit};

pub const SCHEMA_VERSION: u64 = 1;

const KIND: &str = "payload";

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PayloadFile {
    pub made_by: String,
    pub date: String,
    pub sources: Vec<PayloadSource>,
    #[serde(flatten)]
    pub fit: PayloadFit,
    pub accelerometer: Option<Accelerometer>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PayloadSource {
    #[serde(serialize_with = "as_unicode")]
    pub path: PathBuf,
    pub rows: u64,
}

#[derive(Serialize)]
struct PayloadDocument<'f> {
    kind: &'static str,
    schema_version: u64,
    #[serde(flatten)]
    file: &'f PayloadFile,
}

impl PayloadFile {
    /// # Errors
    /// [`CalibrationFileError`] if it cannot be read, or as [`Self::parse`].
    pub fn read(path: &Path) -> Result<Self, CalibrationFileError> {
        let parse = |text: &[u8]| Self::parse(text).map_err(Problem::Inconsistent);
        input::document(path, DocumentKind::Json, parse)
    }

    /// # Errors
    /// The reason and the position.
    pub fn parse(text: &[u8]) -> Result<Self, String> {
        let said = |error: serde_json::Error| {
            let JsonFault { line, column, message } = JsonFault::from(&error);
            format!("line {line}, column {column}: {message}")
        };
        // Check kind and version first: any other field may differ between them.
        let version: serde_json::Value = serde_json::from_slice(text).map_err(said)?;
        let is_payload = version.get("kind").and_then(|kind| kind.as_str()) == Some(KIND);
        ensure!(is_payload, "it is no payload: `kind` is not `{KIND}`");
        let found = version.get("schema_version").and_then(serde_json::Value::as_u64);
        let found = found.ok_or("`schema_version` is missing")?;
        let is_known = found == SCHEMA_VERSION;
        ensure!(is_known, "its schema version is `{found}`, this program reads `{SCHEMA_VERSION}`");
        let file: Self = serde_json::from_slice(text).map_err(said)?;
        file.check()?;
        Ok(file)
    }

    pub fn to_json(&self) -> String {
        let document = PayloadDocument { kind: KIND, schema_version: SCHEMA_VERSION, file: self };
        serde_json::to_string_pretty(&document).expect("plain numbers are always JSON") + "\n"
    }

    fn check(&self) -> Result<(), String> {
        let Payload { mass_kg, centre_m, force_bias_n, moment_bias_nm } = &self.fit.payload;
        let is_positive = *mass_kg > 0.0 && *mass_kg <= LARGEST;
        ensure!(is_positive, "`mass_kg` is `{mass_kg}`, expected a positive number");
        let gravity = self.fit.gravity_m_s2;
        let is_gravity = (0.1..=30.0).contains(&gravity);
        ensure!(is_gravity, "`gravity_m_s2` is `{gravity}`, expected m/s², from 0.1 to 30");
        let mut vectors = vec![
            ("centre_m", centre_m),
            ("force_bias_n", force_bias_n),
            ("moment_bias_nm", moment_bias_nm),
        ];
        if let Some(Accelerometer { matrix, offset_m_s2, .. }) = &self.accelerometer {
            vectors.extend(matrix.iter().map(|row| ("accelerometer.matrix", row)));
            vectors.push(("accelerometer.offset_m_s2", offset_m_s2));
        }
        for (name, vector) in vectors {
            for value in vector {
                let is_small = value.abs() <= LARGEST;
                ensure!(is_small, "`{name}` holds `{value}`, which is too large");
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file() -> PayloadFile {
        let payload = |k: f64| Payload {
            mass_kg: 0.1 * k,
            centre_m: [k, 0.0, -k],
            force_bias_n: [1.0 / 3.0, k, 0.0],
            moment_bias_nm: [0.0, 0.0, 1e-300],
        };
        PayloadFile {
            fit: PayloadFit {
                payload: payload(1.0),
                standard_errors: payload(0.01),
                residual_rms_n: 0.1,
                residual_rms_nm: 0.01,
                poses: 7,
                gravity_m_s2: 9.82,
                spread_rad: [0.5, 0.25],
            },
            accelerometer: Some(Accelerometer {
                matrix: [[1.0, 2.0, 3.0], [0.1, 0.2, 0.3], [0.0, 0.0, -1.0]],
                offset_m_s2: [0.1, 0.2, 0.7],
                residual_rms_m_s2: [0.0; 3],
            }),
            made_by: "test".to_owned(),
            date: "2017-07-14T02:40:00Z".to_owned(),
            sources: vec![PayloadSource { path: "poses.csv".into(), rows: 24 }],
        }
    }

    #[test]
    fn a_document_reads_back_unchanged() {
        let text = file().to_json();
        assert_eq!(PayloadFile::parse(text.as_bytes()), Ok(file()));
        let none = PayloadFile { accelerometer: None, ..file() };
        assert_eq!(PayloadFile::parse(none.to_json().as_bytes()), Ok(none));
    }

    #[test]
    fn other_documents_are_refused() {
        let said = |from: &str, to: &str| {
            let text = file().to_json().replacen(from, to, 1);
            PayloadFile::parse(text.as_bytes()).unwrap_err()
        };
        assert!(said("\"payload\"", "\"tool\"").contains("no payload"));
        assert!(said("\"schema_version\": 1", "\"schema_version\": 9").contains("version is `9`"));
        assert!(said("\"mass_kg\": 0.1", "\"mass_kg\": -0.1").contains("`mass_kg` is `-0.1`"));
        assert!(said("\"mass_kg\": 0.1", "\"mass_kg\": 1e999").contains("line "));
        assert!(said("\"mass_kg\": 0.1,", "").contains("missing field `mass_kg`"));
        assert!(said("0.333", "1e200, 0.333").contains("line "));
        assert!(PayloadFile::parse(b"{").unwrap_err().contains("line 1, column 1"));
    }
}
