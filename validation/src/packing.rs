//! Random packings of the five Platonic solids.

use super::check::{CheckFinding, ValidationCheck};
use super::samples_progress::map_parallel;
use super::suite_size::SuiteSize;
use super::world::{D, GRAVITY, World, in_box, random, stack_loosely};
use ballast::geometry::{Polyhedron, convex_hull};
use ballast::math::Vec3;
use ballast::model::PenetrationCorrection;
use ballast::observe::{self, Zone};
use ballast_report::plot::{Chart, SeriesStyle};
use ballast_session::{Reporter, Result};

/// Friction of plastic on plastic, in the middle of tabulated values (0.4 to 0.7); unknown for the experiment.
const FRICTION: f64 = 0.5;
/// Radius of the fillets of edges and corners over d: 1.2 mm on dice of 15 mm. Unknown for the experiment; chosen, with the
/// friction, in view of the figures of tetrahedra and cubes.
const FILLET: f64 = 0.08;
/// Speed at which dice sink in the liquid, over √(g d) with the effective gravity.
const SINKING_SPEED: f64 = 0.2;
/// Solid fraction of the fluidised bed from which the dice sink.
const FLUIDISED_FRACTION: f64 = 0.3;
/// Name and published solid fraction of loose packings.
const PLATONIC_SOLIDS: [(&str, f64); 5] = [
    ("tetrahedra", 0.51),
    ("cubes", 0.54),
    ("octahedra", 0.52),
    ("dodecahedra", 0.51),
    ("icosahedra", 0.50),
];

/// Known deviations of the solid fraction beyond its tolerance, full and quick; 0: none.
const MAX_DEVIATIONS: [[f64; 2]; 5] =
    [[0.0, 0.045], [0.0, 0.0], [0.015, 0.0], [0.02, 0.015], [0.04, 0.045]];
/// Reason of the known deviations.
const DEVIATION: &str = "Friction, edge radii and the influence of walls are unknown for the published dice; no pair of \
                         friction and fillet meets all five solids.";

/// Tolerance of the solid fraction.
const TOLERANCE: f64 = 0.02;

/// Size and measured region of a packing; lengths in d.
struct PackingSample {
    count: usize,
    /// Width of the box.
    width: f64,
    /// Distance of the measured region from walls and floor.
    margin: f64,
    seeds: u64,
    max_iterations: u32,
    tolerance: f64,
}

/// Solid fractions of a packing.
#[derive(Clone, Copy)]
struct PackingDensity {
    /// Solid fraction away from walls, floor and surface.
    middle: f64,
    /// Solid fraction from wall to wall, above the floor.
    whole: f64,
    /// Mean overlap over d.
    overlap: f64,
}

/// Measures the solid fraction of dice that sink from a fluidised bed in a box, away from walls, floor and surface.
pub fn packing(size: &SuiteSize, console: &dyn Reporter) -> Result<ValidationCheck> {
    let sample = if size.quick {
        PackingSample {
            count: 250,
            width: 6.0,
            margin: 1.5,
            seeds: 1,
            max_iterations: 60,
            tolerance: 1e-3,
        }
    } else {
        PackingSample {
            count: 1000,
            width: 10.0,
            margin: 2.0,
            seeds: 3,
            max_iterations: 100,
            tolerance: 1e-4,
        }
    };
    let mut check = describe(&sample);
    let filleted =
        (0..PLATONIC_SOLIDS.len()).flat_map(|k| (0..sample.seeds).map(move |s| (k, s, FILLET)));
    let sharp = (0..PLATONIC_SOLIDS.len()).map(|k| (k, 0, 0.0)).filter(|_| !size.quick);
    let wanted: Vec<_> = filleted.chain(sharp).collect();
    let packed = map_parallel("packings", &wanted, console, |&(number, seed, fillet)| {
        pack(number, fillet, seed, &sample)
    })?;
    let (filleted, sharp) = packed.split_at(PLATONIC_SOLIDS.len() * sample.seeds as usize);
    let all: Vec<&[PackingDensity]> = filleted.chunks(sample.seeds as usize).collect();
    let mut measured = Vec::new();
    let mut published = Vec::new();
    for (k, ((name, expected), found)) in PLATONIC_SOLIDS.iter().zip(&all).enumerate() {
        let middle = mean(found, |p| p.middle);
        let name = format!("solid fraction of {name}");
        let found = CheckFinding::near(name, middle, *expected, TOLERANCE);
        let largest = MAX_DEVIATIONS[k][usize::from(size.quick)];
        check.findings.push(if largest > 0.0 {
            found.with_known_deviation(largest, DEVIATION)
        } else {
            found
        });
        // Offset, so that the marks do not overlap.
        measured.push([k as f64 - 0.06, middle]);
        published.push([k as f64 + 0.06, *expected, TOLERANCE]);
    }
    for ((name, _), found) in PLATONIC_SOLIDS.iter().zip(&all) {
        let name = format!("{name}, walls and floor included");
        check.findings.push(CheckFinding::informational(name, mean(found, |p| p.whole), "less"));
    }
    if !size.quick {
        for ((name, expected), found) in PLATONIC_SOLIDS.iter().zip(sharp) {
            let name = format!("{name}, sharp, one seed");
            check.findings.push(CheckFinding::informational(
                name,
                found.middle,
                format!("{expected}"),
            ));
        }
        let spread = all.iter().map(|found| spread(found)).fold(0.0, f64::max);
        check.findings.push(CheckFinding::informational("range over the seeds", spread, "scatter"));
    }
    let overlap = all.iter().map(|found| mean(found, |p| p.overlap)).fold(0.0, f64::max);
    check.findings.push(CheckFinding::informational(
        "mean overlap over d",
        overlap,
        "far below 0.01",
    ));
    let names = PLATONIC_SOLIDS.map(|(name, _)| name);
    let chart = Chart::with_names("Loose packings of dice", "solid fraction", names)
        .with("measured", measured, SeriesStyle::Dots)
        .with_error_bars(&format!("published, ± {TOLERANCE}"), &published);
    check.charts.push(chart.svg());
    Ok(check)
}

