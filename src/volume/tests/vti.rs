use super::phantom::{self, ORIGIN, SPACING, assert_phantom, words};
use super::*;
use base64::Engine;
use glam::DMat3;

/// An array and how it is stored.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Mode {
    Ascii,
    Inline,
    Raw,
    Base64,
}

const MODES: [Mode; 4] = [Mode::Ascii, Mode::Inline, Mode::Raw, Mode::Base64];

#[derive(Clone, Copy, Debug, PartialEq)]
enum Codec {
    None,
    Zlib,
    Lz4,
}

/// A small writer, from the format's definition.
struct Writer {
    mode: Mode,
    codec: Codec,
    order: Order,
    is_wide: bool,
    /// Bytes of a block.
    block: usize,
    /// Attributes of ImageData but for the extent.
    frame: String,
    extent: String,
}

impl Default for Writer {
    fn default() -> Self {
        Self {
            mode: Mode::Raw,
            codec: Codec::None,
            order: Order::Little,
            is_wide: true,
            block: 1 << 15,
            frame: String::new(),
            extent: "0 4 0 6 0 8".into(),
        }
    }
}

impl Writer {
    fn number(&self, n: usize) -> Vec<u8> {
        if self.is_wide { self.order.u64(n as u64) } else { self.order.u32(n as u32) }
    }

    /// The header of an array and what follows it.
    fn pack(&self, bytes: &[u8]) -> (Vec<u8>, Vec<u8>) {
        if self.codec == Codec::None {
            return (self.number(bytes.len()), bytes.to_vec());
        }
        let blocks: Vec<Vec<u8>> = bytes
            .chunks(self.block)
            .map(|block| match self.codec {
                Codec::Zlib => {
                    let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), Compression::fast());
                    encoder.write_all(block).unwrap();
                    encoder.finish().unwrap()
                }
                _ => lz4_flex::block::compress(block),
            })
            .collect();
        let head = [blocks.len(), self.block, bytes.len() % self.block];
        let head = head.into_iter().chain(blocks.iter().map(Vec::len)).flat_map(|n| self.number(n)).collect();
        (head, blocks.concat())
    }

    /// A file with these arrays: attributes, bytes, text. `section` is PointData or CellData with its attributes.
    fn file(&self, section: &str, arrays: &[(&str, &[u8], &str)]) -> Vec<u8> {
        let base64 = |bytes: &[u8]| base64::engine::general_purpose::STANDARD.encode(bytes);
        let (mut xml, mut appended) = (String::new(), Vec::new());
        for (attributes, bytes, text) in arrays {
            let (head, body) = self.pack(bytes);
            // A header that is compressed is a stream of its own.
            let encoded = match self.codec {
                Codec::None => base64(&[&head[..], &body].concat()),
                _ => base64(&head) + &base64(&body),
            };
            xml += &match self.mode {
                Mode::Ascii => format!("<DataArray {attributes} format=\"ascii\">\n {text}\n</DataArray>\n"),
                Mode::Inline => format!("<DataArray {attributes} format=\"binary\">\n {encoded}\n</DataArray>\n"),
                Mode::Raw | Mode::Base64 => {
                    format!("<DataArray {attributes} format=\"appended\" offset=\"{}\"/>\n", appended.len())
                }
            };
            appended.extend(if self.mode == Mode::Base64 { encoded.into_bytes() } else { [head, body].concat() });
        }
        let compressor = match self.codec {
            Codec::None => "",
            Codec::Zlib => " compressor=\"vtkZLibDataCompressor\"",
            Codec::Lz4 => " compressor=\"vtkLZ4DataCompressor\"",
        };
        let order = if self.order == Order::Little { "Little" } else { "Big" };
        let width = if self.is_wide { 64 } else { 32 };
        let kind = section.split(' ').next().unwrap();
        let (extent, frame) = (&self.extent, &self.frame);
        let mut file = format!(
            "<?xml version=\"1.0\"?>\n<!-- < -- > -->\n<VTKFile type=\"ImageData\" version=\"1.0\" byte_order=\"{order}Endian\" \
             header_type=\"UInt{width}\"{compressor}>\n<ImageData WholeExtent=\"{extent}\" {frame}>\n<FieldData><DataArray \
             type=\"Float64\" Name=\"TimeValue\" format=\"ascii\">1</DataArray></FieldData>\n<Piece Extent=\"{extent}\">\n\
             <{section}>\n{xml}</{kind}>\n</Piece>\n</ImageData>\n"
        )
        .into_bytes();
        if matches!(self.mode, Mode::Raw | Mode::Base64) {
            let encoding = if self.mode == Mode::Raw { "raw" } else { "base64" };
            file.extend(format!("<AppendedData encoding=\"{encoding}\">\n  _").bytes());
            file.extend(appended);
            file.extend(b"\n</AppendedData>\n");
        }
        file.extend(b"</VTKFile>\n");
        file
    }

    /// The phantom as the only array.
    fn phantom(&self, section: &str) -> Vec<u8> {
        let text: String = points(phantom::DIMS).map(|(x, y, z)| format!("{} ", phantom::value(x, y, z))).collect();
        let bytes = phantom::samples(|v| self.order.u16(v));
        self.file(section, &[("type=\"UInt16\" Name=\"h\"", &bytes, &text)])
    }
}

