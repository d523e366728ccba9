//! USDZ: a mesh with a picture of its colours as a scene of Pixar's USD in text, and the picture, stored in a zip archive (Pixar, "USDZ
//! File Format Specification": no compression, the bytes of each file at a multiple of 64).
//!
//! The picture is what the surface emits, and nothing is reflected: viewers that have lights of their own show the baked
//! light alone. Y is up, in metres; the mesh lies as in the GLB.

use super::gltf::{self, Texture};
use super::{ExportMesh, write_error};
use crate::error::{Error, Result};
use glam::DVec3;
use serde_json::Value;
use std::fmt::Write as _;
use std::io::{Cursor, Write};
use zip::write::SimpleFileOptions;

/// How to write a USDZ.
#[derive(Clone, Debug)]
pub struct UsdzOptions {
    /// A picture of the colours.
    pub texture: Texture,
    /// Metres to a world unit; `None` leaves it to [`gltf::scale`].
    pub scale: Option<f64>,
    /// How the file was made; left out when null.
    pub provenance: Value,
}

const ALIGNMENT: u16 = 64;
const PICTURE: &str = "colours.png";

/// Writes a mesh as USDZ.
///
/// # Errors
/// What [`ExportMesh::check`] refuses; [`Error::Argument`] for a mesh without triangles, or texture coordinates that are not one to
/// a vertex, and for a scale that is none in 32 bits; [`Error::Io`] (path empty) from the stream.
pub fn write(w: &mut (impl Write + ?Sized), mesh: &ExportMesh<'_>, options: &UsdzOptions) -> Result<()> {
    mesh.check()?;
    gltf::check_texture(mesh, Some(&options.texture))?;
    if mesh.is_empty() {
        let remedy = "choose another isovalue, or write .glb, which may be empty";
        return Err(Error::argument("mesh", "no triangles", "a surface to show", remedy));
    }
    let scale = gltf::checked_scale(mesh, options.scale, 1.0)?;
    let longest = scale * (mesh.centre_in_world().abs().max_element() + mesh.box_in_world.size().max_element());
    if !(longest as f32).is_finite() {
        let remedy = "give a smaller --scale";
        return Err(Error::argument("scale", scale, "a size within 3.4e38 metres", remedy));
    }
    let mut archive = zip::ZipWriter::new(Cursor::new(Vec::new()));
    let stored =
        SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored).with_alignment(ALIGNMENT);
    let refused = |e: zip::result::ZipError| match e {
        zip::result::ZipError::Io(source) => write_error(source),
        other => Error::argument("USDZ", other, "a file that zip can hold", "make it smaller"),
    };
    // The scene comes first: it is what a reader opens.
    for (name, bytes) in [("scene.usda", scene(mesh, options, scale).as_bytes()), (PICTURE, &options.texture.png)] {
        archive.start_file(name, stored).map_err(refused)?;
        archive.write_all(bytes).map_err(write_error)?;
    }
    let bytes = archive.finish().map_err(refused)?.into_inner();
    w.write_all(&bytes).map_err(write_error)
}

