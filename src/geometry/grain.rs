//! Random ballast grains.
//!
//! Reads: a random generator and ranges of shape. Writes: a [`Polyhedron`]. Cost: one or two hulls
//! per attempt, about 1 ms per grain.
//! Contract: the same generator state gives the same bytes on every platform (no trigonometric
//! functions); faces and edges are well conditioned for contact detection.

use super::clip::AxisBox;
use super::hull::convex_hull;
use super::polyhedron::Polyhedron;
use crate::error::{Error, Result};
use crate::math::{Quat, Vec3};
use rand::RngExt;
use rand_pcg::Pcg64;

/// Ranges of shape parameters of random grains.
///
/// Axes are the extents along the principal axes, longest, intermediate and shortest: a, b, c.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GrainShape {
    /// Minimum and maximum number of vertices, 4 to 100.
    pub vertices: [u32; 2],
    /// Ratio b / a: mean and half-width of a uniform distribution.
    pub elongation: [f64; 2],
    /// Ratio c / b: mean and half-width of a uniform distribution.
    pub flatness: [f64; 2],
    /// Randomness of vertex directions: 0 for evenly spread (rounded grains) to 1 for random (sharp grains).
    pub angularity: f64,
}

impl Default for GrainShape {
    fn default() -> Self {
        Self { vertices: [8, 40], elongation: [0.7, 0.1], flatness: [0.7, 0.1], angularity: 0.5 }
    }
}

/// Minimum angle between two vertices seen from the centre, in units of the mean spacing √(4π/n).
const MIN_SEPARATION: f64 = 0.4;
/// Weight of random directions at angularity 0.
const DISORDER: f64 = 0.15;
/// Minimum length of an edge, in grain sizes.
const MIN_EDGE_LENGTH: f64 = 0.03;
/// Minimum width of a face, in grain sizes.
const MIN_FACE_WIDTH: f64 = 0.02;
/// Minimum angle between two faces at an edge, rad; below it the edge's normal cone is ill-defined.
const MIN_EDGE_ANGLE: f64 = 0.01;
/// Maximum number of attempts at a grain; typical shapes need a few.
const MAX_ATTEMPTS: usize = 2000;
/// Maximum number of vertices; with 120 no attempt meets the limits on edges and faces.
const MAX_CORNERS: u32 = 100;
/// Tolerance for rounding of ratios that are sums of decimal numbers.
const SLACK: f64 = 1e-9;

/// Returns a random grain of nominal diameter `size` (m): that of the sphere of equal volume.
///
/// Vertices are drawn on an ellipsoid; their hull is then stretched along its own principal axes, so that its extents
/// have exactly the drawn ratios. With the default shape the opening of the square mesh that a grain just passes is
/// 0.93 `size` on average and its intermediate extent 1.08 `size`, so the nominal diameter represents a sieve size
/// without favouring rounded or sharp grains.
///
/// # Errors
/// [`Error::Geometry`] for ranges that allow no grain: ratios outside 0.05 to 1, numbers of vertices outside 4 to
/// 100, sizes that are not positive, or shapes that are degenerate in all attempts.
pub fn random_grain(rng: &mut Pcg64, shape: &GrainShape, size: f64) -> Result<Polyhedron> {
    check(shape, size)?;
    // Drawn once: a new draw after a rejection would favour few vertices.
    let corners = rng.random_range(shape.vertices[0]..=shape.vertices[1]) as usize;
    let ratios = [around(rng, shape.elongation), around(rng, shape.flatness)];
    for _ in 0..MAX_ATTEMPTS {
        let directions = directions(rng, corners, shape.angularity);
        let Some(points) = nominal(&directions, ratios, size) else { continue };
        let Ok((grain, _)) = convex_hull(&points) else { continue };
        if grain.vertices.len() == corners && is_well_conditioned(&grain, size) {
            return Ok(grain);
        }
    }
    Err(Error::Geometry {
        expected: "ranges of shape that give well conditioned grains",
        found: format!("{MAX_ATTEMPTS} degenerate grains of {corners} corners for {shape:?}"),
    })
}

