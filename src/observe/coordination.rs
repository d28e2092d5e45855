//! Coordination of the grains (T-25).

use super::zone::Zone;
use crate::model::Model;
use crate::state::State;

/// Numbers of active contacts by grain.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Coordination {
    /// Number of bodies that each grain touches, driven ones included `[ng]`.
    pub neighbours: Vec<u32>,
    /// Number of contact points of each grain `[ng]`.
    pub points: Vec<u32>,
    /// Number of grains without any impulse.
    pub rattlers: usize,
    /// Touching neighbours per grain, over all grains and without rattlers.
    pub mean_neighbours: [f64; 2],
    /// Contact points per grain, over all grains and without rattlers.
    pub mean_points: [f64; 2],
}

impl Coordination {
    /// Mean number of touching neighbours of the grains whose centre is in `zone`; `None` without grains.
    pub fn mean_within(&self, state: &State, zone: &Zone) -> Option<f64> {
        let inside = |(g, _): &(usize, &u32)| zone.region.contains(&state.position[*g]);
        let counts = self.neighbours.iter().enumerate().filter(inside);
        let (sum, grains) = counts.fold((0, 0), |(s, n), (_, c)| (s + u64::from(*c), n + 1));
        (grains > 0).then(|| sum as f64 / f64::from(grains))
    }
}

/// Counts the active contacts of each grain (T-25); means are zero where there is no grain.
pub fn coordination(model: &Model, state: &State) -> Coordination {
    let ng = model.grains.len();
    let mut found =
        Coordination { neighbours: vec![0; ng], points: vec![0; ng], ..Default::default() };
    let mut last_pair = None;
    for (bodies, impulse) in state.contacts.bodies.iter().zip(&state.contacts.impulse) {
        if *impulse == crate::math::Vec3::zeros() {
            continue;
        }
        // Contacts are sorted by bodies: a pair's points follow each other.
        let new_pair = last_pair != Some(*bodies);
        last_pair = Some(*bodies);
        for body in bodies.map(|b| b as usize) {
            if body < ng {
                found.points[body] += 1;
                found.neighbours[body] += u32::from(new_pair);
            }
        }
    }
    found.rattlers = found.points.iter().filter(|&&p| p == 0).count();
    let mean = |counts: &[u32]| {
        let sum = counts.iter().map(|&c| u64::from(c)).sum::<u64>() as f64;
        [ng, ng - found.rattlers].map(|n| if n == 0 { 0.0 } else { sum / n as f64 })
    };
    (found.mean_neighbours, found.mean_points) = (mean(&found.neighbours), mean(&found.points));
    found
}

#[cfg(test)]
mod tests {
    use super::super::scene;
    use super::*;

    #[test]
    fn a_stack_of_two_and_a_rattler() {
        let model = scene::cubes(3);
        let mut state = scene::at(&[[0.5; 3], [2.0; 3], [0.1; 3], [0.0; 3]]);
        for push in [1.0, 2.0, 0.0] {
            scene::carry(&mut state, [0, 1], [0.0; 3], [0.0, 0.0, push]);
        }
        // A contact that is near but idle makes no neighbour; the floor (body 3) does.
        scene::carry(&mut state, [1, 2], [0.0; 3], [0.0; 3]);
        scene::carry(&mut state, [1, 3], [0.0; 3], [0.0, 0.1, 3.0]);
        let found = coordination(&model, &state);
        assert_eq!(found.neighbours, [1, 2, 0]);
        assert_eq!(found.points, [2, 3, 0]);
        assert_eq!(found.rattlers, 1);
        assert_eq!(found.mean_neighbours, [1.0, 1.5]);
        let zone = |high: f64| {
            Zone::new("zone", crate::math::Vec3::zeros(), crate::math::Vec3::repeat(high)).unwrap()
        };
        assert_eq!(found.mean_within(&state, &zone(1.0)), Some(0.5));
        assert_eq!(found.mean_within(&state, &zone(0.05)), None);
        assert_eq!(found.mean_points, [5.0 / 3.0, 2.5]);
    }

    #[test]
    fn no_grain_has_no_neighbour() {
        let found = coordination(&scene::cubes(0), &State::default());
        assert_eq!(found, Coordination::default());
    }
}
