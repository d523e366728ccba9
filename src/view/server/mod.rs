//! The server of the page: for this machine, for who has the address, for pages of its own.
//!
//! The address holds a random token, so that no other user of the machine and no page elsewhere can guess it; names of
//! other hosts and pages of other origins are refused besides. What a connection may take is bounded: a handler of its
//! own, of which there are at most 32, times, sizes, and one image decoded at a time.
//!
//! The only module of the library besides the command line that reads the clock, for these times and for how long a bake has gone on
//! whose draft is shown; no other number that is served depends on it.

mod http;

use super::{Package, page};
use crate::error::Error;
use crate::file;
use crate::probe::{Probe, ReadOptions};
use http::{Head, Refusal, Timed, read_body, read_head, write_answer};
use std::io::{self, Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError, RwLock};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Connections that are served at a time; more are turned away.
const MOST_CONNECTIONS: usize = 32;
/// Largest environment that is taken from the page.
const MOST_PROBE_BYTES: usize = 64 << 20;
/// Most pixels of it: 8192 × 4096, 400 MB as the page takes them.
const MOST_PROBE_PIXELS: usize = 1 << 25;
/// Environments that are received at a time, so that no more than these are held.
const MOST_UPLOADS: usize = 2;
/// How often a watched file is looked at.
const LOOK: Duration = Duration::from_millis(200);
/// Longest silence of the other side; the head of a request must be there within it.
const PATIENCE: Duration = Duration::from_secs(10);
/// Longest time for an environment to arrive.
const UPLOAD: Duration = Duration::from_secs(120);
/// What is read, at most, of a request that was refused, so that its sender gets to see why.
const DRAINED: u64 = 1 << 20;
const DRAINING: Duration = Duration::from_secs(1);

/// A server that answers, in a thread of its own: the page, its data, and environments that the page sends to be decoded.
pub struct Server {
    address: String,
    site: Arc<Site>,
    answering: JoinHandle<()>,
}

struct Site {
    token: String,
    /// Policy of the page: its own script alone, nothing from elsewhere, in no frame.
    policy: String,
    document: String,
    content: RwLock<Content>,
    connections: Arc<AtomicUsize>,
    uploads: Arc<AtomicUsize>,
    decoding: Mutex<()>,
}

/// What will take the place of what the page shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coming {
    /// Nothing.
    Nothing,
    /// What a watched file becomes when it is saved: the page loads itself again.
    Saved,
    /// A finer texture of the same volume: the page takes it as it stands.
    Finer,
}

/// What the page shows.
struct Content {
    header: Arc<String>,
    payload: Arc<Vec<u8>>,
    /// How often it was made anew.
    revision: u32,
    /// Why what was to come cannot be shown.
    message: Option<String>,
    baking: Option<Baking>,
}

/// How far the bake is of what will come.
struct Baking {
    done: u64,
    all: u64,
    since: Instant,
}

impl Content {
    fn new(mut package: Package, revision: u32, coming: Coming) -> Self {
        if coming != Coming::Nothing {
            // The page asks for changes then.
            package.header["watched"] = revision.into();
            package.header["draft"] = (coming == Coming::Finer).into();
        }
        let (header, payload) = (Arc::new(package.header.to_string()), Arc::new(package.payload));
        Self { header, payload, revision, message: None, baking: None }
    }

    /// What the page is told of what will come.
    fn state(&self) -> serde_json::Value {
        let progress = self.baking.as_ref().map(|baking| {
            serde_json::json!({ "done": baking.done, "all": baking.all, "seconds": baking.since.elapsed().as_secs_f64() })
        });
        serde_json::json!({ "revision": self.revision, "message": self.message, "progress": progress })
    }

    fn hear(&mut self, done: u64, all: u64) {
        match &mut self.baking {
            Some(baking) if baking.all == all && baking.done <= done => baking.done = done,
            // Another part of the bake.
            other => *other = Some(Baking { done, all, since: Instant::now() }),
        }
    }
}

/// A file that is looked at again and again.
pub struct Watched {
    path: PathBuf,
    stamp: Option<String>,
}

impl Watched {
    /// A file as it was at a [`file::stamp`], or as it stands now: take either before the file is read.
    pub fn new(path: impl Into<PathBuf>, stamp: Option<String>) -> Self {
        let path = path.into();
        Self { stamp: stamp.or_else(|| file::stamp(&path)), path }
    }

