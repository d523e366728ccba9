use super::{BadPixels, Layout, ReadImage, ReadOptions, read};
use crate::error::Error;
use exr::math::RoundingMode;
use exr::meta::attribute::EnvironmentMap;
use exr::prelude::{
    AnyChannel, AnyChannels, Blocks, Compression, Encoding, FlatSamples, Image, ImageAttributes, IntegerBounds, Layer,
    LayerAttributes, Levels, LineOrder, Vec2, WritableImage, f16,
};

fn pattern(width: usize, height: usize) -> Vec<[f32; 3]> {
    (0..width * height).map(|i| [i as f32 * 0.25, (i % 7) as f32, 1000.0 / (i + 1) as f32]).collect()
}

fn read_default(bytes: &[u8]) -> ReadImage {
    read(bytes, &ReadOptions::default()).unwrap()
}

/// An OpenEXR file with the given channels of `pattern`, in memory.
fn exr_file(
    size: (usize, usize),
    names: [&str; 3],
    encoding: Encoding,
    samples: impl Fn(Vec<f32>) -> FlatSamples,
    attributes: impl FnOnce(&mut LayerAttributes, &mut ImageAttributes),
) -> Vec<u8> {
    let pixels = pattern(size.0, size.1);
    let channels = (0..3)
        .filter(|c| !names[*c].is_empty())
        .map(|c| AnyChannel::new(names[c], samples(pixels.iter().map(|p| p[c]).collect())));
    let mut layer = Layer::new(size, LayerAttributes::default(), encoding, AnyChannels::sort(channels.collect()));
    let mut image_attributes = ImageAttributes::with_size(size);
    attributes(&mut layer.attributes, &mut image_attributes);
    let image = Image::empty(image_attributes).with_layer(layer);
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write().to_buffered(&mut bytes).unwrap();
    bytes.into_inner()
}

const RGB: [&str; 3] = ["R", "G", "B"];

fn f32_file(size: (usize, usize), names: [&str; 3]) -> Vec<u8> {
    exr_file(size, names, Encoding::UNCOMPRESSED, FlatSamples::F32, |_, _| {})
}

#[test]
fn exr_compressions_and_sample_types() {
    let encoding = |compression, blocks| Encoding { compression, blocks, line_order: LineOrder::Increasing };
    let expected = pattern(40, 20);
    for compression in
        [Compression::Uncompressed, Compression::RLE, Compression::ZIP1, Compression::ZIP16, Compression::PIZ]
    {
        for blocks in [Blocks::ScanLines, Blocks::Tiles(Vec2(16, 16))] {
            let file = exr_file((40, 20), RGB, encoding(compression, blocks), FlatSamples::F32, |_, _| {});
            let read = read_default(&file);
            assert_eq!(read.image.pixels(), expected, "{compression:?} {blocks:?}");
            assert!(read.notes.is_empty(), "{:?}", read.notes);
            assert_eq!((read.layout, read.format), (Layout::LatLong, "OpenEXR"));
        }
    }
    let half = |v: Vec<f32>| FlatSamples::F16(v.into_iter().map(f16::from_f32).collect());
    let lossy = [(Compression::PXR24, 1e-3), (Compression::B44, 0.2), (Compression::PIZ, 1e-3)];
    for (compression, tolerance) in lossy {
        let read = read_default(&exr_file((40, 20), RGB, encoding(compression, Blocks::ScanLines), half, |_, _| {}));
        for (found, expected) in read.image.pixels().iter().zip(&expected) {
            // B44 shares exponents over blocks of 16: its error is relative to the block.
            assert!((found[0] - expected[0]).abs() <= tolerance * (expected[0] + 20.0), "{compression:?}");
        }
    }
    let whole = |v: Vec<f32>| FlatSamples::U32(v.into_iter().map(|v| v as u32).collect());
    let read = read_default(&exr_file((40, 20), RGB, Encoding::UNCOMPRESSED, whole, |_, _| {}));
    assert_eq!(read.image.pixels()[17], [4.0, 3.0, 55.0]);
}

