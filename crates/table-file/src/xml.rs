//! The part of XML that workbooks are written in: elements, attributes and text, as a stream.
//! Namespaces are cut off; comments, instructions and document types are skipped.

use std::io::{BufRead, BufReader, Read};

/// What stands in a document.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum XmlEvent {
    /// The start of an element; one that ends at once is followed by its end.
    Start(XmlElement),
    End(String),
    Text(String),
}

/// The name of an element, and its attributes as they stand.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct XmlElement {
    pub(crate) name: String,
    attributes: String,
}

/// A stream of events.
pub(crate) struct Xml<R> {
    stream: BufReader<R>,
    buffer: Vec<u8>,
    /// Whether the `<` of a tag has been read.
    in_tag: bool,
    /// The end of an element that ended at once.
    end: Option<String>,
}

/// The longest text or tag.
const LONGEST: usize = 1 << 20;

impl<R: Read> Xml<R> {
    pub(crate) fn new(stream: R) -> Self {
        let stream = BufReader::with_capacity(1 << 16, stream);
        Self { stream, buffer: Vec::new(), in_tag: false, end: None }
    }

    /// The next event; what is wrong is said in words.
    pub(crate) fn next(&mut self) -> Result<Option<XmlEvent>, String> {
        if let Some(name) = self.end.take() {
            return Ok(Some(XmlEvent::End(name)));
        }
        loop {
            self.buffer.clear();
            if !self.in_tag {
                self.until(b'<')?;
                self.in_tag = self.buffer.pop_if(|byte| *byte == b'<').is_some();
                if !self.buffer.is_empty() {
                    return Ok(Some(XmlEvent::Text(unescape(&String::from_utf8_lossy(
                        &self.buffer,
                    )))));
                }
                if !self.in_tag {
                    return Ok(None);
                }
            }
            self.in_tag = false;
            if let Some(event) = self.tag()? {
                return Ok(Some(event));
            }
        }
    }

    /// Adds what comes before the next `end`, and that.
    fn until(&mut self, end: u8) -> Result<(), String> {
        let left = LONGEST.saturating_sub(self.buffer.len());
        let mut stream = (&mut self.stream).take(left as u64);
        stream.read_until(end, &mut self.buffer).map_err(|error| error.to_string())?;
        match self.buffer.len() < LONGEST {
            true => Ok(()),
            false => Err(format!("a text or tag longer than {LONGEST} bytes")),
        }
    }

    /// The tag whose `<` has been read; `None` if it is none that matters.
    fn tag(&mut self) -> Result<Option<XmlEvent>, String> {
        let count = |bytes: &[u8], quote| bytes.iter().filter(|byte| **byte == quote).count();
        loop {
            let before = self.buffer.len();
            self.until(b'>')?;
            if self.buffer.len() == before || !self.buffer.ends_with(b">") {
                return Err("it is cut off within a tag".to_owned());
            }
            let tag = &self.buffer[..];
            let is_open = if tag.starts_with(b"!--") {
                !tag.ends_with(b"-->")
            } else if tag.starts_with(b"![CDATA[") {
                !tag.ends_with(b"]]>")
            } else {
                // A `>` may stand in quotes.
                count(tag, b'"') % 2 == 1 || (count(tag, b'"') == 0 && count(tag, b'\'') % 2 == 1)
            };
            if !is_open {
                break;
            }
        }
        let text = String::from_utf8_lossy(&self.buffer);
        let tag = text.strip_suffix('>').unwrap_or(&text);
        if let Some(text) = tag.strip_prefix("![CDATA[").and_then(|tag| tag.strip_suffix("]]")) {
            return Ok(Some(XmlEvent::Text(text.to_owned())));
        }
        if tag.starts_with(['!', '?']) {
            return Ok(None);
        }
        if let Some(name) = tag.strip_prefix('/') {
            return Ok(Some(XmlEvent::End(local(name.trim()))));
        }
        let (tag, ends) = tag.strip_suffix('/').map_or((tag, false), |tag| (tag, true));
        let (name, attributes) = tag.split_once(|c: char| c.is_whitespace()).unwrap_or((tag, ""));
        let element = XmlElement { name: local(name), attributes: attributes.to_owned() };
        self.end = ends.then(|| element.name.clone());
        Ok(Some(XmlEvent::Start(element)))
    }
}

impl XmlElement {
    /// The value of an attribute, whose name may come from a namespace.
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

fn local(name: &str) -> String {
    name.rsplit_once(':').map_or(name, |(_, name)| name).to_owned()
}

/// Text with its references replaced; those that are not known stay.
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
        let mut events = Vec::new();
        while let Some(event) = xml.next().unwrap() {
            events.push(event);
        }
        let XmlEvent::Start(cell) = &events[0] else { panic!("{events:?}") };
        assert_eq!(cell.name, "c");
        assert_eq!(cell.attribute("r").as_deref(), Some("B5"));
        assert_eq!(cell.attribute("t").as_deref(), Some("s>"));
        assert_eq!(cell.attribute("u"), None);
        assert_eq!(events[2], XmlEvent::Text("1 < 2!".to_owned()));
        assert_eq!(events[5], XmlEvent::End("f".to_owned()));
        assert_eq!(events[6], XmlEvent::Text("<&".to_owned()));
        assert_eq!(events.len(), 8);
    }

    #[test]
    fn what_is_cut_off_is_an_error() {
        let mut xml = Xml::new(&b"<a><b"[..]);
        assert!(xml.next().unwrap().is_some());
        assert!(xml.next().is_err());
    }
}
