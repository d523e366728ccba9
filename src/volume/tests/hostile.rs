use super::nifti::Header;
use super::*;
use std::io::{Read, Repeat};

fn zlib(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// Small, complete files of every format that comes in one stream.
fn good_files() -> Vec<(&'static str, Vec<u8>)> {
    let data: Vec<u8> = (0..24).collect();
    let nifti = Header::new(Order::Little, &[2, 3, 4], 2).with(data.clone());
    let join = |head: &str| [head.as_bytes(), &data].concat();
    let nrrd = join("NRRD0004\ntype: uchar\ndimension: 3\nsizes: 2 3 4\nencoding: raw\n\n");
    let mut nrrd_gzip = b"NRRD0004\ntype: uchar\ndimension: 3\nsizes: 2 3 4\nencoding: gzip\n\n".to_vec();
    nrrd_gzip.extend(gzip(&data));
    let vtk = join(
        "# vtk DataFile Version 3.0\ntitle\nBINARY\nDATASET STRUCTURED_POINTS\nDIMENSIONS 2 3 4\nPOINT_DATA 24\n\
         SCALARS s unsigned_char\nLOOKUP_TABLE default\n",
    );
    let mut mrc = vec![0; 1024];
    for (word, value) in [(0, 2), (1, 3), (2, 4), (7, 2), (8, 3), (9, 4), (16, 1), (17, 2), (18, 3)] {
        mrc[4 * word..4 * word + 4].copy_from_slice(&i32::to_le_bytes(value));
    }
    mrc[208..213].copy_from_slice(b"MAP D");
    mrc.extend(&data);
    let cube = format!("a\nb\n0 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n{}", "1.5 ".repeat(23) + "1.5\n");
    let npy_head = "{'descr': '|u1', 'fortran_order': False, 'shape': (4, 3, 2), }\n";
    let npy = [&b"\x93NUMPY\x01\0"[..], &[npy_head.len() as u8, 0], npy_head.as_bytes(), &data].concat();
    let mut tiff = std::io::Cursor::new(Vec::new());
    let mut encoder = ::tiff::encoder::TiffEncoder::new(&mut tiff).unwrap();
    for _ in 0..3 {
        encoder.write_image::<::tiff::encoder::colortype::Gray8>(4, 2, &data[..8]).unwrap();
    }
    let mut ome = std::io::Cursor::new(Vec::new());
    let mut encoder = ::tiff::encoder::TiffEncoder::new(&mut ome).unwrap();
    for z in 0..2 {
        let mut image = encoder.new_image::<::tiff::encoder::colortype::Gray8>(4, 2).unwrap();
        let text = "<OME UUID='u'><Image><Pixels DimensionOrder='XYZCT' SizeZ='2' SizeC='1' SizeT='1' PhysicalSizeX='2' \
                    PhysicalSizeY='2'><TiffData IFD='0' PlaneCount='2'><UUID>u</UUID></TiffData></Pixels></Image></OME>";
        image.encoder().write_tag(::tiff::tags::Tag::ImageDescription, if z == 0 { text } else { "" }).unwrap();
        image.write_data(&data[..8]).unwrap();
    }
    let vti = |array: &str, appended: &str| {
        format!(
            "<VTKFile type=\"ImageData\" byte_order=\"LittleEndian\"><ImageData WholeExtent=\"0 1 0 2 0 3\"><Piece Extent=\"0 1 0 2 \
             0 3\"><PointData><DataArray type=\"UInt8\" Name=\"h\" {array}</PointData></Piece></ImageData>{appended}"
        )
    };
    let appended = vti("format=\"appended\" offset=\"0\"/>", "<AppendedData encoding=\"raw\">_");
    let appended = [appended.as_bytes(), &24u32.to_le_bytes(), &data].concat();
    let inline = vti(&format!("format=\"ascii\">{}</DataArray>", "1 ".repeat(24)), "</VTKFile>").into_bytes();
    let meta = |packed: &str| {
        format!(
            "ObjectType = Image\nNDims = 3\nDimSize = 2 3 4\nElementType = MET_UCHAR\nElementSpacing = 1 2 3\nCompressedData = \
             {packed}\nElementDataFile = LOCAL\n"
        )
    };
    let dx = "object 1 class gridpositions counts 2 3 4\norigin 0 0 0\ndelta 1 0 0\ndelta 0 1 0\ndelta 0 0 1\nobject 3 class array \
              type float rank 0 items 24";
    let text = format!("{dx} data follows\n{}", "1.5 ".repeat(23) + "1.5\n").into_bytes();
    let floats: Vec<u8> = (0..24).flat_map(|i| (i as f32).to_be_bytes()).collect();
    let binary = [format!("{dx} msb ieee data follows\n").as_bytes(), &floats].concat();
    let numbers = [3u32, 200, 4, 3, 2].into_iter().flat_map(u32::to_be_bytes);
    let span = [0.0f32, 4.0, 0.0, 3.0, 0.0, 2.0].into_iter().flat_map(f32::to_be_bytes);
    let plt = numbers.chain(span).chain(floats).collect();
    let second = nifti::second(Order::Big, &[2, 3, 4], 2).with(data.clone());
    let npz = npz::zip(&[("h", npy.clone())], false);
    let packed = npz::zip(&[("h", npy.clone())], true);
    let directions = "space dimension: 4\nspace directions: (1,0,0,0) (0,1,0,0) (0,0,1,0) (0,0,0,1)";
    let series = format!("NRRD0004\ntype: uchar\ndimension: 4\nsizes: 2 3 4 1\n{directions}\nencoding: raw\n\n");
    let files = [
        ("NIfTI", nifti),
        ("NRRD", nrrd),
        ("gzipped NRRD", nrrd_gzip),
        ("VTK", vtk),
        ("MRC", mrc),
        ("cube", cube.into_bytes()),
        ("npy", npy),
        ("TIFF", tiff.into_inner()),
        ("OME-TIFF", ome.into_inner()),
        ("4D NRRD", join(&series)),
        ("VTI", appended),
        ("inline VTI", inline),
        ("MetaImage", join(&meta("False"))),
        ("packed MetaImage", [meta("True").as_bytes(), &zlib(&data)].concat()),
        ("OpenDX", text),
        ("binary OpenDX", binary),
        ("plt", plt),
        ("NIfTI-2", second),
        ("npz", npz),
        ("deflated npz", packed),
    ];
    let packed = files.clone().map(|(name, bytes)| (name, gzip(&bytes)));
    files.into_iter().chain(packed).collect()
}

#[test]
fn every_truncation_of_every_format_is_an_error_with_a_reason() {
    for (name, bytes) in good_files() {
        assert!(load(&bytes).is_ok(), "{name}");
        for length in 0..bytes.len() {
            // Text may lose its last line feed, and digits of its last number: "1.5" still reads as
            // "1". A TIFF may lose padding behind the last page.
            if let Err(error) = load(&bytes[..length]) {
                let text = error.to_string();
                assert!(text.len() > 40 && !text.contains("TIFF signature"), "{name} at {length}: {text}");
            } else {
                let slack = if ["cube", "OpenDX"].contains(&name) { 4 } else { 2 };
                assert!(length + slack > bytes.len(), "{name} cut at {length} of {} was read", bytes.len());
            }
        }
    }
}

#[test]
fn every_single_byte_of_damage_is_survived() {
    // Damage may go unnoticed; it must not panic, hang or exhaust memory.
    for (name, bytes) in good_files().into_iter().take(20) {
        for at in 0..bytes.len() {
            for value in [0, 0x7f, 0xff, b'9', bytes[at] ^ 1] {
                let mut damaged = bytes.clone();
                damaged[at] = value;
                let hint = ReadHint { max_bytes: 1 << 24, ..ReadHint::default() };
                if let Ok(v) = read(&damaged[..], &hint) {
                    assert!(v.samples().len() <= 1 << 24, "{name} {at}");
                }
            }
        }
    }
}

#[test]
fn headers_that_claim_a_trillion_voxels_fail_at_once() {
    // 10^12 voxels in a sized file, in a stream, and in a gzip stream.
    let nrrd = b"NRRD0004\ntype: uchar\ndimension: 3\nsizes: 10000 10000 10000\nencoding: raw\n\nabc".to_vec();
    assert!(refusal(&nrrd).contains("1000000000000 bytes"), "{}", refusal(&nrrd));
    let raised = ReadHint { max_bytes: u64::MAX, length: None, ..ReadHint::default() };
    for bytes in [nrrd.clone(), gzip(&nrrd)] {
        let error = read(&bytes[..], &raised).unwrap_err().to_string();
        assert!(error.contains("before the end of the file"), "{error}");
        let sized = ReadHint { length: Some(bytes.len() as u64), ..raised.clone() };
        let error = read(&bytes[..], &sized).unwrap_err().to_string();
        assert!(error.contains("at most") && error.contains("10000×10000×10000"), "{error}");
    }
    let nifti = Header::new(Order::Big, &[32767, 32767, 32767], 1280).with([1, 2, 3]);
    assert!(matches!(load(&nifti), Err(Error::Limit { .. })));
    let small = ReadHint { max_bytes: 23, ..ReadHint::default() };
    assert!(matches!(read(&good_files()[0].1[..], &small), Err(Error::Limit { .. })));
    for sizes in ["0 3 4", "18446744073709551615 18446744073709551615 2", "-1 3 4", "2 3"] {
        let text = format!("NRRD0004\ntype: uchar\ndimension: 3\nsizes: {sizes}\nencoding: raw\n\nabc");
        assert!(!refusal(text.as_bytes()).is_empty(), "{sizes}");
    }
}

/// Counts what is taken from a stream.
struct Counting<R>(R, std::rc::Rc<std::cell::Cell<u64>>);
impl<R: Read> Read for Counting<R> {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        let n = self.0.read(out)?;
        self.1.set(self.1.get() + n as u64);
        Ok(n)
    }
}

