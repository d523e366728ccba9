//! Small valid files of every kind that is read: written from the formats' definitions or by the
//! encoders this program uses. The committed corpus was made from these by `write_the_corpus`.

use exr::prelude::{
    AnyChannel, AnyChannels, Blocks, Compression, Encoding, FlatSamples, Image, ImageAttributes, Layer,
    LayerAttributes, LineOrder, Vec2, WritableImage, f16,
};
use std::io::Cursor;

/// Name of a seed and its bytes.
pub type Seed = (&'static str, Vec<u8>);

fn data() -> Vec<u8> {
    (0..24).map(|i| i * 10).collect()
}

fn floats() -> Vec<f32> {
    (0..24).map(|i| i as f32 * 0.5 - 3.0).collect()
}

pub fn nifti() -> Vec<Seed> {
    let header = |code: i16, big: bool| {
        let mut bytes = vec![0u8; 352];
        let mut put = |at: usize, value: &[u8]| {
            let mut value = value.to_vec();
            if big {
                value.reverse();
            }
            bytes[at..at + value.len()].copy_from_slice(&value);
        };
        put(0, &348i32.to_le_bytes());
        for (i, d) in [3i16, 2, 3, 4, 1, 1, 1, 1].into_iter().enumerate() {
            put(40 + 2 * i, &d.to_le_bytes());
        }
        put(70, &code.to_le_bytes());
        for i in 0..8 {
            put(76 + 4 * i, &1f32.to_le_bytes());
        }
        put(108, &352f32.to_le_bytes());
        put(112, &2f32.to_le_bytes());
        // A qform of a quarter turn and an sform.
        put(252, &1i16.to_le_bytes());
        put(254, &i16::from(big).to_le_bytes());
        put(256, &0.5f32.to_le_bytes());
        for i in 0..3 {
            put(280 + 16 * i + 4 * i, &(1.0 + i as f32).to_le_bytes());
        }
        bytes[344..348].copy_from_slice(b"n+1\0");
        bytes
    };
    let big: Vec<u8> = floats().iter().flat_map(|v| v.to_be_bytes()).collect();
    let mut second = vec![0u8; 544];
    let fields: [(usize, &[u8]); 6] = [
        (0, &540i32.to_le_bytes()),
        (4, b"n+2\0\r\n\x1a\n"),
        (12, &2i16.to_le_bytes()),
        (168, &544i64.to_le_bytes()),
        (344, &1i32.to_le_bytes()),
        (352, &0.5f64.to_le_bytes()),
    ];
    for (at, field) in fields {
        second[at..at + field.len()].copy_from_slice(field);
    }
    for (i, d) in [3i64, 2, 3, 4, 1, 1, 1, 1].into_iter().enumerate() {
        second[16 + 8 * i..24 + 8 * i].copy_from_slice(&d.to_le_bytes());
        second[104 + 8 * i..112 + 8 * i].copy_from_slice(&1f64.to_le_bytes());
    }
    vec![
        ("u8.nii", [header(2, false), data()].concat()),
        ("f32_big.nii", [header(16, true), big].concat()),
        ("second.nii", [second, data()].concat()),
    ]
}

pub fn nrrd() -> Vec<Seed> {
    let head = |kind: &str, encoding: &str, more: &str| {
        format!(
            "NRRD0004\n# made here\ntype: {kind}\ndimension: 3\nsizes: 2 3 4\nendian: little\nencoding: {encoding}\n{more}\n"
        )
    };
    let join = |head: String, data: &[u8]| [head.as_bytes(), data].concat();
    let text: String = floats().iter().map(|v| format!("{v} ")).collect();
    let space = "space: left-posterior-superior\nspace directions: (1,0,0) (0,2,0) (0,0.5,3)\nspace origin: (1,2,3)\nspace units: \"mm\" \"mm\" \"mm\"\n";
    let axes = "spacings: 1 2 nan\naxis mins: 0 1 2\ncenterings: cell cell node\nunits: \"mm\" \"mm\" \"mm\"\nbyte skip: 2\nline skip: 1\n";
    let mut skipped = b"a line\nxx".to_vec();
    skipped.extend(floats().iter().flat_map(|v| v.to_le_bytes()));
    vec![
        ("u8.nrrd", join(head("uchar", "raw", space), &data())),
        ("f32.nrrd", join(head("float", "raw", axes), &skipped)),
        ("gzip.nrrd", join(head("uchar", "gzip", ""), &super::mutate::gzip(&data()))),
        ("ascii.nrrd", join(head("double", "ascii", ""), text.as_bytes())),
    ]
}

pub fn mrc() -> Vec<Seed> {
    let header = |mode: i32| {
        let mut bytes = vec![0u8; 1024];
        let words = [(0, 2), (1, 3), (2, 4), (3, mode), (4, -1), (7, 2), (8, 3), (9, 4), (16, 3), (17, 1), (18, 2)];
        for (word, value) in words {
            bytes[4 * word..4 * word + 4].copy_from_slice(&i32::to_le_bytes(value));
        }
        for (word, value) in [(10, 2.0f32), (11, 3.0), (12, 4.0), (13, 90.0), (14, 90.0), (15, 100.0), (49, 1.5)] {
            bytes[4 * word..4 * word + 4].copy_from_slice(&value.to_le_bytes());
        }
        bytes[208..213].copy_from_slice(b"MAP D");
        bytes
    };
    let real: Vec<u8> = floats().iter().flat_map(|v| v.to_le_bytes()).collect();
    vec![("i8.mrc", [header(0), data()].concat()), ("f32.ccp4", [header(2), real].concat())]
}

pub fn cube() -> Vec<Seed> {
    let values = "1.5 -2.0E-03 ".repeat(12);
    let plain = format!("title\ncomment\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n6 6.0 0.1 0.2 0.3\n{values}\n");
    let twice = "1.5 -2.5-103 ".repeat(24);
    let orbitals = format!("a\nb\n-1 0 0 0\n-2 1 0 0\n3 0 1 0.2\n4 0 0 1\n6 6.0 0 0 0\n2 5 6\n{twice}");
    vec![("density.cube", plain.into_bytes()), ("orbitals.cube", orbitals.into_bytes())]
}

pub fn vtk() -> Vec<Seed> {
    let head = |encoding: &str, kind: &str| {
        format!(
            "# vtk DataFile Version 3.0\ntitle\n{encoding}\nDATASET STRUCTURED_POINTS\nDIMENSIONS 2 3 4\nSPACING 1 2 3\n\
             ORIGIN 0 0 -1\nPOINT_DATA 24\n{kind}\nLOOKUP_TABLE default\n"
        )
    };
    let text: String = floats().iter().map(|v| format!("{v}\n")).collect();
    let fractions = "0.5 ".repeat(24);
    vec![
        ("binary.vtk", [head("BINARY", "SCALARS s unsigned_char 1").into_bytes(), data()].concat()),
        ("ascii.vtk", (head("ASCII", "SCALARS s float") + &text).into_bytes()),
        ("colour.vtk", (head("ASCII", "COLOR_SCALARS s 1") + &fractions).into_bytes()),
    ]
}

// From here to the end of `npz`: formats of which a file can be read whole by these functions alone.
fn zlib(bytes: &[u8]) -> Vec<u8> {
    use std::io::Write;
    let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(bytes).expect("memory");
    encoder.finish().expect("memory")
}

pub fn vti() -> Vec<Seed> {
    let file = |root: &str, section: &str, array: &str, appended: &[u8]| {
        let head = format!(
            "<?xml version=\"1.0\"?>\n<!-- x -->\n<VTKFile type=\"ImageData\" byte_order=\"LittleEndian\" {root}>\n<ImageData \
             WholeExtent=\"1 2 0 2 -1 2\" Origin=\"0 1 2\" Spacing=\"1 2 3\" Direction=\"0 1 0 1 0 0 0 0 1\">\n<Piece Extent=\"1 2 0 2 \
             -1 2\">\n<{section}>\n<DataArray Name=\"h\" {array}</PointData>\n</Piece>\n</ImageData>\n"
        );
        let end: &[u8] = if appended.is_empty() { b"" } else { b"\n</AppendedData>\n" };
        [head.as_bytes(), appended, end, b"</VTKFile>\n"].concat()
    };
    let text: String = floats().iter().map(|v| format!("{v} ")).collect();
    let raw = [b"<AppendedData encoding=\"raw\">\n_".as_slice(), &24u32.to_le_bytes(), &data()].concat();
    let base64 = "GAAAAAAAAAA=AAECAwQFBgcICQoLDA0ODxAREhMUFRYX";
    // Two blocks of zlib, and one of LZ4 of literals alone.
    let blocks = [zlib(&data()[..16]), zlib(&data()[16..])];
    let head = [2, 16, 8, blocks[0].len() as u64, blocks[1].len() as u64].map(u64::to_le_bytes).concat();
    let packed = [b"<AppendedData encoding=\"raw\">_".as_slice(), &head, &blocks.concat()].concat();
    let lz4 = [vec![0xf0, 9], data()].concat();
    let head = [1, 24, 0, lz4.len() as u32].map(u32::to_le_bytes).concat();
    let lz4 = [b"<AppendedData encoding=\"raw\">_".as_slice(), &head, &lz4].concat();
    let bytes = "type=\"UInt8\" format=\"appended\" offset=\"0\"/>";
    let two = format!(
        "type=\"Float64\" format=\"ascii\">{text}</DataArray><DataArray Name=\"v\" type=\"UInt8\" NumberOfComponents=\"1\" \
         format=\"binary\">{base64}</DataArray>"
    );
    vec![
        ("ascii.vti", file("", "PointData", &format!("type=\"Float32\" format=\"ascii\">{text}</DataArray>"), b"")),
        ("raw.vti", file("", "PointData Scalars=\"h\"", bytes, &raw)),
        ("zlib.vti", file("header_type=\"UInt64\" compressor=\"vtkZLibDataCompressor\"", "PointData", bytes, &packed)),
        ("lz4.vti", file("compressor=\"vtkLZ4DataCompressor\"", "PointData", bytes, &lz4)),
        ("two.vti", file("header_type=\"UInt64\"", "PointData Scalars=\"h\"", &two, b"")),
    ]
}

pub fn metaimage() -> Vec<Seed> {
    let head = |kind: &str, more: &str| {
        format!(
            "ObjectType = Image\nNDims = 3\nDimSize = 2 3 4\nElementType = MET_{kind}\nElementSpacing = 1 2 3\nOffset = 1 -2 3\n\
             TransformMatrix = 0 1 0 1 0 0 0 0 1\n{more}ElementDataFile = LOCAL\n"
        )
    };
    let join = |head: String, data: &[u8]| [head.as_bytes(), data].concat();
    let big: Vec<u8> = floats().iter().flat_map(|v| v.to_be_bytes()).collect();
    let text: String = floats().iter().map(|v| format!("{v} ")).collect();
    let series = head("UCHAR", "ElementNumberOfChannels = 1\n")
        .replace("NDims = 3", "NDims = 4")
        .replace("2 3 4\n", "2 3 2 2\n")
        .replace("1 2 3\n", "1 2 3 4\n")
        .replace("1 -2 3\n", "1 -2 3 0\n")
        .replace("0 1 0 1 0 0 0 0 1", "0 1 0 0 1 0 0 0 0 0 1 0 0 0 0 1");
    vec![
        ("u8.mha", join(head("UCHAR", ""), &data())),
        ("f32_big.mha", join(head("FLOAT", "BinaryDataByteOrderMSB = True\n"), &big)),
        ("zlib.mha", join(head("UCHAR", "CompressedData = True\nAnatomicalOrientation = RAI\n"), &zlib(&data()))),
        ("text.mha", join(head("DOUBLE", "BinaryData = False\n"), text.as_bytes())),
        ("series.mha", join(series, &data())),
    ]
}

pub fn dx() -> Vec<Seed> {
    let head = |counts: &str, array: &str| {
        format!(
            "# x\nobject 1 class gridpositions counts {counts}\norigin 1 -2 3\ndelta 0.5 0 0\ndelta 0 0.7 0.1\ndelta 0 0 1.1\n\
             object 2 class gridconnections counts {counts}\nobject \"the data\" class array {array} data follows\n"
        )
    };
    let text: String = floats().iter().map(|v| format!("{v} ")).collect();
    let end = "\nattribute \"dep\" string \"positions\"\nobject \"x y\" class field\n";
    let big: Vec<u8> = floats().iter().flat_map(|v| v.to_be_bytes()).collect();
    vec![
        ("text.dx", (head("2 3 4", "type double rank 0 items 24") + &text + end).into_bytes()),
        ("cells.dx", (head("3 4 5", "type float rank 0 items 24") + &text + end).into_bytes()),
        ("big.dx", [head("2 3 4", "type float rank 0 items 24 msb ieee").as_bytes(), &big].concat()),
    ]
}

pub fn plt() -> Vec<Seed> {
    let numbers = [3u32, 200, 4, 3, 2];
    let ends = [0.0f32, 3.0, -1.0, 1.0, 0.5, 1.0];
    let rest = [&ends[..], &floats()].concat();
    let big = numbers.iter().flat_map(|n| n.to_be_bytes()).chain(rest.iter().flat_map(|v| v.to_be_bytes()));
    let little = numbers.iter().flat_map(|n| n.to_le_bytes()).chain(rest.iter().flat_map(|v| v.to_le_bytes()));
    vec![("big.plt", big.collect()), ("little.plt", little.collect())]
}

pub fn npz() -> Vec<Seed> {
    let npy = |descr: &str, shape: &str, data: &[u8]| {
        let head = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({shape}), }}\n");
        [&b"\x93NUMPY\x01\0"[..], &[head.len() as u8, 0], head.as_bytes(), data].concat()
    };
    let zip = |entries: &[(&str, Vec<u8>)], deflate: bool| {
        let (mut out, mut directory) = (Vec::new(), Vec::new());
        for (name, bytes) in entries {
            let mut crc = flate2::Crc::new();
            crc.update(bytes);
            // A stream of zlib without its two bytes in front and its checksum.
            let stream = zlib(bytes);
            let packed = if deflate { &stream[2..stream.len() - 4] } else { bytes };
            let sizes = [crc.sum(), packed.len() as u32, bytes.len() as u32].map(u32::to_le_bytes).concat();
            let length = (name.len() as u16).to_le_bytes();
            let fields =
                [&[20, 0, 0, 0, if deflate { 8 } else { 0 }, 0, 0, 0, 0x21, 0], &sizes[..], &length, &[0, 0]].concat();
            let offset = (out.len() as u32).to_le_bytes();
            out.extend([b"PK\x03\x04", &fields[..], name.as_bytes(), packed].concat());
            directory.extend([b"PK\x01\x02\x14\0", &fields[..], &[0; 10], &offset, name.as_bytes()].concat());
        }
        let count = (entries.len() as u16).to_le_bytes();
        let [start, length] = [out.len() as u32, directory.len() as u32].map(u32::to_le_bytes);
        [&out[..], &directory, b"PK\x05\x06\0\0\0\0", &count, &count, &length, &start, &[0, 0]].concat()
    };
    let map: Vec<u8> = (0..12).flat_map(|i| f64::from(u8::from(i % 5 == 0)).to_le_bytes()).collect();
    let array = ("h.npy", npy("|u1", "4, 3, 2", &data()));
    let ours =
        [array.clone(), ("affine.npy", npy("<f8", "3, 4", &map)), ("unit.npy", npy("<U2", "", b"m\0\0\0m\0\0\0"))];
    vec![("stored.npz", zip(&[array], false)), ("deflated.npz", zip(&ours, true))]
}

