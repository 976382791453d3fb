//! Escaping text for other languages, with one function per language. Names of files, columns, groups and sensors may
//! contain any characters. The escaped text is data in its language, and reads as the original if the language can
//! represent it.

use std::borrow::Cow;
use std::fmt::Write;

/// Returns true if a character is not visible: controls, line ends, characters that change the
/// direction of text, and characters without width (Unicode 15.1, categories Cc, Cf, Zl and Zp).
pub const fn is_invisible(character: char) -> bool {
    matches!(
        character,
        '\0'..='\x1f' | '\x7f'..='\u{9f}' | '\u{ad}' | '\u{600}'..='\u{605}' | '\u{61c}' | '\u{6dd}' | '\u{70f}'
        | '\u{890}'..='\u{891}' | '\u{8e2}' | '\u{180e}' | '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}'
        | '\u{2060}'..='\u{206f}' | '\u{feff}' | '\u{fff9}'..='\u{fffb}' | '\u{110bd}' | '\u{110cd}'
        | '\u{13430}'..='\u{1343f}' | '\u{1bca0}'..='\u{1bca3}' | '\u{1d173}'..='\u{1d17a}'
        | '\u{e0001}' | '\u{e0020}'..='\u{e007f}'
    )
}

fn replace(
    text: &str,
    is_special: impl Fn(char) -> bool,
    replaced: impl Fn(char, &mut String),
) -> Cow<'_, str> {
    if !text.contains(&is_special) {
        return Cow::Borrowed(text);
    }
    let mut out = String::with_capacity(text.len() + 16);
    for character in text.chars() {
        match is_special(character) {
            true => replaced(character, &mut out),
            false => out.push(character),
        }
    }
    Cow::Owned(out)
}

fn put(out: &mut String, arguments: std::fmt::Arguments<'_>) {
    out.write_fmt(arguments).expect("writing to a string does not fail");
}

/// Escapes text for one line of a terminal: invisible characters appear as Rust escapes.
pub fn terminal(text: &str) -> Cow<'_, str> {
    replace(text, is_invisible, |character, out| out.extend(character.escape_default()))
}

/// Escapes the invisible characters of a JSON document for a terminal, except for line ends.
pub fn json(document: &str) -> Cow<'_, str> {
    let is_special = |character| character != '\n' && is_invisible(character);
    replace(document, is_special, |character, out| {
        for unit in character.encode_utf16(&mut [0; 2]) {
            put(out, format_args!("\\u{unit:04x}"));
        }
    })
}

/// Escapes a JSON document for an HTML `script` element, so that it cannot end the element.
pub fn script_json(document: &str) -> Cow<'_, str> {
    let is_special = |character| matches!(character, '<' | '\u{2028}' | '\u{2029}');
    replace(document, is_special, |character, out| {
        put(out, format_args!("\\u{:04x}", u32::from(character)));
    })
}

/// Returns true if a character changes the direction of text, so that a page shows another text than it contains.
const fn turns(character: char) -> bool {
    matches!(character, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

/// Escapes text for an element or a quoted attribute in HTML and XML (SVG). Characters that XML
/// cannot represent, and those that change the direction of text, become U+FFFD.
pub fn markup(text: &str) -> Cow<'_, str> {
    let is_special = |character| {
        let is_kept = matches!(character, '\n' | '\t');
        matches!(character, '&' | '<' | '>' | '"' | '\'' | '\u{fffe}' | '\u{ffff}')
            || char::is_control(character) && !is_kept
            || turns(character)
    };
    replace(text, is_special, |character, out| {
        out.push_str(match character {
            '&' => "&amp;",
            '<' => "&lt;",
            '>' => "&gt;",
            '"' => "&quot;",
            '\'' => "&#39;",
            _ => "\u{fffd}",
        });
    })
}

/// Escapes text for a Python string with any kind of quotes, including docstrings.
pub fn python(text: &str) -> Cow<'_, str> {
    let is_special = |character| matches!(character, '\\' | '"' | '\'') || is_invisible(character);
    replace(text, is_special, |character, out| match u32::from(character) {
        _ if !is_invisible(character) => out.extend(['\\', character]),
        code @ ..=0xff => put(out, format_args!("\\x{code:02x}")),
        code @ ..=0xffff => put(out, format_args!("\\u{code:04x}")),
        code => put(out, format_args!("\\U{code:08x}")),
    })
}

/// Escapes text for a MATLAB comment, which ends at the line end.
pub fn matlab_comment(text: &str) -> Cow<'_, str> {
    replace(text, is_invisible, |_, out| out.push('\u{fffd}'))
}

/// Formats a CSV field (RFC 4180). It is quoted if necessary, or if a reader might misread blanks at its ends or
/// another separator.
pub fn csv_field(text: &str) -> Cow<'_, str> {
    let is_plain = !text.contains([',', '"', '\n', '\r', ';', '|', '\t']) && text.trim() == text;
    match is_plain {
        true => Cow::Borrowed(text),
        false => Cow::Owned(format!("\"{}\"", text.replace('"', "\"\""))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NASTY: &str = "a\"'\\<b>&\u{0}\n\r\t\u{7f}\u{9b}\u{202e}\u{2028}\u{e0041}\u{ffff}µ😀";

    #[test]
    fn nothing_invisible_reaches_a_terminal() {
        for text in [terminal(NASTY), json(NASTY).replace('\n', "").into()] {
            assert!(!text.contains(is_invisible), "{text:?}");
        }
        assert_eq!(terminal("\u{1b}[2J\u{9b}1m\rµ 😀"), "\\u{1b}[2J\\u{9b}1m\\rµ 😀");
    }

    #[test]
    fn json_is_the_same_value_and_ends_no_script() {
        let document = serde_json::to_string(&[NASTY, "</script><!--"]).unwrap();
        for escaped in [json(&document), script_json(&document)] {
            let read: Vec<String> = serde_json::from_str(&escaped).unwrap();
            assert_eq!(read, [NASTY, "</script><!--"]);
        }
        assert!(!script_json(&document).contains('<'));
    }

    #[test]
    fn escaped_text_stays_within_its_literal() {
        assert_eq!(markup("a<b> \"&'\u{1}"), "a&lt;b&gt; &quot;&amp;&#39;\u{fffd}");
        assert_eq!(markup("a\u{202e}b"), "a\u{fffd}b");
        assert_eq!(python("x\n\"\"\"\\u\u{2028}\u{e0041}"), r#"x\x0a\"\"\"\\u\u2028\U000e0041"#);
        assert_eq!(matlab_comment("x\nsystem('ls')\u{2028}"), "x\u{fffd}system('ls')\u{fffd}");
        assert_eq!(csv_field("a,\"b\"\n"), "\"a,\"\"b\"\"\n\"");
        assert_eq!((csv_field(" a"), csv_field("µ b")), ("\" a\"".into(), "µ b".into()));
    }
}
