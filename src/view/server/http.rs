//! As much of HTTP/1.1 (RFC 9112) as one page needs: one request to a connection, bodies of a stated length.

use std::io::{self, Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

/// Longest head of a request, request line and fields, in bytes.
pub(super) const LONGEST_HEAD: usize = 16 << 10;
const END: &[u8] = b"\r\n\r\n";

/// The head of a request.
#[derive(Debug, PartialEq)]
pub(super) struct Head {
    pub(super) method: String,
    /// The path, without the query.
    pub(super) path: String,
    fields: Vec<(String, String)>,
}

/// Why a request is not served: a status and a sentence.
#[derive(Debug, PartialEq)]
pub(super) struct Refusal(pub(super) u16, pub(super) String);

impl Refusal {
    pub(super) fn new(status: u16, text: impl Into<String>) -> Self {
        Self(status, text.into())
    }
}

/// Reads as far as the head goes; with it what came of the body already. `None` where the other side has gone.
pub(super) fn read_head(from: &mut impl Read) -> Option<Result<(Head, Vec<u8>), Refusal>> {
    let mut bytes = Vec::new();
    let mut part = [0; 4096];
    loop {
        // The end may lie across two parts.
        let length = bytes.len();
        match from.read(&mut part) {
            Ok(0) => return None,
            Ok(n) => bytes.extend_from_slice(&part[..n]),
            Err(e) if e.kind() == io::ErrorKind::Interrupted => continue,
            Err(e) if is_time_out(&e) => return Some(Err(Refusal::new(408, "the request took too long"))),
            Err(_) => return None,
        }
        let start = length.saturating_sub(END.len() - 1);
        let end = bytes[start..].windows(END.len()).position(|four| four == END).map(|at| start + at);
        if end.unwrap_or(bytes.len()) > LONGEST_HEAD {
            return Some(Err(Refusal::new(431, format!("the head of a request has at most {LONGEST_HEAD} bytes"))));
        }
        if let Some(end) = end {
            let rest = bytes.split_off(end + END.len());
            return Some(Head::parse(&bytes[..end]).map(|head| (head, rest)));
        }
    }
}

/// Whether a read or write ended because nothing came in time.
pub(super) fn is_time_out(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut)
}

impl Head {
    fn parse(bytes: &[u8]) -> Result<Self, Refusal> {
        let wrong = |what: &str| Refusal::new(400, format!("no HTTP request: {what}"));
        let text = std::str::from_utf8(bytes).map_err(|_| wrong("not text"))?;
        let mut lines = text.split("\r\n");
        let words: Vec<&str> = lines.next().unwrap_or_default().split(' ').collect();
        let [method, target, "HTTP/1.1" | "HTTP/1.0"] = words[..] else {
            return Err(wrong("the first line"));
        };
        let mut fields: Vec<(String, String)> = Vec::new();
        for line in lines {
            let (name, value) = line.split_once(':').ok_or_else(|| wrong("a field without a colon"))?;
            if name.is_empty() || name.contains([' ', '\t']) {
                return Err(wrong("the name of a field"));
            }
            fields.push((name.to_ascii_lowercase(), value.trim().to_string()));
        }
        for once in ["host", "content-length", "origin"] {
            if fields.iter().filter(|(name, _)| name == once).count() > 1 {
                return Err(wrong("a field that is there twice"));
            }
        }
        let path = target.split('?').next().unwrap_or_default().to_string();
        Ok(Self { method: method.to_string(), path, fields })
    }

    /// The value of a field, by its name in lower case.
    pub(super) fn field(&self, name: &str) -> Option<&str> {
        self.fields.iter().find(|(n, _)| n == name).map(|(_, value)| value.as_str())
    }

    /// The length of the body.
    ///
    /// # Errors
    /// 411 where it is not stated, 413 where it is more than `most`.
    pub(super) fn length(&self, most: usize) -> Result<usize, Refusal> {
        let stated = self.field("content-length").filter(|_| self.field("transfer-encoding").is_none());
        let length: u64 =
            stated.and_then(|n| n.parse().ok()).ok_or_else(|| Refusal::new(411, "state the Content-Length"))?;
        match usize::try_from(length) {
            Ok(length) if length <= most => Ok(length),
            _ => Err(Refusal::new(413, format!("{length} bytes; at most {most} are taken"))),
        }
    }
}

/// Reads the body of a request; `begun` is what came of it with the head.
pub(super) fn read_body(from: &mut impl Read, begun: Vec<u8>, length: usize) -> io::Result<Vec<u8>> {
    let mut body = begun;
    body.truncate(length);
    let missing = (length - body.len()) as u64;
    from.take(missing).read_to_end(&mut body)?;
    if body.len() < length { Err(io::ErrorKind::UnexpectedEof.into()) } else { Ok(body) }
}