pub fn npy() -> Vec<Seed> {
    let file = |descr: &str, order: &str, data: &[u8]| {
        let head = format!("{{'descr': '{descr}', 'fortran_order': {order}, 'shape': (4, 3, 2), }}\n");
        [&b"\x93NUMPY\x01\0"[..], &[head.len() as u8, 0], head.as_bytes(), data].concat()
    };
    let real: Vec<u8> = floats().iter().flat_map(|v| f64::from(*v).to_be_bytes()).collect();
    vec![("u8.npy", file("|u1", "False", &data())), ("f64_big.npy", file(">f8", "True", &real))]
}

pub fn tiff() -> Vec<Seed> {
    use tiff::encoder::{Compression, DeflateLevel, TiffEncoder, colortype};
    let stack = |compression: Compression, deep: bool| {
        let mut bytes = Cursor::new(Vec::new());
        let mut encoder = TiffEncoder::new(&mut bytes).expect("memory").with_compression(compression);
        for page in 0..3u8 {
            if deep {
                let values: Vec<u16> = (0..8).map(|i| 1000 * u16::from(page) + i).collect();
                encoder.write_image::<colortype::Gray16>(4, 2, &values).expect("memory");
            } else {
                encoder.write_image::<colortype::Gray8>(4, 2, &[page; 8]).expect("memory");
            }
        }
        bytes.into_inner()
    };
    vec![
        ("u8.tif", stack(Compression::Uncompressed, false)),
        ("lzw.tif", stack(Compression::Lzw, true)),
        ("deflate.tif", stack(Compression::Deflate(DeflateLevel::Fast), true)),
        ("packbits.tif", stack(Compression::Packbits, false)),
    ]
}

