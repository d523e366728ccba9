//! What descriptions mean, and which line a mistake is on.

use super::*;
use crate::scene::{MaterialRule, SunSplit};

#[test]
fn a_volume_alone_is_a_scene() {
    let scene = SceneDescription::parse("volume = \"sphere\"\n", "s.toml").expect("a scene");
    assert_eq!((scene.volume.value.as_str(), scene.volume.line), ("sphere", 1));
    assert!(scene.isovalues.is_empty() && scene.outputs.is_empty() && scene.albedo.is_none() && scene.probe.is_none());
    assert_eq!(scene.bake, BakeDescription::default());
}

#[test]
fn every_key_is_read() {
    let text = "
volume = \"a.nrrd\"
solid = \"below\"
up = \"-y\"
isovalues = [90, \"40%\", \"auto\"]
outputs = \"x.png\"
[material]
colormap = \"viridis\"
range = [0, 255]
albedo = 0.5
emission = [[10, 0.0], [20.5, 1, 2, 3]]
[bake]
rays = 0x40
layers = 3
bands = [5, 4, 3]
error = \"2%\"
texture = [8, 9, 10]
positive = true
[probe]
file = \"p.exr\"
rotation = -30
window = \"certified\"
sun_split = 3
[camera]
azimuth = 20
size = [64, 48]
projection = \"perspective\"
exposure = -1.5
background = \"#102030\"
";
    let scene = SceneDescription::parse(text, "s.toml").expect("a scene");
    assert_eq!((scene.solid, scene.up), (Some(Solid::Below), Some(Up::NegY)));
    let isovalues: Vec<&str> = scene.isovalues.iter().map(|i| i.value.as_str()).collect();
    assert_eq!(isovalues, ["90", "40%", "auto"]);
    assert_eq!(scene.outputs, [Located { value: "x.png".to_string(), line: 6 }]);
    let rule = scene.albedo.expect("an albedo").rule((3.0, 4.0));
    assert!(matches!(rule, MaterialRule::Map { low: 0.0, high: 255.0, scale: 0.5, .. }));
    let emission = scene.emission.expect("an emission");
    assert_eq!((emission.at(0.0), emission.at(99.0)), ([0.0; 3], [1.0, 2.0, 3.0]));
    let bake = &scene.bake;
    assert_eq!((bake.rays, bake.layers, bake.error, bake.positive), (Some(64), Some(3), Some(0.02), Some(true)));
    assert_eq!((bake.bands.as_slice(), bake.texture), (&[5, 4, 3][..], Some(TextureSize::Texels([8, 9, 10]))));
    let probe = scene.probe.expect("a probe");
    assert_eq!((probe.name.value.as_str(), probe.is_file, probe.rotation), ("p.exr", true, Some(-30.0)));
    assert_eq!(probe.sun_split, Some(SunSplit::Lobes(3)));
    assert_eq!(scene.camera.view.as_deref(), Some("20,0"));
    assert_eq!((scene.camera.size, scene.camera.field_of_view), (Some([64, 48]), Some(35.0)));
    assert_eq!(scene.camera.exposure.as_deref(), Some("-1.5"));
}

/// Each mistake: the lines after `volume`, the line it is on, and words of the message.
const MISTAKES: [(&str, usize, &[&str]); 26] = [
    ("isovalus = 3", 2, &["`isovalus`", "did you mean isovalues?"]),
    ("\n[bake]\nray = 16", 4, &["`bake.ray`", "did you mean rays?"]),
    ("[walls]\nalbedo = 1", 2, &["tables", "[[walls]]"]),
    ("[medium]\nscattering = 1", 3, &["medium.scattering", "extinction"]),
    ("[[luminaires]]", 2, &["the key `shape`"]),
    ("[caustics]", 2, &["caustics by photons are not supported yet"]),
    ("isovalues = [1, \"4O%\"]", 2, &["isovalues[1] = \"4O%\"", "auto"]),
    ("isovalues = []", 2, &["at least one"]),
    ("solid = \"abov\"", 2, &["did you mean above?"]),
    ("up = 3", 2, &["up = 3", "text"]),
    ("material = 3", 2, &["a table", "[material]"]),
    ("[material]\nalbedo = 1.2", 3, &["material.albedo = 1.2", "from 0 to 1"]),
    ("[material]\nalbedo = [0.1, 0.2]", 3, &["one number or three"]),
    ("[material]\nalbedo = \"red\"", 3, &["a number"]),
    ("[material]\nalbedo = [[2, 0.5],\n [1, 0.2]]", 4, &["material.albedo[1]", "ascend"]),
    ("[material]\nalbedo = [[2, 0.5, 0.5]]", 3, &["a row"]),
    ("[material]\nemission = -1", 3, &["material.emission = -1", "not negative"]),
    ("[material]\nemission = [[0, 0], [5, -0.5]]", 3, &["-0.5"]),
    ("[material]\ncolormap = \"virdis\"", 3, &["did you mean viridis?"]),
    ("[material]\ncolormap = \"viridis\"\nrange = [3, 3]", 4, &["two rising isovalues"]),
    ("[bake]\nrays = 12", 3, &["a power of two"]),
    ("[bake]\nrays = 16.5", 3, &["whole number"]),
    ("[bake]\nlayers = 2\nbands = [5, 4, 3]", 4, &["one for each layer"]),
    ("[probe]\nname = \"studio\"\nfile = \"a.exr\"", 4, &["not both"]),
    ("outputs = [\"a.obj\"]", 2, &["outputs[0]", ".glb"]),
    ("[camera]\nsize = 3 3", 3, &["TOML"]),
];

#[test]
fn mistakes_name_their_line_and_a_remedy() {
    for (text, line, words) in MISTAKES {
        let whole = format!("volume = \"sphere:8\"\n{text}\n");
        let Err(error) = SceneDescription::parse(&whole, "s.toml") else { panic!("{text} was accepted") };
        let message = error.to_string();
        assert!(message.starts_with(&format!("s.toml:{line}: ")), "{text}: {message}");
        assert!(words.iter().all(|word| message.contains(word)), "{text}: {message}");
    }
    let Err(error) = SceneDescription::parse("up = \"z\"", "s.toml") else { panic!("no volume") };
    assert!(error.to_string().contains("`volume`"), "{error}");
}
