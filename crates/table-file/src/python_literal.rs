//! Reads the Python literals of a NumPy header, by rewriting them as JSON.

use serde_json::Value;

/// The value that all of `text` is; tuples become lists.
pub(crate) fn parse(text: &str) -> Option<Value> {
    let (mut json, mut rest) = (String::with_capacity(text.len()), text);
    while let Some(first) = rest.chars().next() {
        let after = &rest[first.len_utf8()..];
        rest = match first {
            '\'' | '"' => {
                let (text, after) = after.split_once(first)?;
                json.push_str(&Value::from(text).to_string());
                after
            }
            // JSON has no comma before the end of a list.
            ',' if after.trim_start().starts_with([')', ']', '}']) => after,
            c if c.is_ascii_alphanumeric() => {
                let end = rest.find(|c: char| !c.is_ascii_alphanumeric()).unwrap_or(rest.len());
                let (word, after) = rest.split_at(end);
                json.push_str(&json_of_word(word)?);
                after
            }
            _ => {
                json.push(match first {
                    '(' => '[',
                    ')' => ']',
                    '[' | ']' | '{' | '}' | ':' | ',' => first,
                    c if c.is_whitespace() => ' ',
                    _ => return None,
                });
                after
            }
        };
    }
    serde_json::from_str(&json).ok()
}

fn json_of_word(word: &str) -> Option<String> {
    Some(match word {
        "True" => "true".to_owned(),
        "False" => "false".to_owned(),
        "None" => "null".to_owned(),
        // Python 2 wrote long numbers with an L.
        number => number.trim_end_matches('L').parse::<u64>().ok()?.to_string(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_of_numpy_are_read() {
        let header = "{'descr': [('t', '<f8'), ('s', '<u2', (8,))], 'fortran_order': False, \
                      'shape': (3L,), }   \n";
        let Some(Value::Object(entries)) = parse(header) else { panic!("no dictionary") };
        assert_eq!(entries.len(), 3);
        assert_eq!(entries["fortran_order"], Value::Bool(false));
        assert_eq!(entries["shape"], Value::from([3]));
        let Value::Array(fields) = &entries["descr"] else { panic!("no list") };
        let eight = Value::from([8]);
        assert_eq!(fields[1], Value::Array(vec!["s".into(), "<u2".into(), eight]));
        assert_eq!(parse(r"('a\b',)"), Some(Value::from([r"a\b"])));
        for wrong in ["", "{", "(1", "{'a' 1}", "['a', ]]", "-1", "1 2", &"(".repeat(1000)] {
            assert_eq!(parse(wrong), None, "{wrong}");
        }
    }
}