/// Sidecars; the samples beside them are made by the target.
pub fn raw() -> Vec<Seed> {
    let full = r#"{"dims": [2, 3, 4], "type": "uint8", "endian": "big", "offset": 0, "spacing": [1, 2, 3.5],
"origin": [-1e3, 0, 1], "slope": 0.5, "inter": -3, "data": "samples.raw"}"#;
    let gzip = r#"{"dims": [2, 3, 2], "type": "int16", "data": "samples.gz"}"#;
    vec![("full.json", full.into()), ("gzip.json", gzip.into())]
}

/// Headers whose samples lie in a second file.
pub fn pairs() -> Vec<Seed> {
    let mut nifti = nifti().swap_remove(0).1;
    nifti.truncate(352);
    nifti[344..348].copy_from_slice(b"ni1\0");
    nifti[108..112].copy_from_slice(&0f32.to_le_bytes());
    let nhdr =
        "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 2 3 4\nencoding: raw\nbyte skip: -1\ndata file: samples.raw\n";
    let mhd = "NDims = 3\nDimSize = 2 3 4\nElementType = MET_UCHAR\nHeaderSize = -1\nElementDataFile = samples.raw\n";
    let pvti = "<VTKFile type=\"PImageData\"><PImageData WholeExtent=\"1 2 0 2 -1 2\" Origin=\"0 1 2\" Spacing=\"1 2 3\" \
                Direction=\"0 1 0 1 0 0 0 0 1\"><PPointData Scalars=\"h\"><PDataArray type=\"UInt8\" Name=\"h\"/></PPointData>\
                <Piece Extent=\"1 2 0 2 -1 2\" Source=\"piece.vti\"/></PImageData></VTKFile>";
    vec![
        ("pair.hdr", nifti),
        ("detached.nhdr", nhdr.into()),
        ("detached.mhd", mhd.into()),
        ("pieces.pvti", pvti.into()),
    ]
}

