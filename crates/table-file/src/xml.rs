//! A streaming parser for XML in workbooks: tags, attributes and text. Namespaces are removed; comments, processing
//! instructions and document types are skipped.

use std::io::{BufRead, BufReader, Read};

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct XmlTag {
    /// Text between the previous tag and this one.
    pub(crate) text: String,
    pub(crate) name: String,
    attributes: String,
    pub(crate) is_start: bool,
    /// True for `</a>`, and also `<a/>`.
    pub(crate) is_end: bool,
}

pub(crate) struct Xml<R> {
    stream: BufReader<R>,
    buffer: Vec<u8>,
}

/// The longest text or tag, in bytes.
pub(crate) const LONGEST: usize = 1 << 20;

impl<R: Read> Xml<R> {
    pub(crate) fn new(stream: R) -> Self {
        Self { stream: BufReader::with_capacity(1 << 16, stream), buffer: Vec::new() }
    }

    /// Returns the next tag; the error is a description in words.
    pub(crate) fn next(&mut self) -> Result<Option<XmlTag>, String> {
        let mut text = String::new();
        loop {
            self.buffer.clear();
            self.until(b'<')?;
            let is_tag = self.buffer.pop_if(|byte| *byte == b'<').is_some();
            text.push_str(&unescape(&String::from_utf8_lossy(&self.buffer)));
            if !is_tag {
                return Ok(None);
            }
            self.read_tag()?;
            let tag = String::from_utf8_lossy(&self.buffer);
            let tag = tag.strip_suffix('>').unwrap_or(&tag);
            if let Some(part) = tag.strip_prefix("![CDATA[").and_then(|tag| tag.strip_suffix("]]"))
            {
                text.push_str(part);
            }
            if text.len() >= LONGEST {
                return Err(too_long());
            }
            if tag.starts_with(['!', '?']) {
                continue;
            }
            let (is_start, is_end) =
                (!tag.starts_with('/'), tag.starts_with('/') || tag.ends_with('/'));
            let tag = tag.trim_matches('/');
            let (name, attributes) = tag.split_once(char::is_whitespace).unwrap_or((tag, ""));
            let name = name.rsplit_once(':').map_or(name, |(_, name)| name).to_owned();
            return Ok(Some(XmlTag {
                text,
                name,
                attributes: attributes.to_owned(),
                is_start,
                is_end,
            }));
        }
    }

    /// Appends the bytes up to and including the next `end`.
    fn until(&mut self, end: u8) -> Result<(), String> {
        let left = LONGEST.saturating_sub(self.buffer.len());
        let mut stream = (&mut self.stream).take(left as u64);
        stream.read_until(end, &mut self.buffer).map_err(|error| error.to_string())?;
        if self.buffer.len() < LONGEST { Ok(()) } else { Err(too_long()) }
    }

    /// Reads a tag after its `<`.
    fn read_tag(&mut self) -> Result<(), String> {
        let count = |bytes: &[u8], quote| bytes.iter().filter(|byte| **byte == quote).count();
        self.buffer.clear();
        loop {
            let before = self.buffer.len();
            self.until(b'>')?;
            if self.buffer.len() == before || !self.buffer.ends_with(b">") {
                return Err("it is cut off within a tag".to_owned());
            }
            let tag = &self.buffer[..];
            let is_whole = if tag.starts_with(b"!--") {
                tag.ends_with(b"-->")
            } else if tag.starts_with(b"![CDATA[") {
                tag.ends_with(b"]]>")
            } else {
                // A quoted value may contain `>`.
                count(tag, b'"') % 2 == 0 && (count(tag, b'"') > 0 || count(tag, b'\'') % 2 == 0)
            };
            if is_whole {
                return Ok(());
            }
        }
    }
}

fn too_long() -> String {
    format!("a text or tag longer than {LONGEST} bytes")
}

impl XmlTag {
    pub(crate) fn attribute(&self, name: &str) -> Option<String> {
        let mut rest = self.attributes.as_str();
        loop {
            let (key, after) = rest.split_once('=')?;
            let after = after.trim_start();
            let quote = after.chars().next().filter(|c| matches!(c, '"' | '\''))?;
            let (value, after) = after[1..].split_once(quote)?;
            let key = key.trim();
            if key.rsplit_once(':').map_or(key, |(_, key)| key) == name {
                return Some(unescape(value));
            }
            rest = after;
        }
    }
}

/// Replaces entity references; unknown ones stay.
fn unescape(text: &str) -> String {
    let mut plain = String::with_capacity(text.len());
    let mut rest = text;
    while let Some((before, after)) = rest.split_once('&') {
        plain.push_str(before);
        let reference = after.split_once(';').filter(|(name, _)| name.len() <= 10);
        let character = reference.and_then(|(name, _)| match name {
            "amp" => Some('&'),
            "lt" => Some('<'),
            "gt" => Some('>'),
            "quot" => Some('"'),
            "apos" => Some('\''),
            _ => {
                let code = name.strip_prefix('#')?;
                let code = match code.strip_prefix(['x', 'X']) {
                    Some(hexadecimal) => u32::from_str_radix(hexadecimal, 16),
                    None => code.parse(),
                };
                char::from_u32(code.ok()?)
            }
        });
        let (character, after) = match (character, reference) {
            (Some(character), Some((_, after))) => (character, after),
            _ => ('&', after),
        };
        plain.push(character);
        rest = after;
    }
    plain.push_str(rest);
    plain
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn elements_attributes_and_texts_are_found() {
        let text = "<?xml version=\"1.0\"?><!-- a > b --><x:c r='B5' x:t=\"s>\"><v>1 &lt; 2&#33;</v>\
                    <f/><![CDATA[<&]]></x:c>";
        let mut xml = Xml::new(text.as_bytes());
        let mut tags = Vec::new();
        while let Some(tag) = xml.next().unwrap() {
            tags.push(tag);
        }
        let [cell, value, value_end, formula, cell_end] = tags.as_slice() else {
            panic!("{tags:?}")
        };
        assert_eq!((cell.name.as_str(), cell.is_start, cell.is_end), ("c", true, false));
        assert_eq!(cell.attribute("r").as_deref(), Some("B5"));
        assert_eq!(cell.attribute("t").as_deref(), Some("s>"));
        assert_eq!(cell.attribute("u"), None);
        assert_eq!((value.text.as_str(), value.is_start), ("", true));
        assert_eq!((value_end.text.as_str(), value_end.is_start), ("1 < 2!", false));
        assert_eq!((formula.name.as_str(), formula.is_start, formula.is_end), ("f", true, true));
        assert_eq!((cell_end.text.as_str(), cell_end.is_end), ("<&", true));
    }

    #[test]
    fn what_is_cut_off_is_an_error() {
        let mut xml = Xml::new(&b"<a><b"[..]);
        assert!(xml.next().unwrap().is_some());
        assert!(xml.next().is_err());
    }
}
