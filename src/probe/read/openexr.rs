//! OpenEXR through the crate `exr`: any compression it knows, half, float and unsigned channels,
//! scan lines or tiles, the largest of several resolution levels.

use super::{Layout, Note, Raw, ReadOptions, check_size, damaged};
use crate::error::{Error, Result};
use exr::math::Vec2;
use exr::meta::attribute::EnvironmentMap;
use exr::meta::header::Header;
use exr::meta::{BlockDescription, MetaData};
use exr::prelude::{IntegerBounds, ReadChannels, ReadLayers, ReadSpecificChannel, Text};
use std::io::Cursor;

const FORMAT: &str = "OpenEXR";

/// The channels that hold the colour of a part.
#[derive(Clone, Debug, PartialEq)]
enum Colour {
    /// Red, green, blue by their full names.
    Rgb([Text; 3]),
    /// Luminance alone.
    Grey(Text),
}

/// The colour channels of a part: R, G, B without a prefix; else of the first layer, in the
/// file's (alphabetic) order, that has all three; else Y or the first `layer.Y`. Names compare
/// without regard to case.
fn colour(header: &Header) -> Option<Colour> {
    let names: Vec<(String, &Text)> =
        header.channels.list.iter().map(|c| (c.name.to_string().to_lowercase(), &c.name)).collect();
    let find = |name: String| names.iter().find(|(lower, _)| *lower == name).map(|(_, text)| (*text).clone());
    let mut prefixes = vec![String::new()];
    for (lower, _) in &names {
        if let Some(end) = lower.rfind('.') {
            prefixes.push(lower[..=end].to_string());
        }
    }
    for suffixes in [["r", "g", "b"], ["red", "green", "blue"]] {
        for prefix in &prefixes {
            let [r, g, b] = suffixes.map(|s| find(format!("{prefix}{s}")));
            if let (Some(r), Some(g), Some(b)) = (r, g, b) {
                return Some(Colour::Rgb([r, g, b]));
            }
        }
    }
    prefixes.iter().find_map(|prefix| find(format!("{prefix}y"))).map(Colour::Grey)
}

fn no_colour(headers: &[Header]) -> Error {
    let names: Vec<String> = headers.iter().flat_map(|h| h.channels.list.iter()).map(|c| c.name.to_string()).collect();
    let deep = headers.iter().any(|h| h.deep);
    let chroma = names.iter().any(|n| n == "RY" || n == "BY");
    Error::format(
        FORMAT,
        match (deep, chroma) {
            (true, _) => "deep data".to_string(),
            (_, true) => "luminance with subsampled chroma (Y, RY, BY)".to_string(),
            _ => format!("the channels {}", names.join(", ")),
        },
        "flat channels R, G, B or Y, alone or with a layer's name before them",
        "write the image as RGB, for example with `oiiotool in.exr --ch R,G,B -o out.exr`",
    )
}

pub(super) fn read(bytes: &[u8], options: &ReadOptions) -> Result<Raw> {
    // The sizes are looked at before the decoder may allocate anything for them.
    let meta = MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(|e| damaged(FORMAT, e))?;
    for header in &meta.headers {
        check_size(FORMAT, header.layer_size.0 as u64, header.layer_size.1 as u64, options)?;
        check_block(header, options)?;
    }
    let mut parts = meta.headers.iter().filter(|h| !h.deep).filter_map(|h| colour(h).map(|c| (h, c)));
    let chroma = |h: &Header| h.channels.list.iter().any(|c| c.sampling != Vec2(1, 1));
    let (header, channels) = parts.find(|(h, _)| !chroma(h)).ok_or_else(|| no_colour(&meta.headers))?;
    let mut notes = Vec::new();
    if meta.headers.len() > 1 {
        let name = header.own_attributes.layer_name.as_ref().map_or("without a name".into(), ToString::to_string);
        notes.push(Note::new(
            format!("the file has several parts; read the first with colour ({name})"),
            meta.headers.len(),
        ));
    }
    match &channels {
        Colour::Grey(name) => notes.push(Note::new(format!("only luminance ({name}); taken as grey"), 1)),
        Colour::Rgb([r, g, b]) if r.to_string().contains('.') => {
            notes.push(Note::new(format!("read the channels {r}, {g}, {b}"), 1));
        }
        Colour::Rgb(_) => {}
    }
    let (size, pixels) = decode(bytes, header, &channels)?;
    let layout = header.own_attributes.environment_map.map(|e| match e {
        EnvironmentMap::LatitudeLongitude => Layout::LatLong,
        EnvironmentMap::Cube => Layout::CubeStrip,
    });
    let raw = Raw { format: FORMAT, width: size.0, height: size.1, pixels, layout, notes };
    if layout.is_some() {
        // The specification measures environments in the data window.
        return Ok(raw);
    }
    place(raw, header.own_attributes.layer_position, header.shared_attributes.display_window, options)
}

