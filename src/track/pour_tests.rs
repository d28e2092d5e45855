use super::*;
use crate::geometry::{Clipper, GrainShape, half_spaces_of};
use crate::track::plan::{
    FrictionPlan, GrainPlan, PreparationPlan, StiffnessPlan, classes_of_grading,
};
use rand::SeedableRng;

fn bed(size: Vec3) -> BedPlan {
    BedPlan {
        size,
        seed: 3,
        density: 2700.0,
        grains: GrainPlan {
            classes: vec![
                SizeClass::of_size(0.025, 0.50),
                SizeClass::of_size(0.0375, 0.34),
                SizeClass::of_size(0.050, 0.16),
            ],
            shape: GrainShape {
                elongation: [0.7, 0.1],
                flatness: [0.7, 0.1],
                vertices: [8, 40],
                angularity: 0.5,
            },
            templates: 20,
            stones: vec![],
        },
        friction: FrictionPlan { grain: 1.0, sleeper: 1.0, tine: 1.0, boundary: [0.8; 5] },
        stiffness: StiffnessPlan::default(),
        gravity: 9.81,
        preparation: PreparationPlan {
            ballast_depth: 0.2,
            fill_level: 0.2,
            friction: 0.3,
            step_ns: 1_000_000,
            iterations: 30,
            rest_speed: 5e-3,
            max_settling: 0.5,
        },
        subgrade: None,
        traffic: None,
    }
}

struct Poured {
    shapes: Vec<Polyhedron>,
    laid: Vec<PlacedGrain>,
    height_map: HeightMap,
}

fn poured(bed: &BedPlan, volume: f64, forbidden: Option<[[f64; 2]; 2]>) -> Poured {
    let mut rng = Pcg64::seed_from_u64(bed.seed);
    let mut shapes = Vec::new();
    let templates = Templates::generate(bed, &mut rng, &mut shapes).unwrap();
    let mut height_map = height_map(bed).unwrap();
    if let Some([low, high]) = forbidden {
        height_map.forbid(low, high);
    }
    let laid = pour(&mut height_map, &templates, &shapes, &bed.size, volume, &mut rng).unwrap();
    Poured { shapes, laid, height_map }
}

#[test]
fn poured_grains_overlap_neither_each_other_nor_the_walls() {
    let bed = bed(Vec3::new(0.3, 0.25, 0.4));
    let Poured { shapes, laid, .. } = poured(&bed, 0.3 * 0.25 * 0.06, None);
    assert!(laid.len() > 100, "{}", laid.len());
    let mut clipper = Clipper::default();
    for (i, a) in laid.iter().enumerate() {
        for v in &shapes[a.shape].vertices {
            let p = a.pose.point(v);
            let inside = (0..2).all(|k| p[k] >= 0.0 && p[k] <= bed.size[k]) && p.z >= 0.0;
            assert!(inside, "grain {i}: {p}");
        }
        let faces = half_spaces_of(&shapes[a.shape], &a.pose);
        for (j, b) in laid.iter().enumerate().take(i) {
            let common = clipper.volume_inside(&shapes[b.shape], &b.pose, &faces);
            assert!(common < 1e-12 * shapes[b.shape].volume, "grains {i} and {j}: {common} m³");
        }
    }
}

#[test]
fn the_rain_is_dense() {
    let bed = bed(Vec3::new(0.6, 0.7, 0.5));
    let volume = 0.6 * 0.7 * 0.15;
    let Poured { laid, .. } = poured(&bed, volume, None);
    let mut heights: Vec<f64> = laid.iter().map(|g| g.pose.position.z).collect();
    heights.sort_by(f64::total_cmp);
    // Twice the median height of the centres is the height of an even bed.
    let compactness = volume / (0.6 * 0.7 * 2.0 * heights[heights.len() / 2]);
    assert!(compactness > 0.33 && compactness < 0.60, "{compactness}");
}

#[test]
fn nothing_is_laid_on_what_is_forbidden() {
    let bed = bed(Vec3::new(0.3, 0.3, 0.4));
    let [low, high] = [[0.1, 0.12], [0.2, 0.24]];
    let Poured { shapes, laid, .. } = poured(&bed, 0.3 * 0.3 * 0.04, Some([low, high]));
    let block = AxisBox { low: Vec3::new(0.1, 0.12, 0.0), high: Vec3::new(0.2, 0.24, 10.0) };
    let mut clipper = Clipper::default();
    for grain in &laid {
        assert_eq!(
            clipper.volume_inside(&shapes[grain.shape], &grain.pose, &block.half_spaces()),
            0.0
        );
    }
}

#[test]
fn the_relief_of_present_grains_is_that_of_their_laying() {
    let bed = bed(Vec3::new(0.3, 0.3, 0.4));
    let Poured { shapes, laid, height_map } = poured(&bed, 0.3 * 0.3 * 0.04, None);
    let mut again = super::height_map(&bed).unwrap();
    cover_present(&mut again, laid.iter().map(|g| (&shapes[g.shape], g.pose)));
    assert!(again.largest_difference(&height_map) < 1e-9);
}

#[test]
fn the_same_seed_lays_the_same_bed_and_another_seed_another() {
    let first = bed(Vec3::new(0.3, 0.3, 0.4));
    let other = BedPlan { seed: 4, ..first.clone() };
    let volume = 0.3 * 0.3 * 0.03;
    assert_eq!(poured(&first, volume, None).laid, poured(&first, volume, None).laid);
    assert_ne!(poured(&first, volume, None).laid, poured(&other, volume, None).laid);
}

