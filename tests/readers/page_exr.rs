//! OpenEXR files dropped onto the page in one file: its decoder, run by node, against the pixels of the crate `exr`. Skips where
//! there is no node.

use exr::prelude::{
    AnyChannel, AnyChannels, Compression, Encoding, FlatSamples, Image, Layer, LayerAttributes, SmallVec, Vec2,
    WritableImage, f16, read_first_rgba_layer_from_file,
};
use std::path::{Path, PathBuf};
use std::process::Command;

/// Smooth, rough with a wide range, flat, and mostly black pictures, of sizes with and without odd sides.
fn pixel(kind: usize, x: usize, y: usize, c: usize) -> f32 {
    let hash = (x * 7919 + y * 104_729 + c * 1_299_709).wrapping_mul(2_654_435_761) >> 7;
    let noise = (hash % 10_007) as f32 / 10_007.0;
    match kind {
        0 => 1.0 + 0.01 * (x * (c + 1)) as f32 + 0.02 * y as f32,
        1 => 2f32.powf(30.0 * noise - 15.0),
        2 => 2.5,
        _ if noise < 0.03 => 1000.0 * noise,
        _ => 0.0,
    }
}

fn write(path: &Path, [width, height]: [usize; 2], kind: usize, half: bool, compression: Compression) {
    let channel = |(name, c): (&str, usize)| {
        let values = (0..width * height).map(|i| pixel(kind, i % width, i / width, c));
        let samples = if half {
            FlatSamples::F16(values.map(f16::from_f32).collect())
        } else {
            FlatSamples::F32(values.collect())
        };
        AnyChannel::new(name, samples)
    };
    let channels: SmallVec<[AnyChannel<FlatSamples>; 4]> =
        [("R", 0), ("G", 1), ("B", 2)].map(channel).into_iter().collect();
    let encoding = Encoding { compression, ..Encoding::UNCOMPRESSED };
    let layer = Layer::new(Vec2(width, height), LayerAttributes::default(), encoding, AnyChannels::sort(channels));
    Image::from_layer(layer).write().to_file(path).expect("written");
}

/// Pixels as the crate reads them.
fn pixels(path: &Path) -> Vec<u8> {
    let image = read_first_rgba_layer_from_file(
        path,
        |size: Vec2<usize>, _: &_| (size.0, vec![[0f32; 3]; size.0 * size.1]),
        |(width, pixels): &mut (usize, Vec<[f32; 3]>), at: Vec2<usize>, (r, g, b, _): (f32, f32, f32, f32)| {
            pixels[at.0 + at.1 * *width] = [r, g, b];
        },
    );
    let image = image.expect("read");
    image.layer_data.channel_data.pixels.1.iter().flatten().flat_map(|v| v.to_le_bytes()).collect()
}

#[test]
fn the_page_decodes_what_the_program_decodes() {
    if !Command::new("node").arg("--version").output().is_ok_and(|o| o.status.success()) {
        println!("skipped: no node");
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let read = [Compression::Uncompressed, Compression::RLE, Compression::ZIP1, Compression::ZIP16, Compression::PIZ];
    let mut files: Vec<PathBuf> = Vec::new();
    for (i, compression) in read.into_iter().enumerate() {
        for (s, size) in [[64, 48], [33, 70], [5, 3], [100, 1]].into_iter().enumerate() {
            for (kind, half) in (0..4).flat_map(|kind| [(kind, false), (kind, true)]) {
                let path = folder.path().join(format!("{i}-{s}-{kind}-{half}.exr"));
                write(&path, size, kind, half, compression);
                files.push(path);
            }
        }
    }
    for (i, compression) in [Compression::DWAA(None), Compression::DWAB(None)].into_iter().enumerate() {
        for (s, size) in [[64, 48], [33, 70], [5, 3], [100, 1], [40, 300]].into_iter().enumerate() {
            for (kind, half) in (0..4).flat_map(|kind| [(kind, false), (kind, true)]) {
                // Lossy: to the rounding of halves.
                let path = folder.path().join(format!("dwa-{i}-{s}-{kind}-{half}.exr"));
                write(&path, size, kind, half, compression);
                files.push(path);
            }
        }
    }
    let data = std::env::var_os("ISOLUME_DATA").map_or_else(|| "../shared/data".into(), PathBuf::from);
    for name in ["courtyard_256x128_piz_half.exr", "courtyard_256x128_zip.exr", "sunset.exr"] {
        let path = folder.path().join(if name == "sunset.exr" { "dwa-sunset.exr" } else { name });
        if std::fs::copy(data.join("probes").join(name), &path).is_ok() {
            files.push(path);
        }
    }
    for path in &files {
        std::fs::write(path.with_extension("f32"), pixels(path)).expect("written");
    }
    // What the page leaves to the program it says so, with the command.
    for (name, compression) in [("pxr24", Compression::PXR24), ("b44", Compression::B44)] {
        let path = folder.path().join(format!("{name}.exr"));
        write(&path, [64, 48], 0, true, compression);
        std::fs::write(path.with_extension("refused"), "isolume env convert X.exr -o X.hdr").expect("written");
    }
    let root = std::env::var_os("CARGO_MANIFEST_DIR").map_or_else(|| env!("CARGO_MANIFEST_DIR").into(), PathBuf::from);
    let script = root.join("tests/browser/openexr.mjs");
    let output = Command::new("node").arg(script).arg(folder.path()).output().expect("node runs");
    let text = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{text}");
}