/// Attributes of a frame; the matrix by rows.
fn frame(axes: DMat3) -> String {
    let rows = axes.transpose().to_cols_array();
    format!("Origin=\"{}\" Spacing=\"{}\" Direction=\"{}\"", words(&ORIGIN.to_array()), words(&SPACING), words(&rows))
}

#[test]
fn the_phantom_comes_back_from_every_encoding() {
    for axes in phantom::directions() {
        for (mode, codec) in MODES.into_iter().flat_map(|m| [Codec::None, Codec::Zlib, Codec::Lz4].map(|c| (m, c))) {
            for (order, is_wide) in ORDERS.into_iter().flat_map(|o| [(o, false), (o, true)]) {
                // Blocks of 100 bytes: seven, the last of 30; and one of exactly all, of which the last size is 0.
                for block in [100, 630] {
                    let writer = Writer { mode, codec, order, is_wide, block, frame: frame(axes), ..Writer::default() };
                    let bytes = writer.phantom("PointData Scalars=\"h\"");
                    let what = format!("{mode:?} {codec:?} {order:?} {is_wide} {block}");
                    let volume = load(&bytes).unwrap_or_else(|e| panic!("{what}: {e}"));
                    assert_phantom(&volume, axes, ORIGIN);
                    assert_eq!((volume.samples().type_name(), volume.notes.len()), ("uint16", 0), "{what}");
                }
            }
        }
    }
    assert_phantom(
        &load(&gzip(&Writer { frame: frame(DMat3::IDENTITY), ..Writer::default() }.phantom("PointData"))).unwrap(),
        DMat3::IDENTITY,
        ORIGIN,
    );
}

#[test]
fn extents_move_the_first_sample_and_cells_lie_half_a_step_inside() {
    for axes in phantom::directions() {
        let steps = axes * DMat3::from_diagonal(DVec3::from_array(SPACING));
        let at = |extent: &str| Writer { frame: frame(axes), extent: extent.into(), ..Writer::default() };
        let volume = load(&at("3 7 -2 4 7 15").phantom("PointData")).unwrap();
        assert_phantom(&volume, axes, ORIGIN + steps * DVec3::new(3.0, -2.0, 7.0));
        let volume = load(&at("0 5 0 7 0 9").phantom("CellData Scalars=\"h\"")).unwrap();
        assert_phantom(&volume, axes, ORIGIN + steps * DVec3::splat(0.5));
        let volume = load(&at("3 8 -2 5 7 16").phantom("CellData")).unwrap();
        assert_phantom(&volume, axes, ORIGIN + steps * DVec3::new(3.5, -1.5, 7.5));
    }
    // Without Origin, Spacing and Direction, as VTK wrote before version 9.
    let volume = load(&Writer::default().phantom("PointData")).unwrap();
    assert_eq!(*volume.world_from_grid(), Affine::IDENTITY);
}

fn chosen(bytes: &[u8], array: Option<&str>, channel: Option<usize>) -> std::result::Result<Volume, String> {
    let (array, channel) = (array.map(String::from), channel.map(Channel::Index));
    let choice = Choice { array, channel, ..Choice::default() };
    read(bytes, &ReadHint { choice, ..ReadHint::default() }).map_err(|e| e.to_string())
}

