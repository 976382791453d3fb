//! The head of a request, its possible errors, and authorisation.

use std::hint::black_box;
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr};

/// Maximum length of a head, bytes; a browser's has about one thousand.
pub(super) const LONGEST: usize = 8192;

/// Status code and phrase (RFC 9110), and a text for people.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct HttpRefusal(pub(super) &'static str, pub(super) &'static str);

impl HttpRefusal {
    pub(super) const MALFORMED: Self = Self("400 Bad Request", "this is no request of HTTP 1.1");
    pub(super) const NO_TOKEN: Self = Self(
        "403 Forbidden",
        "the token is missing or is that of an earlier run: open the address as it was printed",
    );
    pub(super) const NOT_FOUND: Self = Self("404 Not Found", "there is no such page");
    pub(super) const METHOD: Self =
        Self("405 Method Not Allowed", "pages are read, orders are posted");
    pub(super) const TOO_SLOW: Self = Self("408 Request Timeout", "the request took too long");
    const BODY: Self = Self("413 Content Too Large", "no request has a body");
    pub(super) const HOST: Self = Self(
        "421 Misdirected Request",
        "open the address as it was printed: by number, or as localhost",
    );
    pub(super) const TOO_LONG: Self =
        Self("431 Request Header Fields Too Large", "the request is too long");
    pub(super) const BUSY: Self =
        Self("503 Service Unavailable", "too many connections or orders wait");
    pub(super) const VERSION: Self =
        Self("505 HTTP Version Not Supported", "only HTTP 1.1 is spoken");
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Request<'a> {
    pub(super) method: &'a str,
    pub(super) path: &'a str,
    /// `token=` in the address; empty if missing.
    pub(super) token: &'a str,
    /// `None` for HTTP 1.0, which does not require it.
    pub(super) host: Option<&'a str>,
}

pub(super) fn end_of_head(bytes: &[u8]) -> Option<usize> {
    bytes.windows(4).position(|window| window == b"\r\n\r\n").map(|position| position + 4)
}

pub(super) fn parse(head: &[u8]) -> Result<Request<'_>, HttpRefusal> {
    let text = std::str::from_utf8(head).map_err(|_| HttpRefusal::MALFORMED)?;
    let text = text.strip_suffix("\r\n\r\n").ok_or(HttpRefusal::MALFORMED)?;
    let mut lines = text.split("\r\n");
    let words: Vec<&str> = lines.next().unwrap_or_default().split(' ').collect();
    let [method, target, version] = words[..] else { return Err(HttpRefusal::MALFORMED) };
    if !version.starts_with("HTTP/") || !target.starts_with('/') {
        return Err(HttpRefusal::MALFORMED);
    }
    if !matches!(version, "HTTP/1.1" | "HTTP/1.0") {
        return Err(HttpRefusal::VERSION);
    }
    let mut host = None;
    for line in lines {
        let (name, value) = line.split_once(':').ok_or(HttpRefusal::MALFORMED)?;
        // A continuation of the previous line, which browsers no longer send.
        if name.is_empty() || name.bytes().any(|byte| byte <= b' ' || byte >= 127) {
            return Err(HttpRefusal::MALFORMED);
        }
        let value = value.trim_matches([' ', '\t']);
        if name.eq_ignore_ascii_case("host") {
            if host.replace(value).is_some() {
                return Err(HttpRefusal::MALFORMED);
            }
        } else if name.eq_ignore_ascii_case("transfer-encoding")
            || name.eq_ignore_ascii_case("content-length") && value != "0"
        {
            return Err(HttpRefusal::BODY);
        }
    }
    if !matches!(method, "GET" | "POST") {
        return Err(HttpRefusal::METHOD);
    }
    let (path, query) = target.split_once('?').unwrap_or((target, ""));
    let token = query.split('&').find_map(|pair| pair.strip_prefix("token=")).unwrap_or_default();
    // HTTP 1.0 has no `Host`; every browser speaks a later version.
    let host = if version == "HTTP/1.0" { None } else { Some(host.ok_or(HttpRefusal::MALFORMED)?) };
    Ok(Request { method, path, token, host })
}