fn pattern(width: usize, height: usize) -> Vec<[f32; 3]> {
    (0..width * height).map(|i| [i as f32 * 0.25, (i % 7) as f32, 1000.0 / (i + 1) as f32]).collect()
}

pub fn openexr() -> Vec<Seed> {
    let file = |compression, blocks, half: bool| {
        let pixels = pattern(12, 6);
        let channel = |c: usize| {
            let values = pixels.iter().map(|p| p[c]);
            let samples = if half {
                FlatSamples::F16(values.map(f16::from_f32).collect())
            } else {
                FlatSamples::F32(values.collect())
            };
            AnyChannel::new(["R", "G", "B"][c], samples)
        };
        let encoding = Encoding { compression, blocks, line_order: LineOrder::Increasing };
        let channels = AnyChannels::sort((0..3).map(channel).collect());
        let layer = Layer::new((12, 6), LayerAttributes::default(), encoding, channels);
        let mut bytes = Cursor::new(Vec::new());
        let image = Image::empty(ImageAttributes::with_size((12, 6))).with_layer(layer);
        image.write().to_buffered(&mut bytes).expect("memory");
        bytes.into_inner()
    };
    let tiles = Blocks::Tiles(Vec2(8, 4));
    vec![
        ("none.exr", file(Compression::Uncompressed, Blocks::ScanLines, false)),
        ("rle.exr", file(Compression::RLE, Blocks::ScanLines, true)),
        ("zip.exr", file(Compression::ZIP16, Blocks::ScanLines, false)),
        ("zips.exr", file(Compression::ZIP1, tiles, false)),
        ("piz.exr", file(Compression::PIZ, Blocks::ScanLines, true)),
        ("pxr24.exr", file(Compression::PXR24, Blocks::ScanLines, false)),
        ("b44.exr", file(Compression::B44, Blocks::ScanLines, true)),
        ("b44a.exr", file(Compression::B44A, tiles, true)),
    ]
}

