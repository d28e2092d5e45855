//! Mean size and density of the grains, the scales of dimensionless observables.

use super::sum;
use crate::model::Model;

/// Mean nominal diameter `d`, m: the diameter of a sphere of the grain's volume. Zero without grains.
pub fn mean_diameter(model: &Model) -> f64 {
    if model.grains.is_empty() {
        return 0.0;
    }
    let diameters: Vec<f64> = model.shapes.iter().map(|s| s.nominal_diameter()).collect();
    let grains = &model.grains;
    let sum = sum::in_chunks(grains.len(), 0.0, |range| {
        grains.shape[range].iter().map(|&s| diameters[s as usize]).sum()
    });
    sum / grains.len() as f64
}

/// Density of the grains, kg/m³: total mass over total volume. Zero without grains.
pub fn density(model: &Model) -> f64 {
    if model.grains.is_empty() {
        return 0.0;
    }
    let grains = &model.grains;
    let total = |f: &(dyn Fn(usize) -> f64 + Sync)| {
        sum::in_chunks(grains.len(), 0.0, |range| range.map(f).sum())
    };
    total(&|i| grains.mass[i]) / total(&|i| model.shapes[grains.shape[i] as usize].volume)
}

#[cfg(test)]
mod tests {
    use super::super::scene;
    use super::*;
    use crate::geometry::cuboid;
    use crate::math::Vec3;

    #[test]
    fn unequal_cubes_have_the_mean_of_their_spheres() {
        let mut model = scene::cubes(0);
        model.shapes = [0.5, 1.0].map(|half| cuboid(Vec3::repeat(half))).to_vec();
        for (shape, density) in [(0, 2000.0), (1, 3000.0), (0, 2000.0)] {
            let polyhedron = model.shapes[shape as usize].clone();
            model.grains.push(shape, &polyhedron, density);
        }
        let of_unit = (6.0 / std::f64::consts::PI).cbrt();
        assert!((mean_diameter(&model) - of_unit * 4.0 / 3.0).abs() < 1e-14);
        assert!((density(&model) - (2.0 * 2000.0 + 8.0 * 3000.0) / 10.0).abs() < 1e-11);
    }
}