fn scene(mesh: &ExportMesh<'_>, options: &UsdzOptions, scale: f64) -> String {
    let (centre, turn) = (mesh.centre_in_world(), mesh.up.gltf_from_world());
    let at = |v: usize| turn * (scale * mesh.positions.from_centre(v, centre).as_dvec3());
    let vertices = mesh.positions.len();
    let all = (0..vertices).map(at);
    let (low, high) = all.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)));
    let triple = |p: DVec3| {
        let [x, y, z] = p.as_vec3().to_array();
        format!("({x}, {y}, {z})")
    };
    let each = |item: &dyn Fn(usize) -> String| (0..vertices).map(item).collect::<Vec<_>>().join(", ");
    let points = each(&|v| triple(at(v)));
    let normals = each(&|v| triple(turn * mesh.unit_normal(v).as_dvec3()));
    // From the bottom left.
    let places = each(&|v| {
        let [s, t] = options.texture.coordinates[v];
        format!("({s}, {})", 1.0 - t)
    });
    let counts = vec!["3"; mesh.triangles.len()].join(", ");
    let indices = mesh.triangles.iter().map(|[a, b, c]| format!("{a}, {b}, {c}")).collect::<Vec<_>>().join(", ");
    let DVec3 { x, y, z } = turn * (scale * centre);
    let mut text =
        String::from("#usda 1.0\n(\n    defaultPrim = \"Root\"\n    metersPerUnit = 1\n    upAxis = \"Y\"\n");
    if !options.provenance.is_null() {
        // As a string in a dictionary, which readers keep and do not look into.
        let record = options.provenance.to_string().replace('\\', "\\\\").replace('"', "\\\"");
        let _ = write!(text, "    customLayerData = {{\n        string isolume = \"{record}\"\n    }}\n");
    }
    let _ = write!(
        text,
        r#")

def Xform "Root"
{{
    double3 xformOp:translate = ({x}, {y}, {z})
    uniform token[] xformOpOrder = ["xformOp:translate"]

    def Mesh "Surface" (
        prepend apiSchemas = ["MaterialBindingAPI"]
    )
    {{
        uniform bool doubleSided = 1
        uniform token subdivisionScheme = "none"
        float3[] extent = [{low}, {high}]
        int[] faceVertexCounts = [{counts}]
        int[] faceVertexIndices = [{indices}]
        point3f[] points = [{points}]
        normal3f[] normals = [{normals}] (
            interpolation = "vertex"
        )
        texCoord2f[] primvars:st = [{places}] (
            interpolation = "vertex"
        )
        rel material:binding = </Root/Light>
    }}

    def Material "Light"
    {{
        token outputs:surface.connect = </Root/Light/Surface.outputs:surface>

        def Shader "Surface"
        {{
            uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor = (0, 0, 0)
            color3f inputs:emissiveColor.connect = </Root/Light/Colours.outputs:rgb>
            float inputs:roughness = 1
            color3f inputs:specularColor = (0, 0, 0)
            int inputs:useSpecularWorkflow = 1
            token outputs:surface
        }}

        def Shader "Colours"
        {{
            uniform token info:id = "UsdUVTexture"
            asset inputs:file = @{PICTURE}@
            token inputs:sourceColorSpace = "sRGB"
            float2 inputs:st.connect = </Root/Light/Places.outputs:result>
            token inputs:wrapS = "clamp"
            token inputs:wrapT = "clamp"
            float3 outputs:rgb
        }}

        def Shader "Places"
        {{
            uniform token info:id = "UsdPrimvarReader_float2"
            string inputs:varname = "st"
            float2 outputs:result
        }}
    }}
}}
"#,
        low = triple(low),
        high = triple(high),
    );
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::export::test_mesh::TestMesh;
    use std::io::Read;

    #[test]
    fn both_files_are_stored_as_they_are_at_multiples_of_64() {
        let torus = TestMesh::torus(6);
        let png = vec![7; 1001];
        let texture = Texture { coordinates: vec![[0.25, 0.75]; torus.positions.len()], png: png.clone() };
        let provenance = serde_json::json!({ "volume": "a \"name\"" });
        let options = UsdzOptions { texture, scale: Some(0.5), provenance };
        let mut bytes = Vec::new();
        write(&mut bytes, &torus.mesh(), &options).expect("a sound mesh");
        let mut again = Vec::new();
        write(&mut again, &torus.mesh(), &options).expect("a sound mesh");
        assert_eq!(bytes, again, "nothing of the clock is in it");
        let mut archive = zip::ZipArchive::new(Cursor::new(&bytes)).expect("an archive");
        let mut text = String::new();
        for (number, name) in ["scene.usda", PICTURE].into_iter().enumerate() {
            let mut file = archive.by_index(number).expect("a file");
            assert_eq!((file.name(), file.compression()), (name, zip::CompressionMethod::Stored));
            assert_eq!(file.data_start().expect("a place") % 64, 0);
            if number == 0 {
                file.read_to_string(&mut text).expect("text");
            } else {
                let mut found = Vec::new();
                file.read_to_end(&mut found).expect("bytes");
                assert_eq!(found, png);
            }
        }
        assert_eq!(text.matches("(0.25, 0.25)").count(), torus.positions.len());
        assert!(text.contains(r#"string isolume = "{\"volume\":\"a \\\"name\\\"\"}""#), "{}", &text[..200]);
        let none = ExportMesh { triangles: &[], ..torus.mesh() };
        assert!(
            write(&mut Vec::new(), &none, &options).expect_err("nothing to show").to_string().contains("no triangles")
        );
    }
}