#[test]
fn of_several_arrays_the_active_one_or_the_one_asked_for_is_read() {
    let arrays: [(&str, &[u8], &str); 2] = [
        ("type=\"UInt8\" Name=\"v\" NumberOfComponents=\"2\"", &[1, 2, 3, 4, 5, 6, 7, 8], "1 2 3 4 5 6 7 8"),
        ("type=\"UInt8\" Name=\"h\"", &[10, 20, 30, 40], "10 20 30 40"),
    ];
    for mode in MODES {
        let writer = Writer { mode, extent: "0 1 0 1 0 0".into(), ..Writer::default() };
        let plain = writer.file("PointData", &arrays);
        let refused = chosen(&plain, None, None).unwrap_err();
        assert!(refused.contains("2 arrays: v, h") && refused.contains("--array"), "{refused}");
        let of = |v: Volume| v.samples().bytes().to_vec();
        assert_eq!(of(chosen(&plain, Some("h"), None).unwrap()), [10, 20, 30, 40], "{mode:?}");
        let refused = chosen(&plain, Some("v"), None).unwrap_err();
        assert!(refused.contains("2 channels") && refused.contains("--channel"), "{refused}");
        assert_eq!(of(chosen(&plain, Some("v"), Some(1)).unwrap()), [2, 4, 6, 8]);
        assert!(chosen(&plain, Some("w"), None).unwrap_err().contains("one of v, h"));
        let active = chosen(&writer.file("PointData Scalars=\"h\"", &arrays), None, None).unwrap();
        assert_eq!((active.series.arrays.clone(), active.series.array), (vec!["v".to_string(), "h".into()], 1));
        assert!(active.notes.iter().any(|n| n.text.contains("array h of 2")), "{:?}", active.notes);
        assert_eq!(of(active), [10, 20, 30, 40]);
        // A list of what there is.
        let choice = Choice { any_channel: true, ..Choice::default() };
        let listed = read(&plain[..], &ReadHint { choice, ..ReadHint::default() }).unwrap();
        assert_eq!((listed.series.arrays.len(), listed.series.channels.len()), (2, 2));
    }
    let nrrd = b"NRRD0004\ntype: uchar\ndimension: 3\nsizes: 1 1 1\nencoding: raw\n\n\0";
    assert!(chosen(nrrd, Some("h"), None).unwrap_err().contains("--array"));
}

#[test]
fn what_the_program_writes_it_reads() {
    let values: Vec<f32> = points(phantom::DIMS).map(|(x, y, z)| f32::from(phantom::value(x, y, z))).collect();
    let provenance = serde_json::json!({ "by": "x".repeat(9000) + "--" });
    for axes in phantom::directions() {
        let field = crate::export::field::RadianceField {
            dims: phantom::DIMS,
            origin: ORIGIN,
            steps: axes * DMat3::from_diagonal(DVec3::from_array(SPACING)),
            radiance: &vec![[0.25, 0.5, 1.0]; values.len()],
            valid: &vec![1; values.len()],
            values: &values,
            exposure: 1.0,
            provenance: &provenance,
        };
        let mut bytes = Vec::new();
        crate::export::field::write_vti(&mut bytes, &field).unwrap();
        let volume = load(&bytes).unwrap();
        assert_phantom(&volume, axes, ORIGIN);
        assert_eq!(volume.samples(), &Samples::F32(values.clone()));
        let blue = chosen(&bytes, Some("radiance"), Some(2)).unwrap();
        assert_eq!(blue.samples(), &Samples::F32(vec![1.0; values.len()]));
    }
}

