//! The kinds of file that wrenches are written to.

use std::path::Path;

/// A kind of file.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum OutputFormat {
    /// Text.
    #[default]
    Csv,
    /// Parquet.
    Parquet,
    /// MATLAB 5: a variable for each column.
    Matlab,
    /// NumPy: an array of records.
    NumPy,
    /// MCAP for ROS 2: wrenches, and readings, errors and flags as JSON.
    Mcap {
        /// The frame of reference that the wrenches are in.
        frame_id: String,
    },
}

/// What is written besides wrenches, and as what.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OutputPlan {
    /// The kind of file.
    pub format: OutputFormat,
    /// Columns of the log, by place from 0, that are carried along as they stand.
    pub keep: Vec<usize>,
    /// Columns of text likewise, each once.
    pub keep_texts: Vec<usize>,
}

/// A file whose name does not say what it is to be.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{path}` ends in none of {}", EXTENSIONS.map(|(extension, _)| format!("`.{extension}`")).join(", "))]
pub struct UnknownExtension {
    /// The file.
    pub path: String,
}

/// The frame of reference that is named unless another is.
pub const DEFAULT_FRAME_ID: &str = "shell";

const EXTENSIONS: [(&str, OutputFormat); 6] = [
    ("csv", OutputFormat::Csv),
    ("txt", OutputFormat::Csv),
    ("parquet", OutputFormat::Parquet),
    ("mat", OutputFormat::Matlab),
    ("npy", OutputFormat::NumPy),
    ("mcap", OutputFormat::Mcap { frame_id: String::new() }),
];

impl OutputFormat {
    /// What the name of a file says; devices and pipes, which have no such name, get CSV.
    ///
    /// # Errors
    /// [`UnknownExtension`].
    pub fn of(path: &Path, frame_id: &str) -> Result<Self, UnknownExtension> {
        let extension = path.extension().map(|it| it.to_string_lossy().to_lowercase());
        let known = EXTENSIONS.into_iter().find(|(known, _)| extension.as_deref() == Some(known));
        match known {
            Some((_, Self::Mcap { .. })) => Ok(Self::Mcap { frame_id: frame_id.to_owned() }),
            Some((_, format)) => Ok(format),
            None if path.starts_with("/dev") => Ok(Self::Csv),
            None => Err(UnknownExtension { path: path.display().to_string() }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_what_their_names_say() {
        let of = |path: &str| OutputFormat::of(Path::new(path), "base");
        assert_eq!(of("a/b.CSV"), Ok(OutputFormat::Csv));
        assert_eq!(of("b.parquet"), Ok(OutputFormat::Parquet));
        assert_eq!(of("b.mcap"), Ok(OutputFormat::Mcap { frame_id: "base".to_owned() }));
        assert_eq!(of("/dev/null"), Ok(OutputFormat::Csv));
        for path in ["b", "b.xlsx", "b.feather", ".csv"] {
            let said = of(path).unwrap_err().to_string();
            assert!(said.contains(path) && said.contains("`.parquet`"), "{said}");
        }
    }
}
