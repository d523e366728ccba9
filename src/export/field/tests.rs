use super::*;

fn written(field: &RadianceField<'_>, write: impl Fn(&mut Vec<u8>, &RadianceField<'_>) -> Result<()>) -> Vec<u8> {
    let mut bytes = Vec::new();
    write(&mut bytes, field).unwrap();
    bytes
}

#[test]
fn lengths_and_axes_are_checked_and_offsets_fit() {
    let (radiance, provenance) = ([[0.5f32, 2.0, 0.0]; 8], Value::Null);
    let good = RadianceField {
        dims: [2, 2, 2],
        origin: DVec3::new(1.0, 2.0, 3.0),
        steps: DMat3::from_diagonal(DVec3::new(-1.0, 2.0, 3.0)),
        radiance: &radiance,
        valid: &[1, 0, 2, 1, 1, 1, 1, 1],
        values: &[0.25; 8],
        exposure: 0.5,
        provenance: &provenance,
    };
    let vti = written(&good, write_vti);
    let start = vti.windows(2).position(|p| p == b"\n_").unwrap() + 2;
    // `value` comes after 8 + 96 bytes of radiance and 8 + 24 of colour.
    assert_eq!(vti[start + 136..start + 144], 32u64.to_le_bytes());
    assert_eq!(vti[start + 144..start + 148], 0.25f32.to_le_bytes());
    let raw = written(&good, write_raw);
    assert_eq!(bytemuck::pod_collect_to_vec::<u8, f32>(&raw)[..8], [0.5, 2.0, 0.0, 1.0, 0.5, 2.0, 0.0, 0.0]);
    assert!(written(&good, write_nrrd).ends_with(&[radiance[7][2].to_le_bytes()].concat()));
    let sheared = RadianceField { steps: DMat3::from_cols(DVec3::X, DVec3::ONE, DVec3::Z), ..good };
    assert!(write_vti(&mut Vec::new(), &sheared).unwrap_err().to_string().contains(".nrrd"));
    assert!(write_nrrd(&mut Vec::new(), &RadianceField { values: &[0.0; 7], ..good }).is_err());
}
