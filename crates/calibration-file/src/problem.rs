//! What is wrong with a document, with its place.

use super::Problem;

pub(super) fn problem(error: serde_json::Error) -> Problem {
    let (line, column) = (error.line(), error.column());
    let text = error.to_string();
    let message = text.split(" at line ").next().unwrap_or(&text).to_owned();
    if error.is_data() {
        Problem::Field { line, column, message }
    } else {
        Problem::NotJson { line, column, message }
    }
}
