//! The server of the page: for this machine, for who has the address, for pages of its own.
//!
//! The address holds a random token, so that no other user of the machine and no page elsewhere can guess it; names of
//! other hosts and pages of other origins are refused besides. What a connection may take is bounded: a handler of its
//! own, of which there are at most 32, times, sizes, and one image decoded at a time.
//!
//! The only module of the library besides the command line that reads the clock, for these times; no number that is
//! served depends on it.

mod http;

use super::{Package, page};
use crate::error::Error;
use crate::probe::{Probe, ReadOptions};
use http::{Head, Refusal, Timed, read_body, read_head, write_answer};
use std::io::{self, Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Connections that are served at a time; more are turned away.
const MOST_CONNECTIONS: usize = 32;
/// Largest environment that is taken from the page.
const MOST_PROBE_BYTES: usize = 64 << 20;
/// Most pixels of it: 8192 × 4096, 400 MB as the page takes them.
const MOST_PROBE_PIXELS: usize = 1 << 25;
/// Environments that are received at a time, so that no more than these are held.
const MOST_UPLOADS: usize = 2;
/// Longest silence of the other side; the head of a request must be there within it.
const PATIENCE: Duration = Duration::from_secs(10);
/// Longest time for an environment to arrive.
const UPLOAD: Duration = Duration::from_secs(120);
/// What is read, at most, of a request that was refused, so that its sender gets to see why.
const DRAINED: u64 = 1 << 20;
const DRAINING: Duration = Duration::from_secs(1);

/// A server that listens, but does not answer yet.
pub struct Server {
    listener: TcpListener,
    site: Arc<Site>,
}

struct Site {
    token: String,
    /// Policy of the page: its own script alone, nothing from elsewhere, in no frame.
    policy: String,
    document: String,
    header: String,
    payload: Vec<u8>,
    connections: Arc<AtomicUsize>,
    uploads: Arc<AtomicUsize>,
    decoding: Mutex<()>,
}

/// One of so many that may exist at a time.
struct Slot(Arc<AtomicUsize>);

impl Slot {
    fn take(count: &Arc<AtomicUsize>, most: usize) -> Option<Self> {
        let taken = count.fetch_update(Ordering::SeqCst, Ordering::SeqCst, |n| (n < most).then_some(n + 1));
        taken.is_ok().then(|| Self(Arc::clone(count)))
    }
}

impl Drop for Slot {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::SeqCst);
    }
}

/// 128 random bits as text.
fn random() -> Result<String, Error> {
    let mut bytes = [0; 16];
    getrandom::fill(&mut bytes).map_err(|e| Error::io("", "get random numbers", io::Error::other(e.to_string())))?;
    Ok(bytes.iter().map(|b| format!("{b:02x}")).collect())
}

impl Server {
    /// Listens on this machine, for who will ask for the page with this package; port 0 is any that is free.
    ///
    /// # Errors
    /// When the port is taken, or the system has no random numbers.
    pub fn new(port: u16, package: Package) -> Result<Self, Error> {
        let remedy = "give another --port";
        let taken = |e: io::Error| Error::argument("--port", format!("{port}: {e}"), "a port that is free", remedy);
        let listener = TcpListener::bind(("127.0.0.1", port)).map_err(taken)?;
        let (token, nonce) = (random()?, random()?);
        let policy = format!(
            "default-src 'none'; script-src 'nonce-{nonce}'; style-src 'unsafe-inline'; img-src data: blob:; \
             connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
        );
        let script = "<script type=\"module\"";
        let document = page().replace(script, &format!("{script} nonce=\"{nonce}\""));
        let site = Site {
            token,
            policy,
            document,
            header: package.header.to_string(),
            payload: package.payload,
            connections: Arc::default(),
            uploads: Arc::default(),
            decoding: Mutex::new(()),
        };
        Ok(Self { listener, site: Arc::new(site) })
    }

    /// What to open in a browser: `http://127.0.0.1:PORT/TOKEN/`.
    ///
    /// # Errors
    /// When the system does not say where it listens.
    pub fn address(&self) -> Result<String, Error> {
        let address = self.listener.local_addr().map_err(|e| Error::io("", "listen", e))?;
        Ok(format!("http://{address}/{}/", self.site.token))
    }

    /// Answers, for ever: the page, its data, and environments that it sends to be decoded.
    pub fn run(&self) {
        for stream in self.listener.incoming() {
            let Ok(stream) = stream else {
                // Too many open files, say: the next one may find room.
                std::thread::sleep(Duration::from_millis(50));
                continue;
            };
            let Some(slot) = Slot::take(&self.site.connections, MOST_CONNECTIONS) else {
                let _ = self.site.turn_away(&stream);
                continue;
            };
            let site = Arc::clone(&self.site);
            let handler = std::thread::Builder::new().name("connection".into());
            // A browser that went away, and a system without threads, are no reasons to end.
            let _ = handler.spawn(move || {
                let _slot = slot;
                site.serve(&stream)
            });
        }
    }
}

impl Site {
    fn serve(&self, stream: &TcpStream) -> io::Result<()> {
        stream.set_write_timeout(Some(PATIENCE))?;
        let mut timed = Timed { stream, until: Instant::now() + PATIENCE, at_once: PATIENCE };
        match read_head(&mut timed) {
            None => Ok(()),
            Some(Err(refusal)) => self.refuse(stream, true, &refusal),
            Some(Ok((head, begun))) => {
                let with_body = head.method != "HEAD";
                match self.answer(stream, &head, begun) {
                    Ok(written) => written,
                    Err(refusal) => self.refuse(stream, with_body, &refusal),
                }
            }
        }
    }

