//! The layout of the JSON documents: objects over several lines, rows of numbers on one.

use std::io::{self, Write};

use serde::Serialize;
use serde_json::ser::Formatter;

pub(super) fn to_json(document: &impl Serialize) -> String {
    let mut json = Vec::new();
    let mut serializer = serde_json::Serializer::with_formatter(&mut json, Layout::default());
    document.serialize(&mut serializer).expect("plain numbers and strings are always JSON");
    json.push(b'\n');
    String::from_utf8(json).expect("JSON is UTF-8")
}

#[derive(Debug, Default)]
struct Layout {
    indent: usize,
    arrays: usize,
}

impl Layout {
    fn inline(&self) -> bool {
        self.arrays > 1
    }

    fn separate<W: ?Sized + Write>(&self, writer: &mut W, first: bool) -> io::Result<()> {
        writer.write_all(match (first, self.inline()) {
            (true, true) => b"",
            (false, true) => b", ",
            (true, false) => b"\n",
            (false, false) => b",\n",
        })?;
        let indent = if self.inline() { 0 } else { self.indent };
        (0..indent).try_for_each(|_| writer.write_all(b"  "))
    }

    fn end<W: ?Sized + Write>(&mut self, writer: &mut W, close: &[u8]) -> io::Result<()> {
        self.indent -= 1;
        if !self.inline() {
            writer.write_all(b"\n")?;
            (0..self.indent).try_for_each(|_| writer.write_all(b"  "))?;
        }
        writer.write_all(close)
    }
}

impl Formatter for Layout {
    fn begin_array<W: ?Sized + Write>(&mut self, writer: &mut W) -> io::Result<()> {
        self.indent += 1;
        self.arrays += 1;
        writer.write_all(b"[")
    }

    fn end_array<W: ?Sized + Write>(&mut self, writer: &mut W) -> io::Result<()> {
        self.end(writer, b"]")?;
        self.arrays -= 1;
        Ok(())
    }

    fn begin_array_value<W: ?Sized + Write>(
        &mut self,
        writer: &mut W,
        first: bool,
    ) -> io::Result<()> {
        self.separate(writer, first)
    }

    fn begin_object<W: ?Sized + Write>(&mut self, writer: &mut W) -> io::Result<()> {
        self.indent += 1;
        writer.write_all(b"{")
    }

    fn end_object<W: ?Sized + Write>(&mut self, writer: &mut W) -> io::Result<()> {
        self.end(writer, b"}")
    }

    fn begin_object_key<W: ?Sized + Write>(
        &mut self,
        writer: &mut W,
        first: bool,
    ) -> io::Result<()> {
        self.separate(writer, first)
    }

    fn begin_object_value<W: ?Sized + Write>(&mut self, writer: &mut W) -> io::Result<()> {
        writer.write_all(b": ")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_of_numbers_stay_on_one_line() {
        let value = serde_json::json!({"a": [[1, 2], [3, 4]], "b": {"c": []}});
        let expected = "{\n  \"a\": [\n    [1, 2],\n    [3, 4]\n  ],\n  \"b\": {\n    \"c\": [\n    ]\n  }\n}\n";
        assert_eq!(to_json(&value), expected);
    }
}