#[test]
fn of_a_gzip_bomb_only_what_the_header_asks_for_is_unpacked() {
    // A good volume followed by 1 GiB of zeros, about 1 MiB packed.
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(&good_files()[0].1).unwrap();
    let zeros: std::io::Take<Repeat> = std::io::repeat(0).take(1 << 30);
    std::io::copy(&mut { zeros }, &mut encoder).unwrap();
    let bomb = encoder.finish().unwrap();
    let taken = std::rc::Rc::default();
    let v = read(Counting(&bomb[..], std::rc::Rc::clone(&taken)), &ReadHint::default()).unwrap();
    assert_eq!(v.dims(), [2, 3, 4]);
    assert!(taken.get() < 200_000 && bomb.len() > 1_000_000, "{} of {}", taken.get(), bomb.len());
    // Zeros from the start: no format; a bomb of blanks in place of numbers: refused.
    assert!(refusal(&gzip(&vec![0; 1 << 20])).contains("starts with"));
    let blanks = "a\nb\n0 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n".to_string() + &" ".repeat(3 << 20);
    assert!(refusal(&gzip(blanks.as_bytes())).contains("white space"));
}

#[test]
fn a_damaged_gzip_stream_is_noticed_by_its_checksum() {
    let mut bytes = gzip(&good_files()[0].1);
    let at = bytes.len() - 8;
    bytes[at] ^= 1; // the CRC
    assert!(refusal(&bytes).contains("checksum"), "{}", refusal(&bytes));
}

