//! Reads concatenated partial fits, as from `cat`, with one in memory at a time.

use std::io::{self, BufRead, Read};
use std::path::PathBuf;

use super::super::{CalibrationFileError, Problem};
use super::PartialFit;
use crate::checksum::END;
use crate::input::DocumentKind;

#[derive(Debug)]
pub struct PartialStream<R> {
    reader: R,
    name: PathBuf,
    lines: usize,
    document: Vec<u8>,
    has_failed: bool,
    parse: fn(&[u8]) -> Result<PartialFit, Problem>,
}

impl<R: BufRead> PartialStream<R> {
    pub fn new(reader: R, name: impl Into<PathBuf>) -> Self {
        let (name, document) = (name.into(), Vec::new());
        Self { reader, name, lines: 0, document, has_failed: false, parse: PartialFit::parse }
    }

    pub fn edited(self) -> Self {
        Self { parse: PartialFit::parse_edited, ..self }
    }

    fn error(&mut self, problem: Problem) -> CalibrationFileError {
        self.has_failed = true;
        CalibrationFileError { path: self.name.clone(), problem }
    }

    /// Reads the next whole document; returns false at the end of the stream.
    fn read_document(&mut self) -> io::Result<bool> {
        self.document.clear();
        let mut rest = (&mut self.reader).take(DocumentKind::Json.budget() + 1);
        while rest.read_until(b'\n', &mut self.document)? > 0 {
            if self.document.trim_ascii().is_empty() {
                self.document.clear();
                self.lines += 1;
                continue;
            }
            // Stop early if this is not a document.
            if self.document.trim_ascii_start().first().is_some_and(|&byte| byte != b'{') {
                return Ok(true);
            }
            if self.document.ends_with(END.as_bytes()) {
                return Ok(true);
            }
        }
        if self.document.len() as u64 > DocumentKind::Json.budget() {
            return Err(DocumentKind::Json.too_long());
        }
        Ok(!self.document.trim_ascii().is_empty())
    }
}

impl<R: BufRead> Iterator for PartialStream<R> {
    type Item = Result<PartialFit, CalibrationFileError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.has_failed {
            return None;
        }
        match self.read_document() {
            Ok(false) => return None,
            Ok(true) => {}
            Err(error) => return Some(Err(self.error(Problem::Io(error)))),
        }
        let lines = self.lines;
        self.lines += memchr::memchr_iter(b'\n', &self.document).count();
        let partial = (self.parse)(&self.document);
        Some(partial.map_err(|problem| self.error(problem.after_lines(lines))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Role, SourceFile, Sums};
    use calibration::exact::Accumulator;
    use calibration::model::{Basis, Model};

    fn partial(rows: usize) -> PartialFit {
        let mut sums = Accumulator::new(Basis::Linear, 1);
        let readings = vec![(0..rows).map(|row| row as f64).collect()];
        sums.absorb(&readings, &vec![vec![0.25; rows]; 6]).unwrap();
        let model = Model { basis: Basis::Linear, intercept: true, channels: 1, memory: 0 };
        let mut partial = PartialFit::new(model, Sums::Exact(sums.finish().unwrap()));
        let path = "log.csv".into();
        partial.sources = vec![SourceFile {
            role: Role::Train,
            path,
            checksum: None,
            digest: None,
            rows: rows as u64,
        }];
        partial
    }

    #[test]
    fn partial_fits_are_read_one_by_one() {
        let parts = [partial(3), partial(5)];
        let text = parts.iter().map(PartialFit::to_json).collect::<Vec<_>>().join("\n");
        let read: Vec<_> =
            PartialStream::new(text.as_bytes(), "-").collect::<Result<_, _>>().unwrap();
        assert_eq!(read, parts);
        assert!(PartialStream::new(&b"\n \n"[..], "-").next().is_none());
    }

    #[test]
    fn a_fault_is_reported_by_line_and_ends_the_stream() {
        let good = partial(3).to_json();
        let lines = good.lines().count();
        let bad = good.replacen("\"model\"", "\"muddle\"", 1);
        let cut = &good[..good.len() - 4];
        for (second, line) in [(bad.as_str(), None), (cut, None), ("nonsense\n", Some(1))] {
            let text = format!("{good}{second}{good}");
            let mut stream = PartialStream::new(text.as_bytes(), "-");
            assert!(stream.next().unwrap().is_ok());
            let error = stream.next().unwrap().unwrap_err();
            match error.problem {
                Problem::Field(fault) | Problem::NotJson(fault) => {
                    let found = fault.line;
                    assert!(found > lines && line.is_none_or(|line| found == lines + line));
                }
                problem => panic!("{problem}"),
            }
            assert!(stream.next().is_none());
        }
    }
}