/// Creates the check with its description.
fn describe(sample: &PackingSample) -> ValidationCheck {
    let PackingSample { count, width, margin, seeds, .. } = sample;
    let of = if *seeds == 1 { "one seed".to_string() } else { format!("mean of {seeds} seeds") };
    let mut check = ValidationCheck::new(
        "random packings of Platonic solids",
        format!(
            "{count} dice each in a box {width} d wide, in random orientation, sink from a fluidised bed of solid fraction \
             {FLUIDISED_FRACTION} at {SINKING_SPEED} √(g d) with the liquid's drag on them until they rest; μ = {FRICTION}; edges \
             and corners have fillets of {FILLET} d; measured at least {margin} d from walls and floor, and 2 d below \
             the uppermost die; {of}."
        ),
        "Baker & Kudrolli 2010, Phys. Rev. E 82, 061304: loose packings of fluidised dice",
    );
    check.remark = format!(
        "Friction and fillet of the dice in the experiment are not published. They are chosen as {FRICTION} and {FILLET} d, \
         plausible for moulded plastic, in view of two of the five figures, those of tetrahedra and cubes; the \
         other three are predictions. Walls are assumed to have no influence. Less friction makes all solids denser, \
         sharp edges and walls make all of them looser, each by as much as the tolerance or more."
    );
    check
}

fn mean(found: &[PackingDensity], of: impl Fn(&PackingDensity) -> f64) -> f64 {
    found.iter().map(of).sum::<f64>() / found.len() as f64
}

/// Returns the largest minus the smallest fraction.
fn spread(found: &[PackingDensity]) -> f64 {
    let (low, high) = (found.iter().map(|p| p.middle))
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), f| (low.min(f), high.max(f)));
    high - low
}

/// Returns a Platonic solid of nominal diameter [`D`].
fn solid(number: usize) -> Result<Polyhedron> {
    let golden = 0.5 * (1.0 + 5f64.sqrt());
    let signs = [-1.0, 1.0];
    let mut points: Vec<Vec3> = vec![];
    let cube: Vec<Vec3> = (signs.iter())
        .flat_map(|x| signs.iter().flat_map(move |y| signs.map(|z| Vec3::new(*x, *y, z))))
        .collect();
    // The three cyclic permutations of (0, ±a, ±b).
    let rectangles = |a: f64, b: f64| -> Vec<Vec3> {
        let corners = signs.iter().flat_map(move |s| signs.map(|t| [0.0, s * a, t * b]));
        corners
            .flat_map(|c| [0, 1, 2].map(|k| Vec3::new(c[k], c[(k + 1) % 3], c[(k + 2) % 3])))
            .collect()
    };
    match number {
        0 => points.extend(cube.iter().filter(|c| c.product() > 0.0)),
        1 => points = cube,
        2 => points.extend((0..3).flat_map(|k| signs.map(|s| Vec3::ith(k, s)))),
        3 => {
            points = cube;
            points.extend(rectangles(1.0 / golden, golden));
        }
        _ => points = rectangles(1.0, golden),
    }
    die(&points)
}

/// Returns the hull of points, scaled to the nominal diameter [`D`].
fn die(points: &[Vec3]) -> Result<Polyhedron> {
    let (rough, _) = convex_hull(points)?;
    let scale = D / rough.nominal_diameter();
    let points: Vec<Vec3> = points.iter().map(|p| p * scale).collect();
    Ok(convex_hull(&points)?.0)
}

