//! `isolume view`: the live page, served on this machine or written into one file.

use super::console::Console;
use super::info::{self, check_store};
use super::isovalue::Isovalue;
use super::light::open_probe;
use super::output::check_file;
use super::{Failure, Outcome, text};
use crate::error::Error;
use crate::export::atomic;
use crate::probe::{EMBEDDED, Probe, ReadOptions};
use crate::transfer::store::Store;
use crate::view::page::{page, page_in_one_file};
use crate::view::{Coding, Options, Package, Subject, pack};
use serde_json::json;
use std::io::Write;
use std::path::PathBuf;
use tiny_http::{Header, Method, Request, Response, Server};

/// Look at a store in the browser: every isosurface, relit under the hand
///
/// Serves a page on 127.0.0.1 until Ctrl-C, or writes one file that opens without a network. The page needs a browser
/// with WebGL2. Environments (.hdr, .exr) can be dropped onto it.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  isolume view brain.isolume
  isolume view brain.isolume --html brain.html --texture-side 96 --env sunset.hdr")]
pub(super) struct View {
    /// The store
    #[arg(value_name = "X.isolume")]
    input: String,
    /// Write the page with its data into one file instead: 8-bit coefficients, reduced resolution
    #[arg(long, value_name = "OUT.html")]
    html: Option<PathBuf>,
    /// The isovalue to begin with: a number, a percentage of the range, or auto
    #[arg(
        short,
        long,
        visible_alias = "isovalues",
        value_name = "C",
        default_value = "auto",
        allow_hyphen_values = true
    )]
    isovalue: Isovalue,
    /// Environments besides the embedded ones: image files or skies, as relight takes them
    #[arg(short, long, value_name = "PROBE")]
    env: Vec<String>,
    /// Most texels along an axis; more are reduced to their means [default: 256, in one file 96]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=2048))]
    texture_side: Option<u32>,
    /// Most samples of the volume along an axis [default: 512, in one file 160]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=2048))]
    volume_side: Option<u32>,
    /// Port to serve on [default: a free one]
    #[arg(long, value_name = "PORT", default_value_t = 0, hide_default_value = true)]
    port: u16,
    /// Open the page in the browser of this system
    #[arg(long)]
    open: bool,
}

impl View {
    pub(super) fn run(&self, console: &Console) -> Outcome {
        check_store(&self.input)?;
        self.html.as_deref().map_or(Ok(()), check_file)?;
        let package = self.package(console)?;
        match &self.html {
            Some(path) => write_page(path, &package, console),
            None => self.serve(&package, console),
        }
    }

    fn package(&self, console: &Console) -> Outcome<Package> {
        let store = Store::open(&self.input)?;
        let volume = store.volume()?;
        let held = store.holdings()?;
        let isovalue = match held.isovalues.first() {
            Some(&first) if !held.all && self.isovalue == Isovalue::Auto => first,
            _ => self.isovalue.resolve(&volume, Some(volume.solid), None)?.value,
        };
        let names = self.env.iter().map(String::as_str).chain(EMBEDDED);
        let mut probes: Vec<Probe> = names.map(|name| open_probe(name, false, None)).collect::<Result<_, _>>()?;
        probes.dedup_by(|a, b| a.name == b.name);
        let one_file = self.html.is_some();
        let options = Options {
            texture_side: self.texture_side.map_or(if one_file { 96 } else { 256 }, |n| n as usize),
            volume_side: self.volume_side.map_or(if one_file { 160 } else { 512 }, |n| n as usize),
            coding: if one_file { Coding::Byte } else { Coding::Half },
        };
        let layout = store.layout();
        let identity = store.identity();
        let triple = |[x, y, z]: [usize; 3]| format!("{x} × {y} × {z}");
        let rays = if held.rays[0] == held.rays[1] {
            held.rays[0].to_string()
        } else {
            format!("{} to {}", held.rays[0], held.rays[1])
        };
        let about = [
            ("volume", format!("{}, {} samples", volume.name, triple(volume.dims()))),
            ("solid", format!("{} the isovalue", identity.solid)),
            ("texture", format!("{} texels", triple(layout.lattice.texels()))),
            ("layers", format!("{} with {:?} bands", layout.layers.len(), layout.layers.bands())),
            ("estimator", format!("{}, {rays} rays a texel, seed {}", identity.estimator, identity.seed)),
            ("isovalues", info::isovalues_text(&held)),
            ("store", identity.hash()[..16].to_string()),
            ("program", concat!("isolume ", env!("CARGO_PKG_VERSION")).into()),
        ];
        let subject = Subject {
            volume: &volume,
            source: &store,
            isovalues: (!held.all).then(|| held.isovalues.clone()),
            about: about.map(|(name, text)| (name.to_string(), text)).to_vec(),
            probes: &probes,
            isovalue,
        };
        let package = pack(&subject, &options)?;
        let reduced = |from: [usize; 3], to: [usize; 3]| {
            if from == to { triple(to) } else { format!("{} (of {})", triple(to), triple(from)) }
        };
        let coding = match options.coding {
            Coding::Half => "16-bit floats",
            Coding::Byte => "8 bits with a scale to each coefficient",
        };
        console.note(format!(
            "{}: samples {}, texels {}; {} texels with a level set × {} coefficients in {coding}, {}",
            self.input,
            reduced(volume.dims(), package.samples),
            reduced(layout.lattice.texels(), package.texels),
            text::count(package.valid_texels),
            layout.layers.coefficients(),
            text::bytes(package.payload.len() as f64),
        ));
        Ok(package)
    }