pub fn radiance() -> Vec<Seed> {
    let mut flat = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=2\nCOLORCORR=1 1 2\n\n-Y 4 +X 8\n".to_vec();
    flat.extend((0..32).flat_map(|i| [i, 128, 3 * i, 129]));
    let mut run_length = Vec::new();
    let pixels: Vec<image::Rgb<f32>> = pattern(16, 8).into_iter().map(image::Rgb).collect();
    image::codecs::hdr::HdrEncoder::new(&mut run_length).encode(&pixels, 16, 8).expect("memory");
    vec![("flat.hdr", flat), ("rle.hdr", run_length)]
}

pub fn low_range() -> Vec<Seed> {
    let colour = image::RgbImage::from_fn(12, 6, |x, y| image::Rgb([20 * x as u8, 40 * y as u8, 7]));
    let grey =
        image::ImageBuffer::<image::LumaA<u16>, _>::from_fn(8, 8, |x, y| image::LumaA([(999 * x * y) as u16, 9]));
    let bytes = |image: image::DynamicImage, format| {
        let mut bytes = Cursor::new(Vec::new());
        image.write_to(&mut bytes, format).expect("memory");
        bytes.into_inner()
    };
    vec![
        ("colour.png", bytes(colour.clone().into(), image::ImageFormat::Png)),
        ("grey_alpha.png", bytes(grey.into(), image::ImageFormat::Png)),
        ("colour.jpg", bytes(colour.into(), image::ImageFormat::Jpeg)),
    ]
}

