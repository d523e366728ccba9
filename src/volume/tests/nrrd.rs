use super::*;

const DIMS: [usize; 3] = [4, 3, 2];

fn file(header: &str, data: &[u8]) -> Vec<u8> {
    [format!("NRRD0004\n# comment\ndimension: 3\nsizes: 4 3 2\n{header}\nkey:=value\n\n").as_bytes(), data].concat()
}

fn shorts(order: Order) -> Vec<u8> {
    points(DIMS).flat_map(|(x, y, z)| order.i16(probe(x, y, z) as i16)).collect()
}

#[test]
fn encodings_types_and_byte_orders() {
    for order in ORDERS {
        let endian = if order == Order::Little { "little" } else { "big" };
        for (encoding, data) in [("raw", shorts(order)), ("gzip", gzip(&shorts(order)))] {
            let v = load(&file(&format!("type: short\nencoding: {encoding}\nendian: {endian}"), &data)).unwrap();
            assert_eq!((v.dims(), v.samples().type_name()), (DIMS, "int16"));
            assert_probe(&v);
        }
    }
    let text: Vec<String> = points(DIMS).map(|(x, y, z)| probe(x, y, z).to_string()).collect();
    for (name, type_name) in
        [("uchar", "uint8"), ("int8", "int8"), ("ushort", "uint16"), ("int", "uint16"), ("double", "float32")]
    {
        let v = load(&file(&format!("type: {name}\nencoding: ascii"), text.join(" \n").as_bytes())).unwrap();
        assert_eq!(v.samples().type_name(), type_name);
        assert_probe(&v);
    }
    // Header fields may end in CR LF; single bytes need no byte order.
    let data: Vec<u8> = points(DIMS).map(|(x, y, z)| probe(x, y, z) as u8).collect();
    let mut dos = b"NRRD0001\r\ntype: unsigned char\r\ndimension: 3\r\nsizes: 4 3 2\r\nencoding: raw\r\n\r\n".to_vec();
    dos.extend(&data);
    assert_probe(&load(&dos).unwrap());
    // Lines and bytes to skip lie before the samples.
    let skipped = [&b"two\nlines\nxyz"[..], &data].concat();
    assert_probe(&load(&file("type: uchar\nencoding: raw\nline skip: 2\nbyte skip: 3", &skipped)).unwrap());
}

#[test]
fn spaces_are_converted_to_ras() {
    let data = shorts(Order::Little);
    let common = "type: short\nencoding: raw\nendian: little";
    let directions = "space directions: (1,0.5,0) (0,2,0) (0,0,-3)\nspace origin: (10,20,30)";
    let p = DVec3::new(1.0, 1.0, 1.0);
    for (space, sign) in [
        ("left-posterior-superior", DVec3::new(-1.0, -1.0, 1.0)),
        ("LPS", DVec3::new(-1.0, -1.0, 1.0)),
        ("left-anterior-superior", DVec3::new(-1.0, 1.0, 1.0)),
        ("right-anterior-superior", DVec3::ONE),
        ("3D-right-handed", DVec3::ONE),
        ("scanner-xyz", DVec3::ONE),
    ] {
        let header = format!("{common}\nspace: {space}\n{directions}\nspace units: \"mm\" \"mm\" \"mm\"");
        let v = load(&file(&header, &data)).unwrap();
        assert_eq!(v.world_from_grid().point(p), sign * DVec3::new(11.0, 22.5, 27.0), "{space}");
        assert_eq!(v.unit, LengthUnit::Metres(1e-3));
        let is_patient = !["3D-right-handed", "scanner-xyz"].contains(&space);
        assert_eq!(v.up.is_anatomical(), is_patient, "{space}");
    }
    // Without a space: as given, the unit too.
    let v = load(&file(&format!("{common}\nspace dimension: 3\n{directions}"), &data)).unwrap();
    assert_eq!(v.world_from_grid().point(p), DVec3::new(11.0, 22.5, 27.0));
    assert_eq!(v.unit, LengthUnit::Unknown);
    let header = format!("{common}\nspacings: 2 3 4\naxis mins: 1 0 nan\ncenters: cell cell cell\nunits: um um um");
    let v = load(&file(&header, &data)).unwrap();
    // The cell that begins at 1 and is 2 long has its centre at 2; 0 and nan say nothing.
    assert_eq!(v.world_from_grid().point(p), DVec3::new(4.0, 3.0, 4.0));
    assert_eq!(v.unit, LengthUnit::Metres(1e-6));
    let v = load(&file(&format!("{common}\nspacings: nan 0 4\nunits: um mm um"), &data)).unwrap();
    assert_eq!((v.world_from_grid().spacing(), v.notes.len()), (DVec3::new(1.0, 1.0, 4.0), 2));
    assert_eq!(v.unit, LengthUnit::Unknown);
}