#[test]
fn exr_channel_names() {
    let expected = pattern(8, 4);
    for names in [["env.R", "env.G", "env.B"], ["r", "g", "b"], ["a.b.red", "a.b.green", "a.b.blue"]] {
        assert_eq!(read_default(&f32_file((8, 4), names)).image.pixels(), expected, "{names:?}");
    }
    for names in [["Y", "", ""], ["env.Y", "", ""], ["Y", "R", "Z"]] {
        let read = read_default(&f32_file((8, 4), names));
        assert_eq!(read.image.pixels()[9], [2.25; 3]);
        assert!(read.notes[0].text.contains("grey"));
    }
    let error = read(&f32_file((8, 4), ["R", "G", "Z"]), &ReadOptions::default()).unwrap_err();
    assert!(error.to_string().contains("found the channels G, R, Z"), "{error}");
}

#[test]
fn exr_windows_and_environments() {
    // A data window of 4 × 2 at (6, 5) in a display window of 8 × 4 at (4, 4).
    let file = exr_file((4, 2), RGB, Encoding::UNCOMPRESSED, FlatSamples::F32, |layer, image| {
        layer.layer_position = Vec2(6, 5);
        image.display_window = IntegerBounds::new((4, 4), (8, 4));
    });
    let read = read_default(&file);
    assert_eq!((read.image.width(), read.image.height()), (8, 4));
    for y in 0..4 {
        for x in 0..8 {
            let inside = (2..6).contains(&x) && (1..3).contains(&y);
            let expected = if inside { pattern(4, 2)[(y - 1) * 4 + x - 2] } else { [0.0; 3] };
            assert_eq!(read.image.row(y)[x], expected);
        }
    }
    assert_eq!(read.notes[0].count, 24);
    // A data window beyond the display window is cut.
    let file = exr_file((8, 4), RGB, Encoding::UNCOMPRESSED, FlatSamples::F32, |layer, image| {
        layer.layer_position = Vec2(-2, -1);
        image.display_window = IntegerBounds::new((0, 0), (4, 2));
    });
    let read = read_default(&file);
    assert_eq!(read.image.row(1)[3], pattern(8, 4)[2 * 8 + 5]);
    assert_eq!(read.notes[0].count, 24);
    // An environment is its data window.
    let file = exr_file((8, 4), RGB, Encoding::UNCOMPRESSED, FlatSamples::F32, |layer, image| {
        layer.layer_position = Vec2(-2, -1);
        layer.environment_map = Some(EnvironmentMap::LatitudeLongitude);
        image.display_window = IntegerBounds::new((0, 0), (4, 2));
    });
    assert_eq!(read_default(&file).image.pixels(), pattern(8, 4));
    let file = exr_file((4, 24), RGB, Encoding::UNCOMPRESSED, FlatSamples::F32, |layer, _| {
        layer.environment_map = Some(EnvironmentMap::Cube);
    });
    let read = read_default(&file);
    assert_eq!((read.layout, read.image.width(), read.stored_size), (Layout::CubeStrip, 16, [4, 24]));
}

#[test]
fn exr_mip_levels_and_parts() {
    let size = Vec2(16, 8);
    let sizes: Vec<Vec2<usize>> =
        exr::meta::mip_map_levels(RoundingMode::Down, size).map(|(_, level_size)| level_size).collect();
    let channel = |name: &str, value: f32| {
        let level_data = sizes.iter().enumerate().map(|(i, s)| FlatSamples::F32(vec![value - i as f32; s.area()]));
        AnyChannel::new(name, Levels::Mip { rounding_mode: RoundingMode::Down, level_data: level_data.collect() })
    };
    let channels = ["R", "G", "B"].into_iter().zip([10.0, 20.0, 30.0]).map(|(n, v)| channel(n, v));
    let encoding = Encoding { blocks: Blocks::Tiles(Vec2(8, 8)), ..Encoding::FAST_LOSSLESS };
    let layer = Layer::new(size, LayerAttributes::named("first"), encoding, AnyChannels::sort(channels.collect()));
    let mut second = layer.clone();
    second.attributes.layer_name = Some("second".into());
    let image = Image::empty(ImageAttributes::with_size(size)).with_layer(layer).with_layer(second);
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write().to_buffered(&mut bytes).unwrap();
    let read = read_default(&bytes.into_inner());
    assert_eq!((read.image.width(), read.image.height()), (16, 8));
    assert!(read.image.pixels().iter().all(|p| *p == [10.0, 20.0, 30.0]));
    assert!(read.notes[0].text.contains("several parts"));
}

