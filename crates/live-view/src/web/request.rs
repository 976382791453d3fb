//! The head of a request, and what may be wrong with it.

/// The longest head of a request, bytes: that of a browser has about one thousand.
pub(super) const LONGEST: usize = 8192;

/// The response to a refused request: the status line (RFC 9110) and a text for people.
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
    const VERSION: Self = Self("505 HTTP Version Not Supported", "only HTTP 1.1 is spoken");
}

/// How something is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum RequestMethod {
    Get,
    Post,
}

/// What is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Request<'a> {
    pub(super) method: RequestMethod,
    pub(super) path: &'a str,
    /// The value of `token=` in the address; empty if there is none.
    pub(super) token: &'a str,
    pub(super) host: &'a str,
}

/// Where the head of a request ends, its empty line included; bytes before `from` were looked at.
pub(super) fn end_of_head(bytes: &[u8], from: usize) -> Option<usize> {
    let from = from.saturating_sub(3).min(bytes.len());
    let position = bytes[from..].windows(4).position(|window| window == b"\r\n\r\n")?;
    Some(from + position + 4)
}

/// Reads a whole head.
pub(super) fn parse(head: &[u8]) -> Result<Request<'_>, HttpRefusal> {
    let text = std::str::from_utf8(head).map_err(|_| HttpRefusal::MALFORMED)?;
    let text = text.strip_suffix("\r\n\r\n").ok_or(HttpRefusal::MALFORMED)?;
    let mut lines = text.split("\r\n");
    let words: Vec<&str> = lines.next().unwrap_or_default().split(' ').collect();
    let [method, target, version] = words[..] else { return Err(HttpRefusal::MALFORMED) };
    if !version.starts_with("HTTP/") || !target.starts_with('/') {
        return Err(HttpRefusal::MALFORMED);
    }
    if version != "HTTP/1.1" {
        return Err(HttpRefusal::VERSION);
    }
    let mut host = None;
    for line in lines {
        let (name, value) = line.split_once(':').ok_or(HttpRefusal::MALFORMED)?;
        // A line that begins with a space would go on the one before, which no browser sends any more.
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
    let method = match method {
        "GET" => RequestMethod::Get,
        "POST" => RequestMethod::Post,
        _ => return Err(HttpRefusal::METHOD),
    };
    let (path, query) = target.split_once('?').unwrap_or((target, ""));
    let token = query.split('&').find_map(|pair| pair.strip_prefix("token=")).unwrap_or_default();
    Ok(Request { method, path, token, host: host.ok_or(HttpRefusal::MALFORMED)? })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_request_of_a_browser_is_understood() {
        let head =
            b"GET /events?x=1&token=ab12 HTTP/1.1\r\nHost: localhost:80\r\nAccept: */*\r\n\r\n";
        let request = Request {
            method: RequestMethod::Get,
            path: "/events",
            token: "ab12",
            host: "localhost:80",
        };
        assert_eq!(parse(head), Ok(request));
        let head = b"POST /mark HTTP/1.1\r\nhOST:\tlocalhost \r\nContent-Length: 0\r\n\r\n";
        let request =
            Request { method: RequestMethod::Post, path: "/mark", token: "", host: "localhost" };
        assert_eq!(parse(head), Ok(request));
    }

    #[test]
    fn what_is_no_request_is_refused() {
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
    fn the_end_of_a_head_is_found_however_it_arrives() {
        let head = b"GET / HTTP/1.1\r\nHost: a\r\n\r\nrest";
        let end = head.len() - 4;
        assert_eq!(end_of_head(head, 0), Some(end));
        for looked_at in 0..end {
            assert_eq!(end_of_head(&head[..looked_at], 0), None);
            assert_eq!(end_of_head(head, looked_at), Some(end), "{looked_at}");
        }
        assert_eq!(end_of_head(b"", 7), None);
    }
}
