//! Transcripts in the documentation: commands and their output, in which `[..]` and `...` match anything.
#![expect(clippy::unwrap_used, reason = "a test may panic and say why")]

#[derive(Debug)]
pub struct Step {
    pub command: String,
    pub expected: Vec<String>,
}

/// Returns the commands in the blocks of a kind on a page: `$ ` begins one, `> ` continues it.
pub fn steps(page: &str, kind: &str) -> Vec<Step> {
    let begin = format!("```{kind}");
    let mut steps: Vec<Step> = Vec::new();
    let mut is_inside = false;
    for line in page.lines() {
        if line == begin {
            is_inside = true;
        } else if line == "```" {
            is_inside = false;
        } else if let Some(command) = line.strip_prefix("$ ").filter(|_| is_inside) {
            steps.push(Step { command: command.to_owned(), expected: Vec::new() });
        } else if let Some(step) = steps.last_mut().filter(|_| is_inside) {
            match line.strip_prefix("> ") {
                Some(more) => step.command += &format!("\n{more}"),
                None => step.expected.push(line.to_owned()),
            }
        }
    }
    steps
}

/// Returns a line with one blank, or one dash of a rule, in place of several: columns of a table are as wide as
/// their numbers, which differ from run to run.
fn narrow(line: &str) -> String {
    let mut narrow = String::new();
    for c in line.chars() {
        if !([' ', '─'].contains(&c) && narrow.ends_with(c)) {
            narrow.push(c);
        }
    }
    narrow
}

/// True if a line is as expected but for the widths of columns; `[..]` matches anything.
fn is_like(line: &str, expected: &str) -> bool {
    let (line, expected) = (narrow(line), narrow(expected));
    let mut parts = expected.split("[..]");
    let first = parts.next().unwrap();
    let Some(mut rest) = line.strip_prefix(first) else { return false };
    let parts: Vec<&str> = parts.collect();
    for (at, part) in parts.iter().enumerate() {
        if at + 1 == parts.len() {
            return rest.ends_with(part);
        }
        let Some(found) = rest.find(part) else { return false };
        rest = &rest[found + part.len()..];
    }
    rest.is_empty()
}

/// True if lines are as expected; `...` matches any number of lines.
pub fn are_like(lines: &[&str], expected: &[String]) -> bool {
    match expected.split_first() {
        None => lines.is_empty(),
        Some((any, expected)) if any == "..." => {
            (0..=lines.len()).any(|skipped| are_like(&lines[skipped..], expected))
        }
        Some((first, expected)) => lines
            .split_first()
            .is_some_and(|(line, lines)| is_like(line, first) && are_like(lines, expected)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_match_with_wildcards() {
        assert!(
            is_like("a 12 b 3 c", "a [..] b [..] c") && is_like("x", "x") && is_like("ab", "a[..]")
        );
        assert!(is_like("──── a    b", "── a b") && !is_like("ab", "a b"));
        assert!(!is_like("a 12 d", "a [..] b") && !is_like("xy", "x") && !is_like("b", "a[..]"));
        let lines = ["one", "two", "three"];
        let like = |expected: &[&str]| {
            are_like(&lines, &expected.iter().map(|&line| line.to_owned()).collect::<Vec<_>>())
        };
        assert!(like(&["one", "..."]) && like(&["...", "three"]) && like(&["...", "two", "..."]));
        assert!(!like(&["..."; 0]) && !like(&["one", "three"]) && !like(&["...", "four"]));
    }
}