/// A Radiance file of one colour, flat, with extra header lines.
fn radiance_file(lines: &str, resolution: &str, pixel: [u8; 4], count: usize) -> Vec<u8> {
    let mut bytes = format!("#?RGBE\n# made by hand\n{lines}\n{resolution}\n").into_bytes();
    bytes.extend(std::iter::repeat_n(pixel, count).flatten());
    bytes
}

#[test]
fn radiance_headers() {
    let pixel = [128, 64, 32, 129]; // 128/256 · 2 = 1, 0.5, 0.25
    let read = read_default(&radiance_file("FORMAT=32-bit_rle_rgbe\n", "-Y 2 +X 4", pixel, 8));
    assert_eq!((read.image.pixels()[7], read.notes.len()), ([1.0, 0.5, 0.25], 0));
    let lines = "EXPOSURE=2\nEXPOSURE= 0.25\nCOLORCORR=1 2 4\nVIEW= -vtv\nPRIMARIES=1 2 3\n";
    let read = read_default(&radiance_file(lines, "-Y 2 +X 4", pixel, 8));
    assert_eq!(read.image.pixels()[0], [2.0, 0.5, 0.125]);
    assert!(read.notes[0].text.contains("EXPOSURE"));
    for (lines, resolution, expected) in [
        ("", "+Y 2 +X 4", "+Y 2 +X 4"),
        ("", "-Y 2 -X 4", "-Y 2 -X 4"),
        ("", "-X 4 +Y 2", "-X 4 +Y 2"),
        ("", "-Y two +X 4", "two"),
        ("", "-Y 0 +X 4", "4x0"),
        ("EXPOSURE=none\n", "-Y 2 +X 4", "EXPOSURE=none"),
        ("EXPOSURE=0\n", "-Y 2 +X 4", "EXPOSURE=0"),
        ("COLORCORR=1 2\n", "-Y 2 +X 4", "COLORCORR=1 2"),
        ("FORMAT=32-bit_rle_xyze\n", "-Y 2 +X 4", "xyze"),
        ("", "-Y 1000000000 +X 1000000000", "1000000000x1000000000"),
        ("", "-Y 18446744073709551615 +X 18446744073709551615", "18446744073709551615"),
        ("", "-Y 3 +X 4", "Radiance HDR"), // more pixels than the file has
    ] {
        let error = read_error(&radiance_file(lines, resolution, pixel, 8));
        assert!(error.to_string().contains(expected), "{error}");
    }
}

fn read_error(bytes: &[u8]) -> Error {
    let error = read(bytes, &ReadOptions::default()).unwrap_err();
    assert!(matches!(error, Error::Format { .. } | Error::Limit { .. }), "{error}");
    error
}

#[test]
fn png_and_jpeg_become_linear_with_a_note() {
    let encode = |format| {
        let image = image::RgbImage::from_fn(8, 4, |_, _| image::Rgb([188, 128, 0]));
        let mut bytes = std::io::Cursor::new(Vec::new());
        image.write_to(&mut bytes, format).unwrap();
        bytes.into_inner()
    };
    let read = read_default(&encode(image::ImageFormat::Png));
    // sRGB 188 → 0.5029, 128 → 0.2159 (IEC 61966-2-1).
    let [r, g, b] = read.image.pixels()[5];
    assert!((r - 0.502_886).abs() < 1e-5 && (g - 0.215_861).abs() < 1e-5 && b == 0.0, "{r} {g} {b}");
    assert!(read.notes[0].text.contains("not an HDR image"));
    let [r, g, b] = read_default(&encode(image::ImageFormat::Jpeg)).image.pixels()[5];
    assert!((r - 0.503).abs() < 0.03 && (g - 0.216).abs() < 0.03 && b < 0.01, "{r} {g} {b}");
    let mut huge = encode(image::ImageFormat::Png);
    huge[16..24].copy_from_slice(&[0x7f, 0xff, 0xff, 0xff, 0x7f, 0xff, 0xff, 0xff]);
    read_error(&huge);
}

