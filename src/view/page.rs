//! The page: HTML, style and scripts put together, with the data inside or beside it.
//!
//! The scripts are modules that import each other, so that they can be read and tested one by one. A page opened from
//! disk cannot import files, so they are joined into one module: lines that begin with `import ` go, `export ` too.

use super::Package;
use crate::error::{Error, Result};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use std::io::Write;

const HTML: &str = include_str!("page/page.html");
const STYLE: &str = include_str!("page/page.css");

/// The scripts, in an order in which names are defined before they run.
const SCRIPTS: [&str; 11] = [
    include_str!("page/sh.mjs"),
    include_str!("page/radiance.mjs"),
    include_str!("page/openexr_codes.mjs"),
    include_str!("page/openexr_dwa.mjs"),
    include_str!("page/openexr.mjs"),
    include_str!("page/host.mjs"),
    include_str!("page/data.mjs"),
    include_str!("page/shaders.mjs"),
    include_str!("page/camera.mjs"),
    include_str!("page/renderer.mjs"),
    include_str!("page/main.mjs"),
];

/// The page for a server: its data come from `header.json` and `payload.bin` beside it.
pub fn page() -> String {
    assemble("isolume", "")
}

/// The page in one file: the header as JSON, the payload deflated (zlib, RFC 1950) in base64.
///
/// # Errors
/// None in practice: a stream in memory takes all that is written.
pub fn page_in_one_file(package: &Package) -> Result<String> {
    let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::best());
    let deflated = encoder.write_all(&package.payload).and_then(|()| encoder.finish());
    let deflated = deflated.map_err(|e| Error::io("", "deflate", e))?;
    // In a script element "</script", "<!--" and "<script" have meanings of their own (HTML, 4.12.1.3).
    let header = package.header.to_string().replace('<', "\\u003c");
    let data = format!(
        "<script type=\"application/json\" id=\"header\">{header}</script>\n\
         <script type=\"application/octet-stream;base64\" id=\"payload\">{}</script>",
        STANDARD.encode(deflated)
    );
    let title = package.header["name"].as_str().unwrap_or("isolume");
    Ok(assemble(title, &data))
}

fn assemble(title: &str, data: &str) -> String {
    HTML.replace("<!--TITLE-->", &escape(title))
        .replace("/*STYLE*/", STYLE)
        .replace("/*SCRIPT*/", &script())
        .replace("<!--DATA-->", data)
}

/// The scripts as one module.
pub fn script() -> String {
    let mut out = String::new();
    for line in SCRIPTS.iter().flat_map(|s| s.lines()) {
        if !line.starts_with("import ") {
            out.push_str(line.strip_prefix("export ").unwrap_or(line));
            out.push('\n');
        }
    }
    out
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    /// Twice the same name is a syntax error of the one module, and no page.
    #[test]
    fn no_name_of_the_scripts_occurs_twice() {
        let script = script();
        let names = script.lines().flat_map(|line| {
            let mut words = line.split([' ', '(', '=', ';', '*']).filter(|word| !word.is_empty());
            let is_declaration = match words.next() {
                Some("async") => words.next() == Some("function"),
                first => matches!(first, Some("function" | "const" | "let" | "class")),
            };
            // One a line: lists and patterns do not stand at the top.
            words.next().filter(|name| is_declaration && !line.starts_with(' ') && !name.starts_with(['{', '[']))
        });
        let mut seen = BTreeSet::new();
        let twice: Vec<&str> = names.filter(|name| !seen.insert(name.to_string())).collect();
        assert!(seen.len() > 50 && twice.is_empty(), "{} names, twice {twice:?}", seen.len());
    }
}
