//! Inertial number of a zone (T-22).

use super::grain_size::{density, mean_diameter};
use super::stress::stress;
use super::sum;
use super::zone::Zone;
use crate::math::{Mat3, Vec3};
use crate::model::Model;
use crate::state::State;
use std::ops::Add;

/// Inertial number of a zone: ratio of the times of rearrangement and shear.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InertialNumber {
    /// Inertial number `I = γ̇ d sqrt(ρ / P)`; `None` without pressure or shear rate.
    pub value: Option<f64>,
    /// Shear rate `γ̇`, 1/s; `None` where the grains' centres span no volume.
    pub shear_rate: Option<f64>,
    /// Pressure `P`, Pa.
    pub pressure: f64,
}

/// Computes the inertial number of a zone (T-22), with `d` the mean nominal diameter and `ρ` the grains' density.
pub fn inertial_number(model: &Model, state: &State, zone: &Zone) -> InertialNumber {
    let shear_rate = shear_rate(model, state, zone);
    let pressure = stress(model, state, zone).pressure;
    let value = shear_rate
        .filter(|_| pressure > 0.0)
        .map(|rate| rate * mean_diameter(model) * (density(model) / pressure).sqrt());
    InertialNumber { value, shear_rate, pressure }
}

/// Computes the shear rate `γ̇ = sqrt(2 D' : D')` of a zone, 1/s, `D'` the deviator of the symmetric gradient.
///
/// The gradient is the linear velocity field that fits, weighted by mass, the grains whose centre
/// is in the zone; `None` where their centres span no volume.
pub fn shear_rate(model: &Model, state: &State, zone: &Zone) -> Option<f64> {
    let gradient = velocity_gradient(model, state, zone)?;
    let symmetric = (gradient + gradient.transpose()) / 2.0;
    let deviator = symmetric - Mat3::identity() * (symmetric.trace() / 3.0);
    Some(deviator.norm() * 2f64.sqrt())
}

/// Mass-weighted sums over grains.
#[derive(Clone, Copy)]
struct Moments {
    mass: f64,
    position: Vec3,
    velocity: Vec3,
    /// Sum Σ m v ⊗ x.
    mixed: Mat3,
    /// Sum Σ m x ⊗ x.
    second: Mat3,
}

impl Add for Moments {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self {
            mass: self.mass + other.mass,
            position: self.position + other.position,
            velocity: self.velocity + other.velocity,
            mixed: self.mixed + other.mixed,
            second: self.second + other.second,
        }
    }
}

/// Fits by least squares `v = v0 + L x` to the grains of a zone.
fn velocity_gradient(model: &Model, state: &State, zone: &Zone) -> Option<Mat3> {
    let centre = (zone.region.low + zone.region.high) / 2.0;
    let zero = Moments {
        mass: 0.0,
        position: Vec3::zeros(),
        velocity: Vec3::zeros(),
        mixed: Mat3::zeros(),
        second: Mat3::zeros(),
    };
    let sum = sum::in_chunks(model.grains.len(), zero, |range| {
        range.filter(|&i| zone.region.contains(&state.position[i])).fold(zero, |sum, i| {
            // Relative to the zone's centre, to limit cancellation.
            let (m, v, x) = (model.grains.mass[i], state.velocity[i], state.position[i] - centre);
            let mixed = v * x.transpose() * m;
            let second = x * x.transpose() * m;
            sum + Moments { mass: m, position: x * m, velocity: v * m, mixed, second }
        })
    });
    if sum.mass == 0.0 {
        return None;
    }
    let mean = sum.position / sum.mass;
    let mixed = sum.mixed - sum.velocity * mean.transpose();
    let second = sum.second - sum.position * mean.transpose();
    // Centres in a plane leave the gradient across it open.
    let size = second.trace() / 3.0;
    if second.determinant() <= 1e-9 * size.powi(3) {
        return None;
    }
    second.try_inverse().map(|inverse| mixed * inverse)
}

#[cfg(test)]
mod tests {
    use super::super::scene;
    use super::*;

    fn sheared(rate: f64) -> (Model, State) {
        let positions: Vec<[f64; 3]> = (0..27)
            .map(|k| [10.0 + (k % 3) as f64, (k / 3 % 3) as f64 * 1.3, (k / 9) as f64 * 0.9])
            .collect();
        let mut state = scene::at(&positions);
        for (v, x) in state.velocity.iter_mut().zip(&positions) {
            // Simple shear, a rotation, a translation and an expansion: only the first counts.
            let x = Vec3::from(*x);
            *v = Vec3::x() * (rate * x.z) + Vec3::new(0.3, 0.1, 0.7).cross(&x) + x * 0.4;
        }
        (scene::cubes(27), state)
    }

    fn everywhere() -> Zone {
        Zone::new("all", Vec3::repeat(-1.0), Vec3::new(14.0, 5.0, 5.0)).unwrap()
    }

    #[test]
    fn simple_shear_is_found_under_rotation_and_expansion() {
        let (model, mut state) = sheared(0.8);
        assert!((shear_rate(&model, &state, &everywhere()).unwrap() - 0.8).abs() < 1e-12);
        let flat = Zone::new("flat", Vec3::repeat(-1.0), Vec3::new(14.0, 5.0, 0.5)).unwrap();
        assert_eq!(shear_rate(&model, &state, &flat), None);
        scene::carry(&mut state, [0, 1], [10.5, 0.0, 0.0], [-90.0e-3, 0.0, 0.0]);
        assert_eq!(inertial_number(&model, &state, &flat).value, None);
    }

    #[test]
    fn the_number_is_the_closed_form() {
        let (model, mut state) = sheared(0.8);
        let loose = inertial_number(&model, &state, &everywhere());
        assert_eq!(loose.value, None);
        // Grain 0 pressed on grain 1 by 90 N over their distance.
        let push = [-90.0e-3, 0.0, 0.0];
        scene::carry(&mut state, [0, 1], [10.5, 0.0, 0.0], push);
        let found = inertial_number(&model, &state, &everywhere());
        let pressure = 90.0 / everywhere().region.volume() / 3.0;
        assert!((found.pressure / pressure - 1.0).abs() < 1e-12);
        let d = (6.0 / std::f64::consts::PI).cbrt();
        let expected = 0.8 * d * (scene::DENSITY / pressure).sqrt();
        assert!((found.value.unwrap() / expected - 1.0).abs() < 1e-12);
    }
}