#[test]
fn an_axis_of_one_component_is_dropped_and_vectors_are_refused() {
    let four = |sizes: &str, more: &str| {
        let head = format!("NRRD0004\ntype: uchar\ndimension: 4\nsizes: {sizes}\nencoding: raw\n{more}\n\n");
        [head.as_bytes(), &[1, 2, 3, 4, 5, 6][..]].concat()
    };
    let directions = "kinds: vector domain domain domain\nspace directions: none (1,0,0) (0,1,0) (0,0,2)";
    let v = load(&four("1 3 2 1", directions)).unwrap();
    assert_eq!((v.dims(), v.world_from_grid().spacing()), ([3, 2, 1], DVec3::new(1.0, 1.0, 2.0)));
    let error = refusal(&four("3 2 1 1", directions));
    assert!(error.contains("3 channels") && error.contains("--channel"), "{error}");
    assert!(refusal(&four("2 3 1 1", "")).contains("axes"));
}

/// Two channels (fastest), 4 × 3 × 2 samples, three times (slowest): probe + 1000 · channel + 2000 · time.
fn five_axes() -> Vec<i16> {
    let all = (0..3).flat_map(|t| points([4, 3, 2]).map(move |p| (t, p)));
    all.flat_map(|(t, (x, y, z))| [0, 1].map(|c| probe(x, y, z) as i16 + 1000 * c + 2000 * t)).collect()
}

#[test]
fn channels_and_time_points_are_chosen() {
    let bytes = |values: &[i16]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    let text = five_axes().iter().map(i16::to_string).collect::<Vec<_>>().join(" ");
    let header = |encoding: &str| {
        format!(
            "NRRD0004\ntype: short\nendian: little\ndimension: 5\nsizes: 2 4 3 2 3\nspace dimension: 4\nspace \
             directions: none (2,0,0,0) (0,3,0,0) (0,0,4,0) (0,0,0,1)\nspace origin: (1,2,3,9)\nencoding: {encoding}\n\n"
        )
    };
    for (encoding, data) in
        [("raw", bytes(&five_axes())), ("gzip", gzip(&bytes(&five_axes()))), ("ascii", text.into_bytes())]
    {
        let file = [header(encoding).as_bytes(), &data].concat();
        assert!(refusal(&file).contains("2 channels: 0, 1"));
        for (channel, timepoint) in [(0, 0), (1, 0), (1, 2), (0, 1)] {
            let choice =
                Choice { channel: Some(Channel::Index(channel)), timepoint: Some(timepoint), ..Choice::default() };
            let volume = read(&file[..], &ReadHint { choice, ..ReadHint::default() }).unwrap();
            let shift = 1000.0 * channel as f64 + 2000.0 * timepoint as f64;
            let value = |i: usize| f64::from(volume.samples().raw(i)) - shift;
            assert!(points([4, 3, 2]).enumerate().all(|(i, (x, y, z))| value(i) == probe(x, y, z)), "{encoding}");
            assert_eq!(volume.world_from_grid().point(DVec3::ONE), DVec3::new(-3.0, -5.0, 7.0));
            assert_eq!((volume.series.channels.len(), volume.series.timepoints), (2, 3));
        }
        let choice = Choice { channel: Some(Channel::Index(0)), timepoint: Some(3), ..Choice::default() };
        let error = read(&file[..], &ReadHint { choice, ..ReadHint::default() }).unwrap_err().to_string();
        assert!(error.contains("0 to 2"), "{error}");
    }
    // By their kinds, without directions; and without either.
    let head = "NRRD0004\ntype: uchar\ndimension: 4\nsizes: 2 1 3 2\nencoding: raw\n";
    let four =
        |more: &str| [head.as_bytes(), more.as_bytes(), b"\n\n", &[1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12]].concat();
    let volume = load(&four("kinds: domain domain domain time")).unwrap();
    assert_eq!((volume.dims(), volume.samples()), ([2, 1, 3], &Samples::U8(vec![1, 2, 3, 4, 5, 6])));
    // A shear of space in time is no volume.
    let sheared = "space dimension: 4\nspace directions: (1,0,0,0) (0,1,0,0) (0,0,1,0.5) (0,0,0,1)";
    assert!(refusal(&four(sheared)).contains("space directions"));
}

