//! The location of a reference sensor, and errors in opening it.

use std::fmt;
use std::str::FromStr;

use shell_data::hint::Hint;

use super::page::BadPage;
use super::rdt;

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ReferenceSource {
    /// An ATI Net F/T box, or a device that answers like one.
    NetFt {
        host: String,
        /// UDP port, if not the usual one; the page may be at the same TCP port.
        port: Option<u16>,
        /// True to take the load at the start as zero.
        bias: bool,
    },
    Ft300(String),
    /// A shell command that prints lines.
    Command(String),
    /// A TCP server that sends lines: `HOST:PORT`.
    Tcp(String),
}

#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "`{0}` is none of `netft:HOST[:PORT][,bias]`, `ft300:PORT`, `lines:COMMAND`, `lines:tcp:HOST:PORT`"
)]
pub struct BadSource(String);

impl FromStr for ReferenceSource {
    type Err = BadSource;

    fn from_str(word: &str) -> Result<Self, BadSource> {
        let bad = || BadSource(word.to_owned());
        let (kind, rest) =
            word.split_once(':').filter(|(_, rest)| !rest.is_empty()).ok_or_else(bad)?;
        match kind {
            "netft" => {
                let (rest, bias) = match rest.strip_suffix(",bias") {
                    Some(rest) => (rest, true),
                    None => (rest, false),
                };
                let (host, port) = split_port(rest).ok_or_else(bad)?;
                Ok(Self::NetFt { host, port, bias })
            }
            "ft300" => Ok(Self::Ft300(rest.to_owned())),
            "lines" => Ok(match rest.strip_prefix("tcp:") {
                Some(at) => {
                    let (_, port) = split_port(at).ok_or_else(bad)?;
                    port.ok_or_else(bad)?;
                    Self::Tcp(at.to_owned())
                }
                None => Self::Command(rest.to_owned()),
            }),
            _ => Err(bad()),
        }
    }
}

/// Splits off the port, if given. An IPv6 address with a port is in brackets.
fn split_port(text: &str) -> Option<(String, Option<u16>)> {
    if let Some((host, after)) = text.strip_prefix('[').and_then(|rest| rest.split_once(']')) {
        let port = after.strip_prefix(':').map(|port| port.parse().ok());
        let is_whole = after.is_empty() || port.is_some_and(|port: Option<u16>| port.is_some());
        return (is_whole && !host.is_empty()).then(|| (host.to_owned(), port.flatten()));
    }
    match text.rsplit_once(':') {
        _ if text.contains(['[', ']']) => None,
        Some((host, _)) if host.contains(':') => Some((text.to_owned(), None)),
        Some((host, port)) => {
            let port = port.parse().ok().filter(|_| !host.is_empty())?;
            Some((host.to_owned(), Some(port)))
        }
        None => (!text.is_empty()).then(|| (text.to_owned(), None)),
    }
}

impl fmt::Display for ReferenceSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NetFt { host, port, .. } => {
                write!(f, "netft:{host}:{}", port.unwrap_or(rdt::PORT))
            }
            Self::Ft300(port) => write!(f, "ft300:{port}"),
            Self::Command(command) => write!(f, "lines:{command}"),
            Self::Tcp(at) => write!(f, "lines:tcp:{at}"),
        }
    }
}

/// Errors in reading a reference. Errors of the system are stored as text.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ReferenceError {
    #[error("cannot open the reference `{source_name}`: {reason}")]
    Open { source_name: String, reason: String },
    #[error("cannot get `netftapi2.xml` from the reference `{source_name}`: {reason}")]
    NoPage {
        source_name: String,
        /// The reason for each port that was tried.
        reason: String,
    },
    #[error("the reference `{source_name}`: {problem}")]
    Page { source_name: String, problem: BadPage },
    #[error("the reference: {0}")]
    Port(#[from] board_link::LinkError),
    #[error("no sample from the reference `{source_name}` in {seconds} s{more}")]
    Silent {
        source_name: String,
        seconds: u64,
        /// Data that arrived instead, if any.
        more: String,
    },
    #[error("the reference `{source_name}`: {reason}")]
    Ended { source_name: String, reason: String },
}

impl Hint for ReferenceError {
    fn hint(&self) -> Option<String> {
        let text = match self {
            Self::Open { .. } => "check the name; is the sensor on, and on this network?",
            Self::NoPage { .. } => {
                "a box serves its page at port 80: open http://HOST/netftapi2.xml in a browser"
            }
            Self::Page { .. } => "choose other units on the box's page, such as N and N-m",
            Self::Port(error) => return error.hint(),
            Self::Silent { source_name, .. } if source_name.starts_with("netft:") => {
                "a box serves one program at a time: end others; a firewall may hold back UDP"
            }
            Self::Silent { source_name, .. } if source_name.starts_with("ft300:") => {
                "is the sensor on 24 V, and its adapter for RS-485 at this port?"
            }
            Self::Silent { .. } | Self::Ended { .. } => {
                "lines are CSV below a header `fx_n,fy_n,…`, or JSON; a program must flush each line \
                 (`python -u`)"
            }
        };
        Some(text.to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sources_are_named_or_refused() {
        let netft =
            |host: &str, port, bias| ReferenceSource::NetFt { host: host.into(), port, bias };
        for (word, source) in [
            ("netft:192.168.1.1", netft("192.168.1.1", None, false)),
            ("netft:box.lab:5000,bias", netft("box.lab", Some(5000), true)),
            ("netft:[::1]:5000", netft("::1", Some(5000), false)),
            ("netft:fe80::1", netft("fe80::1", None, false)),
            ("ft300:/dev/ttyUSB1", ReferenceSource::Ft300("/dev/ttyUSB1".into())),
            ("lines:python -u a.py", ReferenceSource::Command("python -u a.py".into())),
            ("lines:tcp:localhost:9000", ReferenceSource::Tcp("localhost:9000".into())),
        ] {
            assert_eq!(word.parse(), Ok(source), "{word}");
        }
        for word in
            ["", "netft", "netft:", "netft:a:b", "netft::1", "netft:[::1", "lines:tcp:a", "x:y"]
        {
            assert!(word.parse::<ReferenceSource>().is_err(), "{word}");
        }
    }
}