pub fn obj() -> Vec<Seed> {
    let square =
        "# a square\no square\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0.5\nvt 0 0\nvn 0 0 1\nusemtl x\nf 1/1/1 2//1 3/1 4\n";
    let last = "v -1 0 0\r\nv 1e-3 0 0\r\nv 0 2.5 0\r\nf -3 -2 -1\r\ns off\r\n";
    vec![("square.obj", square.into()), ("last.obj", last.into())]
}

pub fn ply() -> Vec<Seed> {
    let head = |format: &str| {
        format!(
            "ply\nformat {format} 1.0\ncomment made here\nelement vertex 4\nproperty float x\nproperty double y\n\
             property float z\nproperty uchar red\nelement edge 1\nproperty int a\nelement face 1\n\
             property list uchar int vertex_indices\nend_header\n"
        )
    };
    let vertices = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.5]];
    let text: String = vertices.iter().map(|[x, y, z]| format!("{x} {y} {z} 7\n")).collect();
    let binary = |big: bool| {
        let mut out = Vec::new();
        let mut put = |value: &[u8]| {
            let mut value = value.to_vec();
            if big {
                value.reverse();
            }
            out.extend(value);
        };
        for [x, y, z] in vertices {
            put(&(x as f32).to_le_bytes());
            put(&f64::to_le_bytes(y));
            put(&(z as f32).to_le_bytes());
            put(&[7]);
        }
        put(&1i32.to_le_bytes());
        put(&[4]);
        (0..4i32).for_each(|i| put(&i.to_le_bytes()));
        out
    };
    vec![
        ("text.ply", (head("ascii") + &text + "1\n4 0 1 2 3\n").into_bytes()),
        ("little.ply", [head("binary_little_endian").into_bytes(), binary(false)].concat()),
        ("big.ply", [head("binary_big_endian").into_bytes(), binary(true)].concat()),
    ]
}

/// Four positions, then six indices of 16 bits.
pub fn buffer_of_gltf() -> Vec<u8> {
    let mut bytes: Vec<u8> =
        [0f32, 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0.].iter().flat_map(|v| v.to_le_bytes()).collect();
    bytes.extend([0u16, 1, 2, 0, 2, 3].iter().flat_map(|v| v.to_le_bytes()));
    bytes
}

/// A GLB of its JSON and what follows it.
pub fn glb(json: &[u8], rest: &[u8]) -> Vec<u8> {
    let mut json = json.to_vec();
    json.resize(json.len().next_multiple_of(4), b' ');
    let length = |n: usize| (n as u32).to_le_bytes();
    [&b"glTF\x02\0\0\0"[..], &length(20 + json.len() + rest.len()), &length(json.len()), b"JSON", &json, rest].concat()
}

pub fn gltf() -> Vec<Seed> {
    let json = |uri: &str| {
        format!(
            r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0,3]}}],
