//! Who may ask.

use std::hint::black_box;
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr};

/// Whether two secrets are the same, in a time that does not tell where they differ.
pub(super) fn is_same(given: &str, secret: &str) -> bool {
    let pairs = given.bytes().zip(secret.bytes());
    let difference = pairs.fold(0, |difference, (a, b)| black_box(difference | (a ^ b)));
    given.len() == secret.len() && difference == 0
}

/// Whether a `Host` is one that no other site can have: an address, or `localhost`.
///
/// A page of another site could let its own name point to this machine ("DNS rebinding"), and would then
/// be taken for ours by the browser. It has to send that name.
pub(super) fn is_host_ours(host: &str) -> bool {
    let bare = host.strip_prefix('[').and_then(|rest| rest.strip_suffix(']'));
    let (name, port) = host.split_once(':').unwrap_or((host, "0"));
    host.parse::<SocketAddr>().is_ok()
        || host.parse::<Ipv4Addr>().is_ok()
        || bare.is_some_and(|address| address.parse::<Ipv6Addr>().is_ok())
        || name.eq_ignore_ascii_case("localhost") && port.parse::<u16>().is_ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_whole_secret_is_the_secret() {
        assert!(is_same("0123abcd", "0123abcd"));
        for other in ["", "0123abc", "0123abcd0", "0123abce", "1123abcd", "0123ABCD"] {
            assert!(!is_same(other, "0123abcd"), "{other}");
        }
    }

    #[test]
    fn addresses_are_ours_and_names_are_not() {
        let ours =
            ["127.0.0.1:80", "127.0.0.1", "localhost", "LocalHost:8080", "[::1]:9", "[fe80::1]"];
        for host in ours.into_iter().chain(["192.168.1.7:5000"]) {
            assert!(is_host_ours(host), "{host}");
        }
        let others =
            ["", "evil.example", "evil.example:80", "127.0.0.1.evil.example", "localhost."];
        let damaged = ["::1", "[::1", "[::1]x", "[127.0.0.1]", "127.0.0.1:", "127.0.0.1:x", "[]:1"];
        let more = ["127.0.0.1:70000", "127.0.0.1@evil.example", "localhost:80:80", " localhost"];
        for host in others.into_iter().chain(damaged).chain(more) {
            assert!(!is_host_ours(host), "{host}");
        }
    }
}