/// Most bytes to a pixel that a block may have if it held all pixels: a thousand channels over a whole image are no
/// environment, and a few megabytes of zeros deflated can claim them.
const MOST_BYTES_PER_PIXEL: usize = 16;

/// Refuses blocks (scan lines, tiles) that take more memory to decode than the largest image: all channels are unpacked.
fn check_block(header: &Header, options: &ReadOptions) -> Result<()> {
    let pixels = match header.blocks {
        BlockDescription::Tiles(tiles) => tiles.tile_size.0.checked_mul(tiles.tile_size.1),
        BlockDescription::ScanLines => {
            let lines = header.compression.scan_lines_per_block().min(header.layer_size.1);
            lines.checked_mul(header.layer_size.0)
        }
    };
    let needed = pixels.and_then(|pixels| pixels.checked_mul(header.channels.bytes_per_pixel));
    let limit = options.max_pixels.saturating_mul(MOST_BYTES_PER_PIXEL);
    if needed.is_some_and(|needed| needed <= limit) {
        return Ok(());
    }
    Err(Error::Limit {
        what: format!("a block of an {FORMAT} image of {} channels", header.channels.list.len()),
        needed: needed.map_or("more bytes than can be counted".into(), |needed| format!("{needed} bytes")),
        limit: format!("{limit} bytes"),
        remedy: "save the image with smaller tiles, fewer channels, or the header is damaged".into(),
    })
}

type Pixels = (Vec2<usize>, Vec<[f32; 3]>);

fn decode(bytes: &[u8], header: &Header, channels: &Colour) -> Result<Pixels> {
    let blank = |size: Vec2<usize>| (size, vec![[0.0f32; 3]; size.area()]);
    let put =
        |(size, pixels): &mut Pixels, at: Vec2<usize>, value: [f32; 3]| pixels[at.flat_index_for_size(*size)] = value;
    let cursor = Cursor::new(bytes);
    let start = exr::prelude::read().no_deep_data().largest_resolution_level().specific_channels();
    // One thread: the number of threads is the caller's business, and the crate would start its
    // own pool.
    let (size, pixels) = match channels.clone() {
        Colour::Rgb([r, g, b]) => {
            start
                .required::<f32>(r)
                .required::<f32>(g)
                .required::<f32>(b)
                .collect_pixels(
                    |size, _| blank(size),
                    move |image, at, (r, g, b): (f32, f32, f32)| put(image, at, [r, g, b]),
                )
                .first_valid_layer()
                .all_attributes()
                .non_parallel()
                .from_buffered(cursor)
                .map_err(|e| damaged(FORMAT, e))?
                .layer_data
                .channel_data
                .pixels
        }
        Colour::Grey(y) => {
            start
                .required::<f32>(y)
                .collect_pixels(|size, _| blank(size), move |image, at, (y,): (f32,)| put(image, at, [y; 3]))
                .first_valid_layer()
                .all_attributes()
                .non_parallel()
                .from_buffered(cursor)
                .map_err(|e| damaged(FORMAT, e))?
                .layer_data
                .channel_data
                .pixels
        }
    };
    if size != header.layer_size {
        return Err(damaged(FORMAT, "another part has the same channels in another size"));
    }
    Ok((size, pixels))
}

/// Puts the data window into the display window, black where there is no data; what lies
/// outside is cut.
fn place(mut raw: Raw, data_origin: Vec2<i32>, display: IntegerBounds, options: &ReadOptions) -> Result<Raw> {
    let (width, height) = (display.size.0, display.size.1);
    if data_origin == display.position && (raw.width, raw.height) == (width, height) {
        return Ok(raw);
    }
    check_size(FORMAT, width as u64, height as u64, options)?;
    let offset = |a: i32, b: i32| i64::from(a) - i64::from(b);
    let (dx, dy) = (offset(data_origin.0, display.position.0), offset(data_origin.1, display.position.1));
    let mut pixels = vec![[0.0; 3]; width * height];
    let mut covered = 0;
    for (i, pixel) in raw.pixels.iter().enumerate() {
        let (x, y) = ((i % raw.width) as i64 + dx, (i / raw.width) as i64 + dy);
        if (0..width as i64).contains(&x) && (0..height as i64).contains(&y) {
            pixels[y as usize * width + x as usize] = *pixel;
            covered += 1;
        }
    }
    if covered == 0 {
        raw.notes.push(Note::new("the data window lies outside the display window; the data window was read", 1));
        return Ok(raw);
    }
    if covered < width * height {
        let text = "pixels of the display window have no data (the data window is smaller); they are black";
        raw.notes.push(Note::new(text, width * height - covered));
    }
    if covered < raw.pixels.len() {
        let text = "pixels of the data window lie outside the display window; they were cut";
        raw.notes.push(Note::new(text, raw.pixels.len() - covered));
    }
    Ok(Raw { width, height, pixels, ..raw })
}
