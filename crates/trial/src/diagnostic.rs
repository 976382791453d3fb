//! Information beside the results of a trial.

use serde::Serialize;

use super::window::Proposal;

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// Information on how the log was recorded.
    Note,
    /// The results may be worse than they look.
    Warning,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Diagnostic {
    pub severity: Severity,
    /// A short name for scripts, the same for all diagnostics of a kind.
    pub code: &'static str,
    pub text: String,
}

impl Diagnostic {
    pub(super) fn note(code: &'static str, text: impl Into<String>) -> Self {
        Self { severity: Severity::Note, code, text: text.into() }
    }

    pub fn warning(code: &'static str, text: impl Into<String>) -> Self {
        Self { severity: Severity::Warning, code, text: text.into() }
    }

    pub fn found_window(found: &Proposal) -> Self {
        let text = format!(
            "the window was found in the drag: confidence {:.0} %, entry ± {:.3} s, exit ± {:.3} s",
            100.0 * found.confidence,
            found.t_enter_se_s,
            found.t_exit_se_s
        );
        let severity = if found.is_good() { Severity::Note } else { Severity::Warning };
        Self { severity, code: "found_window", text }
    }
}