/// Every kind of PNG, against the crate `image`, which reads them another way.
#[test]
fn kinds_of_png_are_read_as_by_another_reader() {
    let noise = |n: usize| -> Vec<u8> { (0..n).map(|i| (i * 7919 % 251) as u8).collect() };
    for (colour, channels) in [
        (png::ColorType::Grayscale, 1),
        (png::ColorType::GrayscaleAlpha, 2),
        (png::ColorType::Rgb, 3),
        (png::ColorType::Rgba, 4),
    ] {
        for (depth, bytes) in [(png::BitDepth::Eight, 1), (png::BitDepth::Sixteen, 2)] {
            let mut file = Vec::new();
            let mut encoder = png::Encoder::new(&mut file, 8, 4);
            encoder.set_color(colour);
            encoder.set_depth(depth);
            let mut writer = encoder.write_header().unwrap();
            writer.write_image_data(&noise(32 * channels * bytes)).unwrap();
            writer.finish().unwrap();
            let other = image::load_from_memory(&file).unwrap().into_rgb16();
            let expected =
                other.pixels().map(|p| p.0.map(|v| crate::srgb::linear_from_srgb(f64::from(v) / 65535.0) as f32));
            let read = read_default(&file);
            assert_eq!(read.image.pixels(), expected.collect::<Vec<_>>(), "{colour:?} {depth:?}");
            assert_eq!(read.notes.len(), 1 + usize::from(channels % 2 == 0), "{:?}", read.notes);
        }
    }
    // A palette of two bits.
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, 4, 2);
    encoder.set_color(png::ColorType::Indexed);
    encoder.set_depth(png::BitDepth::Two);
    encoder.set_palette(vec![0, 0, 0, 255, 0, 0, 0, 255, 0, 255, 255, 255]);
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(&[0b00_01_10_11, 0b11_10_01_00]).unwrap();
    writer.finish().unwrap();
    let (k, r, g, w) = ([0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0; 3]);
    assert_eq!(read_default(&file).image.pixels(), [k, r, g, w, w, g, r, k]);
}

/// A header that claims more to unpack at once than the image may have.
#[test]
fn blocks_of_very_many_channels_are_refused() {
    let names: Vec<String> = (0..300).map(|i| format!("c{i:03}")).chain(RGB.map(String::from)).collect();
    let channels = names.iter().map(|n| AnyChannel::new(n.as_str(), FlatSamples::F32(vec![0.5; 64 * 32])));
    let encoding =
        Encoding { compression: Compression::ZIP16, blocks: Blocks::ScanLines, line_order: LineOrder::Increasing };
    let layer = Layer::new((64, 32), LayerAttributes::default(), encoding, AnyChannels::sort(channels.collect()));
    let image = Image::empty(ImageAttributes::with_size((64, 32))).with_layer(layer);
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write().to_buffered(&mut bytes).unwrap();
    let file = bytes.into_inner();
    assert_eq!(read_default(&file).image.pixels()[0], [0.5; 3]);
    // 16 lines of 64 pixels of 303 channels of 4 bytes are 1.2 MB; 16 bytes for each pixel of the image 33 kB.
    let options = ReadOptions { max_pixels: 64 * 32, ..ReadOptions::default() };
    let error = read(&file, &options).unwrap_err();
    assert!(matches!(error, Error::Limit { .. }) && error.to_string().contains("303 channels"), "{error}");
}