/// The phantom in two pieces that share a layer of points.
fn in_pieces(second: &str, shift: u16) -> String {
    let values = |zs: std::ops::RangeInclusive<usize>, shift: u16| -> String {
        let all = zs.flat_map(|z| points([5, 7, 1]).map(move |(x, y, _)| phantom::value(x, y, z) + shift));
        all.map(|v| format!("{v} ")).collect()
    };
    let piece = |extent: &str, text: String| {
        format!(
            "<Piece Extent=\"{extent}\"><PointData><DataArray type=\"UInt16\" Name=\"h\" format=\"ascii\">{text}</DataArray>\
             </PointData></Piece>"
        )
    };
    let frame = frame(DMat3::IDENTITY);
    let (low, high) = (piece("0 4 0 6 0 5", values(0..=5, 0)), piece(second, values(5..=8, shift)));
    format!(
        "<VTKFile type=\"ImageData\" byte_order=\"LittleEndian\"><ImageData WholeExtent=\"0 4 0 6 0 8\" {frame}>{low}{high}\
         </ImageData></VTKFile>"
    )
}

#[test]
fn pieces_are_joined_where_they_agree() {
    assert_phantom(&load(in_pieces("0 4 0 6 5 8", 0).as_bytes()).unwrap(), DMat3::IDENTITY, ORIGIN);
    assert!(refusal(in_pieces("0 4 0 6 5 8", 1).as_bytes()).contains("disagree at sample 0, 0, 5"));
    assert!(refusal(in_pieces("0 4 0 6 6 9", 0).as_bytes()).contains("outside"));
    let gap = refusal(in_pieces("0 4 0 6 4 7", 0).as_bytes());
    assert!(gap.contains("disagree"), "{gap}");
}

#[test]
fn the_pieces_of_a_pvti_are_found_beside_it() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &[u8]| std::fs::write(folder.path().join(name), text).unwrap();
    let axes = phantom::directions()[1];
    let header = |first: &str, frame: &str| {
        format!(
            "<VTKFile type=\"PImageData\"><PImageData WholeExtent=\"0 4 0 6 0 8\" GhostLevel=\"1\" {frame}><PPointData \
             Scalars=\"h\"><PDataArray type=\"UInt16\" Name=\"h\"/></PPointData><Piece Extent=\"0 4 0 6 0 5\" Source=\"{first}\"/>\
             <Piece Extent=\"0 4 0 6 4 8\" Source=\"p/b.vti\"/></PImageData></VTKFile>"
        )
    };
    std::fs::create_dir(folder.path().join("p")).unwrap();
    for (name, zs) in [("a.vti", 0..=5), ("p/b.vti", 4..=8)] {
        let extent = format!("0 4 0 6 {} {}", zs.start(), zs.end());
        let values: Vec<u8> = zs
            .flat_map(|z| points([5, 7, 1]).flat_map(move |(x, y, _)| phantom::value(x, y, z).to_le_bytes()))
            .collect();
        let writer = Writer { frame: frame(axes), extent, codec: Codec::Zlib, ..Writer::default() };
        write(name, &writer.file("PointData", &[("type=\"UInt16\" Name=\"h\"", &values, "")]));
    }
    let path = folder.path().join("whole.pvti");
    let refused = |text: String| {
        std::fs::write(&path, text).unwrap();
        open(&path).unwrap_err().to_string()
    };
    std::fs::write(&path, header("a.vti", &frame(axes))).unwrap();
    let volume = open(&path).unwrap();
    assert_phantom(&volume, axes, ORIGIN);
    assert!(volume.notes.iter().any(|n| n.text.contains("b.vti")), "{:?}", volume.notes);
    // VTK 9.7 writes no Direction there: that of the pieces counts.
    let bare = frame(axes);
    std::fs::write(&path, header("a.vti", bare.split(" Direction").next().unwrap())).unwrap();
    assert_phantom(&open(&path).unwrap(), axes, ORIGIN);
    assert!(refused(header("gone.vti", &frame(axes))).contains("gone.vti"));
    assert!(refused(header("../a.vti", &frame(axes))).contains("--allow-outside"));
    assert!(refused(header("a.vti", &frame(DMat3::IDENTITY))).contains("as the .pvti says"));
    assert!(
        refused(header("p/b.vti", &frame(axes))).contains("210 samples")
            || refused(header("p/b.vti", &frame(axes))).contains("no piece")
    );
    assert!(refused(header("whole.pvti", &frame(axes))).contains("a piece with"));
    // In a stream there is no second file.
    assert!(refusal(header("a.vti", "").as_bytes()).contains("a.vti"));
}