    fn answer(&self, stream: &TcpStream, head: &Head, begun: Vec<u8>) -> Result<io::Result<()>, Refusal> {
        let page = self.check(head)?;
        let (kind, body): (_, &[u8]) = match (head.method.as_str(), page) {
            ("GET" | "HEAD", "") => ("text/html; charset=utf-8", self.document.as_bytes()),
            ("GET" | "HEAD", "header.json") => ("application/json", self.header.as_bytes()),
            ("GET" | "HEAD", "payload.bin") => ("application/octet-stream", &self.payload),
            ("POST", "probe") => return self.receive(stream, head, begun),
            (_, "" | "header.json" | "payload.bin") => return Err(Refusal::new(405, "GET and HEAD alone")),
            (_, "probe") => return Err(Refusal::new(405, "POST alone")),
            _ => return Err(Refusal::new(404, "not found")),
        };
        Ok(self.write(stream, 200, &[("Content-Type", kind)], body, head.method != "HEAD"))
    }

    /// Refuses who may not ask; what is asked for otherwise, below the token.
    fn check<'h>(&self, head: &'h Head) -> Result<&'h str, Refusal> {
        // A foreign name that resolves to this machine is refused, and so are pages from elsewhere.
        let is_here = |host: &str| {
            let name = host.rsplit_once(':').map_or(host, |(name, _)| name);
            name == "127.0.0.1" || name.eq_ignore_ascii_case("localhost")
        };
        let host = head.field("host").unwrap_or_default();
        if !is_here(host) {
            return Err(Refusal::new(403, "this page is for 127.0.0.1"));
        }
        if let Some(origin) = head.field("origin")
            && !origin.strip_prefix("http://").is_some_and(|from| from.eq_ignore_ascii_case(host))
        {
            return Err(Refusal::new(403, "pages of another origin may not ask"));
        }
        let wrong = || Refusal::new(403, "use the whole address that isolume view printed");
        let (token, page) = head.path.strip_prefix('/').and_then(|p| p.split_once('/')).ok_or_else(wrong)?;
        // Every byte is looked at, so that the time tells nothing.
        let differs = token.bytes().zip(self.token.bytes()).fold(0, |all, (a, b)| all | (a ^ b));
        if token.len() != self.token.len() || differs != 0 {
            return Err(wrong());
        }
        Ok(page)
    }

    /// An environment that the page cannot decode: its pixels.
    fn receive(&self, stream: &TcpStream, head: &Head, begun: Vec<u8>) -> Result<io::Result<()>, Refusal> {
        let length = head.length(MOST_PROBE_BYTES)?;
        let busy = || Refusal::new(503, "other environments are being read; try again");
        let _slot = Slot::take(&self.uploads, MOST_UPLOADS).ok_or_else(busy)?;
        if head.field("expect").is_some_and(|e| e.eq_ignore_ascii_case("100-continue")) {
            let go_on = (&*stream).write_all(b"HTTP/1.1 100 Continue\r\n\r\n");
            go_on.map_err(|_| Refusal::new(400, "the connection ended"))?;
        }
        let mut timed = Timed { stream, until: Instant::now() + UPLOAD, at_once: PATIENCE };
        let body = read_body(&mut timed, begun, length);
        let body = body.map_err(|_| Refusal::new(408, "the environment did not arrive"))?;
        let _one = self.decoding.lock().unwrap_or_else(PoisonError::into_inner);
        let options = ReadOptions { max_pixels: MOST_PROBE_PIXELS, ..ReadOptions::default() };
        let probe = Probe::from_bytes("dropped", &body, &options).map_err(|e| Refusal::new(415, e.to_string()))?;
        drop(body);
        let image = &probe.image;
        let size = format!("{}x{}", image.width(), image.height());
        let fields = [("Content-Type", "application/octet-stream"), ("X-Image-Size", &size)];
        Ok(self.write(stream, 200, &fields, bytemuck::cast_slice(image.pixels()), true))
    }

    fn write(
        &self,
        mut stream: &TcpStream,
        status: u16,
        fields: &[(&str, &str)],
        body: &[u8],
        with_body: bool,
    ) -> io::Result<()> {
        let always = [
            ("Cache-Control", "no-store"),
            ("X-Content-Type-Options", "nosniff"),
            ("X-Frame-Options", "DENY"),
            ("Cross-Origin-Resource-Policy", "same-origin"),
            // The address is a secret.
            ("Referrer-Policy", "no-referrer"),
            ("Content-Security-Policy", self.policy.as_str()),
        ];
        write_answer(&mut stream, status, &[fields, &always].concat(), body, with_body)
    }

    /// Refuses without waiting for the request.
    fn turn_away(&self, stream: &TcpStream) -> io::Result<()> {
        stream.set_write_timeout(Some(DRAINING))?;
        self.write(stream, 503, &[], b"too many connections at a time; try again", true)
    }

    fn refuse(&self, stream: &TcpStream, with_body: bool, refusal: &Refusal) -> io::Result<()> {
        let Refusal(status, why) = refusal;
        self.write(stream, *status, &[("Content-Type", "text/plain; charset=utf-8")], why.as_bytes(), with_body)?;
        if *status == 408 {
            return Ok(()); // Nothing comes.
        }
        // A connection that is closed before all is read is reset, and the answer lost.
        stream.shutdown(Shutdown::Write)?;
        let timed = Timed { stream, until: Instant::now() + DRAINING, at_once: DRAINING };
        io::copy(&mut timed.take(DRAINED), &mut io::sink()).map(drop)
    }
}
