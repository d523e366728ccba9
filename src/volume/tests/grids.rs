//! OpenDX and gOpenMol.

use super::phantom::{self, ORIGIN, SPACING, assert_phantom, words};
use super::*;
use glam::DMat3;

/// A grid with the columns of `steps`; `data` says how the samples follow.
fn dx(counts: &str, steps: DMat3, array: &str) -> String {
    let delta = |axis: DVec3| format!("delta {}\n", words(&axis.to_array()));
    format!(
        "# made here\nobject 1 class gridpositions counts {counts}\norigin {}\n{}{}{}object 2 class gridconnections counts {counts}\n\
         object 3 class array {array} data follows\n",
        words(&ORIGIN.to_array()),
        delta(steps.x_axis),
        delta(steps.y_axis),
        delta(steps.z_axis)
    )
}

const END: &str = "attribute \"dep\" string \"positions\"\nobject \"regular positions regular connections\" class field\n\
                   component \"positions\" value 1\ncomponent \"connections\" value 2\ncomponent \"data\" value 3\n";

/// The samples of the phantom, z fastest.
fn z_fastest(encode: impl Fn(u16) -> Vec<u8>) -> Vec<u8> {
    let [x, y, z] = phantom::DIMS;
    points([z, y, x]).flat_map(|(z, y, x)| encode(phantom::value(x, y, z))).collect()
}

fn steps(axes: DMat3) -> DMat3 {
    axes * DMat3::from_diagonal(DVec3::from_array(SPACING))
}

#[test]
fn the_phantom_comes_back_from_opendx_as_text_and_in_both_byte_orders() {
    let text = z_fastest(|v| format!("{v}.0 ").into_bytes());
    for axes in phantom::directions() {
        let head = |array: &str| dx("5 7 9", steps(axes), array).into_bytes();
        let plain = [&head("type double rank 0 items 315")[..], &text, b"\n", END.as_bytes()].concat();
        let mut files = vec![plain.clone(), gzip(&plain)];
        for (o, name) in [(Order::Little, "lsb"), (Order::Big, "msb")] {
            let floats = z_fastest(|v| o.f32(v.into()));
            files.push(
                [&head(&format!("type float rank 0 items 315 {name} ieee"))[..], &floats, b"\n", END.as_bytes()]
                    .concat(),
            );
            let shorts = z_fastest(|v| o.u16(v));
            files.push(
                [&head(&format!("type unsigned short rank 1 shape 1 items 315 {name} binary"))[..], &shorts].concat(),
            );
        }
        for bytes in files {
            let volume = load(&bytes).unwrap();
            assert_phantom(&volume, axes, ORIGIN);
            assert_eq!(volume.unit, LengthUnit::Metres(1e-10));
            assert!(volume.notes[0].text.contains("no unit"));
        }
        // As many values as cells; names in quotes, mixed line ends, a mark of UTF-8.
        let head =
            dx("6 8 10", steps(axes), "type \"double\" rank 0 items 315").replace("object 1", "object \"the grid\"");
        let cells = [b"\xef\xbb\xbf", head.replace('\n', "\r\n").as_bytes(), &text].concat();
        let volume = load(&[&cells[..], b"\n"].concat()).unwrap();
        assert_phantom(&volume, axes, ORIGIN + steps(axes) * DVec3::splat(0.5));
    }
}

