//! Where a stream goes, in a word.

use std::fmt;
use std::net::{Ipv4Addr, SocketAddr, ToSocketAddrs};
use std::path::PathBuf;
use std::str::FromStr;

/// Where rows go.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Destination {
    /// The standard output.
    Stdout,
    /// A file.
    File(PathBuf),
    /// A datagram for each row, to this address.
    Udp(SocketAddr),
    /// Whoever connects to this address.
    Tcp(SocketAddr),
}

/// A word that is no destination.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}; a destination is `-`, `udp:HOST:PORT`, `tcp:PORT`, `tcp:IP:PORT` or a file")]
pub struct BadDestination(String);

impl FromStr for Destination {
    type Err = BadDestination;

    fn from_str(word: &str) -> Result<Self, BadDestination> {
        let bad = |problem: String| BadDestination(problem);
        if let Some(at) = word.strip_prefix("udp:") {
            let mut found =
                at.to_socket_addrs().map_err(|error| bad(format!("`{at}`: {error}")))?;
            let found = found.next().ok_or_else(|| bad(format!("`{at}` has no address")))?;
            return Ok(Self::Udp(found));
        }
        if let Some(at) = word.strip_prefix("tcp:") {
            let own = |port| SocketAddr::from((Ipv4Addr::LOCALHOST, port));
            let address = at.parse().map(own).or_else(|_| at.parse());
            return address.map(Self::Tcp).map_err(|error| bad(format!("`{at}`: {error}")));
        }
        match word {
            "" => Err(bad("there is no name".to_owned())),
            "-" => Ok(Self::Stdout),
            path => Ok(Self::File(path.strip_prefix("file:").unwrap_or(path).into())),
        }
    }
}

impl fmt::Display for Destination {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Stdout => f.write_str("standard output"),
            Self::File(path) => write!(f, "`{}`", path.display()),
            Self::Udp(address) => write!(f, "udp:{address}"),
            Self::Tcp(address) => write!(f, "tcp:{address}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_port_alone_is_of_this_machine() {
        let tcp = |text: &str| Destination::Tcp(text.parse().unwrap());
        assert_eq!("tcp:9000".parse(), Ok(tcp("127.0.0.1:9000")));
        assert_eq!("tcp:0.0.0.0:9000".parse(), Ok(tcp("0.0.0.0:9000")));
        assert_eq!("-".parse(), Ok(Destination::Stdout));
        assert_eq!("file:-".parse(), Ok(Destination::File("-".into())));
        assert_eq!("run.csv".parse(), Ok(Destination::File("run.csv".into())));
        for word in ["", "udp:9870", "tcp:host", "tcp:70000", "udp:127.0.0.1"] {
            assert!(word.parse::<Destination>().is_err(), "{word}");
        }
    }
}
