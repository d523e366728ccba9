//! Nothing gets through a surface, and nothing hits where it starts.

use super::oracle::Twin;
use super::*;
use crate::geom::Frame;

/// What a batch of rays did.
#[derive(Debug, Default)]
struct Tally {
    counts: Counts,
    escaped: u64,
    lost: u64,
    hits: u64,
    self_hits: u64,
}

/// What must hold for the rays of one shape.
struct Rules<'a> {
    /// Isovalues of the starts.
    isovalues: (f32, f32),
    /// Whether a point of the grid may be a start (of a level set that the shape closes).
    starts: &'a dyn Fn(DVec3) -> bool,
    /// Cosine between a direction and the analytic normal at a grid point, from which on the ray
    /// leaves the surface whatever the facets and the quantisation do; `None` where unknown.
    leaves: &'a dyn Fn(DVec3, Vec3) -> bool,
    /// Whether a ray may escape at this point of the border.
    open: &'a dyn Fn(DVec3) -> bool,
}

/// The border point that a ray meets.
fn way_out(dims: [usize; 3], from: DVec3, direction: Vec3) -> DVec3 {
    let d = as_traced(direction).as_dvec3();
    let t = (0..3)
        .filter(|&a| d[a] != 0.0)
        .fold(f64::INFINITY, |t, a| t.min(((if d[a] > 0.0 { (dims[a] - 1) as f64 } else { 0.0 }) - from[a]) / d[a]));
    from + d * t
}

fn trace_all<T: Sample>(field: &LevelField<'_, T>, twin: &Twin, rules: &Rules<'_>, seed: u64, starts: u64) -> Tally {
    let (mut tally, all) = (Tally::default(), directions());
    for item in 0..starts {
        let (mut start, _) = any_start(field, seed, item);
        let c;
        if item % 3 == 0 {
            // A texel, with the rule for its isovalue.
            let p = start.at.in_grid().round().as_dvec3();
            let Some(site) = field.site(p.to_array()) else { continue };
            (start, c) = (site.start, site.isovalue);
        } else {
            start.on_surface = true;
            c = field.raw_value(&start.at);
        }
        if !(rules.isovalues.0..rules.isovalues.1).contains(&c)
            || !(rules.starts)(start.at.cell.as_dvec3() + start.at.local.as_dvec3())
        {
            continue;
        }
        // Six fixed or uniform directions, the last followed through up to six bounces.
        for k in 0..6u64 {
            let pick = item * 6 + k;
            let mut d = if k % 2 == 0 { all[pick as usize * 7 % all.len()] } else { on_sphere(seed, pick) };
            let mut from = start;
            for bounce in 0..7 {
                let at = from.at.cell.as_dvec3() + from.at.local.as_dvec3();
                let hit = match field.trace(c, &from, d, &mut tally.counts) {
                    Outcome::Hit(hit) => hit,
                    Outcome::Lost => {
                        tally.lost += 1;
                        break;
                    }
                    Outcome::Escaped => {
                        tally.escaped += 1;
                        let exit = way_out(field.dims(), at, d);
                        assert!((rules.open)(exit), "leak at {exit}, isovalue {c}, from {from:?} along {d}");
                        // Only the lit side is open; a little more for exits along the surface.
                        let f = f64::from(field.sign()) * (twin.value(exit) - f64::from(c));
                        let range = f64::from(rules.isovalues.1 - rules.isovalues.0);
                        let along = at.distance(exit) == 0.0;
                        assert!(f < 1e-4 * range || along, "out of the solid at {exit}: {f}, from {from:?} along {d}");
                        break;
                    }
                };
                tally.hits += 1;
                let way = (hit.at.cell.as_dvec3() + hit.at.local.as_dvec3()).distance(at);
                if way < 1e-2 && from.on_surface && (rules.leaves)(at, d) {
                    tally.self_hits += 1;
                }
                let Some(normal) = field.normal(&hit.at) else { break };
                if k != 5 || bounce == 6 {
                    break;
                }
                from = Start::on(hit.at);
                let z = uniform(seed, pick, 40 + bounce).sqrt();
                let flat = (1.0 - z * z).sqrt() as f32;
                let (sin, cos) = (std::f32::consts::TAU * uniform(seed, pick, 50 + bounce) as f32).sin_cos();
                d = Frame::around(normal).from_local(Vec3::new(flat * cos, flat * sin, z as f32));
            }
        }
    }
    tally
}

/// Cosine of `d` with the direction from `p` to `centre`.
fn inward(p: DVec3, centre: DVec3, d: Vec3) -> f64 {
    (centre - p).normalize().dot(d.as_dvec3().normalize())
}

#[test]
fn a_closed_sphere_lets_nothing_out() {
    // h = |x|, solid above: for c below the distance of the border (1, or 200 of 8-bit steps) the
    // lit ball is closed. Facets of a sphere of radius r voxels are off by at most about 1/r;
    // steps of 1/10 voxel by another 1/10 in each of three axes.
    let mut rays = 0;
    for (volume, isovalues, margin) in [
        (floating([41; 3], |p| p.length()), (0.25, 0.97), 0.25),
        (bytes([41; 3], |p| 200.0 * p.length()), (50.0, 194.0), 0.5),
        (floating([33; 3], |p| p.length() * 1e30), (0.25e30, 0.97e30), 0.3),
    ] {
        let twin = Twin::new(&volume);
        let centre = DVec3::splat((volume.dims()[0] - 1) as f64 / 2.0);
        with_field!(volume, field => {
            let rules = Rules {
                isovalues,
                starts: &|_| true,
                leaves: &|p, d| inward(p, centre, d) > margin,
                open: &|_| false,
            };
            let tally = trace_all(&field, &twin, &rules, 31, 70_000);
            assert_eq!((tally.escaped, tally.self_hits), (0, 0), "{tally:?}");
            // Half of all directions point into the solid; the bounces do not.
            assert!(tally.lost * 5 > tally.hits && tally.hits > tally.lost, "{tally:?}");
            rays += tally.counts.rays;
        });
    }
    assert!(rays > 350_000, "{rays}");
}

