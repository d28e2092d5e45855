//! Sizes, ratios, conditioning and reproducibility of random grains.

use super::*;
use rand::SeedableRng;

fn grains(seed: u64, count: usize, shape: &GrainShape, size: f64) -> Vec<Polyhedron> {
    let mut rng = Pcg64::seed_from_u64(seed);
    (0..count).map(|_| random_grain(&mut rng, shape, size).unwrap()).collect()
}

fn descending(grain: &Polyhedron) -> [f64; 3] {
    let mut e: [f64; 3] = extent(&grain.vertices).into();
    e.sort_by(|a, b| b.total_cmp(a));
    e
}

/// Opening of the square mesh that the grain passes along its longest axis.
fn passing(grain: &Polyhedron) -> f64 {
    let long = extent(&grain.vertices).imax();
    let width = |c: f64, s: f64| {
        let across = grain.vertices.iter().map(|v| v[(long + 1) % 3] * c + v[(long + 2) % 3] * s);
        across.clone().fold(f64::MIN, f64::max) - across.fold(f64::MAX, f64::min)
    };
    (0..180)
        .map(|k| (k as f64 / 2.0).to_radians().sin_cos())
        .map(|(s, c)| width(c, s).max(width(-s, c)))
        .fold(f64::MAX, f64::min)
}

#[test]
fn volume_ratios_and_vertices_are_as_requested() {
    let shape = GrainShape::default();
    let size = 0.04;
    let mut sums = [0.0; 3];
    let all = grains(11, 300, &shape, size);
    for g in &all {
        let nominal = std::f64::consts::FRAC_PI_6 * size.powi(3);
        assert!((g.volume / nominal - 1.0).abs() < 1e-12);
        assert!((8..=40).contains(&g.vertices.len()));
        let [a, b, c] = descending(g);
        assert!((0.6 - 1e-9..=0.8 + 1e-9).contains(&(b / a)), "{a} {b} {c}");
        assert!((0.6 - 1e-9..=0.8 + 1e-9).contains(&(c / b)), "{a} {b} {c}");
        for (sum, x) in sums.iter_mut().zip([b / a, c / b, g.vertices.len() as f64]) {
            *sum += x / all.len() as f64;
        }
    }
    // Means of uniform distributions, within four standard errors.
    assert!((sums[0] - 0.7).abs() < 0.0135 && (sums[1] - 0.7).abs() < 0.0135, "{sums:?}");
    assert!((sums[2] - 24.0).abs() < 2.2, "{sums:?}");
}

#[test]
fn the_nominal_diameter_lies_between_mesh_opening_and_intermediate_extent() {
    let all = grains(12, 200, &GrainShape::default(), 1.0);
    let mean = |f: &dyn Fn(&Polyhedron) -> f64| all.iter().map(f).sum::<f64>() / 200.0;
    let (mesh, intermediate) = (mean(&passing), mean(&|g| descending(g)[1]));
    assert!(
        (mesh - 0.93).abs() < 0.02 && (intermediate - 1.08).abs() < 0.02,
        "{mesh} {intermediate}"
    );
}

#[test]
fn the_mean_ballast_grain_has_24_cubic_centimetres() {
    let mut rng = Pcg64::seed_from_u64(13);
    let classes = [(0.025, 50), (0.0375, 34), (0.05, 16)];
    let mut sum = 0.0;
    for (size, count) in classes {
        for _ in 0..count {
            sum += random_grain(&mut rng, &GrainShape::default(), size).unwrap().volume;
        }
    }
    assert!((sum / 100.0 - 24e-6).abs() < 0.2e-6, "{sum}");
}

#[test]
fn grains_are_well_conditioned_for_any_angularity() {
    for angularity in [0.0, 1.0] {
        for vertices in [[4, 6], [8, 40], [60, 60]] {
            let shape = GrainShape { angularity, vertices, ..Default::default() };
            for g in grains(14, 20, &shape, 0.03) {
                assert!(is_well_conditioned(&g, 0.03));
                let shortest = g
                    .edges
                    .iter()
                    .map(|e| e.vertices.map(|v| g.vertices[v as usize]))
                    .map(|[a, b]| (a - b).norm())
                    .fold(f64::MAX, f64::min);
                assert!(shortest >= MIN_EDGE_LENGTH * 0.03);
            }
        }
    }
}

