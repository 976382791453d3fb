//! Reads whole documents (logs are streamed) if the beginning has the expected form, within a budget that keeps a
//! wrong file, a device or an endless pipe from filling the memory.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

use super::{CalibrationFileError, Problem};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DocumentKind {
    /// JSON: calibrations and partial fits.
    Json,
    /// Lines of text: tables, manifests, profiles.
    Text,
    Matrix,
}

impl DocumentKind {
    pub const fn budget(self) -> u64 {
        match self {
            // A calibration of the largest model with a covariance by groups.
            DocumentKind::Json => 512 << 20,
            // A table of some million rows.
            DocumentKind::Text => 256 << 20,
            // The largest model takes 200 kB.
            DocumentKind::Matrix => 16 << 20,
        }
    }

    pub(crate) fn too_long(self) -> io::Error {
        refusal(format!("it is longer than the {} MB that are read", self.budget() >> 20))
    }

    fn check(self, first: &[u8]) -> Result<(), &'static str> {
        match self {
            DocumentKind::Text if first.starts_with(b"PK\x03\x04") => {
                Err("it is a workbook or an archive: save the table as CSV")
            }
            DocumentKind::Json | DocumentKind::Text if first.contains(&0) => Err("it is not text"),
            DocumentKind::Matrix if first.starts_with(&[0; 16]) => Err("it is empty but for zeros"),
            _ => Ok(()),
        }
    }
}

/// # Errors
/// An error of the system; `InvalidData` if the document is too long or its beginning has the wrong form.
pub fn read(path: &Path, document: DocumentKind) -> io::Result<Vec<u8>> {
    // Check before opening: opening a pipe blocks until it has a writer.
    let metadata = std::fs::metadata(path)?;
    if !metadata.is_file() && !metadata.is_dir() {
        return Err(refusal("it is not a regular file"));
    }
    let file = File::open(path)?;
    let (length, budget) = (file.metadata()?.len(), document.budget());
    if length > budget {
        return Err(document.too_long());
    }
    let mut bytes = Vec::with_capacity(usize::try_from(length).unwrap_or(0));
    let mut file = file.take(budget + 1);
    file.by_ref().take(1 << 12).read_to_end(&mut bytes)?;
    document.check(&bytes).map_err(refusal)?;
    let first = bytes.trim_ascii_start().first();
    if document == DocumentKind::Json && first != Some(&b'{') {
        // The beginning is enough for an error message.
        return Ok(bytes);
    }
    file.read_to_end(&mut bytes)?;
    if bytes.len() as u64 > budget {
        return Err(document.too_long());
    }
    Ok(bytes)
}

pub(crate) fn document<T>(
    path: &Path,
    kind: DocumentKind,
    parse: impl Fn(&[u8]) -> Result<T, Problem>,
) -> Result<T, CalibrationFileError> {
    let content = read(path, kind).map_err(Problem::Io).and_then(|bytes| parse(&bytes));
    content.map_err(|problem| CalibrationFileError { path: path.to_path_buf(), problem })
}

/// Reads the text of a document.
///
/// # Errors
/// As for [`read`]; `InvalidData` if it is not UTF-8.
pub fn read_text(path: &Path) -> io::Result<String> {
    let bytes = read(path, DocumentKind::Text)?;
    String::from_utf8(bytes).map_err(|error| {
        let line =
            1 + memchr::memchr_iter(b'\n', &error.as_bytes()[..error.utf8_error().valid_up_to()])
                .count();
        refusal(format!("line {line} is not UTF-8"))
    })
}

fn refusal(why: impl Into<String>) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, why.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wrong_beginning_is_refused_before_the_rest_is_read() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("file");
        for (bytes, document, is_right) in [
            (&b"{}"[..], DocumentKind::Json, true),
            (b"\n {", DocumentKind::Json, true),
            (b"", DocumentKind::Json, true),
            (b"{\0", DocumentKind::Json, false),
            (b"a,b\n", DocumentKind::Text, true),
            (b"a\0", DocumentKind::Text, false),
            (b"MATLAB\0", DocumentKind::Matrix, true),
        ] {
            std::fs::write(&path, bytes).unwrap();
            let read = read(&path, document);
            assert_eq!(read.is_ok(), is_right, "{bytes:?}");
            assert!(read.is_err() || read.unwrap() == bytes);
        }
    }

    #[test]
    fn a_file_beyond_the_budget_is_refused_by_its_length() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("file");
        File::create(&path).unwrap().set_len(10 << 30).unwrap();
        for document in [DocumentKind::Json, DocumentKind::Text, DocumentKind::Matrix] {
            let error = read(&path, document).unwrap_err().to_string();
            assert!(error.contains("longer than the"), "{error}");
        }
    }

    #[cfg(unix)]
    #[test]
    fn an_endless_device_is_refused_at_once() {
        for document in [DocumentKind::Json, DocumentKind::Text, DocumentKind::Matrix] {
            assert!(read(Path::new("/dev/zero"), document).is_err());
        }
    }
}