    /// Waits until the file was saved.
    fn wait(&mut self) {
        loop {
            std::thread::sleep(LOOK);
            let stamp = file::stamp(&self.path);
            if stamp.is_some() && stamp != self.stamp {
                self.stamp = stamp;
                return;
            }
        }
    }
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
    /// Serves a page with this package on this machine; port 0 is any that is free.
    ///
    /// # Errors
    /// When the port is taken, or the system has no random numbers or no thread.
    pub fn new(port: u16, package: Package, coming: Coming) -> Result<Self, Error> {
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
        let place = listener.local_addr().map_err(|e| Error::io("", "listen", e))?;
        let address = format!("http://{place}/{token}/");
        let site = Arc::new(Site {
            token,
            policy,
            document,
            content: RwLock::new(Content::new(package, 0, coming)),
            connections: Arc::default(),
            uploads: Arc::default(),
            decoding: Mutex::new(()),
        });
        let answering = std::thread::Builder::new().name("server".into()).spawn({
            let site = Arc::clone(&site);
            move || site.run(&listener)
        });
        let answering = answering.map_err(|e| Error::io("", "start a thread", e))?;
        Ok(Self { address, site, answering })
    }

    /// What to open in a browser: `http://127.0.0.1:PORT/TOKEN/`.
    pub fn address(&self) -> &str {
        &self.address
    }

    /// Shows what has been made, or says why it cannot be shown: then what was shown stays, with that message on the page.
    pub fn take(&self, made: Result<Package, String>, coming: Coming) {
        self.site.change(|content| match made {
            Ok(package) => *content = Content::new(package, content.revision + 1, coming),
            Err(message) => (content.message, content.baking) = (Some(message), None),
        });
    }

    /// Whom to tell how many of so many texels are baked of what will come; the page says so.
    pub fn listener(&self) -> impl Fn(u64, u64) + Send + Sync + 'static {
        let site = Arc::clone(&self.site);
        move |done, all| site.change(|content| content.hear(done, all))
    }

    /// Shows what a file has become whenever it is saved, for ever: `remake` makes the package of it, or says why it cannot.
    ///
    /// # Errors
    /// The first outer error of `remake`.
    pub fn watch<E>(
        self,
        mut file: Watched,
        mut remake: impl FnMut() -> Result<Result<Package, String>, E>,
    ) -> Result<(), E> {
        loop {
            file.wait();
            self.take(remake()?, Coming::Saved);
        }
    }

    /// Answers, for ever.
    pub fn wait(self) {
        // A bug that ended the thread has been told by it.
        let _ = self.answering.join();
    }
}

impl Site {
    /// Answers, for ever.
    fn run(self: &Arc<Self>, listener: &TcpListener) {
        for stream in listener.incoming() {
            let Ok(stream) = stream else {
                // Too many open files, say: the next one may find room.
                std::thread::sleep(Duration::from_millis(50));
                continue;
            };
            let Some(slot) = Slot::take(&self.connections, MOST_CONNECTIONS) else {
                let _ = self.turn_away(&stream);
                continue;
            };
            let site = Arc::clone(self);
            let handler = std::thread::Builder::new().name("connection".into());
            // A browser that went away, and a system without threads, are no reasons to end.
            let _ = handler.spawn(move || {
                let _slot = slot;
                site.serve(&stream)
            });
        }
    }

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
        let (header, payload, state) = {
            let content = self.content.read().unwrap_or_else(PoisonError::into_inner);
            (Arc::clone(&content.header), Arc::clone(&content.payload), content.state().to_string())
        };
        let (kind, body): (_, &[u8]) = match (head.method.as_str(), page) {
            ("GET" | "HEAD", "") => ("text/html; charset=utf-8", self.document.as_bytes()),
            ("GET" | "HEAD", "header.json") => ("application/json", header.as_bytes()),
            ("GET" | "HEAD", "payload.bin") => ("application/octet-stream", &payload),
            ("GET" | "HEAD", "watched.json") => ("application/json", state.as_bytes()),
            ("POST", "probe") => return self.receive(stream, head, begun),
            (_, "" | "header.json" | "payload.bin" | "watched.json") => {
                return Err(Refusal::new(405, "GET and HEAD alone"));
            }
            (_, "probe") => return Err(Refusal::new(405, "POST alone")),
            _ => return Err(Refusal::new(404, "not found")),
        };
        Ok(self.write(stream, 200, &[("Content-Type", kind)], body, head.method != "HEAD"))
    }

    fn change(&self, change: impl FnOnce(&mut Content)) {
        change(&mut self.content.write().unwrap_or_else(PoisonError::into_inner));
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
