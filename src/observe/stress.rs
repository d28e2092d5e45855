//! Love-Weber stress of a zone (T-23).

use super::sum;
use super::zone::Zone;
use crate::geometry::AxisBox;
use crate::math::{Mat3, Vec3};
use crate::model::Model;
use crate::state::State;

/// Mean stress of a zone over the step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stress {
    /// Stress tensor `σ`, compression positive, Pa; symmetric if the grains are in balance of moments.
    pub tensor: Mat3,
    /// Pressure `P = tr σ / 3`, Pa.
    pub pressure: f64,
}

impl Stress {
    /// Deviatoric stress `q = sqrt(3/2) ‖dev σ‖`, Pa: the stress difference of a triaxial test.
    pub fn deviator(&self) -> f64 {
        let symmetric = (self.tensor + self.tensor.transpose()) / 2.0;
        (symmetric - Mat3::identity() * self.pressure).norm() * 1.5f64.sqrt()
    }
}

/// Computes the Love-Weber stress of a zone (T-23).
///
/// A contact's impulse runs along the legs from its point to the two bodies; each leg counts with
/// the length that lies inside the zone, so a force chain through the zone counts exactly once
/// wherever its grains are. Bodies and points are at their end-of-step positions. Zero without contacts.
pub fn stress(model: &Model, state: &State, zone: &Zone) -> Stress {
    let contacts = &state.contacts;
    let position = |b: u32| &state.position[b as usize];
    let sum = sum::in_chunks(contacts.impulse.len(), Mat3::zeros(), |range| {
        let mut sum = Mat3::zeros();
        for (k, impulse) in range.clone().zip(&contacts.impulse[range]) {
            if *impulse == Vec3::zeros() {
                continue;
            }
            let [candidate, antagonist] = contacts.bodies[k];
            let point = &state.pose(candidate as usize).point(&contacts.local_point[k]);
            let mut branch = inside(&zone.region, point, position(candidate));
            // A driven body is not part of the volume of the grains.
            if (antagonist as usize) < model.grains.len() {
                branch += inside(&zone.region, position(antagonist), point);
            }
            sum += impulse * branch.transpose();
        }
        sum
    });
    let h = model.stepping.h();
    let tensor = sum / (h * zone.region.volume());
    Stress { tensor, pressure: tensor.trace() / 3.0 }
}

/// Returns the part of the vector from `a` to `b` inside the box.
fn inside(region: &AxisBox, a: &Vec3, b: &Vec3) -> Vec3 {
    let along = b - a;
    let (mut from, mut to) = (0.0f64, 1.0f64);
    for k in 0..3 {
        let (low, high) = (region.low[k] - a[k], region.high[k] - a[k]);
        if along[k] == 0.0 {
            if low > 0.0 || high < 0.0 {
                return Vec3::zeros();
            }
            continue;
        }
        let (first, second) = (low / along[k], high / along[k]);
        from = from.max(first.min(second));
        to = to.min(first.max(second));
    }
    along * (to - from).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::super::scene;
    use super::*;

    /// Three unit cubes on top of each other on a floor (body 3), pressed with 7 N and sheared by 2 N.
    fn column() -> (Model, State) {
        let model = scene::cubes(3);
        let mut state = scene::at(&[[0.0; 3], [0.0, 0.0, 1.0], [0.0, 0.0, 2.0], [0.0; 3]]);
        let h = model.stepping.h();
        for k in 0..2 {
            let z = k as f64 + 0.5;
            let push = [-2.0 * h, 0.0, -7.0 * h];
            scene::carry(&mut state, [k, k + 1], [0.0, 0.0, z], push);
        }
        let push = [2.0 * h, 0.0, 7.0 * h];
        scene::carry(&mut state, [0, 3], [0.0, 0.0, -0.5], push);
        (model, state)
    }

    #[test]
    fn a_column_carries_its_load_over_its_section_wherever_the_zone_ends() {
        let (model, state) = column();
        for (low, high) in [(-0.5, 2.0), (0.13, 1.78), (0.6, 0.9), (-0.5, 0.2)] {
            let low = Vec3::new(-1.0, -0.5, low);
            let zone = Zone::new("z", low, Vec3::new(1.0, 0.5, high)).unwrap();
            let found = stress(&model, &state, &zone);
            let mut expected = Mat3::zeros();
            (expected[(2, 2)], expected[(0, 2)]) = (3.5, 1.0);
            assert!((found.tensor - expected).amax() < 1e-12, "{}", found.tensor);
            assert!((found.pressure - 3.5 / 3.0).abs() < 1e-12);
        }
        let beside = Zone::new("b", Vec3::new(1.0, 1.0, 0.0), Vec3::repeat(2.0)).unwrap();
        assert_eq!(stress(&model, &state, &beside).tensor, Mat3::zeros());
    }

    #[test]
    fn the_deviator_is_the_difference_of_triaxial_stresses() {
        let tensor = Mat3::from_diagonal(&Vec3::new(2.0, 2.0, 9.0));
        let found = Stress { tensor, pressure: 13.0 / 3.0 };
        assert!((found.deviator() - 7.0).abs() < 1e-14);
    }
}
