//! Which document a file is.

use serde::Deserialize;

use super::problem::problem;
use super::{
    CalibrationFile, FEWER_AXES_SCHEMA_VERSION, PHYSICS_SCHEMA_VERSION, Problem, SCHEMA_VERSION,
    document, physics_document,
};

#[derive(Deserialize)]
struct Version {
    schema_version: u64,
}

/// Parses a document of any known version.
pub(super) fn parse(text: &[u8]) -> Result<CalibrationFile, Problem> {
    // The version first: a document of another version may differ in any other field.
    let Version { schema_version } = serde_json::from_slice(text).map_err(problem)?;
    match schema_version {
        SCHEMA_VERSION | FEWER_AXES_SCHEMA_VERSION => document::parse(text),
        PHYSICS_SCHEMA_VERSION => physics_document::parse(text),
        found => Err(Problem::SchemaVersion { found }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn another_schema_version_is_told_whatever_else_the_file_holds() {
        let Err(Problem::SchemaVersion { found: 4 }) = parse(b"{\"schema_version\": 4}") else {
            panic!()
        };
    }
}