#[test]
fn impossible_pixels_are_counted() {
    let values = [[1.0, 2.0, 3.0], [f32::NAN, 1.0, -1.0], [f32::INFINITY, 0.0, 0.0], [-2.0, -0.5, 4.0]];
    let channel = |c: usize| {
        let samples = (0..8).map(|i| values.get(i).map_or(0.0, |v| v[c])).collect();
        AnyChannel::new(RGB[c], FlatSamples::F32(samples))
    };
    let channels = AnyChannels::sort((0..3).map(channel).collect());
    let image = Image::from_channels((4, 2), channels);
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write().to_buffered(&mut bytes).unwrap();
    let bytes = bytes.into_inner();
    let read_it = read_default(&bytes);
    assert_eq!(read_it.bad, BadPixels { nan: 1, infinite: 1, negative: 2 });
    assert_eq!(read_it.image.pixels()[..4], [[1.0, 2.0, 3.0], [0.0, 1.0, 0.0], [0.0; 3], [0.0, 0.0, 4.0]]);
    assert_eq!(read_it.notes.iter().map(|n| n.count).collect::<Vec<_>>(), [1, 1, 2]);
    let kept = read(&bytes, &ReadOptions { keep_negative: true, ..ReadOptions::default() }).unwrap();
    assert_eq!(kept.image.pixels()[1], [0.0, 1.0, -1.0]);
    assert_eq!(kept.image.pixels()[3], [-2.0, -0.5, 4.0]);
}

#[test]
fn single_pixels_and_odd_sizes() {
    for (size, layout) in [((1, 1), Layout::LatLong), ((7, 3), Layout::LatLong), ((5, 5), Layout::Angular)] {
        let read = read_default(&f32_file(size, RGB));
        assert_eq!(read.layout, layout);
        assert_eq!(read.stored_size, [size.0, size.1]);
    }
}

#[test]
fn damaged_files_are_refused_without_panic() {
    let hdr = crate::probe::embedded("courtyard").unwrap();
    let exr = exr_file((32, 16), RGB, Encoding::FAST_LOSSLESS, FlatSamples::F32, |_, _| {});
    let png = {
        let mut bytes = std::io::Cursor::new(Vec::new());
        image::RgbImage::new(32, 16).write_to(&mut bytes, image::ImageFormat::Png).unwrap();
        bytes.into_inner()
    };
    for whole in [hdr, &exr[..], &png[..]] {
        let last = if whole == &png[..] { whole.len() - 16 } else { whole.len() - 1 };
        for i in 0..40 {
            read_error(&whole[..last * i / 39]);
        }
    }
    let mut wrong = exr.clone();
    wrong[0] ^= 1;
    assert!(read_error(&wrong).to_string().contains("starts with bytes 77 2f 31 01"));
    assert!(read_error(b"PF\n1 1\n-1\n").to_string().contains("PFM"));
    assert!(read_error(b"").to_string().contains("empty"));
    // A header that claims 2³⁰ × 2³⁰ pixels: the data window is four i32 after its attribute's
    // name, type and size.
    let name = b"dataWindow\0box2i\0";
    let at = exr.windows(name.len()).position(|w| w == name).unwrap() + name.len() + 4 + 8;
    let mut huge = exr.clone();
    huge[at..at + 4].copy_from_slice(&((1i32 << 30) - 1).to_le_bytes());
    huge[at + 4..at + 8].copy_from_slice(&((1i32 << 30) - 1).to_le_bytes());
    read_error(&huge);
    // Any single byte may be wrong: an answer or an error, never a panic.
    for i in 0..exr.len().min(2000) {
        for flip in [0x01, 0x80, 0xff] {
            let mut bytes = exr.clone();
            bytes[i] ^= flip;
            let _ = read(&bytes, &ReadOptions { max_pixels: 1 << 20, ..ReadOptions::default() });
        }
    }
    for i in 0..400 {
        let mut bytes = hdr[..20_000].to_vec();
        bytes[i] ^= 0x55;
        let _ = read(&bytes, &ReadOptions { max_pixels: 1 << 20, ..ReadOptions::default() });
    }
}
