//! The literals of Python that a NumPy header is made of.

/// A value.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Literal {
    Text(String),
    Whole(u64),
    Truth(bool),
    Nothing,
    /// A list or a tuple.
    List(Vec<Literal>),
    Dictionary(Vec<(Literal, Literal)>),
}

/// How deep lists may be nested.
const DEPTH: usize = 16;

/// The value that all of `text` is.
pub(crate) fn parse(text: &str) -> Option<Literal> {
    let mut rest = text;
    let value = value(&mut rest, DEPTH)?;
    rest.trim().is_empty().then_some(value)
}

fn value(rest: &mut &str, depth: usize) -> Option<Literal> {
    let depth = depth.checked_sub(1)?;
    *rest = rest.trim_start();
    let first = rest.chars().next()?;
    match first {
        '\'' | '"' => {
            let (text, after) = rest[1..].split_once(first)?;
            *rest = after;
            Some(Literal::Text(text.to_owned()))
        }
        '(' => list(rest, ')', depth),
        '[' => list(rest, ']', depth),
        '{' => dictionary(rest, depth),
        _ => {
            let end = rest.find(|c: char| !c.is_ascii_alphanumeric()).unwrap_or(rest.len());
            let (word, after) = rest.split_at(end);
            *rest = after;
            match word {
                "True" => Some(Literal::Truth(true)),
                "False" => Some(Literal::Truth(false)),
                "None" => Some(Literal::Nothing),
                // Python 2 wrote long numbers with an L.
                number => number.trim_end_matches('L').parse().ok().map(Literal::Whole),
            }
        }
    }
}

/// Whether the next character is `expected`, which is then taken.
fn take(rest: &mut &str, expected: char) -> bool {
    *rest = rest.trim_start();
    match rest.strip_prefix(expected) {
        Some(after) => {
            *rest = after;
            true
        }
        None => false,
    }
}

fn list(rest: &mut &str, end: char, depth: usize) -> Option<Literal> {
    *rest = &rest[1..];
    let mut values = Vec::new();
    loop {
        if take(rest, end) {
            return Some(Literal::List(values));
        }
        values.push(value(rest, depth)?);
        if !take(rest, ',') {
            return take(rest, end).then_some(Literal::List(values));
        }
    }
}

fn dictionary(rest: &mut &str, depth: usize) -> Option<Literal> {
    *rest = &rest[1..];
    let mut entries = Vec::new();
    loop {
        if take(rest, '}') {
            return Some(Literal::Dictionary(entries));
        }
        let key = value(rest, depth)?;
        if !take(rest, ':') {
            return None;
        }
        entries.push((key, value(rest, depth)?));
        if !take(rest, ',') {
            return take(rest, '}').then_some(Literal::Dictionary(entries));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_of_numpy_are_read() {
        let header = "{'descr': [('t', '<f8'), ('s', '<u2', (8,))], 'fortran_order': False, \
                      'shape': (3L,), }   \n";
        let text = |text: &str| Literal::Text(text.to_owned());
        let Some(Literal::Dictionary(entries)) = parse(header) else { panic!("no dictionary") };
        assert_eq!(entries.len(), 3);
        assert_eq!(entries[1], (text("fortran_order"), Literal::Truth(false)));
        assert_eq!(entries[2].1, Literal::List(vec![Literal::Whole(3)]));
        let Literal::List(fields) = &entries[0].1 else { panic!("no list") };
        let eight = Literal::List(vec![Literal::Whole(8)]);
        assert_eq!(fields[1], Literal::List(vec![text("s"), text("<u2"), eight]));
        for wrong in ["", "{", "(1", "{'a' 1}", "['a', ]]", "-1", &"(".repeat(1000)] {
            assert_eq!(parse(wrong), None, "{wrong}");
        }
    }
}
