//! A tine as a driven body: a blade below a shaft, as boxes or as convex parts.
//!
//! Reads: a tine's plan. Writes: the body, and its shapes if the model does not have them yet.
//! Contract: the body's origin, to which its wrench refers, is the middle of the blade's upper edge.

use super::shape::{cuboid, part, solid};
use crate::error::{Error, Result};
use crate::geometry::{AxisBox, Polyhedron, convex_hull};
use crate::math::Vec3;
use crate::model::{ContactStiffness, DrivenBody, Mount, Role};
use crate::track::plan::{TinePlan, TineShape};

/// Depth below the reference point down to which a part belongs to the shaft, m: tolerance of the level at which a blade begins.
const MIN_BLADE_DEPTH: f64 = 1e-3;

/// The driven body of a tine; its shapes are appended to `shapes` unless they are there already.
///
/// # Errors
/// Sizes and corners that make no solid, and parts of which none is below the reference point.
pub fn tine(plan: &TinePlan, friction: f64, shapes: &mut Vec<Polyhedron>) -> Result<DrivenBody> {
    let parts = match &plan.shape {
        TineShape::Boxes { blade, shaft } => {
            let blade = solid(blade, || format!("blade of {:?}", plan.name))?;
            let shaft = solid(shaft, || format!("shaft of {:?}", plan.name))?;
            let below = Vec3::new(0.0, 0.0, -0.5 * blade.z);
            let above = Vec3::new(0.0, 0.0, 0.5 * shaft.z);
            vec![cuboid(shapes, &blade, below), cuboid(shapes, &shaft, above)]
        }
        TineShape::Parts(parts) => {
            // Written so that NaN is refused, too.
            if !(plan.shape.blade_bounds().low.z < 0.0) {
                return Err(Error::Model {
                    place: format!("tine {:?}", plan.name),
                    expected: "a part below its reference point".into(),
                    found: format!("{} parts above it", parts.len()),
                });
            }
            let convex = |corners: &Vec<Vec3>| {
                let facing = corners.iter().map(|c| Vec3::new(plan.direction * c.x, c.y, c.z));
                let (shape, pose) =
                    convex_hull(&facing.collect::<Vec<_>>()).map_err(|e| Error::Model {
                        place: format!("a part of tine {:?}", plan.name),
                        expected: "corners of a convex part".into(),
                        found: e.to_string(),
                    })?;
                Ok(part(shapes, shape, pose))
            };
            parts.iter().map(convex).collect::<Result<_>>()?
        }
    };
    Ok(DrivenBody {
        name: plan.name.clone(),
        role: Role::Tine,
        friction,
        stiffness: ContactStiffness::RIGID,
        parts,
        mount: plan.mount,
    })
}

impl TineShape {
    /// Returns the bounding box about the reference point of a tine that squeezes towards +x, m.
    pub fn bounds(&self) -> AxisBox {
        match self {
            Self::Boxes { blade, shaft } => box_about(blade.sup(shaft), -blade.z, shaft.z),
            Self::Parts(parts) => AxisBox::around(parts.iter().flatten().copied()),
        }
    }

    /// Returns the bounding box of the blade alone, which is all below the reference point, m.
    pub fn blade_bounds(&self) -> AxisBox {
        match self {
            Self::Boxes { blade, .. } => box_about(*blade, -blade.z, 0.0),
            Self::Parts(parts) => AxisBox::around(parts.iter().flat_map(|p| below(p))),
        }
    }
}

fn box_about(size: Vec3, low: f64, high: f64) -> AxisBox {
    let half = size * 0.5;
    AxisBox { low: Vec3::new(-half.x, -half.y, low), high: Vec3::new(half.x, half.y, high) }
}

impl TinePlan {
    /// Returns the bounding box about the reference point, m.
    pub fn bounds(&self) -> AxisBox {
        self.facing(self.shape.bounds())
    }

    /// Returns the bounding box of the blade, which is all below the reference point, m.
    pub fn blade_bounds(&self) -> AxisBox {
        self.facing(self.shape.blade_bounds())
    }

    /// Mirrors a box if the tine squeezes towards -x.
    fn facing(&self, AxisBox { low, high }: AxisBox) -> AxisBox {
        let [a, b] = [low.x, high.x].map(|x| self.direction * x);
        AxisBox {
            low: Vec3::new(a.min(b), low.y, low.z),
            high: Vec3::new(a.max(b), high.y, high.z),
        }
    }
}

