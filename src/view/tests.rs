//! What the page is given, against the texture and the volume it was made from.

use super::page::{page, page_in_one_file, script};
use super::*;
use crate::geom::Affine;
use crate::probe::Probe;
use crate::relight::{Light, LuminaireLight, Material, Textures, contract};
use crate::transfer::store::SceneIdentity;
use crate::transfer::{BRICK_TEXELS, Brick, Lattice, Layers, Layout, MemoryTexture, validity};
use crate::volume::{Samples, Volume};
use half::f16;

/// A texture of texels n, valid where n is no multiple of 3, that hold value(n, i) in number i.
fn filled(dims: [usize; 3], layers: &Layers, value: impl Fn(usize, usize) -> f32) -> MemoryTexture {
    let layout = Layout { lattice: Lattice::from_ratio(dims, 1.0).unwrap(), layers: layers.clone() };
    let mut texture = MemoryTexture::new(layout);
    let [bx, by, bz] = dims.map(|n| n.div_ceil(8));
    let (coefficients, errors) = (layers.coefficients(), layers.errors());
    for b in 0..bx * by * bz {
        let index = [b % bx, b / bx % by, b / bx / by];
        let mut brick = Brick::unbaked(layers);
        for t in 0..BRICK_TEXELS {
            let [x, y, z] = [t % 8 + 8 * index[0], t / 8 % 8 + 8 * index[1], t / 64 + 8 * index[2]];
            let number = x + dims[0] * (y + dims[1] * z);
            let valid = x < dims[0] && y < dims[1] && z < dims[2] && !number.is_multiple_of(3);
            brick.validity[t] = if valid { validity::VALID } else { 0 };
            for i in 0..coefficients {
                brick.transfer[t * coefficients + i] = f16::from_f32(if valid { value(number, i) } else { 0.0 });
            }
            brick.stderr[t * errors..(t + 1) * errors].fill(f16::ZERO);
        }
        texture.insert(index, brick).unwrap();
    }
    texture
}

/// A grey texture whose coefficient i of texel n is n/64 + 8·i.
fn texture(dims: [usize; 3]) -> MemoryTexture {
    filled(dims, &Layers::new(vec![2, 1]).unwrap(), |n, i| n as f32 / 64.0 + 8.0 * i as f32)
}

fn volume(dims: [usize; 3]) -> Volume {
    let samples: Vec<f32> = (0..dims.iter().product()).map(|i| i as f32 - 7.0).collect();
    Volume::new(dims, Samples::F32(samples), Affine::IDENTITY).unwrap()
}

fn white() -> Probe {
    Probe::from_image("white", crate::probe::LatLong::new(4, 2, vec![[1.0; 3]; 8]).unwrap())
}