/// Compares secrets in a time that does not depend on the position of a difference.
pub(super) fn is_same(given: &str, secret: &str) -> bool {
    let pairs = given.bytes().zip(secret.bytes());
    let difference = pairs.fold(0, |difference, (a, b)| black_box(difference | (a ^ b)));
    given.len() == secret.len() && difference == 0
}

/// Returns true for a `Host` that no other site can have: an address, or `localhost`. Another site
/// may let its name point here ("DNS rebinding"), but the browser sends it as `Host`.
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
    fn a_request_of_a_browser_is_understood() {
        let head =
            b"GET /events?x=1&token=ab12 HTTP/1.1\r\nHost: localhost:80\r\nAccept: */*\r\n\r\n";
        let request =
            Request { method: "GET", path: "/events", token: "ab12", host: Some("localhost:80") };
        assert_eq!(parse(head), Ok(request));
        let head = b"POST /mark HTTP/1.1\r\nhOST:\tlocalhost \r\nContent-Length: 0\r\n\r\n";
        let request = Request { method: "POST", path: "/mark", token: "", host: Some("localhost") };
        assert_eq!(parse(head), Ok(request));
    }

    #[test]
    fn malformed_requests_are_refused() {
        let refused =
            |head: &str, why: HttpRefusal| assert_eq!(parse(head.as_bytes()), Err(why), "{head}");
        for head in [
            "\r\n\r\n",
            "GET /\r\n\r\n",
            "GET  / HTTP/1.1\r\nHost: a\r\n\r\n",
            "GET / HTTP/1.1 x\r\nHost: a\r\n\r\n",
            "GET http://a/ HTTP/1.1\r\nHost: a\r\n\r\n",
            "GET / HTTP/1.1\r\n\r\n",
            "GET / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n",
            "GET / HTTP/1.1\r\nHost: a\r\n and more\r\n\r\n",
            "GET / HTTP/1.1\r\nHost : a\r\n\r\n",
            "GET / HTTP/1.1\r\nHost: a\r\nno colon\r\n\r\n",
            "GET / FTP/1.1\r\nHost: a\r\n\r\n",
        ] {
            refused(head, HttpRefusal::MALFORMED);
        }
        assert_eq!(parse(b"GET /\xff HTTP/1.1\r\nHost: a\r\n\r\n"), Err(HttpRefusal::MALFORMED));
        refused("GET / HTTP/2\r\nHost: a\r\n\r\n", HttpRefusal::VERSION);
        refused("DELETE / HTTP/1.1\r\nHost: a\r\n\r\n", HttpRefusal::METHOD);
        refused("POST / HTTP/1.1\r\nHost: a\r\nContent-Length: 5\r\n\r\n", HttpRefusal::BODY);
        refused(
            "POST / HTTP/1.1\r\nHost: a\r\nTransfer-Encoding: chunked\r\n\r\n",
            HttpRefusal::BODY,
        );
    }

    #[test]
    fn the_end_of_a_head_is_found_for_any_pieces() {
        let head = b"GET / HTTP/1.1\r\nHost: a\r\n\r\nrest";
        let end = head.len() - 4;
        assert_eq!(end_of_head(head), Some(end));
        (0..end).for_each(|arrived| assert_eq!(end_of_head(&head[..arrived]), None, "{arrived}"));
    }

    #[test]
    fn a_partial_token_is_refused() {
        assert!(is_same("0123abcd", "0123abcd"));
        for other in ["", "0123abc", "0123abcd0", "0123abce", "1123abcd", "0123ABCD"] {
            assert!(!is_same(other, "0123abcd"), "{other}");
        }
    }

    #[test]
    fn host_addresses_are_accepted_and_host_names_refused() {
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
