use super::*;
use crate::geometry::{GrainShape, convex_hull, cuboid, random_grain, random_rotation};
use rand::SeedableRng;
use rand_pcg::Pcg64;

fn assert_close(found: f64, expected: f64) {
    assert!((found - expected).abs() < 1e-9 * expected.max(1.0), "{found} instead of {expected}");
}

fn brick(x: f64, y: f64, z: f64) -> ShapeDescriptors {
    ShapeDescriptors::of(&cuboid(Vec3::new(x, y, z) / 2.0))
}

fn hull(points: &[[f64; 3]]) -> ShapeDescriptors {
    let points: Vec<Vec3> = points.iter().map(|p| Vec3::from(*p)).collect();
    ShapeDescriptors::of(&convex_hull(&points).expect("a solid").0)
}

/// All permutations of signs of the coordinates.
fn with_signs(p: [f64; 3]) -> impl Iterator<Item = [f64; 3]> {
    (0..8).map(move |s| std::array::from_fn(|k| if s >> k & 1 == 0 { p[k] } else { -p[k] }))
}

/// Vertices of the octahedron of edge √2, the icosahedron of edge 2 and the dodecahedron of edge √5 - 1.
fn platonic() -> [Vec<[f64; 3]>; 3] {
    let golden = (1.0 + 5.0_f64.sqrt()) / 2.0;
    let cyclic =
        |p: [f64; 3]| (0..3).flat_map(move |k| with_signs(std::array::from_fn(|i| p[(i + k) % 3])));
    let octahedron = cyclic([1.0, 0.0, 0.0]).collect();
    let icosahedron = cyclic([0.0, 1.0, golden]).collect();
    let dodecahedron = with_signs([1.0; 3]).chain(cyclic([0.0, 1.0 / golden, golden])).collect();
    [octahedron, icosahedron, dodecahedron]
}

#[test]
fn a_cube_is_as_long_as_wide_as_thick() {
    let cube = brick(2.0, 2.0, 2.0);
    for length in [cube.length, cube.width, cube.thickness, cube.sieve_size] {
        assert_close(length, 2.0);
    }
    assert_close(cube.longest_diameter, 12.0_f64.sqrt());
    assert_close(cube.sphericity, (PI / 6.0).cbrt());
    assert_close(cube.angularity, FRAC_PI_2);
    assert_close(cube.length_to_thickness(), 3.0_f64.sqrt());
}

#[test]
fn a_brick_has_its_sides_in_any_order() {
    for (x, y, z) in [(3.0, 2.0, 1.0), (1.0, 3.0, 2.0), (2.0, 1.0, 3.0)] {
        let brick = brick(x, y, z);
        assert_close(brick.length, 3.0);
        assert_close(brick.width, 2.0);
        assert_close(brick.thickness, 1.0);
        assert_close(brick.longest_diameter, 14.0_f64.sqrt());
        assert_close(brick.elongation(), 2.0 / 3.0);
        assert_close(brick.flatness(), 0.5);
        assert_close(brick.sieve_size, 2.0);
        assert_close(brick.sphericity, PI * (36.0 / PI).powf(2.0 / 3.0) / 22.0);
    }
}

#[test]
fn a_plate_passes_a_square_hole_diagonally() {
    let plate = brick(3.0, 2.0, 0.5);
    assert_close(plate.sieve_size, 2.5 / 2.0_f64.sqrt());
    assert!(plate.length_to_thickness() > 3.0);
}

#[test]
fn a_regular_tetrahedron_fits_into_its_cube() {
    // Every second corner of a cube of side 2: its edges are the diagonals of the cube's faces.
    let tetrahedron = hull(&[[1.0; 3], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]]);
    for length in [tetrahedron.length, tetrahedron.width, tetrahedron.thickness] {
        assert_close(length, 2.0);
    }
    assert_close(tetrahedron.longest_diameter, 8.0_f64.sqrt());
    assert_close(tetrahedron.sphericity, (PI / (6.0 * 3.0_f64.sqrt())).cbrt());
    assert_close(tetrahedron.angularity, PI - (1.0_f64 / 3.0).acos());
}

#[test]
fn regular_solids_have_their_known_sphericity_thickness_and_edge_angle() {
    let [octahedron, icosahedron, dodecahedron] = platonic().map(|points| hull(&points));
    let golden = (1.0 + 5.0_f64.sqrt()) / 2.0;
    assert_close(octahedron.thickness, 2.0 / 3.0_f64.sqrt());
    assert_close(octahedron.width, 2.0_f64.sqrt());
    assert_close(octahedron.length, 2.0 * (2.0_f64 / 3.0).sqrt());
    assert_close(octahedron.sphericity, (PI / (3.0 * 3.0_f64.sqrt())).cbrt());
    assert_close(octahedron.angularity, PI - (-1.0_f64 / 3.0).acos());
    // Twice the radius of the inscribed sphere.
    assert_close(icosahedron.thickness, 2.0 * golden * golden / 3.0_f64.sqrt());
    assert_close(icosahedron.angularity, PI - (-(5.0_f64.sqrt()) / 3.0).acos());
    assert!((icosahedron.sphericity - 0.939_326).abs() < 1e-6);
    assert_close(dodecahedron.angularity, PI - (-1.0 / 5.0_f64.sqrt()).acos());
    assert!((dodecahedron.sphericity - 0.910_453).abs() < 1e-6);
}

#[test]
fn descriptors_do_not_depend_on_orientation_and_scale_with_size() {
    let mut rng = Pcg64::seed_from_u64(3);
    for _ in 0..20 {
        let stone = random_grain(&mut rng, &GrainShape::default(), 0.04).expect("a stone");
        let turn = random_rotation(&mut rng);
        let turned: Vec<Vec3> = stone.vertices.iter().map(|v| turn * v * 3.0).collect();
        let (a, b) = (
            ShapeDescriptors::of(&stone),
            ShapeDescriptors::of(&convex_hull(&turned).expect("a stone").0),
        );
        for (found, expected) in [
            (b.length, 3.0 * a.length),
            (b.width, 3.0 * a.width),
            (b.thickness, 3.0 * a.thickness),
            (b.longest_diameter, 3.0 * a.longest_diameter),
            (b.sieve_size, 3.0 * a.sieve_size),
            (b.sphericity, a.sphericity),
            (b.angularity, a.angularity),
        ] {
            assert!((found - expected).abs() < 1e-6 * expected, "{found} instead of {expected}");
        }
        assert!(a.longest_diameter >= a.length && a.length >= a.width && a.width >= a.thickness);
        assert!(a.sieve_size >= a.thickness && a.sieve_size <= 1.001 * a.longest_diameter);
        assert_eq!(ShapeDescriptors::of(&stone.scaled(1.0)), a);
    }
}

#[test]
fn no_direction_gives_less_than_the_thickness() {
    let mut rng = Pcg64::seed_from_u64(8);
    for _ in 0..10 {
        let stone = random_grain(&mut rng, &GrainShape::default(), 1.0).expect("a stone");
        let thickness = ShapeDescriptors::of(&stone).thickness;
        let width = |n: &Vec3| {
            let along = stone.vertices.iter().map(|v| n.dot(v));
            along.clone().fold(f64::MIN, f64::max) - along.fold(f64::MAX, f64::min)
        };
        let least = (0..20_000)
            .map(|_| width(&(random_rotation(&mut rng) * Vec3::x())))
            .fold(f64::INFINITY, f64::min);
        assert!(least >= thickness - 1e-12 && least < 1.03 * thickness, "{least} {thickness}");
    }
}