fn package(dims: [usize; 3], options: Options) -> Package {
    let (volume, texture) = (volume(dims), texture(dims));
    let textures = Textures::of_volume(&texture).unwrap();
    let about = vec![("volume".to_string(), "a </script> test".to_string())];
    let subject = Subject {
        volume: &volume,
        textures: &textures,
        surrounded: None,
        isovalues: None,
        about,
        probes: &[white()],
        isovalue: 3.0,
    };
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

/// What the page makes of a package of a scene, texel by texel: the formula of [`contract`] on decoded numbers. With
/// each radiance how far it may be off: half a step of each coefficient of the environment, as far as weight and tail
/// take it.
fn decoded(
    package: &Package,
    bands: &[usize],
    light: &Light,
    material: &Material,
    powers: &[f64],
) -> Vec<[[f64; 2]; 3]> {
    let header = &package.header;
    let numbers = |list: &serde_json::Value| -> Vec<f64> {
        list.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
    };
    let (count, scales) = (package.valid_texels as usize, numbers(&header["texture"]["scales"]));
    let is_byte = header["texture"]["coding"] == "byte";
    let transfer: Vec<f64> = match is_byte {
        true => section(package, "transfer").iter().map(|&c| f64::from(c as i8) / 127.0).collect(),
        false => {
            let planes: Vec<f16> = bytemuck::pod_collect_to_vec(section(package, "transfer"));
            planes.iter().map(|v| v.to_f64()).collect()
        }
    };
    let surroundings: Vec<f16> = bytemuck::pod_collect_to_vec(section(package, "surroundings"));
    let luminaires = header["scene"]["luminaires"].as_array().unwrap();
    let (layers, last) = (bands.len(), bands.len() - 1);
    let texel = |t: usize, c: usize| {
        let group = |g: usize, k: usize| surroundings[((g * layers + k) * 3 + c) * count + t].to_f64();
        let (rho, glow) = (f64::from(material.albedo[c]), f64::from(material.emission[c]));
        let again = match layers {
            1 => 0.0,
            _ if group(0, last - 1) > 0.0 => rho * (group(0, last) / group(0, last - 1)).min(1.0),
            _ => 0.0,
        };
        let gain = if again < 1.0 { again / (1.0 - again) } else { 0.0 };
        let (mut sum, mut error, mut first) = (glow, 0.0, 0);
        for (k, b) in bands.iter().enumerate() {
            let power = rho.powi(k as i32 + 1);
            let repeated = if k == last { 1.0 + gain } else { 1.0 };
            for i in 0..b * b {
                let at = first + c * b * b + i;
                let weight = power * light.coefficients(k)[i][c] * repeated;
                sum += weight * transfer[at * count + t] * scales[at];
                error += if is_byte { weight.abs() * 0.5 * scales[at] / 127.0 } else { 0.0 };
            }
            first += 3 * b * b;
            sum += repeated * power * glow * group(0, k);
            for (l, luminaire) in luminaires.iter().enumerate() {
                let factor = numbers(&luminaire["factor"])[c] * powers[l];
                sum += repeated * power * factor * group(1 + l, k);
            }
        }
        [sum, error]
    };
    (0..count).map(|t| [0, 1, 2].map(|c| texel(t, c))).collect()
}

fn identity(luminaires: &[&str]) -> SceneIdentity {
    SceneIdentity {
        fingerprint: String::new(),
        luminaires: luminaires.iter().map(|name| (*name).into()).collect(),
        exponents: vec![0; luminaires.len()],
        coupling: None,
        media: false,
        body: None,
    }
}

/// The numbers of a page give the radiance of the contraction: in 16 bits to the rounding of its 32-bit result, in 8
/// bits within half a step of each coefficient, however little of a luminaire arrives.
#[test]
fn a_package_of_a_scene_has_the_radiance_of_the_contraction() {
    let dims = [9, 5, 4];
    for bands in [&[3, 2, 1][..], &[2]] {
        let layers = Layers::new(bands.to_vec()).unwrap().coloured();
        let of_group = Layers::uniform(bands.len(), 1).unwrap().coloured();
        let random = |n: usize, i: usize, what: u32| crate::sampling::hash::uniform(3, n as u64, i as u32, what);
        let environment = filled(dims, &layers, |n, i| random(n, i, 0) - 0.4);
        let emission = filled(dims, &of_group, |n, i| (random(n, i, 1) - 0.1).max(0.0));
        // Near a lamp a thousand times what is far from it.
        let lamps = [2, 3].map(|what| filled(dims, &of_group, |n, i| random(n, i, what).powi(10)));
        let luminaires = |powers: [f64; 2]| {
            let factors = [[4.0, 2.0, 1.0], [0.25; 3]];
            let lit = |l: usize| LuminaireLight { texture: &lamps[l], factor: factors[l].map(|f| f * powers[l]) };
            [lit(0), lit(1)]
        };
        let textures = Textures::of_scene(&environment, &emission, &luminaires([1.0; 2])).unwrap();
        let (volume, identity) = (volume(dims), identity(&["ceiling", "lamp"]));
        let subject = Subject {
            volume: &volume,
            textures: &textures,
            surrounded: Some(Surrounded { identity: &identity, rotation: 30.0 }),
            isovalues: None,
            about: Vec::new(),
            probes: &[white()],
            isovalue: 3.0,
        };
        let light = Light::new((0..9).map(|i| [0.9, 0.5, -0.4].map(|c| c / f64::from(1 + i))).collect()).unwrap();
        let material = Material::new([0.9, 0.6, 0.3], [0.5, 0.0, 0.25]).unwrap();
        for (coding, powers) in [(Coding::Half, [1.0, 1.0]), (Coding::Half, [0.5, 3.0]), (Coding::Byte, [2.0, 0.0])] {
            let package = pack(&subject, &Options { coding, ..WHOLE }).unwrap();
            assert_eq!(package.header["scene"]["luminaires"][1]["name"], "lamp");
            let found = decoded(&package, bands, &light, &material, &powers);
            let textures = Textures::of_scene(&environment, &emission, &luminaires(powers)).unwrap();
            let bricks = crate::transfer::Selection::all(textures.layout().lattice).bricks();
            let contracted = contract(&textures, &bricks, &light, &material).unwrap();
            let valid = (0..dims.iter().product::<usize>()).filter(|n| !n.is_multiple_of(3));
            let places: Vec<[f32; 3]> = valid.map(|n| [n % 9, n / 9 % 5, n / 45].map(|i| i as f32)).collect();
            let normals = vec![[0.0, 0.0, 1.0]; places.len()];
            let expected = contracted.look_up(&places, &normals, &light, &material).radiance;
            assert_eq!(found.len(), expected.len());
            for (rgb, expected) in found.iter().zip(&expected) {
                for c in 0..3 {
                    let [radiance, error] = rgb[c];
                    // Weights of the contraction and its result are 32-bit numbers; terms are at most 10 here.
                    let tolerance = error + 1e-5 * (10.0 + radiance.abs());
                    assert!((radiance - f64::from(expected[c])).abs() <= tolerance, "{rgb:?} {expected:?}");
                }
            }
        }
    }
}

#[test]
fn textures_of_other_surroundings_are_refused() {
    let dims = [9, 5, 4];
    let (volume, texture, identity) = (volume(dims), texture(dims), identity(&["ceiling"]));
    let textures = Textures::of_volume(&texture).unwrap();
    let surrounded = Some(Surrounded { identity: &identity, rotation: 0.0 });
    let (isovalues, about, probes) = (None, Vec::new(), &[white()][..]);
    let subject = Subject { volume: &volume, textures: &textures, surrounded, isovalues, about, probes, isovalue: 3.0 };
    let error = pack(&subject, &WHOLE).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(error.contains("a volume alone") && error.contains("1 luminaires"), "{error}");
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
