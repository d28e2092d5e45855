//! A sleeper as a driven body: one block, or two (twin-block).
//!
//! Reads: a sleeper's plan. Writes: the body, and its shapes if the model does not have them yet.
//! Contract: the body's origin, to which its wrench refers, is the centre of the underside.

use super::shape::{cuboid, solid};
use crate::error::{Error, Result};
use crate::geometry::Polyhedron;
use crate::math::Vec3;
use crate::model::{DrivenBody, Role};
use crate::track::plan::SleeperPlan;

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
        parts.push(cuboid(shapes, &size, centre)?);
    }
    Ok(DrivenBody { name: plan.name.clone(), role: Role::Sleeper, friction, parts, mount: None })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::track::plan::BlockPlan;
    use crate::track::shape::test_support::extent;

    #[test]
    fn twin_blocks_stand_on_the_reference_plane_either_side() {
        let size = Vec3::new(0.29, 0.67, 0.21);
        let plan = SleeperPlan {
            name: "sleeper".into(),
            centre: [0.3, 1.0],
            blocks: vec![BlockPlan { offset_y: -0.6, size }, BlockPlan { offset_y: 0.6, size }],
            tamped: true,
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
        };
        assert!(sleeper(&plan, 1.0, &mut Vec::new()).is_err());
    }
}