#[test]
fn damage_is_named() {
    let good = String::from_utf8(Writer { mode: Mode::Ascii, ..Writer::default() }.phantom("PointData")).unwrap();
    let cases = [
        ("type=\"UInt16\"", "type=\"Bit\"", "Bit"),
        ("type=\"UInt16\"", "type=\"String\"", "String"),
        ("type=\"UInt16\"", "type=\"UInt8\"", "uint8"),
        ("0 4 0 6 0 8", "0 4 0 6 0 -1", "extent"),
        ("0 4 0 6 0 8", "0 4 0 6 0 999999999999", "samples of 2 bytes"),
        ("0 4 0 6 0 8", "0 4 0 6 0 99999999999999999999", "extent"),
        ("0 4 0 6 0 8", "0 4 0 6 0 9", "before the end"),
        ("0 4 0 6 0 8", "0 4 0 6 0 7", "more than 280 numbers"),
        (" >\n<FieldData>", " Spacing=\"nan 1 1\" >\n<FieldData>", "finite"),
        (" >\n<FieldData>", " Direction=\"1 0 0 1 0 0 0 0 1\" >\n<FieldData>", "independent"),
        (" >\n<FieldData>", " Origin=\"1 2\" >\n<FieldData>", "Origin"),
        (">\n 0", ">\n x", "\"x\" as sample 0"),
        ("format=\"ascii\">\n 0", "format=\"hex\">\n 0", "hex"),
        ("UInt64", "UInt128", "UInt128"),
        ("LittleEndian", "MiddleEndian", "MiddleEndian"),
        ("header_type=\"UInt64\"", "compressor=\"vtkZstdDataCompressor\"", "vtkZstdDataCompressor"),
        ("type=\"ImageData\"", "type=\"RectilinearGrid\"", "resample"),
        ("type=\"ImageData\"", "type=\"StructuredGrid\"", "resample"),
        ("type=\"ImageData\"", "type=\"UnstructuredGrid\"", "resample"),
        ("<!-- <", "<!DOCTYPE x><!-- <", "document type"),
        ("<PointData>", "<PointData", "no array"),
        ("Name=\"h\"", "Name=\"h\" NumberOfComponents=\"-1\"", "NumberOfComponents"),
    ];
    for (from, to, word) in cases {
        assert!(good.contains(from), "{from}");
        let text = refusal(good.replace(from, to).as_bytes());
        assert!(text.contains(word), "{to}: {text}");
    }
    // A byte order left out, mixed line ends and a UTF-8 mark.
    let bare = good.replace(" byte_order=\"LittleEndian\"", "").replace('\n', "\r\n");
    let volume = load(&[b"\xef\xbb\xbf", bare.as_bytes()].concat()).unwrap();
    assert!(volume.notes.iter().any(|n| n.text.contains("little-endian")));

    let binary = Writer { extent: "0 1 0 1 0 1".into(), codec: Codec::Zlib, ..Writer::default() };
    let good = binary.file("PointData", &[("type=\"UInt8\" Name=\"h\"", &[7; 8], "")]);
    let start = good.windows(2).position(|w| w == b" _").unwrap() + 2;
    let with = |at: usize, bytes: &[u8]| {
        let mut damaged = good.clone();
        damaged[start + at..start + at + bytes.len()].copy_from_slice(bytes);
        refusal(&damaged)
    };
    assert!(with(0, &u64::MAX.to_le_bytes()).contains("blocks"));
    assert!(with(16, &[7]).contains("the last of 7"), "{}", with(16, &[7]));
    assert!(with(24, &[3]).contains("damaged"), "{}", with(24, &[3]));
    // A bomb: a block that unpacks to more than it announces.
    let bomb = Writer { block: 1 << 24, ..binary };
    let bomb = bomb.file("PointData", &[("type=\"UInt8\" Name=\"h\"", &vec![0; 1 << 24], "")]);
    assert!(refusal(&bomb).contains("blocks of 16777216 bytes"), "{}", refusal(&bomb));
    let mut hidden = bomb;
    for (at, value) in [(8, 8u64), (16, 0)] {
        hidden[start + at..start + at + 8].copy_from_slice(&value.to_le_bytes());
    }
    assert!(refusal(&hidden).contains("8 are announced"), "{}", refusal(&hidden));
}