#[test]
fn a_bowl_is_open_at_its_rim_alone() {
    // h = |x| on z ∈ [−1, 0]: for c < 1 every way out leads through the disk |x| ≤ c at z = 0; the
    // rays that run inside the solid to the border are lost.
    let mut rays = 0;
    for (volume, isovalues, margin) in [
        (floating([41, 41, 21], |p| Vec3::new(p.x, p.y, 0.5 * p.z - 0.5).length()), (0.25, 0.97), 0.25),
        (bytes([41, 41, 21], |p| 200.0 * Vec3::new(p.x, p.y, 0.5 * p.z - 0.5).length()), (50.0, 194.0), 0.5),
    ] {
        let twin = Twin::new(&volume);
        let centre = DVec3::splat(20.0);
        with_field!(volume, field => {
            let rules = Rules {
                isovalues,
                starts: &|_| true,
                leaves: &|p, d| inward(p, centre, d) > margin,
                open: &|exit| (exit.z - 20.0).abs() < 1e-4,
            };
            let tally = trace_all(&field, &twin, &rules, 32, 90_000);
            assert_eq!(tally.self_hits, 0, "{tally:?}");
            assert!(tally.escaped > 50_000 && tally.lost > 50_000, "{tally:?}");
            rays += tally.counts.rays;
        });
    }
    assert!(rays > 300_000, "{rays}");
}

#[test]
fn a_sphere_over_a_plane_lets_nothing_through_the_plane() {
    // h = max(R − |x − p|, −z) with the plane a third up the box. For c < 0 the level sets lie
    // above the plane; every way out is above the level z = −c, which the assertion on the sign of
    // f at the exit says, and never through the floor.
    let shape = |p: Vec3| (0.35 - p.distance(Vec3::new(0.0, 0.0, 0.2))).max(-(p.z + 0.4));
    let mut rays = 0;
    for (volume, isovalues) in [
        (floating([37, 41, 35], shape), (-0.2, 0.1)),
        (bytes([37, 41, 35], |p| 150.0 + 150.0 * shape(p)), (120.0, 165.0)),
    ] {
        let twin = Twin::new(&volume);
        with_field!(volume, field => {
            let rules = Rules {
                isovalues,
                // Far from the crease between the two, straight up leaves.
                starts: &|_| true,
                leaves: &|p, d| p.x.min(p.y) < 3.0 && d.z > 0.5,
                open: &|exit| exit.z > 1e-3,
            };
            let tally = trace_all(&field, &twin, &rules, 33, 160_000);
            assert_eq!(tally.self_hits, 0, "{tally:?}");
            assert!(tally.escaped > 30_000 && tally.hits > 10_000, "{tally:?}");
            rays += tally.counts.rays;
        });
    }
    assert!(rays > 300_000, "{rays}");
}

#[test]
fn no_ray_leaves_a_closed_sphere_from_its_inner_side() {
    // Solid outside: h = |x| with solid above. Every texel near the surface, every direction.
    let volume = cube(33, |p| p.length());
    let pyramid = Pyramid::new(&volume);
    let field = LevelField::new(&volume, floats(&volume), &pyramid);
    let mut counts = Counts::default();
    let mut lost = 0;
    for z in 6..27 {
        for y in 6..27 {
            for x in 6..27 {
                let radius = (Vec3::new(x as f32, y as f32, z as f32) - 16.0).length();
                if !(5.0..15.0).contains(&radius) {
                    continue;
                }
                let site = field.site([x as f64, y as f64, z as f64]).unwrap();
                for d in directions() {
                    match field.trace(site.isovalue, &site.start, d, &mut counts) {
                        Outcome::Escaped => panic!("leak at {x},{y},{z} along {d}"),
                        Outcome::Lost => lost += 1,
                        Outcome::Hit(hit) => {
                            let at = (hit.at.in_grid() - 16.0) / 16.0;
                            let c = site.isovalue;
                            assert!((at.length() - c).abs() < 0.02, "{x},{y},{z} {d}: {} for {c}", at.length());
                        }
                    }
                }
            }
        }
    }
    // Directions into the solid are lost, about half of them.
    let share = lost as f64 / counts.rays as f64;
    assert!((0.4..0.6).contains(&share), "{share}");
}

#[test]
fn every_outward_ray_of_a_convex_sphere_escapes() {
    let volume = cube(33, |p| -p.length());
    let pyramid = Pyramid::new(&volume);
    let field = LevelField::new(&volume, floats(&volume), &pyramid);
    let mut counts = Counts::default();
    for z in 4..29 {
        for y in 4..29 {
            for x in 4..29 {
                let radius = (Vec3::new(x as f32, y as f32, z as f32) - 16.0).length();
                if !(5.0..16.0).contains(&radius) {
                    continue;
                }
                let site = field.site([x as f64, y as f64, z as f64]).unwrap();
                for d in directions() {
                    // Clear of the facets of the trilinear sphere.
                    if d.normalize().dot(site.normal.vec()) > 0.15 {
                        let outcome = field.trace(site.isovalue, &site.start, d, &mut counts);
                        assert_eq!(outcome, Outcome::Escaped, "{x},{y},{z} along {d}");
                    }
                }
            }
        }
    }
}