#[test]
fn wrong_files_are_named() {
    for (bytes, word) in [
        (&b""[..], "an empty file"),
        (b"Dear colleague,\nplease find attached", "Dear colleague"),
        (b"\x89HDF\r\n\x1a\n", "HDF5"),
        (b"<?xml version=\"1.0\"?>", "not VTK's .vti"),
        (b"PK\x03\x04", "zip"),
        (b"BZh91AY", "bzip2"),
        (b"\x1f\x8b", "gzip"),
        (b"{\"dims\": 3}", "sidecar"),
        (b"MM\0*", "TIFF"),
        (b"II*\0\xff\xff\xff\xff", "TIFF"),
        (&[0; 2000], "starts with"),
    ] {
        assert!(refusal(bytes).contains(word), "{}", refusal(bytes));
    }
    let dicom = [&[0; 128][..], b"DICM"].concat();
    assert!(refusal(&dicom).contains("DICOM"));
    assert!(refusal(&gzip(&gzip(b"x"))).contains("gzip within gzip"));

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("head.nii.gz");
    std::fs::write(&path, "This is no volume at all, only text with a hopeful name.").unwrap();
    let error = open(&path).unwrap_err().to_string();
    assert!(error.contains("head.nii.gz") && error.contains("This is no volume"), "{error}");
    assert!(open(folder.path()).unwrap_err().to_string().contains("a folder of 1 files"));
    let missing = open(folder.path().join("gone.nii")).unwrap_err();
    assert!(matches!(missing, Error::Io { .. }), "{missing}");
    // The suffix does not matter.
    std::fs::write(&path, &good_files()[1].1).unwrap();
    let v = open(&path).unwrap();
    assert_eq!((v.dims(), v.name.as_str()), ([2, 3, 4], "head"));
}