#[test]
fn data_outside_the_folder_of_the_header_is_not_read() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("in")).unwrap();
    std::fs::write(folder.path().join("secret"), [7; 64]).unwrap();
    let path = folder.path().join("in/p.nhdr");
    let absolute = folder.path().join("secret").display().to_string();
    for name in ["../secret", &absolute, "../../../../../../../../etc/passwd"] {
        let header = "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 4 4 4\nencoding: raw\ndata file:";
        std::fs::write(&path, format!("{header} {name}\n\n")).unwrap();
        let error = open(&path).unwrap_err().to_string();
        assert!(error.contains(name) && error.contains("--allow-outside"), "{error}");
    }
    let choice = Choice { allow_outside: true, ..Choice::default() };
    std::fs::write(
        &path,
        std::fs::read_to_string(&path).unwrap().replace("../../../../../../../../etc/passwd", "../secret"),
    )
    .unwrap();
    let volume = open_with(&path, &ReadHint { choice, ..ReadHint::default() }).unwrap();
    assert!(volume.notes.iter().any(|n| n.text.contains("secret")), "{:?}", volume.notes);
}

#[test]
fn spacings_that_no_picture_can_have_are_refused_at_once() {
    let data = shorts(Order::Little);
    for spacings in ["3e38 1 1", "1 1e-30 1"] {
        let header = format!("type: short\nencoding: raw\nendian: little\nspacings: {spacings}");
        let error = refusal(&file(&header, &data));
        assert!(error.contains("spacing") && error.contains("--spacing"), "{error}");
    }
}

#[test]
fn detached_data_is_found_beside_the_header() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, bytes: &[u8]| std::fs::write(folder.path().join(name), bytes).unwrap();
    let header = |more: &str| format!("NRRD0004\ndimension: 3\nsizes: 4 3 2\ntype: short\nendian: big\n{more}\n");
    let path = folder.path().join("a.nhdr");
    write("a.nhdr", header("encoding: raw\ndata file: sub/a.raw").as_bytes());
    let error = open(&path).unwrap_err().to_string();
    assert!(error.contains("a.raw") && error.contains("cannot open"), "{error}");
    std::fs::create_dir(folder.path().join("sub")).unwrap();
    write("sub/a.raw", &shorts(Order::Big));
    assert_probe(&open(&path).unwrap());
    write("a.nhdr", header("encoding: gzip\ndatafile: a.raw.gz").as_bytes());
    write("a.raw.gz", &gzip(&shorts(Order::Big)));
    assert_probe(&open(&path).unwrap());
    // The samples at the end of a file with a header of its own.
    write("a.nhdr", header("encoding: raw\nbyte skip: -1\ndata file: tail.raw").as_bytes());
    write("tail.raw", &[&b"something else"[..], &shorts(Order::Big)].concat());
    assert_probe(&open(&path).unwrap());
    write("tail.raw", b"short");
    let error = open(&path).unwrap_err().to_string();
    assert!(error.contains("a.nhdr") && error.contains("too short"), "{error}");
    write("a.nhdr", header("encoding: raw\ndata file: tail.raw").as_bytes());
    let error = open(&path).unwrap_err().to_string();
    assert!(error.starts_with("tail.raw: NRRD") && error.contains("48 bytes"), "{error}");
    // In a stream there is no second file.
    let stream = header("encoding: raw\ndata file: sub/a.raw");
    assert!(refusal(stream.as_bytes()).contains("sub/a.raw"));
    for spread in ["LIST", "slice%03d.raw 1 20 1"] {
        assert!(refusal(header(&format!("encoding: raw\ndata file: {spread}")).as_bytes()).contains("several files"));
    }
}

#[test]
fn damage_is_named() {
    let data = shorts(Order::Little);
    for (header, word) in [
        ("type: short\nencoding: raw", "endian"),
        ("type: short\nencoding: hex\nendian: little", "hex"),
        ("type: block\nencoding: raw", "block"),
        ("encoding: raw", "\"type\""),
        ("type: short\nendian: little", "\"encoding\""),
        ("type: short\nencoding: raw\nendian: middle", "middle"),
        ("type: short\nencoding: raw\nendian: little\nspacings: 1 2", "spacings"),
        (
            "type: short\nencoding: raw\nendian: little\nspace: up\nspace directions: (1,0,0) (0,1,0) (0,0,1)",
            "space: up",
        ),
        ("type: short\nencoding: raw\nendian: little\nspace directions: (1,0,0) (1,0,0) (0,0,1)", "independent"),
        ("type: short\nencoding: raw\nendian: little\nspace directions: (1,0,0) (0,1,0)", "space directions"),
        ("type: short\nencoding: raw\nendian: little\nspace directions: (1,0 (0,1,0) (0,0,1)", "space directions"),
        ("type: short\nencoding: raw\nendian: little\nbyte skip: -1", "byte skip"),
        ("type: short\nno colon here", "no colon here"),
    ] {
        let error = refusal(&file(header, &data));
        assert!(error.contains(word), "{header}: {error}");
    }
}
