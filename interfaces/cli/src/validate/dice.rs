//! Random packings of the five Platonic solids.

use super::check::{Check, Finding};
use super::size::Size;
use super::world::{D, FALL, World, hang, random};
use crate::plot::{Chart, Mark};
use ballast::geometry::{Polyhedron, convex_hull};
use ballast::math::Vec3;
use ballast::observe::{self, Zone};

/// Friction of plastic dice.
const FRICTION: f64 = 0.4;
/// Name and published solid fraction of loose packings.
const SOLIDS: [(&str, f64); 5] = [
    ("tetrahedra", 0.51),
    ("cubes", 0.54),
    ("octahedra", 0.52),
    ("dodecahedra", 0.51),
    ("icosahedra", 0.50),
];

/// Dice settle slowly in a box; the solid fraction is that of the middle, away from walls, floor and surface.
pub fn dice(size: &Size) -> ballast::Result<Check> {
    let (count, across) = if size.quick { (150, 5.0) } else { (1200, 9.0) };
    let mut check = Check::new(
        "Platonic dice",
        format!(
            "{count} dice each in a box {across} d wide, turned at random, settling no faster than {FALL} m/s, μ = \
             {FRICTION}; measured at least 1.2 d from walls and floor, and 2 d below the uppermost die."
        ),
        "Baker & Kudrolli 2010, Phys. Rev. E 82, 061304: loose packings",
    );
    let mut points = Vec::new();
    for (k, (name, expected)) in SOLIDS.iter().enumerate() {
        let found = solid_fraction(&solid(k)?, count, across * D, k as u64)?;
        let near = Finding::near(format!("solid fraction of {name}"), found, *expected, 0.02);
        check.findings.push(near);
        points.push([[(k + 1) as f64, found], [(k + 1) as f64, *expected]]);
    }
    let column = |c: usize| points.iter().map(|p| p[c]).collect();
    let chart =
        Chart::new("Loose packings of dice", "solid, in the order of the table", "solid fraction")
            .with("measured", column(0), Mark::Points)
            .with("published", column(1), Mark::Expected);
    check.charts.push(chart.svg());
    check.remark = "Friction and the way of pouring are assumed here and may not be those of the experiment; in a small \
                    box few dice are away from the walls, and the order that walls impose reaches far."
        .into();
    Ok(check)
}

/// The solid of nominal diameter [`D`].
fn solid(number: usize) -> ballast::Result<Polyhedron> {
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
    let (rough, _) = convex_hull(&points)?;
    let scale = D / rough.nominal_diameter();
    let points: Vec<Vec3> = points.iter().map(|p| p * scale).collect();
    Ok(convex_hull(&points)?.0)
}

fn solid_fraction(die: &Polyhedron, count: usize, edge: f64, seed: u64) -> ballast::Result<f64> {
    let mut world = World::new(2_000_000, FRICTION, 0.05 * D).pouring(60);
    let shape = world.shape(die.clone());
    hang(&mut world, &mut random(seed), &[shape], count, [edge; 2], |_, _| true);
    world.container([edge; 2], FRICTION, FRICTION);
    world.settle(FALL, 1e-3)?;
    let top = world.state.position[..count].iter().map(|p| p.z).fold(0.0, f64::max);
    let margin = 1.2 * D;
    let low = Vec3::repeat(margin);
    let high = Vec3::new(edge - margin, edge - margin, top - 2.0 * D);
    let zone = Zone::new("middle", low, high)?;
    Ok(observe::compactness(&world.model, &world.state, &zone)?.compactness)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_solids_are_platonic() {
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
}
