//! A tine as a driven body: a blade below a shaft.
//!
//! Reads: a tine's plan. Writes: the body, and its shapes if the model does not have them yet.
//! Contract: the body's origin, to which its wrench refers, is the middle of the blade's upper edge.

use super::shape::{cuboid, solid};
use crate::error::Result;
use crate::geometry::Polyhedron;
use crate::math::Vec3;
use crate::model::{ContactStiffness, DrivenBody, Mount, Role};
use crate::track::plan::TinePlan;

/// The driven body of a tine; its shapes are appended to `shapes` unless they are there already.
///
/// # Errors
/// Sizes that make no solid.
pub fn tine(plan: &TinePlan, friction: f64, shapes: &mut Vec<Polyhedron>) -> Result<DrivenBody> {
    let blade = solid(&plan.blade, || format!("blade of {:?}", plan.name))?;
    let shaft = solid(&plan.shaft, || format!("shaft of {:?}", plan.name))?;
    let below = Vec3::new(0.0, 0.0, -0.5 * blade.z);
    let above = Vec3::new(0.0, 0.0, 0.5 * shaft.z);
    Ok(DrivenBody {
        name: plan.name.clone(),
        role: Role::Tine,
        friction,
        stiffness: ContactStiffness::RIGID,
        parts: vec![cuboid(shapes, &blade, below)?, cuboid(shapes, &shaft, above)?],
        mount: plan.mount,
    })
}

/// Undamped mount of a blade at the end of its shaft, a steel beam held at the top: `3 E I / l³` in
/// the weaker direction, l to the middle of the blade, and the blade's mass with 33/140 of the
/// shaft's (Rayleigh).
pub fn steel_cantilever(blade: &Vec3, shaft: &Vec3) -> Mount {
    /// Young's modulus of steel, Pa, and its density, kg/m³.
    const STEEL: (f64, f64) = (210e9, 7850.0);
    let (thin, wide) = (shaft.x.min(shaft.y), shaft.x.max(shaft.y));
    let second_moment = wide * thin.powi(3) / 12.0;
    let length = shaft.z + 0.5 * blade.z;
    let mass = STEEL.1 * (blade.product() + 33.0 / 140.0 * shaft.product());
    Mount::spring(mass, 3.0 * STEEL.0 * second_moment / length.powi(3), 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::track::shape::test_support::extent;

    fn plan() -> TinePlan {
        TinePlan {
            name: "tine 1".into(),
            position: [0.1, 0.2],
            direction: 1.0,
            pair: 0,
            blade: Vec3::new(0.022, 0.12, 0.07),
            shaft: Vec3::new(0.03, 0.06, 0.45),
            mount: None,
        }
    }

    #[test]
    fn the_reference_point_is_on_the_upper_edge_of_the_blade() {
        let mut shapes = Vec::new();
        let body = tine(&plan(), 1.0, &mut shapes).unwrap();
        let (low, high) = extent(&shapes, &body.parts[0]);
        assert!((low - Vec3::new(-0.011, -0.06, -0.07)).norm() < 1e-15, "{low}");
        assert!((high - Vec3::new(0.011, 0.06, 0.0)).norm() < 1e-15, "{high}");
        let (low, high) = extent(&shapes, &body.parts[1]);
        assert!((low - Vec3::new(-0.015, -0.03, 0.0)).norm() < 1e-15, "{low}");
        assert!((high - Vec3::new(0.015, 0.03, 0.45)).norm() < 1e-15, "{high}");
    }

    #[test]
    fn tines_of_one_make_share_their_shapes() {
        let mut shapes = Vec::new();
        let first = tine(&plan(), 1.0, &mut shapes).unwrap();
        let second = tine(&plan(), 1.0, &mut shapes).unwrap();
        assert_eq!(first.parts, second.parts);
        assert_eq!(shapes.len(), 2);
    }

    #[test]
    fn a_steel_tine_gives_way_by_millimetres_under_kilonewtons() {
        let TinePlan { blade, shaft, .. } = plan();
        let mount = steel_cantilever(&blade, &shaft);
        // 3 · 210 GPa · 1.35e-7 m⁴ / (0.485 m)³.
        let [stiffness, _] = mount.dof_modes[0].spring();
        assert!((stiffness - 7.455e5).abs() < 1e2, "{stiffness}");
        assert!((mount.mass - 2.949).abs() < 1e-3, "{}", mount.mass);
    }

    #[test]
    fn a_blade_without_thickness_is_refused_by_name() {
        let flat = TinePlan { blade: Vec3::new(0.0, 0.12, 0.07), ..plan() };
        let message = tine(&flat, 1.0, &mut Vec::new()).unwrap_err().to_string();
        assert!(message.contains("blade of \"tine 1\""), "{message}");
    }
}