/// Returns the convex stone with the given corners, in any unit of length, with a nominal diameter of 1.
///
/// # Errors
/// [`Error::Geometry`] for fewer than 4 or more than 100 corners, corners that are no corners of their convex hull, flat
/// stones, and edges or faces that are too narrow for contact detection.
pub fn stone_with_corners(corners: &[Vec3]) -> Result<Polyhedron> {
    let bad = |expected, found: String| Err(Error::Geometry { expected, found });
    if !(4..=MAX_CORNERS as usize).contains(&corners.len()) {
        return bad("4 to 100 corners", corners.len().to_string());
    }
    let (hull, _) = convex_hull(corners)?;
    if hull.vertices.len() != corners.len() {
        let inside = corners.len() - hull.vertices.len();
        return bad(
            "corners of a convex stone, each of them once",
            format!("{inside} of {} that are none of its convex hull", corners.len()),
        );
    }
    let stone = hull.scaled(1.0 / hull.nominal_diameter());
    if !is_well_conditioned(&stone, 1.0) {
        return bad(
            "edges of 3 % and faces of 2 % of the nominal diameter or more, no two faces nearly in one plane",
            format!("a stone of {} corners with shorter or narrower ones", corners.len()),
        );
    }
    Ok(stone)
}

/// Returns vertices along `directions` from the centre of an ellipsoid, with exact ratios of extents and volume.
fn nominal(directions: &[Vec3], [elongation, flatness]: [f64; 2], size: f64) -> Option<Vec<Vec3>> {
    let extents = [1.0 / elongation, 1.0, flatness];
    let ellipsoid: Vec<Vec3> =
        directions.iter().map(|d| d.component_mul(&Vec3::from(extents))).collect();
    let (rough, _) = convex_hull(&ellipsoid).ok()?;
    let factors = stretch(&rough.vertices, extents);
    let volume = rough.volume * factors.product();
    let scale = size * cube_root(std::f64::consts::FRAC_PI_6 / volume);
    Some(rough.vertices.iter().map(|v| v.component_mul(&factors) * scale).collect())
}

fn check(shape: &GrainShape, size: f64) -> Result<()> {
    let bad = |expected, found: String| Err(Error::Geometry { expected, found });
    let [least, most] = shape.vertices;
    if least < 4 || most > MAX_CORNERS || least > most {
        return bad("a range of 4 to 100 corners", format!("{least} to {most}"));
    }
    for [mean, half_width] in [shape.elongation, shape.flatness] {
        let (low, high) = (mean - half_width, mean + half_width);
        if !(low >= 0.05 - SLACK && high <= 1.0 + SLACK && half_width >= 0.0) {
            return bad("ratios of extents from 0.05 to 1", format!("{mean} ± {half_width}"));
        }
    }
    if !(0.0..=1.0).contains(&shape.angularity) {
        return bad("an angularity from 0 to 1", shape.angularity.to_string());
    }
    if !(size > 0.0 && size.is_finite()) {
        return bad("a positive grain size", format!("{size} m"));
    }
    Ok(())
}

/// Returns the cube root by Newton's method; that of libraries may differ between platforms in the last digit.
fn cube_root(x: f64) -> f64 {
    (0..50).fold(1.0, |y, _| (2.0 * y + x / (y * y)) / 3.0)
}

/// Draws uniformly from mean ± half-width.
fn around(rng: &mut Pcg64, [mean, half_width]: [f64; 2]) -> f64 {
    mean + half_width * rng.random_range(-1.0..=1.0)
}