/// Returns the solid with fillets of a radius (m) at edges and corners, of equal volume. A fillet is a plane cut between the
/// lines at which the adjacent faces begin to curve.
fn filleted(sharp: &Polyhedron, radius: f64) -> Result<Polyhedron> {
    let mut points = vec![];
    let faces = sharp.face_normals.iter().zip(&sharp.face_offsets);
    for ((normal, inradius), range) in faces.zip(sharp.face_starts.windows(2)) {
        // A filleted solid is a smaller one, by the radius at each face, plus a ball of this radius around its points.
        // The flat part of a face is the face of the smaller solid.
        let middle = normal * *inradius;
        let left = 1.0 - radius / inradius;
        let corners = &sharp.face_vertices[range[0] as usize..range[1] as usize];
        let corner = |v: &u16| middle + (sharp.vertices[usize::from(*v)] - middle) * left;
        points.extend(corners.iter().map(corner));
    }
    die(&points)
}

/// Packs one of the solids, with fillets of a radius over d.
fn pack(number: usize, fillet: f64, seed: u64, sample: &PackingSample) -> Result<PackingDensity> {
    let sharp = solid(number)?;
    let die = if fillet > 0.0 { filleted(&sharp, fillet * D)? } else { sharp };
    let (count, edge) = (sample.count, sample.width * D);
    let mut world = World::new(4_000_000, FRICTION, 0.05 * D).pouring(sample.max_iterations);
    world.model.solver.tolerance = Some(sample.tolerance);
    // Overlaps would increase the solid fraction.
    let correction = PenetrationCorrection { factor: 0.2, slop: 5e-4 * D, iterations: 20 };
    world.model.solver.penetration_correction = Some(correction);
    let shape = world.shape(die);
    stack_loosely(
        &mut world,
        &mut random(10 * seed + number as u64),
        &[shape],
        count,
        1,
        in_box([edge; 2]),
    );
    world.container([edge; 2], FRICTION, FRICTION);
    world.suspend(edge * edge, FLUIDISED_FRACTION)?;
    world.sink(SINKING_SPEED * (GRAVITY * D).sqrt())?;
    let top = world.top();
    let fraction = |margin: f64, floor: f64| -> Result<f64> {
        let high = Vec3::new(edge - margin, edge - margin, top - 2.0 * D);
        let zone = Zone::new("middle", Vec3::new(margin, margin, floor), high)?;
        Ok(observe::compactness(&world.model, &world.state, &zone)?.compactness)
    };
    let margin = sample.margin * D;
    let overlap = observe::penetration(&world.model, &world.workspace).mean;
    Ok(PackingDensity { middle: fraction(margin, margin)?, whole: fraction(0.0, 0.0)?, overlap })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn solids_are_platonic() {
        for (number, (corners, faces)) in
            [(4, 4), (8, 6), (6, 8), (20, 12), (12, 20)].iter().enumerate()
        {
            let die = solid(number).unwrap();
            assert_eq!((die.vertices.len(), die.face_count()), (*corners, *faces), "{number}");
            assert!((die.nominal_diameter() - D).abs() < 1e-12);
            let [low, high] = [die.unit_inertia.min(), die.unit_inertia.max()];
            assert!(high - low < 1e-9 * high);
        }
    }

    #[test]
    fn fillets_cut_all_edges_and_corners_and_keep_the_volume() {
        // Faces, edges and corners of the sharp solid are faces of the filleted one.
        for (number, (corners, faces)) in
            [(12, 14), (24, 26), (24, 26), (60, 62), (60, 62)].iter().enumerate()
        {
            let sharp = solid(number).unwrap();
            let die = filleted(&sharp, FILLET * D).unwrap();
            assert_eq!((die.vertices.len(), die.face_count()), (*corners, *faces), "{number}");
            assert!((die.nominal_diameter() - D).abs() < 1e-12);
            assert!(die.radius < sharp.radius);
        }
    }

    #[test]
    fn fillet_starts_at_its_radius_over_the_tangent_of_half_the_angle() {
        // On a cube, whose half angle is 45°, this is the radius itself: 1 of 8 leaves faces 6 wide.
        let cube = solid(1).unwrap();
        let edge = 2.0 * cube.face_offsets[0];
        let cut = filleted(&cube, edge / 8.0).unwrap();
        let [out, inner] = [0, 1].map(|k| {
            let mut sizes = cut.vertices[0].abs();
            sizes.as_mut_slice().sort_by(|a, b| b.total_cmp(a));
            sizes[k]
        });
        assert!((inner / out - 0.75).abs() < 1e-12);
    }
}