/// Corners of the lower piece of a convex part that is cut at z = 0; none of a part that belongs to the shaft.
fn below(corners: &[Vec3]) -> Vec<Vec3> {
    let (mut lower, upper): (Vec<Vec3>, Vec<Vec3>) =
        corners.iter().copied().partition(|c| c.z <= 0.0);
    if lower.iter().all(|c| c.z > -MIN_BLADE_DEPTH) {
        return Vec::new();
    }
    for i in 0..lower.len() {
        let a = lower[i];
        lower.extend(upper.iter().map(|b| a + (b - a) * (a.z / (a.z - b.z))));
    }
    lower
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

    const BLADE: Vec3 = Vec3::new(0.022, 0.12, 0.07);
    const SHAFT: Vec3 = Vec3::new(0.03, 0.06, 0.45);

    fn plan() -> TinePlan {
        TinePlan {
            name: "tine 1".into(),
            position: [0.1, 0.2],
            direction: 1.0,
            pair: 0,
            shape: TineShape::Boxes { blade: BLADE, shaft: SHAFT },
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
        let mount = steel_cantilever(&BLADE, &SHAFT);
        // 3 · 210 GPa · 1.35e-7 m⁴ / (0.485 m)³.
        let [stiffness, _] = mount.dof_modes[0].spring();
        assert!((stiffness - 7.455e5).abs() < 1e2, "{stiffness}");
        assert!((mount.mass - 2.949).abs() < 1e-3, "{}", mount.mass);
    }

    #[test]
    fn a_blade_without_thickness_is_refused_by_name() {
        let blade = Vec3::new(0.0, 0.12, 0.07);
        let flat = TinePlan { shape: TineShape::Boxes { blade, shaft: SHAFT }, ..plan() };
        let message = tine(&flat, 1.0, &mut Vec::new()).unwrap_err().to_string();
        assert!(message.contains("blade of \"tine 1\""), "{message}");
    }

    /// Corners of the box between two opposite corners.
    fn corners(low: [f64; 3], high: [f64; 3]) -> Vec<Vec3> {
        let ends = [low, high];
        let at = |i: usize, k: usize| ends[i >> k & 1][k];
        (0..8).map(|i| Vec3::new(at(i, 0), at(i, 1), at(i, 2))).collect()
    }

    fn with_parts(parts: Vec<Vec<Vec3>>, direction: f64) -> TinePlan {
        TinePlan { shape: TineShape::Parts(parts), direction, ..plan() }
    }

    #[test]
    fn parts_that_are_blade_and_shaft_are_the_boxes() {
        let parts = vec![
            corners([-0.011, -0.06, -0.07], [0.011, 0.06, 0.0]),
            corners([-0.015, -0.03, 0.0], [0.015, 0.03, 0.45]),
        ];
        let (mut boxes, mut shapes) = (Vec::new(), Vec::new());
        let expected = tine(&plan(), 1.0, &mut boxes).unwrap();
        let found = tine(&with_parts(parts.clone(), 1.0), 1.0, &mut shapes).unwrap();
        for (a, b) in expected.parts.iter().zip(&found.parts) {
            let ((low, high), (low_b, high_b)) = (extent(&boxes, a), extent(&shapes, b));
            assert!((low - low_b).norm() < 1e-15 && (high - high_b).norm() < 1e-15);
        }
        for direction in [1.0, -1.0] {
            let plan = with_parts(parts.clone(), direction);
            assert_eq!(plan.bounds(), self::plan().bounds());
            assert_eq!(plan.blade_bounds(), self::plan().blade_bounds());
        }
    }

    #[test]
    fn the_facing_tine_is_the_mirror_image() {
        // A wedge through the level of the reference point, thinner and farther to +x below.
        let mut wedge = corners([-0.02, 0.01, -0.08], [0.03, 0.05, 0.08]);
        wedge.iter_mut().filter(|c| c.z < 0.0 && c.x < 0.0).for_each(|c| c.x = 0.01);
        let [plus, minus] = [1.0, -1.0].map(|d| with_parts(vec![wedge.clone()], d));
        let low = Vec3::new(-0.005, 0.01, -0.08);
        assert!((plus.blade_bounds().low - low).norm() < 1e-15, "half way up the slope");
        assert_eq!(plus.blade_bounds().high, Vec3::new(0.03, 0.05, 0.0));
        let mirrored = |b: AxisBox| AxisBox {
            low: Vec3::new(-b.high.x, b.low.y, b.low.z),
            high: Vec3::new(-b.low.x, b.high.y, b.high.z),
        };
        assert_eq!(minus.blade_bounds(), mirrored(plus.blade_bounds()));
        assert_eq!(minus.bounds(), mirrored(plus.bounds()));
        let mut shapes = Vec::new();
        for plan in [&plus, &minus] {
            let body = tine(plan, 1.0, &mut shapes).unwrap();
            let (low, high) = extent(&shapes, &body.parts[0]);
            let AxisBox { low: low_b, high: high_b } = plan.bounds();
            assert!((low - low_b).norm() < 1e-15 && (high - high_b).norm() < 1e-15);
        }
        assert!((shapes[0].volume / shapes[1].volume - 1.0).abs() < 1e-12);
    }

    #[test]
    fn parts_without_a_blade_or_without_a_volume_are_refused() {
        let shaft = corners([-0.01, -0.01, 0.0], [0.01, 0.01, 0.1]);
        let message =
            |parts| tine(&with_parts(parts, 1.0), 1.0, &mut Vec::new()).unwrap_err().to_string();
        assert!(message(vec![shaft]).contains("below its reference point"));
        let flat = corners([-0.01, 0.0, -0.1], [0.01, 0.0, 0.1]);
        assert!(message(vec![flat]).contains("a part of tine \"tine 1\""));
    }
}