#[test]
fn damaged_opendx_files_are_named() {
    let good = dx("5 7 9", steps(DMat3::IDENTITY), "type double rank 0 items 315");
    let text = z_fastest(|v| format!("{v} ").into_bytes());
    for (from, to, word) in [
        ("items 315", "items 314", "314 items"),
        ("items 315", "items -1", "items -1"),
        ("counts 5 7 9", "counts 5 7", "counts 5 7"),
        ("gridpositions counts 5 7 9", "gridpositions counts 5 7 8", "connections"),
        ("counts 5 7 9", "counts 5 7 0", "items"),
        ("type double", "type string", "string"),
        ("type double", "", "without a type"),
        ("rank 0", "rank 1 shape 3", "shape 3"),
        ("delta 0.5 0 0", "delta 0.5 0 0 ", ""),
        ("delta 0.5 0 0\n", "", "2 steps"),
        ("delta 0.5 0 0", "delta 0 0.7 0", "independent"),
        ("delta 0.5 0 0", "delta nan 0 0", "finite"),
        ("data follows", "data file x.bin,0", "data file"),
        ("data follows", "ieee data follows", "byte order"),
        ("data follows", "xdr data follows", "xdr"),
        ("gridpositions", "path", ""),
    ] {
        assert!(good.contains(from), "{from}");
        let bytes = [good.replace(from, to).as_bytes(), &text, b"\n"].concat();
        if word.is_empty() {
            let _ = load(&bytes);
            continue;
        }
        let error = refusal(&bytes);
        assert!(error.contains(word), "{to}: {error}");
    }
    let huge = good.replace("5 7 9", "10000 10000 10000").replace("315", "1000000000000");
    assert!(refusal(&[huge.as_bytes(), &text].concat()).contains("8000000000000 bytes"));
    assert!(refusal(&[good.as_bytes(), &text, b"5\n"].concat()).contains("more numbers"));
    assert!(refusal(&[good.as_bytes(), &text[..text.len() - 5]].concat()).contains("before the end"));
    assert!(refusal(b"object 1 class array type float rank 0 items 1 data follows\n1\n").contains("before positions"));
    assert!(refusal(b"object 1 class gridpositions counts 1 1 1\n").contains("end of the file"));
}

/// The header of gOpenMol: z, y, x.
fn plt(o: Order, dims: [u32; 3], span: [[f32; 2]; 3]) -> Vec<u8> {
    let [x, y, z] = dims;
    let numbers = [3, 200, z, y, x].into_iter().flat_map(|n| o.u32(n));
    let ends = [span[2], span[1], span[0]].into_iter().flatten().flat_map(|v| o.f32(v));
    numbers.chain(ends).collect()
}

#[test]
fn the_phantom_comes_back_from_gopenmol_in_both_byte_orders() {
    let dims = phantom::DIMS.map(|n| n as u32);
    let span: [[f32; 2]; 3] = std::array::from_fn(|a| {
        // Borders of the first and the last cell.
        let first = ORIGIN[a] - 0.5 * SPACING[a];
        [first as f32, (first + SPACING[a] * phantom::DIMS[a] as f64) as f32]
    });
    for o in ORDERS {
        let bytes = [plt(o, dims, span), phantom::samples(|v| o.f32(v.into()))].concat();
        for bytes in [bytes.clone(), gzip(&bytes)] {
            let volume = load(&bytes).unwrap();
            assert_phantom(&volume, DMat3::IDENTITY, ORIGIN);
            assert_eq!(volume.unit, LengthUnit::Metres(1e-10));
        }
        assert!(load(&[&bytes[..], b"x"].concat()).unwrap().notes[0].text.contains("goes on"));
        assert!(load(&bytes).unwrap().notes[0].text.contains("cells"));
        assert!(refusal(&bytes[..bytes.len() - 1]).contains("samples"));
        assert!(refusal(&bytes[..40]).contains("starts with"));
        let huge = plt(o, [1 << 20; 3], span);
        assert!(refusal(&huge).contains("limit"), "{}", refusal(&huge));
        for wrong in [plt(o, [0, 7, 9], span), plt(o, [u32::MAX; 3], span), plt(o, dims, [[0.0, f32::NAN]; 3])] {
            assert!(refusal(&[wrong, vec![0; 1260]].concat()).contains("starts with"));
        }
        let flat = plt(o, dims, [[1.0, 1.0], [0.0, 1.0], [0.0, 1.0]]);
        assert!(refusal(&[flat, vec![0; 1260]].concat()).contains("independent"));
    }
}
