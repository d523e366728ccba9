//! What is unusual about the level sets that a bake for one isovalue would start from: texels that
//! have none, and texels whose own was moved.

use super::{LevelField, Pyramid};
use crate::finding::Finding;
use crate::grid3;
use crate::volume::{Sample, Volume, with_samples};

/// Share of clamped texels above which the data is worth a word.
pub const MANY_CLAMPED: f64 = 0.25;

/// What is unusual about the texels that the isosurface of `isovalue` (in the file's values) needs,
/// on the lattice of the data: those at the corners of the cells it crosses. Nothing for a grid
/// without cells and for an isovalue that crosses none.
///
/// | topic | what is counted |
/// |---|---|
/// | `invalid texels` | texels without a level set: no gradient |
/// | `clamped texels` | texels whose isovalue is moved away from a local extreme |
pub fn diagnose(volume: &Volume, isovalue: f64) -> Vec<Finding> {
    if volume.dims().iter().any(|&d| d < 2) || !isovalue.is_finite() {
        return Vec::new();
    }
    let pyramid = Pyramid::new(volume);
    let Census { texels, invalid, clamped } = with_samples!(volume.samples(), s => {
        census(&LevelField::new(volume, s, &pyramid), s, volume.raw_from_value(isovalue))
    });
    let mut found = Vec::new();
    if invalid > 0 {
        found.push(Finding::new(
            "invalid texels",
            (invalid, texels, "texels"),
            "texels at this surface where the neighbourhood is flat: no gradient, no normal",
            "they are stored as invalid and never guessed: a lookup gives their weights to the valid ones of the eight \
             around it, then to those of the surrounding 4³, and relight counts such lookups",
        ));
    }
    if clamped as f64 > MANY_CLAMPED * texels as f64 {
        found.push(Finding::new(
            "clamped texels",
            (clamped, texels, "texels"),
            "texels at this surface near the end of the range of their 3³ neighbours: edges as sharp as the voxels, or \
             noise",
            "their own level sets would be specks, so they are baked for an isovalue clamped to the inner 60 % of that \
             range. Smoothing the volume first, or --texture 2, brings texels nearer to the surface",
        ));
    }
    found
}

#[derive(Default)]
struct Census {
    texels: u64,
    invalid: u64,
    clamped: u64,
}

fn census<T: Sample>(field: &LevelField<'_, T>, samples: &[T], c_raw: f64) -> Census {
    let [nx, ny, nz] = field.dims();
    let sign = f64::from(field.sign());
    let solid = |i: usize| sign * (f64::from(samples[i].raw()) - c_raw) > 0.0;
    let rows = [0, nx, nx * ny, nx * ny + nx];
    let mut needed = vec![false; samples.len()];
    for z in 0..nz - 1 {
        for y in 0..ny - 1 {
            let row = nx * (y + ny * z);
            let face = |x: usize| rows.iter().filter(|&o| solid(row + x + o)).count();
            let mut before = face(0);
            for x in 1..nx {
                let after = face(x);
                if !matches!(before + after, 0 | 8) {
                    rows.iter().for_each(|o| needed[row + x - 1 + o] = true);
                    rows.iter().for_each(|o| needed[row + x + o] = true);
                }
                before = after;
            }
        }
    }
    let mut census = Census::default();
    for (i, _) in needed.iter().enumerate().filter(|(_, n)| **n) {
        census.texels += 1;
        match field.site(grid3::at([nx, ny], i).map(|v| v as f64)) {
            None => census.invalid += 1,
            Some(site) => census.clamped += u64::from(site.clamped),
        }
    }
    census
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::Affine;
    use crate::volume::Samples;

    fn volume(dims: [usize; 3], value: impl Fn([usize; 3]) -> u8) -> Volume {
        let [nx, ny, nz] = dims;
        let samples = (0..nx * ny * nz).map(|i| value(grid3::at([nx, ny], i))).collect();
        Volume::new(dims, Samples::U8(samples), Affine::IDENTITY).unwrap()
    }

    #[test]
    fn a_ramp_has_nothing_unusual() {
        assert_eq!(diagnose(&volume([8, 8, 8], |[x, _, _]| 20 * x as u8), 50.0), []);
        assert_eq!(diagnose(&volume([8, 1, 8], |[x, _, _]| 20 * x as u8), 50.0), []);
    }

    #[test]
    fn a_saddle_point_without_gradient_is_counted() {
        // |x − 3| + … is symmetric about the sample (3, 3, 3): its gradient vanishes by symmetry, and the
        // isovalue 1 crosses all cells around it. By the same symmetry no other of its corners is flat.
        let v = volume([7, 7, 7], |p| 10 * p.map(|i| i.abs_diff(3)).iter().sum::<usize>() as u8);
        let found = diagnose(&v, 5.0);
        let invalid = found.iter().find(|f| f.topic == "invalid texels").unwrap();
        assert_eq!((invalid.count, invalid.of, invalid.unit), (1, 27, "texels"));
    }

    #[test]
    fn a_checkerboard_is_all_extremes() {
        let v = volume([6, 6, 6], |p| 200 * (p.iter().sum::<usize>() % 2) as u8);
        let found = diagnose(&v, 100.0);
        // Every texel is a local extreme: it has no gradient, or a clamped isovalue.
        let count = |topic| found.iter().find(|f| f.topic == topic).map_or(0, |f| f.count);
        assert_eq!(count("invalid texels") + count("clamped texels"), 216, "{found:?}");
    }
}