#[test]
fn sharp_grains_have_sharper_edges_than_rounded_ones() {
    let sharpness = |angularity: f64| -> f64 {
        let shape = GrainShape { angularity, vertices: [24, 24], ..Default::default() };
        let all = grains(15, 60, &shape, 1.0);
        // Rounded grains fill more of their box: then the box of unit-volume grains is smaller.
        all.iter().map(|g| descending(g).iter().product::<f64>()).sum::<f64>() / 60.0
    };
    assert!(sharpness(1.0) > 1.05 * sharpness(0.0));
}

#[test]
fn a_seed_gives_the_same_bytes() {
    // FNV-1a over the corners. Obtained from the first run; changes with the drawing of grains, with
    // the generator's stream, or with the order of corners in the hull, and then all beds change.
    let mut hash = 0xcbf2_9ce4_8422_2325_u64;
    for g in grains(2024, 40, &GrainShape::default(), 0.0375) {
        for x in g.vertices.iter().flat_map(|v| v.iter()) {
            for byte in x.to_le_bytes() {
                hash = (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
            }
        }
    }
    assert_eq!(hash, 0xce38_2267_9bf5_eb38, "{hash:#x}");
}

#[test]
fn ratios_at_the_limit_are_valid() {
    // As floating-point numbers 0.15 - 0.1 is below 0.05.
    let shape = GrainShape { elongation: [0.15, 0.1], ..GrainShape::default() };
    random_grain(&mut Pcg64::seed_from_u64(1), &shape, 1.0).unwrap();
}

#[test]
fn the_largest_number_of_corners_gives_grains() {
    let shape = GrainShape { vertices: [MAX_CORNERS; 2], ..GrainShape::default() };
    let grain = random_grain(&mut Pcg64::seed_from_u64(1), &shape, 1.0).unwrap();
    assert_eq!(grain.vertices.len(), 100);
}

#[test]
fn impossible_shapes_are_refused() {
    let good = GrainShape::default();
    let cases = [
        (GrainShape { vertices: [3, 9], ..good }, 1.0, "corners"),
        (GrainShape { vertices: [9, 8], ..good }, 1.0, "corners"),
        (GrainShape { vertices: [9, 101], ..good }, 1.0, "4 to 100 corners"),
        (GrainShape { elongation: [0.9, 0.2], ..good }, 1.0, "ratios"),
        (GrainShape { flatness: [f64::NAN, 0.2], ..good }, 1.0, "ratios"),
        (GrainShape { angularity: 1.5, ..good }, 1.0, "angularity"),
        (good, 0.0, "size"),
        (good, f64::INFINITY, "size"),
    ];
    for (shape, size, words) in cases {
        let error = random_grain(&mut Pcg64::seed_from_u64(1), &shape, size).unwrap_err();
        assert!(error.to_string().contains(words), "{error}");
    }
}

#[test]
fn stones_have_their_corners_and_a_nominal_diameter_of_one() {
    let cube = |side: f64| -> Vec<Vec3> {
        (0..8).map(|k| Vec3::from_fn(|i, _| if k >> i & 1 == 0 { 0.0 } else { side })).collect()
    };
    for side in [1e-3, 1.0, 50.0] {
        let stone = stone_with_corners(&cube(side)).unwrap();
        assert_eq!((stone.vertices.len(), stone.face_count()), (8, 6));
        assert!((stone.nominal_diameter() - 1.0).abs() < 1e-12);
    }
    let message = |corners: &[Vec3]| stone_with_corners(corners).unwrap_err().to_string();
    assert!(message(&cube(1.0)[..3]).contains("4 to 100 corners"));
    let with_middle = [cube(1.0), vec![Vec3::repeat(0.5)]].concat();
    assert!(message(&with_middle).contains("1 of 9"), "{}", message(&with_middle));
    let mut blunt = cube(1.0);
    blunt[7] -= Vec3::new(0.0, 0.0, 0.01);
    blunt.push(Vec3::new(1.0, 0.99, 1.0));
    blunt.push(Vec3::new(0.99, 1.0, 1.0));
    assert!(message(&blunt).contains("3 %"), "{}", message(&blunt));
    let flat: Vec<Vec3> = cube(1.0).iter().map(|c| Vec3::new(c.x, c.y, 0.0)).collect();
    stone_with_corners(&flat).unwrap_err();
}
