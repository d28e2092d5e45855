//! Compactness of a zone (T-21).

use super::sum;
use super::zone::Zone;
use crate::error::{Error, Result};
use crate::geometry::{Clipper, HalfSpace, cuboid, half_spaces_of};
use crate::math::Pose;
use crate::model::{Model, Part};
use crate::state::State;

/// Solid and accessible volume of a zone, and their ratio.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Compactness {
    /// Volume of grains inside the zone, m³.
    pub solid: f64,
    /// Volume of the zone that driven bodies leave free, m³.
    pub accessible: f64,
    /// Solid over accessible volume, φ.
    pub compactness: f64,
}

/// Minimum accessible fraction of a zone; below it, overlaps of grains and bodies matter as much as the grains.
const MIN_ACCESSIBLE_FRACTION: f64 = 0.05;

/// Measures φ of a zone, with exact volumes of clipped polyhedra (T-21).
///
/// Not only sleepers and tines but all driven bodies take their volume from the zone, so a zone may
/// reach beyond floor and walls. Parts that overlap count once.
///
/// # Errors
/// [`Error::State`] if driven bodies leave less than a twentieth of the zone.
pub fn compactness(model: &Model, state: &State, zone: &Zone) -> Result<Compactness> {
    let accessible = accessible_volume(model, state, zone);
    let fraction = accessible / zone.region.volume();
    if fraction <= MIN_ACCESSIBLE_FRACTION {
        return Err(Error::State {
            place: format!("compactness of zone {:?}", zone.name),
            expected: format!(
                "more than {} % of it free of driven bodies",
                100.0 * MIN_ACCESSIBLE_FRACTION
            ),
            found: format!("{:.1} %", 100.0 * fraction.max(0.0)),
        });
    }
    let solid = solid_volume(model, state, zone);
    Ok(Compactness { solid, accessible, compactness: solid / accessible })
}

/// Volume of the grains inside a zone, m³.
fn solid_volume(model: &Model, state: &State, zone: &Zone) -> f64 {
    let half_spaces = zone.region.half_spaces();
    sum::in_chunks(model.grains.len(), 0.0, |range| {
        let mut clipper = Clipper::default();
        range
            .map(|i| {
                let shape = &model.shapes[model.grains.shape[i] as usize];
                clipper.volume_inside(shape, &state.pose(i), &half_spaces)
            })
            .sum()
    })
}

/// Volume of a zone outside all driven bodies, m³.
fn accessible_volume(model: &Model, state: &State, zone: &Zone) -> f64 {
    let (low, high) = (zone.region.low, zone.region.high);
    let (block, pose) = (cuboid((high - low) / 2.0), Pose::at((low + high) / 2.0));
    let mut outside_walls: Vec<HalfSpace> = Vec::new();
    let mut obstacles = Vec::new();
    for (d, body) in model.driven.iter().enumerate() {
        let body_pose = state.pose(model.grains.len() + d);
        for part in &body.parts {
            match part {
                Part::HalfSpace { normal, offset } => {
                    let wall = HalfSpace { normal: *normal, offset: *offset };
                    outside_walls.push(wall.at(&body_pose).flipped());
                }
                Part::Convex { shape, pose } => {
                    let shape = &model.shapes[*shape as usize];
                    obstacles.push(half_spaces_of(shape, &body_pose.then(pose)));
                }
            }
        }
    }
    Clipper::default().volume_outside(&block, &pose, &mut outside_walls, &obstacles)
}

#[cfg(test)]
mod tests {
    use super::super::scene;
    use super::*;
    use crate::math::{Vec3, rotation};
    use crate::model::Role;

    fn zone(low: [f64; 3], high: [f64; 3]) -> Zone {
        Zone::new("test", low.into(), high.into()).unwrap()
    }

    #[test]
    fn grains_count_with_the_part_that_is_inside() {
        let model = scene::cubes(4);
        // Whole, half, an eighth, none.
        let state =
            scene::at(&[[1.0, 1.0, 1.0], [1.0, 3.0, 4.0], [4.0, 4.0, 0.0], [1.0, 1.0, 4.6]]);
        let found = compactness(&model, &state, &zone([0.0; 3], [4.0; 3])).unwrap();
        assert!((found.solid - 1.625).abs() < 1e-14);
        assert!((found.accessible - 64.0).abs() < 1e-13);
        assert!((found.compactness - 1.625 / 64.0).abs() < 1e-16);
    }

    #[test]
    fn sleepers_tines_and_walls_take_their_volume_once() {
        let mut model = scene::cubes(0);
        let convex = |x: f64| Part::Convex { shape: 0, pose: Pose::at(Vec3::new(x, 0.0, 0.0)) };
        // Two unit cubes that overlap by half: volume 1.5.
        model.driven.push(scene::driven("block", Role::Sleeper, vec![convex(0.0), convex(0.5)]));
        let floor = Part::HalfSpace { normal: Vec3::z(), offset: 0.0 };
        model.driven.push(scene::driven("floor", Role::Boundary, vec![floor]));
        let mut state = scene::at(&[[2.0, 2.0, 2.0], [0.0, 0.0, 0.0]]);
        state.orientation[0] = rotation::exp(&Vec3::new(0.3, -0.2, 0.9));
        let found = accessible_volume(&model, &state, &zone([0.0, 0.0, -1.0], [4.0, 4.0, 4.0]));
        assert!((found - 62.5).abs() < 1e-12, "{found}");
        // The wall's offset and normal follow its pose: turned by half a turn it fills the rest.
        state.orientation[1] = rotation::exp(&(Vec3::x() * std::f64::consts::PI));
        state.position[1].z = 3.0;
        let found = accessible_volume(&model, &state, &zone([0.0; 3], [1.0, 1.0, 4.0]));
        assert!((found - 3.0).abs() < 1e-12, "{found}");
    }

    #[test]
    fn a_zone_inside_a_sleeper_has_no_compactness() {
        let mut model = scene::cubes(0);
        let part = Part::Convex { shape: 0, pose: Pose::identity() };
        model.driven.push(scene::driven("block", Role::Sleeper, vec![part]));
        let within =
            |z: f64| compactness(&model, &scene::at(&[[0.0; 3]]), &zone([-0.2; 3], [0.2, 0.2, z]));
        // The block ends at 0.5: what is left of these zones is nothing, 4 and 6 %.
        for (z, expected) in
            [(0.2, Some("0.0 %")), (0.7 / 0.96 - 0.2, Some("4.0 %")), (0.7 / 0.94 - 0.2, None)]
        {
            let message = within(z).err().map(|e| e.to_string());
            assert_eq!(message.is_some(), expected.is_some(), "{message:?}");
            assert!(
                message.is_none_or(
                    |text| text.contains("\"test\"") && text.contains(expected.unwrap())
                )
            );
        }
    }
}
