//! What the page is given, against the texture and the volume it was made from.

use super::page::{page, page_in_one_file, script};
use super::*;
use crate::geom::Affine;
use crate::probe::Probe;
use crate::transfer::{BRICK_TEXELS, Brick, Lattice, Layers, Layout, MemoryTexture, validity};
use crate::volume::{Samples, Volume};
use half::f16;

/// A texture whose coefficient i of texel n is n + 1000·i, valid where n is no multiple of 3.
fn texture(dims: [usize; 3]) -> MemoryTexture {
    let layers = Layers::new(vec![2, 1]).unwrap();
    let layout = Layout { lattice: Lattice::from_ratio(dims, 1.0).unwrap(), layers: layers.clone() };
    let mut texture = MemoryTexture::new(layout);
    let [bx, by, bz] = dims.map(|n| n.div_ceil(8));
    for b in 0..bx * by * bz {
        let index = [b % bx, b / bx % by, b / bx / by];
        let mut brick = Brick::unbaked(&layers);
        for t in 0..BRICK_TEXELS {
            let [x, y, z] = [t % 8 + 8 * index[0], t / 8 % 8 + 8 * index[1], t / 64 + 8 * index[2]];
            let number = x + dims[0] * (y + dims[1] * z);
            let valid = x < dims[0] && y < dims[1] && z < dims[2] && !number.is_multiple_of(3);
            brick.validity[t] = if valid { validity::VALID } else { 0 };
            for i in 0..5 {
                let value = if valid { number as f32 / 64.0 + 8.0 * i as f32 } else { 0.0 };
                brick.transfer[t * 5 + i] = f16::from_f32(value);
            }
            brick.stderr[t * 3..t * 3 + 3].fill(f16::ZERO);
        }
        texture.insert(index, brick).unwrap();
    }
    texture
}

fn package(dims: [usize; 3], options: Options) -> Package {
    let samples: Vec<f32> = (0..dims.iter().product()).map(|i| i as f32 - 7.0).collect();
    let volume = Volume::new(dims, Samples::F32(samples), Affine::IDENTITY).unwrap();
    let texture = texture(dims);
    let probes = [Probe::from_image("white", crate::probe::LatLong::new(4, 2, vec![[1.0; 3]; 8]).unwrap())];
    let about = vec![("volume".to_string(), "a </script> test".to_string())];
    let subject = Subject { volume: &volume, source: &texture, isovalues: None, about, probes: &probes, isovalue: 3.0 };
    pack(&subject, &options).unwrap()
}

fn section<'a>(package: &'a Package, name: &str) -> &'a [u8] {
    let entry = &package.header["sections"][name];
    let [offset, length] = [0, 1].map(|i| entry[i].as_u64().unwrap() as usize);
    assert_eq!(offset % 8, 0, "{name}");
    &package.payload[offset..offset + length]
}

const WHOLE: Options = Options { texture_side: 100, volume_side: 100, coding: Coding::Half };

#[test]
fn the_valid_texels_arrive_as_planes_bit_for_bit() {
    let dims = [9, 5, 4];
    let package = package(dims, WHOLE);
    let all: usize = dims.iter().product();
    let valid: Vec<usize> = (0..all).filter(|n| !n.is_multiple_of(3)).collect();
    assert_eq!(package.valid_texels as usize, valid.len());
    let bits = section(&package, "valid");
    assert!((0..all).all(|n| (bits[n / 8] >> (n % 8) & 1 == 1) != n.is_multiple_of(3)));
    let planes: Vec<f16> = bytemuck::pod_collect_to_vec(section(&package, "transfer"));
    for i in 0..5 {
        for (t, n) in valid.iter().enumerate() {
            assert_eq!(planes[i * valid.len() + t].to_f32(), f16::from_f32(*n as f32 / 64.0 + 8.0 * i as f32).to_f32());
        }
    }
}

