//! `cargo xtask check words`: the wording of comments, pages and messages, by `docs/style.md`.

use std::fs;
use std::process::Command;

use anyhow::{Context, Result, ensure};

use crate::steps::{self, workspace};

/// First words that delay the subject of a doc comment.
const OPENINGS: [&str; 7] = ["What", "Whatever", "Who", "Whoever", "Of", "Those", "The same"];

/// Doc comments that may begin with `Whether`, for a `bool`.
const MOST_WHETHER: usize = 60;

/// Phrases to avoid, separated by bars.
const PHRASES: &str = "that there are|that there is|it cannot be told|is told so|is to be said|is to be done|\
                       of a pose's|square sum|would hold less than|makes up for|make up for|nobody knows|\
                       whoever|as they stand|as it stands|in the mean |of no row|so that none";

const MESSAGES: [&str; 6] = ["#[error(", "bail!(", "anyhow!(", ".note(", ".warning(", ".failure("];

/// Maximum length of a message, in characters without placeholders.
const LONGEST: usize = 100;

pub(crate) fn check() -> Result<()> {
    let types = ["*.rs", "*.md", "*.py", "*.js", "*.html", "*.toml"];
    let list = ["ls-files", "--", ":!CHANGELOG.md", ":!docs/style.md", ":!xtask/src/words.rs"];
    let mut list_files = Command::new("git");
    let listed = steps::output(list_files.args(list).args(types).current_dir(workspace()))?;
    let (mut findings, mut whether) = (0, 0);
    for name in listed.lines() {
        let text = fs::read_to_string(workspace().join(name)).with_context(|| name.to_owned())?;
        let mut found = phrases(&text);
        if name.ends_with(".rs") {
            whether += openings(&text).filter(|it| it.1.starts_with("Whether ")).count();
            found.extend(code(&text));
        }
        found.iter().for_each(|(line, finding)| eprintln!("{name}:{line}: {finding}"));
        findings += found.len();
    }
    ensure!(
        whether <= MOST_WHETHER,
        "{whether} doc comments begin with `Whether`, at most {MOST_WHETHER} may"
    );
    ensure!(findings == 0, "{findings} texts to reword, see docs/style.md");
    Ok(())
}

type Findings = Vec<(usize, String)>;

/// Returns the first line of each doc comment, with its number.
fn openings(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let mut before = None;
    (1..).zip(text.lines()).filter_map(move |(number, line)| {
        let marked =
            line.trim_start().split_at_checked(3).filter(|it| ["///", "//!"].contains(&it.0));
        let is_first = before != marked.map(|it| it.0);
        before = marked.map(|it| it.0);
        marked.filter(|_| is_first).map(|it| (number, it.1.trim_start()))
    })
}

/// Finds phrases, also across a line break.
fn phrases(text: &str) -> Findings {
    let (mut joined, mut starts) = (String::new(), Vec::new());
    for line in text.lines() {
        starts.push(joined.len());
        let words = line.trim_matches(|c: char| c.is_whitespace() || "/!#\\".contains(c));
        joined.extend([&words.to_lowercase(), " "]);
    }
    let found = PHRASES.split('|').flat_map(|phrase| joined.match_indices(phrase));
    let line = |at| starts.partition_point(|start| *start <= at);
    found.map(|(at, phrase)| (line(at), format!("`{phrase}`"))).collect()
}

fn code(text: &str) -> Findings {
    let begins =
        |line: &str, word: &str| line.strip_prefix(word).is_some_and(|rest| rest.starts_with(' '));
    let opening = |(number, line)| {
        let word = OPENINGS.into_iter().find(|word| begins(line, word))?;
        Some((number, format!("a doc comment begins with `{word}`: name the thing first")))
    };
    let mut findings: Findings = openings(text).filter_map(opening).collect();
    let mut measure = |at: usize, message: &str| {
        let shown = message.split('{').filter_map(|part| part.split('}').next_back());
        let length: usize = shown.map(|part| part.chars().count()).sum();
        if length > LONGEST {
            let line = text[..at].matches('\n').count() + 1;
            findings.push((line, format!("{length} characters, at most {LONGEST}: {message}")));
        }
    };
    for (at, marker) in MESSAGES.iter().flat_map(|marker| text.match_indices(marker)) {
        let after = text[at + marker.len()..].trim_start();
        let after = after.strip_prefix("format!(").unwrap_or(after).trim_start();
        if let Some((message, _)) = literal(after) {
            measure(text.len() - after.len(), &message);
        }
    }
    for (at, _) in text.match_indices("fn hint(&self)") {
        let end = text[at..].find("\n    }\n").map_or(text.len(), |length| at + length);
        let mut from = at;
        while let Some(quote) = text[from..end].find('"').map(|length| from + length)
            && let Some((hint, length)) = literal(&text[quote..])
        {
            measure(quote, &hint);
            from = quote + length;
        }
    }
    findings
}

/// Reads the string literal at the start of `code`, with continued lines, and its length.
fn literal(code: &str) -> Option<(String, usize)> {
    let mut rest = code.strip_prefix('"')?;
    let mut text = String::new();
    loop {
        let at = rest.find(['"', '\\'])?;
        text.push_str(&rest[..at]);
        let Some(escaped) = rest[at..].strip_prefix('\\') else {
            return Some((text, code.len() - rest.len() + at + 1));
        };
        let mut after = escaped.chars();
        match after.next()? {
            '\n' => rest = escaped.trim_start(),
            letter => {
                text.push(letter);
                rest = after.as_str();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_doc_comment_with_a_wrong_opening_is_found() {
        let text = "/// What it holds.\n/// Of all.\nstruct A;\n//! Office\n/// Those it holds.\n";
        let lines: Vec<usize> = code(text).into_iter().map(|it| it.0).collect();
        assert_eq!(lines, [1, 5]);
    }

    #[test]
    fn a_phrase_is_found_across_a_line_break() {
        let found =
            phrases("fn a() {}\n    /// All rows that\n    /// There are, as they stood.\n");
        assert_eq!(found, [(2, "`that there are`".to_owned())]);
    }

    #[test]
    fn long_messages_and_hints_are_found() {
        let long = "a".repeat(LONGEST - 2);
        let text = format!(
            "#[error(\"{long}\\\"b\")]\nbail!(\n    \"{long}\\\n     b c\"\n);\n\
             fn hint(&self) {{\n        \"short\"; \"{long}{{x}}bcd\"\n    }}\n"
        );
        let lines: Vec<usize> = code(&text).into_iter().map(|it| it.0).collect();
        assert_eq!(lines, [3, 7]);
    }
}