"nodes":[{{"children":[1,2],"translation":[0,0,5]}},{{"mesh":0,"scale":[2,2,-2]}},{{"mesh":1,"rotation":[0,0,1,0]}},
{{"mesh":0,"matrix":[1,0,0,0,0,1,0,0,0,0,1,0,3,0,0,1]}}],
"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":1}}]}},{{"primitives":[{{"attributes":{{"POSITION":2}},"mode":4}}]}}],
"buffers":[{{{uri}"byteLength":60}}],
"bufferViews":[{{"buffer":0,"byteOffset":0,"byteLength":48,"byteStride":12}},{{"buffer":0,"byteOffset":48,"byteLength":12,"target":34963}}],
"accessors":[{{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}},
{{"bufferView":1,"componentType":5123,"count":6,"type":"SCALAR"}},
{{"bufferView":0,"byteOffset":12,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}}]}}"#
        )
    };
    let buffer = buffer_of_gltf();
    let chunk = [&(buffer.len() as u32).to_le_bytes()[..], b"BIN\0", &buffer].concat();
    vec![("nodes.gltf", json(r#""uri":"a.bin","#).into_bytes()), ("nodes.glb", glb(json("").as_bytes(), &chunk))]
}

/// A closed tetrahedron, as text and binary.
pub fn stl() -> Vec<Seed> {
    let corners = [[0f32, 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.]];
    let mut text = "solid tetrahedron\n".to_string();
    let mut binary = vec![b'-'; 80];
    binary.extend(4u32.to_le_bytes());
    for facet in [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]] {
        binary.extend([0; 12]);
        text += "facet normal 0 0 0\nouter loop\n";
        for corner in facet {
            let [x, y, z] = corners[corner];
            corners[corner].iter().for_each(|v| binary.extend(v.to_le_bytes()));
            text += &format!("vertex {x} {y} {z}\n");
        }
        binary.extend([0; 2]);
        text += "endloop\nendfacet\n";
    }
    text += "endsolid\n";
    vec![("text.stl", text.into()), ("binary.stl", binary)]
}

pub fn model() -> Vec<Seed> {
    let head = "[model]\nbounds = [[-1, -1, -1], [1, 1, 1]]\nisovalue = 0.5\nroot = \"r\"\n";
    let skeletons = "[model.point.a]\ncentre = [0, 0, 0]\nradius = 1\nfalloff = \"metaball\"\n[model.segment.b]\nfrom = [0, 0, 0]\n\
        to = [1, 0, 0]\nradius = [0.6, 0.4]\n[model.disc.c]\ncentre = [0, 0, 0]\nnormal = [0, 0, 1]\ndisc_radius = 0.3\nradius = 0.2\n\
        [model.torus.d]\ncentre = [0, 0, 0]\nnormal = [1, 0, 1]\nring_radius = 0.5\nradius = 0.2\nfalloff = \"gaussian\"\nsharpness = 3\n\
        [model.polygon.e]\npoints = [[0, 0, 0], [1, 0, 0], [1, 1, 0]]\nsurface_radius = 0.2\n[model.plane.f]\npoint = [0, 0, 0]\n\
        normal = [0, 0, 1]\nradius = 0.2\n[model.blend.g]\nof = [\"a\", \"b\", \"c\"]\nricci = 3\n[model.union.h]\nof = [\"d\", \"e\"]\n\
        smooth = { m = 0.7, k = 0.3 }\n[model.difference.r]\nof = [\"g\", \"h\", \"f\"]\n";
    let warps = "[model.box.a]\ncentre = [0, 0, 0]\nsize = [1, 0.5, 0.3]\nradius = 0.2\nweight = -2\n[model.twist.b]\nof = \"a\"\naxis = \"x\"\n\
        per_unit = 0.8\n[model.taper.c]\nof = \"b\"\nfrom = -0.5\nto = 0.5\nscale = 0.5\n[model.bend.d]\nof = \"c\"\nper_unit = 0.4\nfrom = -0.5\n\
        to = 0.5\n[model.affine.e]\nof = \"d\"\nscale = [1, 2, 1]\nrotate = [0, 0, 1, 30]\ntranslate = [0.1, 0, 0]\n[model.repeat.f]\nof = \"e\"\n\
        count = 3\ntranslate = [0.3, 0, 0]\nblend = \"sum\"\n[model.shell.r]\nof = \"f\"\nthickness = 0.1\n";
    let others = "[model.formula.a]\nf = \"sin(3*x)*cos(y^2) + r*max(z, -x)\"\nparameters = { r = 0.1 }\n[model.mesh.b]\nfile = \"t.stl\"\n\
        scale = 0.5\n[model.points.c]\nfile = \"w.xyz\"\nradii = \"vdw\"\n[model.convolution.d]\npoints = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]\n\
        filled = true\nradius = 0.5\nkernel = \"cauchy\"\nsharpness = 2\n[model.rbf.e]\npoints = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, 0, 1]]\n\
        normals = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, 0, 1]]\nsmoothing = 0.1\n[model.cache.f]\nof = \"c\"\nsamples = 8\n\
        [model.pasko.g]\nof = [\"a\", \"b\"]\noperation = \"union\"\ndisplacement = [0.2, 0.5, 0.5]\n[model.sum.r]\n\
        of = [\"g\", \"d\", \"e\", \"f\"]\n";
    let more = "[model.volume.a]\nfile = \"v.nii\"\nisovalue = 100\nweight = 0.02\nscale = 0.8\n[model.polyline.b]\n\
        points = [[0, 0, 0], [0.5, 0, 0], [0.5, 0.5, 0]]\nclosed = true\nradius = 0.3\n[model.instance.c]\nof = \"b\"\n\
        at = [[0, 0, 0.5], [0, 0, -0.5]]\n[model.round.d]\nof = \"c\"\nby = 0.05\n[model.invert.e]\nof = \"a\"\n[model.weight.f]\n\
        of = \"e\"\nby = 0.5\n[model.union.r]\nof = [\"d\", \"f\"]\n";
    [("skeletons.toml", skeletons), ("warps.toml", warps), ("others.toml", others), ("more.toml", more)]
        .map(|(name, body)| (name, format!("{head}{body}").into_bytes()))
        .into()
}

pub fn scene() -> Vec<Seed> {
    let bare = "volume = \"bumpbox:16\"\nsolid = \"above\"\nup = \"z\"\nisovalues = [30, \"40%\", \"auto\"]\n\
        outputs = [\"{isovalue}.png\"]\n[material]\nalbedo = [[-1, 0.6, 0.6, 0.65], [1.2, 0.8, 0.5, 0.3]]\n\
        emission = [[0.3, 0, 0, 0], [0.9, 0.9, 0.35, 0.08]]\n[bake]\nrays = 64\nlayers = 4\nbands = [5, 4, 3, 3]\n\
        texture = [16, 16, 8]\npositive = true\n[probe]\nname = \"sky\"\nrotation = 30\nsun_split = true\n\
        [camera]\nazimuth = 30\nelevation = 40\nsize = [64, 48]\nprojection = \"perspective\"\nfield_of_view = 35\n\
        exposure = \"auto\"\n";
    let room = "volume = \"bumpbox:16\"\nmetres_per_unit = 1.0\nisovalues = 47\n[material]\ncolormap = \"viridis\"\n\
        range = [0, 200]\n[[walls]]\nname = \"room\"\nshape = \"room\"\nmin = [0, 0, 0]\nmax = [1, 1, 1]\nalbedo = 0.7\n\
        faces = { \"-x\" = [0.63, 0.06, 0.05] }\nopen = [\"-z\"]\n[[objects]]\nshape = \"sphere\"\ncentre = [0.5, 0.3, 0.5]\n\
        radius = 0.1\nmaterial = \"glass\"\nindex = 1.5\n[[objects]]\nname = \"table\"\nshape = \"mesh\"\nfile = \"t.obj\"\n\
        scale = 0.01\nrotate = [0, 0, 1, 90]\ntranslate = [0, 0, 0.2]\nemission = [2, 1, 0.5]\n[[objects]]\n\
        shape = \"isosurface\"\nvolume = \"gyroid:8\"\nisovalue = 0.5\nscale = 0.1\n[[objects]]\nshape = \"rectangle\"\n\
        corner = [0, 0, 0]\nu = [1, 0, 0]\nv = [0, 1, 0]\nmaterial = \"mirror\"\nreflectance = 0.9\n[[luminaires]]\n\
        name = \"ceiling\"\nshape = \"rectangle\"\ncorner = [0.3, 0, 0.3]\nu = [0, 0, 0.4]\nv = [0.4, 0, 0]\npower = 90\n\
        colour = [1, 0.9, 0.8]\n[[luminaires]]\nshape = \"sphere\"\ncentre = [0, 2, 0]\nradius = 0.1\npower = [1, 2, 3]\n\
        [[luminaires]]\nshape = \"point\"\nposition = [0, 0, 3]\npower = 1\n[[luminaires]]\nshape = \"directional\"\n\
        direction = [0, 0, -1]\nirradiance = 5\n";
    let pair = "coupling = [[47, 0.6], [60, 0.8]]\nisovalues = 50\n[[volumes]]\nname = \"a\"\nvolume = \"bumpbox:8\"\n\
        [[volumes]]\nname = \"b\"\nvolume = \"gyroid:8\"\nsolid = \"below\"\nscale = 0.3\nrotate = [1, 2, 3, 40]\n\
        translate = [0.35, 0.08, 0.35]\nalbedo = [0.3, 0.5, 1.0]\n";
    let fog = "volume = \"torus:12\"\nmetres_per_unit = 0.01\n[[medium]]\nname = \"a\"\nextinction = [[-1, 0.0], [1, 2, 3, 4]]\n\
        albedo = [0.9, 0.8, 0.7]\nphase = { mix = [[0.5, { hg = 0.5 }], [0.25, { schlick = -0.2 }], [0.25, { table = [[-1, 1], [1, 2]] }]] }\n\
        emission = 0.5\nmin = [-1, -1, -1]\nmax = [1, 1, 1]\n[[medium]]\nextinction = 0.5\nphase = \"rayleigh\"\ncentre = [0, 0, 0]\n\
        radius = 2\n";
    let wax = "volume = \"torus:12\"\nmetres_per_unit = 0.01\n[material]\nkind = \"translucent\"\nmean_free_path = \"2.5 mm\"\n\
        albedo_nodes = 6\nindex = 1.4\nphase = { hg = 0.3 }\n";
    vec![
        ("bare.toml", bare.into()),
        ("room.toml", room.into()),
        ("pair.toml", pair.into()),
        ("fog.toml", fog.into()),
        ("wax.toml", wax.into()),
    ]
}