/// Writes an answer; for HEAD without its body.
pub(super) fn write_answer(
    to: &mut impl Write,
    status: u16,
    fields: &[(&str, &str)],
    body: &[u8],
    with_body: bool,
) -> io::Result<()> {
    let mut head = format!("HTTP/1.1 {status} {}\r\n", reason(status));
    let length = body.len().to_string();
    for (name, value) in fields.iter().chain(&[("Content-Length", length.as_str()), ("Connection", "close")]) {
        head.push_str(&format!("{name}: {value}\r\n"));
    }
    head.push_str("\r\n");
    to.write_all(head.as_bytes())?;
    if with_body {
        to.write_all(body)?;
    }
    to.flush()
}

fn reason(status: u16) -> &'static str {
    match status {
        200 => "OK",
        400 => "Bad Request",
        403 => "Forbidden",
        404 => "Not Found",
        405 => "Method Not Allowed",
        408 => "Request Timeout",
        411 => "Length Required",
        413 => "Content Too Large",
        415 => "Unsupported Media Type",
        431 => "Request Header Fields Too Large",
        503 => "Service Unavailable",
        _ => "Error",
    }
}

/// A connection that is read until a time, and waited for no longer than so long at once.
pub(super) struct Timed<'a> {
    pub(super) stream: &'a TcpStream,
    pub(super) until: Instant,
    pub(super) at_once: Duration,
}

impl Read for Timed<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let left = self.until.saturating_duration_since(Instant::now()).min(self.at_once);
        if left.is_zero() {
            return Err(io::ErrorKind::TimedOut.into());
        }
        self.stream.set_read_timeout(Some(left))?;
        self.stream.read(buffer)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Hands out at most so many bytes at a time.
    struct Slowly<'a>(&'a [u8], usize);

    impl Read for Slowly<'_> {
        fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
            let n = self.1.min(buffer.len()).min(self.0.len());
            buffer[..n].copy_from_slice(&self.0[..n]);
            self.0 = &self.0[n..];
            Ok(n)
        }
    }

    #[test]
    fn a_head_is_read_however_it_arrives() {
        let request = b"POST /a/probe?name=x HTTP/1.1\r\nHOST: here\r\nContent-Length:  5 \r\n\r\nhello and more";
        for step in [1, 2, 3, 7, 4096] {
            let mut stream = Slowly(request, step);
            let (head, begun) = read_head(&mut stream).expect("somebody").expect("a head");
            assert_eq!((head.method.as_str(), head.path.as_str()), ("POST", "/a/probe"));
            assert_eq!((head.field("host"), head.length(5)), (Some("here"), Ok(5)));
            assert_eq!(read_body(&mut stream, begun, 5).expect("a body"), b"hello");
        }
    }

    #[test]
    fn wrong_requests_get_the_status_that_names_them() {
        let status = |request: &[u8]| read_head(&mut &request[..]).map(|r| r.expect_err("a refusal").0);
        assert_eq!(status(b"GET /\r\n\r\n"), Some(400));
        assert_eq!(status(b"GET / HTTP/2\r\n\r\n"), Some(400));
        assert_eq!(status(b"GET / HTTP/1.1\r\nno colon\r\n\r\n"), Some(400));
        assert_eq!(status(b"GET / HTTP/1.1\r\nHost: a\r\nhost: b\r\n\r\n"), Some(400));
        assert_eq!(status(b"GET / HTTP/1.1\r\n\xff: a\r\n\r\n"), Some(400));
        assert_eq!(status(b"GET / HTTP/1.1\r\nHost"), None, "gone before the end");
        let endless = [b"GET / HTTP/1.1\r\nA: ".as_slice(), &vec![b'a'; LONGEST_HEAD]].concat();
        assert_eq!(status(&endless), Some(431));
        let head = |fields: &str| {
            let request = format!("POST / HTTP/1.1\r\n{fields}\r\n\r\n");
            read_head(&mut request.as_bytes()).expect("somebody").expect("a head").0
        };
        for (fields, expected) in [
            ("Content-Length: 11", 413),
            ("Content-Length: 99999999999999999999", 411),
            ("Content-Length: -1", 411),
            ("Host: a", 411),
            ("Transfer-Encoding: chunked\r\nContent-Length: 3", 411),
        ] {
            assert_eq!(head(fields).length(10).expect_err(fields).0, expected, "{fields}");
        }
    }
}