#[test]
fn shares_are_by_number() {
    let bed = bed(Vec3::new(0.6, 0.6, 0.4));
    let Poured { shapes, laid, .. } = poured(&bed, 0.6 * 0.6 * 0.2, None);
    let volume = |size: f64| std::f64::consts::FRAC_PI_6 * size * size * size;
    for (size, share) in [(0.025, 0.50), (0.0375, 0.34), (0.050, 0.16)] {
        let of_class =
            |g: &&PlacedGrain| (shapes[g.shape].volume / volume(size) - 1.0).abs() < 1e-9;
        let found = laid.iter().filter(of_class).count() as f64 / laid.len() as f64;
        // Three standard deviations of a share among some 3000 grains.
        assert!((found - share).abs() < 0.03, "{size}: {found}");
    }
}

#[test]
fn a_sieve_curve_is_that_of_the_mass() {
    let curve = [[0.0224, 0.0], [0.0315, 0.1], [0.04, 0.45], [0.05, 0.85], [0.063, 1.0]];
    for angularity in [0.0, 0.5, 1.0] {
        let mut bed = bed(Vec3::new(0.6, 0.6, 0.4));
        bed.grains.classes = classes_of_grading(&curve);
        bed.grains.shape.angularity = angularity;
        bed.grains.templates = 60;
        let Poured { shapes, laid, .. } = poured(&bed, 0.6 * 0.6 * 0.2, None);
        let sieves: Vec<f64> = shapes.iter().map(|s| ShapeDescriptors::of(s).sieve_size).collect();
        let total: f64 = laid.iter().map(|g| shapes[g.shape].volume).sum();
        for [sieve, passing] in curve {
            let passes = |g: &&PlacedGrain| sieves[g.shape] <= sieve;
            let found: f64 =
                laid.iter().filter(passes).map(|g| shapes[g.shape].volume).sum::<f64>() / total;
            // Three standard deviations among some 1200 grains.
            assert!((found - passing).abs() < 0.04, "{sieve}: {found} instead of {passing}");
        }
        // The curve between its points: half of the fraction's mass at the geometric mean of its sieves.
        let middle = (0.04_f64 * 0.05).sqrt();
        let below = laid.iter().filter(|g| sieves[g.shape] <= middle);
        let found = below.map(|g| shapes[g.shape].volume).sum::<f64>() / total;
        assert!((found - 0.65).abs() < 0.04, "{found}");
        let estimate = bed.grains.mean_volume() * laid.len() as f64;
        assert!((estimate / total - 1.0).abs() < 0.25, "{estimate} m³ instead of {total} m³");
    }
}

#[test]
fn a_box_narrower_than_a_grain_is_refused() {
    let bed = bed(Vec3::new(0.03, 0.3, 0.4));
    let mut rng = Pcg64::seed_from_u64(1);
    let mut shapes = Vec::new();
    let templates = Templates::generate(&bed, &mut rng, &mut shapes).unwrap();
    let mut height_map = height_map(&bed).unwrap();
    let found = pour(&mut height_map, &templates, &shapes, &bed.size, 0.001, &mut rng);
    assert!(found.unwrap_err().to_string().contains("bed.size"));
}

/// Corners of a brick and of a tetrahedron, in different units.
fn given_stones() -> Vec<Vec<Vec3>> {
    let brick = [[0, 0], [30, 0], [30, 40], [0, 40]]
        .iter()
        .flat_map(|[x, y]| [0.0, 20.0].map(|z| Vec3::new(f64::from(*x), f64::from(*y), z)));
    let tetrahedron =
        [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]].map(Vec3::from);
    vec![brick.collect(), tetrahedron.to_vec()]
}

#[test]
fn given_stones_are_taken_in_turn_and_scaled_to_the_sizes() {
    let mut bed = bed(Vec3::new(0.3, 0.3, 0.3));
    bed.grains.stones = given_stones();
    bed.grains.templates = 6;
    let mut rng = Pcg64::seed_from_u64(1);
    let mut shapes = Vec::new();
    Templates::generate(&bed, &mut rng, &mut shapes).unwrap();
    // Of 6 shapes: 3, 2 and 1 of the classes.
    let sizes = [0.025, 0.025, 0.025, 0.0375, 0.0375, 0.05];
    assert_eq!(shapes.len(), sizes.len());
    for (k, (shape, size)) in shapes.iter().zip(sizes).enumerate() {
        assert_eq!(shape.vertices.len(), [8, 4][k % 2]);
        assert!((shape.nominal_diameter() / size - 1.0).abs() < 1e-12, "shape {k}");
    }

    bed.grains.classes = classes_of_grading(&[[0.0224, 0.0], [0.0315, 0.4], [0.05, 1.0]]);
    shapes.clear();
    Templates::generate(&bed, &mut rng, &mut shapes).unwrap();
    let sieves: Vec<f64> = shapes.iter().map(|s| ShapeDescriptors::of(s).sieve_size).collect();
    assert!(sieves.iter().all(|s| (0.0224..=0.05).contains(s)), "{sieves:?}");
    assert_eq!(shapes.iter().filter(|s| s.vertices.len() == 8).count(), shapes.len().div_ceil(2));
}