    fn serve(&self, package: &Package, console: &Console) -> Outcome {
        let server = Server::http(("127.0.0.1", self.port)).map_err(|e| {
            Failure::Message(format!("cannot serve on 127.0.0.1:{}: {e}; give another --port", self.port))
        })?;
        let address = format!("http://{}/", server.server_addr());
        console.print(format!("{address}  (Ctrl-C ends it)"));
        console.print_json(&json!({ "address": address }));
        if self.open {
            open_browser(&address, console);
        }
        let document = page();
        let header = package.header.to_string();
        for request in server.incoming_requests() {
            // A browser that went away is no reason to end.
            let _ = answer(request, &document, &header, &package.payload);
        }
        Ok(())
    }
}

fn write_page(path: &std::path::Path, package: &Package, console: &Console) -> Outcome {
    let document = page_in_one_file(package)?;
    let size = document.len();
    console.note(format!("{}: will be {}", path.display(), text::bytes(size as f64)));
    atomic::write(path, |w| w.write_all(document.as_bytes()).map_err(|e| Error::io(path, "write", e)))?;
    console.print(format!("{}  {}", path.display(), text::bytes(size as f64)));
    console.print_json(&json!({
        "path": path.display().to_string(), "bytes": size, "texels": package.texels, "samples": package.samples,
        "valid_texels": package.valid_texels,
    }));
    Ok(())
}

/// Largest environment that is taken from the page.
const MOST_PROBE_BYTES: usize = 1 << 28;

fn answer(mut request: Request, document: &str, header: &str, payload: &[u8]) -> std::io::Result<()> {
    // Only a page of this server may ask: a foreign name that resolves to this machine is refused.
    let host = request.headers().iter().find(|h| h.field.equiv("Host")).map(|h| h.value.as_str().to_string());
    let name = host.as_deref().map_or("", |h| h.rsplit_once(':').map_or(h, |(name, _)| name));
    if name != "127.0.0.1" && name != "localhost" {
        return request.respond(Response::from_string("this page is for 127.0.0.1").with_status_code(403));
    }
    let (method, url) = (request.method().clone(), request.url().to_string());
    let path = url.split('?').next().unwrap_or_default();
    match (method, path) {
        (Method::Get, "/") => request.respond(typed(document.as_bytes(), "text/html; charset=utf-8")),
        (Method::Get, "/header.json") => request.respond(typed(header.as_bytes(), "application/json")),
        (Method::Get, "/payload.bin") => request.respond(typed(payload, "application/octet-stream")),
        (Method::Post, "/probe") => {
            let mut bytes = Vec::new();
            let limit = MOST_PROBE_BYTES as u64 + 1;
            std::io::Read::read_to_end(&mut std::io::Read::take(request.as_reader(), limit), &mut bytes)?;
            match decode(&bytes) {
                Ok((size, pixels)) => {
                    let mut response = typed(bytemuck::cast_slice(&pixels), "application/octet-stream");
                    response.add_header(field("X-Image-Size", &size));
                    request.respond(response)
                }
                Err(message) => request.respond(Response::from_string(message).with_status_code(415)),
            }
        }
        _ => request.respond(Response::from_string("not found").with_status_code(404)),
    }
}

/// Size and pixels of an environment, for the page.
fn decode(bytes: &[u8]) -> Result<(String, Vec<[f32; 3]>), String> {
    if bytes.len() > MOST_PROBE_BYTES {
        return Err(format!("more than {}", text::bytes(MOST_PROBE_BYTES as f64)));
    }
    let probe = Probe::from_bytes("dropped", bytes, &ReadOptions::default()).map_err(|e| e.to_string())?;
    let image = &probe.image;
    Ok((format!("{}x{}", image.width(), image.height()), image.pixels().to_vec()))
}

fn typed<'a>(bytes: &'a [u8], kind: &str) -> Response<&'a [u8]> {
    let headers = vec![field("Content-Type", kind), field("Cache-Control", "no-store")];
    // With its length, so that a browser can say how far it is.
    Response::new(200.into(), headers, bytes, Some(bytes.len()), None).with_chunked_threshold(usize::MAX)
}

fn field(name: &str, value: &str) -> Header {
    let made = Header::from_bytes(name.as_bytes(), value.as_bytes());
    // Both are ASCII, by construction.
    made.unwrap_or_else(|()| unreachable!("{name}: {value} is a header"))
}

/// Asks the system for its browser; where there is none, the address on the terminal has to do.
fn open_browser(address: &str, console: &Console) {
    let program = if cfg!(target_os = "macos") {
        "open"
    } else if cfg!(windows) {
        "explorer"
    } else {
        "xdg-open"
    };
    if let Err(error) = std::process::Command::new(program).arg(address).spawn() {
        console.note(format!("{program} did not start ({error}): open the address by hand"));
    }
}
