//! What a user can ask of a stream, one command a line.

use std::str::FromStr;

/// A command.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StreamCommand {
    /// Take the mean wrench of the next frames as zero.
    Tare,
    /// Take that zero back.
    Untare,
    /// Flag the next row.
    Mark,
    /// So many rows per second, or all.
    Rate(Option<f64>),
}

/// A line that is no command.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{0}` is no command; there are `tare`, `untare`, `mark`, `rate HZ` and `rate all`")]
pub struct UnknownCommand(String);

impl FromStr for StreamCommand {
    type Err = UnknownCommand;

    fn from_str(line: &str) -> Result<Self, UnknownCommand> {
        let unknown = || UnknownCommand(line.trim().to_owned());
        let words: Vec<&str> = line.split_whitespace().collect();
        match words[..] {
            ["tare"] => Ok(Self::Tare),
            ["untare"] => Ok(Self::Untare),
            ["mark"] => Ok(Self::Mark),
            ["rate", "all"] => Ok(Self::Rate(None)),
            ["rate", hz] => {
                let hz = hz.parse().ok().filter(|hz: &f64| hz.is_finite() && *hz > 0.0);
                hz.map(|hz| Self::Rate(Some(hz))).ok_or_else(unknown)
            }
            _ => Err(unknown()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_a_command_or_told_to_be_none() {
        assert_eq!("tare\n".parse(), Ok(StreamCommand::Tare));
        assert_eq!(" rate 12.5 ".parse(), Ok(StreamCommand::Rate(Some(12.5))));
        assert_eq!("rate all".parse(), Ok(StreamCommand::Rate(None)));
        for line in ["", "rate", "rate -1", "rate NaN", "rate 0", "tare now", "Tare"] {
            assert!(line.parse::<StreamCommand>().is_err(), "{line}");
        }
    }
}