/// Returns unit vectors between an even spiral (randomly rotated) and independent ones.
///
/// At angularity 0 some disorder remains: for some counts the spiral alone has four neighbours in one plane.
fn directions(rng: &mut Pcg64, count: usize, angularity: f64) -> Vec<Vec3> {
    // Cosine and sine of the golden angle, π (3 − √5).
    const COS: f64 = -0.737_368_878_078_319_7;
    const SIN: f64 = 0.675_490_294_261_523_8;
    let turn = random_rotation(rng);
    let (mut x, mut y) = (1.0, 0.0);
    let disorder = DISORDER + (1.0 - DISORDER) * angularity;
    let apart = MIN_SEPARATION * (4.0 * std::f64::consts::PI / count as f64).sqrt();
    let mut found: Vec<Vec3> = Vec::with_capacity(count);
    for k in 0..count {
        let z = 1.0 - (2 * k + 1) as f64 / count as f64;
        let r = (1.0 - z * z).sqrt();
        let even = turn * Vec3::new(r * x, r * y, z);
        (x, y) = (x * COS - y * SIN, x * SIN + y * COS);
        let mut draw = || {
            let mixed = even * (1.0 - disorder) + random_direction(rng) * disorder;
            mixed.try_normalize(1e-3).unwrap_or(even)
        };
        let mut direction = draw();
        // The check of the whole grain handles a crowded region.
        for _ in 0..30 {
            if found.iter().all(|d| (d - direction).norm() >= apart) {
                break;
            }
            direction = draw();
        }
        found.push(direction);
    }
    found
}

/// Draws a direction uniformly on the sphere, by rejection.
fn random_direction(rng: &mut Pcg64) -> Vec3 {
    loop {
        let v = Vec3::from_fn(|_, _| rng.random_range(-1.0..=1.0));
        let squared = v.norm_squared();
        if (1e-4..=1.0).contains(&squared) {
            return v / squared.sqrt();
        }
    }
}

/// Draws a rotation uniformly from all rotations, by rejection.
pub fn random_rotation(rng: &mut Pcg64) -> Quat {
    loop {
        let q = nalgebra::Vector4::from_fn(|_, _| rng.random_range(-1.0..=1.0));
        if (1e-4..=1.0).contains(&q.norm_squared()) {
            return Quat::new_normalize(nalgebra::Quaternion::new(q.w, q.x, q.y, q.z));
        }
    }
}

/// Returns the factor along each principal axis that makes the extents, in their order, `extents` (descending).
///
/// Stretching along principal axes keeps them principal.
fn stretch(points: &[Vec3], extents: [f64; 3]) -> Vec3 {
    let found = extent(points);
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| found[b].total_cmp(&found[a]));
    let mut factors = Vec3::zeros();
    for (rank, &axis) in order.iter().enumerate() {
        factors[axis] = extents[rank] / found[axis];
    }
    factors
}

/// Returns the extents along the axes, m.
fn extent(points: &[Vec3]) -> Vec3 {
    let AxisBox { low, high } = AxisBox::around(points.iter().copied());
    high - low
}

/// True if edges are long, faces wide and angles between faces distinct.
fn is_well_conditioned(grain: &Polyhedron, size: f64) -> bool {
    let corner = |v: u16| grain.vertices[v as usize];
    let edges = grain.edges.iter().all(|e| {
        let [f, g] = e.faces.map(|f| grain.face_normals[f as usize]);
        // |f × g| is the sine of the angle; a sharp edge has f · g < 0.
        let distinct = f.dot(&g) < 0.0 || f.cross(&g).norm() >= MIN_EDGE_ANGLE;
        let long = (corner(e.vertices[0]) - corner(e.vertices[1])).norm() >= MIN_EDGE_LENGTH * size;
        distinct && long
    });
    edges && (0..grain.face_count()).all(|f| face_width(grain, f) >= MIN_FACE_WIDTH * size)
}

/// Returns the minimum distance between an edge of a face and the parallel line through its farthest vertex, m.
fn face_width(grain: &Polyhedron, f: usize) -> f64 {
    let face = grain.face(f);
    let corner = |k: usize| grain.vertices[face[k % face.len()] as usize];
    (0..face.len())
        .map(|k| {
            let along = (corner(k + 1) - corner(k)).normalize();
            let inward = grain.face_normals[f].cross(&along);
            (0..face.len()).map(|j| inward.dot(&(corner(j) - corner(k)))).fold(0.0, f64::max)
        })
        .fold(f64::MAX, f64::min)
}

#[cfg(test)]
#[path = "grain_tests.rs"]
mod tests;
