//! A sleeper as a driven body: one block, or two (twin-block).
//!
//! Reads: a sleeper's plan. Writes: the body, and its shapes if the model does not have them yet.
//! Contract: the body's origin, to which its wrench refers, is the centre of the underside.

use super::shape::{cuboid, cuboid_mount, solid};
use crate::error::{Error, Result};
use crate::geometry::{AxisBox, Polyhedron};
use crate::math::{Pose, Vec3};
use crate::model::{ContactStiffness, DofMode, DrivenBody, Mount, Role};
use crate::track::plan::{BlockPlan, Plan, SleeperPlan};

/// Returns the pose of a sleeper before the lift.
pub(super) fn sleeper_pose(plan: &Plan, s: &SleeperPlan) -> Pose {
    Pose::at(Vec3::new(s.centre[0], s.centre[1], plan.bed.preparation.ballast_depth))
}

/// The driven body of a sleeper; its shapes are appended to `shapes` unless they are there already.
///
/// # Errors
/// A sleeper without blocks, and sizes that make no solid.
pub fn sleeper(
    plan: &SleeperPlan,
    friction: f64,
    shapes: &mut Vec<Polyhedron>,
) -> Result<DrivenBody> {
    if plan.blocks.is_empty() {
        return Err(Error::Model {
            place: format!("sleeper {:?}", plan.name),
            expected: "one or two blocks".into(),
            found: "none".into(),
        });
    }
    let mut parts = Vec::with_capacity(plan.blocks.len());
    for (i, block) in plan.blocks.iter().enumerate() {
        let size = solid(&block.size, || format!("block {} of {:?}", i + 1, plan.name))?;
        let centre = Vec3::new(0.0, block.offset_y, 0.5 * size.z);
        parts.push(cuboid(shapes, &size, centre));
    }
    Ok(DrivenBody {
        name: plan.name.clone(),
        role: Role::Sleeper,
        friction,
        stiffness: ContactStiffness::RIGID,
        parts,
        mount: None,
    })
}

/// The blocks of all sleepers at their level, world.
pub(super) fn block_boxes(plan: &Plan) -> impl Iterator<Item = AxisBox> + '_ {
    let depth = plan.bed.preparation.ballast_depth;
    plan.sleepers.iter().flat_map(move |s| {
        s.blocks.iter().map(move |b| {
            let middle = Vec3::new(s.centre[0], s.centre[1] + b.offset_y, depth);
            let half = Vec3::new(0.5 * b.size.x, 0.5 * b.size.y, 0.0);
            AxisBox { low: middle - half, high: middle + half + Vec3::z() * b.size.z }
        })
    })
}

/// Density of reinforced concrete, kg/m³.
pub(crate) const CONCRETE: f64 = 2400.0;

/// Mount of a sleeper whose blocks have one density, that of concrete if its mass (kg) is not given.
///
/// Moments of inertia are those about the body's axes: products of inertia, which blocks of different sizes
/// have, are left out.
pub fn sleeper_mount(blocks: &[BlockPlan], mass: Option<f64>, freedoms: [DofMode; 6]) -> Mount {
    let cuboids = blocks.iter().map(|b| (Vec3::new(0.0, b.offset_y, 0.5 * b.size.z), b.size));
    cuboid_mount(&cuboids.collect::<Vec<_>>(), CONCRETE, mass, freedoms)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::track::shape::test_support::extent;

    #[test]
    fn twin_blocks_stand_on_the_reference_plane_either_side() {
        let size = Vec3::new(0.29, 0.67, 0.21);
        let plan = SleeperPlan {
            name: "sleeper".into(),
            centre: [0.3, 1.0],
            blocks: vec![BlockPlan { offset_y: -0.6, size }, BlockPlan { offset_y: 0.6, size }],
            tamped: true,
            mount: None,
        };
        let mut shapes = Vec::new();
        let body = sleeper(&plan, 1.0, &mut shapes).unwrap();
        assert_eq!(shapes.len(), 1, "equal blocks share a shape");
        let (low, high) = extent(&shapes, &body.parts[0]);
        assert!((low - Vec3::new(-0.145, -0.935, 0.0)).norm() < 1e-15, "{low}");
        assert!((high - Vec3::new(0.145, -0.265, 0.21)).norm() < 1e-15, "{high}");
        let (low, _) = extent(&shapes, &body.parts[1]);
        assert!((low - Vec3::new(-0.145, 0.265, 0.0)).norm() < 1e-15, "{low}");
    }

    #[test]
    fn a_sleeper_without_blocks_is_refused() {
        let plan = SleeperPlan {
            name: "empty".into(),
            centre: [0.3, 1.0],
            blocks: Vec::new(),
            tamped: false,
            mount: None,
        };
        assert!(sleeper(&plan, 1.0, &mut Vec::new()).is_err());
    }

    #[test]
    fn two_blocks_turn_like_the_one_that_they_make_up() {
        let size = Vec3::new(0.3, 1.0, 0.2);
        let whole = [BlockPlan { offset_y: 0.1, size }];
        let half = Vec3::new(0.3, 0.5, 0.2);
        let halves = [-0.15, 0.35].map(|offset_y| BlockPlan { offset_y, size: half });
        let loaded = [DofMode::Free; 6];
        let (one, two) =
            (sleeper_mount(&whole, None, loaded), sleeper_mount(&halves, None, loaded));
        assert!((one.mass - 144.0).abs() < 1e-10 && (one.mass - two.mass).abs() < 1e-10);
        assert!((one.centre - Vec3::new(0.0, 0.1, 0.1)).norm() < 1e-15, "{}", one.centre);
        assert!((one.centre - two.centre).norm() < 1e-15, "{}", two.centre);
        assert!((one.inertia - two.inertia).norm() < 1e-12 * one.inertia.norm(), "{}", two.inertia);
        let known = Vec3::new(1.04, 0.13, 1.09) * (144.0 / 12.0);
        assert!((one.inertia - known).norm() < 1e-12 * known.norm(), "{}", one.inertia);
        let heavy = sleeper_mount(&whole, Some(288.0), loaded);
        assert!((heavy.inertia - known * 2.0).norm() < 1e-12 * known.norm(), "{}", heavy.inertia);
    }
}