#[test]
fn eight_bits_are_within_half_a_step_of_each_coefficient() {
    let dims = [9, 5, 4];
    let package = package(dims, Options { coding: Coding::Byte, ..WHOLE });
    let count = package.valid_texels as usize;
    let codes: &[i8] = bytemuck::cast_slice(section(&package, "transfer"));
    let scales = package.header["texture"]["scales"].as_array().unwrap();
    let valid = (0..dims.iter().product::<usize>()).filter(|n| !n.is_multiple_of(3));
    for (t, n) in valid.enumerate() {
        for (i, scale) in scales.iter().enumerate() {
            let scale = scale.as_f64().unwrap();
            let stored = f64::from(f16::from_f32(n as f32 / 64.0 + 8.0 * i as f32).to_f32());
            let error = (f64::from(codes[i * count + t]) * scale / 127.0 - stored).abs();
            assert!(error <= 0.5 * scale / 127.0 + 1e-5 * scale, "{i} {n}: {error}");
        }
    }
}

#[test]
fn ranges_hold_every_cell_of_their_block() {
    let dims = [19, 9, 12];
    let package = package(dims, WHOLE);
    let samples: Vec<f16> = bytemuck::pod_collect_to_vec(section(&package, "samples"));
    let ranges: Vec<f16> = bytemuck::pod_collect_to_vec(section(&package, "ranges"));
    let blocks = [3, 1, 2];
    assert_eq!(package.header["volume"]["blocks"], serde_json::json!(blocks));
    for z in 0..dims[2] - 1 {
        for y in 0..dims[1] - 1 {
            for x in 0..dims[0] - 1 {
                let block = x / 8 + blocks[0] * (y / 8 + blocks[1] * (z / 8));
                for corner in 0..8 {
                    let at = x + (corner & 1) + dims[0] * (y + (corner >> 1 & 1) + dims[1] * (z + (corner >> 2)));
                    assert!(ranges[2 * block] <= samples[at] && samples[at] <= ranges[2 * block + 1]);
                }
            }
        }
    }
}

#[test]
fn a_coarser_lattice_keeps_what_is_linear() {
    // Coefficients rise linearly with x, y and z; where all texels around are valid a tent keeps a linear function.
    let dims = [33, 17, 9];
    let coarse = package(dims, Options { texture_side: 17, volume_side: 17, ..WHOLE });
    assert_eq!((coarse.texels, coarse.samples), ([17, 9, 5], [17, 9, 5]));
    let samples: Vec<f16> = bytemuck::pod_collect_to_vec(section(&coarse, "samples"));
    let scale = coarse.header["volume"]["scale"].as_f64().unwrap();
    for (z, y, x) in [(1, 1, 1), (3, 7, 15), (2, 4, 8)] {
        let fine = 2 * x + dims[0] * (2 * y + dims[1] * (2 * z));
        let got = f64::from(samples[x + 17 * (y + 9 * z)].to_f32()) * scale;
        assert!((got - (fine as f64 - 7.0)).abs() < scale * 1e-3, "{got} {fine}");
    }
}

#[test]
fn the_page_is_one_script_and_data_cannot_end_it() {
    let script = script();
    assert!(!script.lines().any(|l| l.starts_with("import ") || l.starts_with("export ")));
    assert!(!script.contains("</script"));
    let served = page();
    assert!(!served.contains("/*SCRIPT*/") && !served.contains("<!--DATA-->") && !served.contains("id=\"payload\""));
    let alone = page_in_one_file(&package([9, 5, 4], WHOLE)).unwrap();
    assert!(!alone.contains("a </script> test") && alone.contains("a \\u003c/script> test"));
    // Nothing that a browser would fetch.
    let without_data = &alone[..alone.find("<script type=\"application/json\"").unwrap()];
    assert!(!without_data.contains("src=") && !without_data.contains("url(") && !without_data.contains("http"));
}

/// `<!--` and `<script` in a name would swallow the rest of the page (HTML, 4.12.1.3).
#[test]
fn no_name_changes_how_the_page_in_one_file_is_read() {
    let mut package = package([9, 5, 4], WHOLE);
    let name = "<!--<script></script>]]><\u{2028}";
    package.header["name"] = name.into();
    let alone = page_in_one_file(&package).unwrap();
    let header = alone.split("id=\"header\">").nth(1).unwrap().split("</script>").next().unwrap();
    assert!(!header.contains('<'));
    assert_eq!(serde_json::from_str::<serde_json::Value>(header).unwrap(), package.header);
    let ends = alone.matches("</script>").count();
    assert_eq!((alone.matches("<script").count(), ends), (3, 3), "data, data, and the page's own");
    assert!(!alone.contains("<!--<"));
}
