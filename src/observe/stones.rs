//! Shapes and grading of the stones of a bed, by mass, as a quarry certifies them.

use crate::geometry::ShapeDescriptors;
use crate::model::Model;

/// Sides of the square holes of the sieves of EN 13450, m.
pub const EN_13450_SIEVES: [f64; 6] = [0.0224, 0.0315, 0.04, 0.05, 0.063, 0.08];
/// Sieves of EN 933-3, m: neighbours bound a size fraction, whose bar sieve has slots of half the upper size.
const EN_933_3_SIEVES: [f64; 15] = [
    0.004, 0.005, 0.0063, 0.008, 0.01, 0.0125, 0.016, 0.02, 0.025, 0.0315, 0.04, 0.05, 0.063, 0.08,
    0.1,
];
/// Ratio of length to thickness above which a particle is not cubical (EN 933-4).
const NON_CUBICAL_RATIO: f64 = 3.0;

/// Mean and standard deviation over the stones of a bed, weighted by mass.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct MassWeightedMean {
    /// Mean.
    pub mean: f64,
    /// Standard deviation.
    pub deviation: f64,
}

/// Shape and grading of the stones of a bed; shares are by mass.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StoneStatistics {
    /// Elongation I/L.
    pub elongation: MassWeightedMean,
    /// Flatness S/I.
    pub flatness: MassWeightedMean,
    /// Wadell's sphericity.
    pub sphericity: MassWeightedMean,
    /// Angularity, rad: mean angle between the normals of faces at edges.
    pub angularity: MassWeightedMean,
    /// Flakiness index (EN 933-3): share of the stones from 4 to 100 mm whose thickness is below half the upper sieve of
    /// their size fraction.
    pub flakiness_index: f64,
    /// Shape index (EN 933-4): share of the stones whose longest diameter is more than three times their thickness.
    pub shape_index: f64,
    /// Share that passes each of [`EN_13450_SIEVES`].
    pub passing: [f64; 6],
}

/// Returns shape and grading of the stones; `None` without stones.
pub fn stone_statistics(model: &Model) -> Option<StoneStatistics> {
    let mut masses = vec![0.0; model.shapes.len()];
    for (&shape, mass) in model.grains.shape.iter().zip(&model.grains.mass) {
        masses[shape as usize] += mass;
    }
    let stones: Vec<(f64, ShapeDescriptors)> = (masses.iter().zip(&model.shapes))
        .filter(|(mass, _)| **mass > 0.0)
        .map(|(mass, shape)| (*mass, ShapeDescriptors::of(shape)))
        .collect();
    if stones.is_empty() {
        return None;
    }
    let sum = |is_in: &dyn Fn(&ShapeDescriptors) -> bool| -> f64 {
        // `sum` of nothing would be -0.
        stones.iter().filter(|(_, s)| is_in(s)).fold(0.0, |sum, (mass, _)| sum + mass)
    };
    let total = sum(&|_| true);
    let mean = |value: &dyn Fn(&ShapeDescriptors) -> f64| {
        let mean = stones.iter().map(|(mass, s)| mass * value(s)).sum::<f64>() / total;
        let variance = stones
            .iter()
            .map(|(mass, s)| mass * (value(s) - mean) * (value(s) - mean))
            .sum::<f64>();
        MassWeightedMean { mean, deviation: (variance / total).sqrt() }
    };
    let tested = sum(&|s| slot(s).is_some());
    let flaky = sum(&|s| slot(s).is_some_and(|slot| s.thickness < slot));
    Some(StoneStatistics {
        elongation: mean(&ShapeDescriptors::elongation),
        flatness: mean(&ShapeDescriptors::flatness),
        sphericity: mean(&|s| s.sphericity),
        angularity: mean(&|s| s.angularity),
        flakiness_index: if tested > 0.0 { flaky / tested } else { 0.0 },
        shape_index: sum(&|s| s.length_to_thickness() > NON_CUBICAL_RATIO) / total,
        passing: EN_13450_SIEVES.map(|sieve| sum(&|s| s.sieve_size <= sieve) / total),
    })
}

/// Returns the slot width (m) of the bar sieve for the size fraction of a stone; `None` outside all fractions.
fn slot(stone: &ShapeDescriptors) -> Option<f64> {
    let fraction = EN_933_3_SIEVES
        .windows(2)
        .find(|sieves| sieves[0] < stone.sieve_size && stone.sieve_size <= sieves[1])?;
    Some(0.5 * fraction[1])
}

#[cfg(test)]
mod tests {
    use super::super::scene;
    use super::*;
    use crate::geometry::cuboid;
    use crate::math::Vec3;

    /// Bed of bricks, each with its number.
    fn bed(bricks: &[([f64; 3], usize)]) -> Model {
        let mut model = scene::cubes(0);
        model.shapes = bricks.iter().map(|(sides, _)| cuboid(Vec3::from(*sides) / 2.0)).collect();
        for (shape, (_, count)) in bricks.iter().enumerate() {
            for _ in 0..*count {
                let polyhedron = model.shapes[shape].clone();
                model.grains.push(shape as u32, &polyhedron, 2700.0);
            }
        }
        model
    }

    #[test]
    fn shares_are_by_mass() {
        // Volumes 27, 64 and 60 cm³, of which the first comes twice.
        let cubes = bed(&[([0.03; 3], 2), ([0.04; 3], 1), ([0.03, 0.04, 0.05], 1)]);
        let statistics = stone_statistics(&cubes).expect("stones");
        let total = 54.0 + 64.0 + 60.0;
        // The brick lies on its length, and passes with the larger side of its cross-section.
        let expected = [0.0, 54.0 / total, 1.0, 1.0, 1.0, 1.0];
        for (found, expected) in statistics.passing.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-12, "{found} instead of {expected}");
        }
        assert_eq!((statistics.flakiness_index, statistics.shape_index), (0.0, 0.0));
        let flatness = (54.0 + 64.0 + 60.0 * 0.75) / total;
        assert!((statistics.flatness.mean - flatness).abs() < 1e-12);
        let variance = (54.0 + 64.0) * (1.0 - flatness) * (1.0 - flatness)
            + 60.0 * (0.75 - flatness) * (0.75 - flatness);
        assert!((statistics.flatness.deviation - (variance / total).sqrt()).abs() < 1e-12);
        let right_angle = std::f64::consts::FRAC_PI_2;
        assert!((statistics.angularity.mean - right_angle).abs() < 1e-12);
        assert!(statistics.angularity.deviation < 1e-7);
        assert_eq!(stone_statistics(&bed(&[])), None);
    }

    #[test]
    fn flaky_and_long_stones_are_counted_as_the_standards_say() {
        // In the fraction 40/50 mm slots of 25 mm retain the first and pass the second; the third is long, not flaky.
        let bricks = [[0.05, 0.045, 0.026], [0.05, 0.045, 0.024], [0.12, 0.045, 0.04]];
        let volume = |b: [f64; 3]| b.iter().product::<f64>();
        let statistics = stone_statistics(&bed(&bricks.map(|b| (b, 1)))).expect("stones");
        let total: f64 = bricks.iter().map(|b| volume(*b)).sum();
        assert!((statistics.flakiness_index - volume(bricks[1]) / total).abs() < 1e-12);
        assert!((statistics.shape_index - volume(bricks[2]) / total).abs() < 1e-12);
    }
}
