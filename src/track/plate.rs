//! A plate as a driven body of boxes: lid, piston, part of a shear box, vibrating wall.
//!
//! Reads: a plate's plan, the bed. Writes: the body, and its shapes if the model does not have them yet.
//! Contract: the body's origin, to which its wrench refers, is the reference point of its boxes. A plate never starts in a
//! grain or in another body.

use super::settle::BedBuilder;
use super::shape::{cuboid, cuboid_mount, overlaps, solid};
use crate::error::{Error, Result};
use crate::geometry::{AxisBox, Clipper, Polyhedron};
use crate::math::{Pose, Vec3};
use crate::model::{DofMode, DrivenBody, Model, Mount, Part, Role};
use crate::state::State;
use crate::track::plan::{Plan, PlateBox, PlatePlan};

/// Density of steel, kg/m³.
const STEEL: f64 = 7850.0;

/// Mount of a plate whose boxes have one density, that of steel if its mass (kg) is not given.
///
/// Moments of inertia are those about the body's axes: products of inertia are left out.
pub fn plate_mount(boxes: &[PlateBox], mass: Option<f64>, dof_modes: [DofMode; 6]) -> Mount {
    let cuboids: Vec<_> = boxes.iter().map(|b| (b.offset, b.size)).collect();
    cuboid_mount(&cuboids, STEEL, mass, dof_modes)
}

/// The driven body of a plate without its mount; its shapes are appended to `shapes` unless they are there already.
///
/// # Errors
/// A plate without boxes, and sizes that make no solid.
pub(super) fn plate(
    plan: &PlatePlan,
    friction: f64,
    shapes: &mut Vec<Polyhedron>,
) -> Result<DrivenBody> {
    if plan.boxes.is_empty() {
        return Err(refused(plan, "one box or more", "none".into()));
    }
    let mut parts = Vec::with_capacity(plan.boxes.len());
    for (i, part) in plan.boxes.iter().enumerate() {
        let size = solid(&part.size, || format!("box {} of {:?}", i + 1, plan.name))?;
        parts.push(cuboid(shapes, &size, part.offset));
    }
    Ok(DrivenBody {
        name: plan.name.clone(),
        role: Role::Plate,
        friction,
        stiffness: plan.stiffness,
        parts,
        mount: None,
    })
}

/// Refuses motions and loads that are no functions of time.
pub(super) fn check_program(plan: &PlatePlan) -> Result<()> {
    for (name, knots) in [("motion", &plan.motion), ("load", &plan.load)] {
        let is_sorted = knots.windows(2).all(|pair| pair[0].time_ns < pair[1].time_ns);
        if !is_sorted || knots.iter().any(|knot| !knot.value.iter().all(|x| x.is_finite())) {
            let expected = format!("a {name} of finite numbers in order of time");
            return Err(refused(plan, &expected, format!("{knots:?}")));
        }
    }
    Ok(())
}

/// Returns the boxes of a plate whose reference point is `at`, world.
pub fn plate_boxes(plan: &PlatePlan, at: Vec3) -> impl Iterator<Item = AxisBox> {
    plan.boxes.iter().map(move |b| {
        let (middle, half) = (at + b.offset, b.size * 0.5);
        AxisBox { low: middle - half, high: middle + half }
    })
}

/// The boxes of all plates that stand in the bed while it is prepared, world.
pub(super) fn standing_boxes(plan: &Plan) -> impl Iterator<Item = AxisBox> {
    let standing = plan.plates.iter().filter(|p| p.in_preparation);
    standing.flat_map(|p| plate_boxes(p, planned_position(p)))
}

/// Puts the plates that stand in the bed while it is prepared into the empty box.
///
/// # Errors
/// A plate without height or boxes; traffic over a bed with such plates.
pub(super) fn place_standing(plan: &Plan, builder: &mut BedBuilder) -> Result<()> {
    for p in plan.plates.iter().filter(|p| p.in_preparation) {
        if p.z.is_none() {
            return Err(refused(p, "a height, if it stands in the bed", "none".into()));
        }
        if plan.bed.traffic.is_some() {
            // Traffic moves the settled bed up, which would shear it along the plate.
            return Err(refused(p, "a bed without traffic, if it stands in it", "traffic".into()));
        }
        let friction = p.friction.min(plan.bed.preparation.friction);
        let body = plate(p, friction, &mut builder.model.shapes)?;
        builder.model.driven.push(body);
        builder.state.push(Pose::at(planned_position(p)));
    }
    Ok(())
}

/// Returns the pose at which a plate of the run starts: at its height of the plan, or lowered onto the grains. In a bed without
/// grains, which stands for the case before its preparation, a lowered plate is at `fill_level` (m).
///
/// # Errors
/// A plate that reaches into a grain or another body there, or that has no grain below it to be lowered onto.
pub(super) fn start_pose(
    plan: &PlatePlan,
    fill_level: f64,
    model: &Model,
    state: &State,
) -> Result<Pose> {
    if plan.z.is_none() && model.grains.is_empty() {
        return Ok(Pose::at(planned_position(plan) + Vec3::z() * fill_level));
    }
    let at = Vec3::new(plan.position[0], plan.position[1], start_height(plan, model, state)?);
    check_grains(plan, at, model, state)?;
    check_bodies(plan, at, model, state)?;
    Ok(Pose::at(at))
}

/// Refuses a plate with a grain in its boxes, its reference point being `at`.
fn check_grains(plan: &PlatePlan, at: Vec3, model: &Model, state: &State) -> Result<()> {
    let boxes: Vec<AxisBox> = plate_boxes(plan, at).collect();
    let mut clipper = Clipper::default();
    let mut is_met = |g: usize| {
        let (shape, pose) = (&model.shapes[model.grains.shape[g] as usize], state.pose(g));
        boxes.iter().any(|part| overlaps(&mut clipper, shape, &pose, part))
    };
    let met = (0..model.grains.len()).filter(|g| is_met(*g)).count();
    if met == 0 {
        return Ok(());
    }
    let expected = "a place clear of the grains: another height, none in the case to be lowered onto them, or in the bed while \
                    it is prepared";
    Err(refused(plan, expected, format!("{met} grains in it, at z = {} m", at.z)))
}

/// Refuses a plate with a part of another driven body in its boxes, its reference point being `at`.
pub(super) fn check_bodies(plan: &PlatePlan, at: Vec3, model: &Model, state: &State) -> Result<()> {
    let boxes: Vec<AxisBox> = plate_boxes(plan, at).collect();
    let mut clipper = Clipper::default();
    for (d, other) in model.driven.iter().enumerate().filter(|(_, d)| d.name != plan.name) {
        for part in &other.parts {
            let Part::Convex { shape, pose } = part else { continue };
            let pose = state.pose(model.grains.len() + d).then(pose);
            let shape = &model.shapes[*shape as usize];
            if boxes.iter().any(|part| overlaps(&mut clipper, shape, &pose, part)) {
                let found = format!("{:?} in it, at z = {} m", other.name, at.z);
                return Err(refused(plan, "a place clear of all other bodies", found));
            }
        }
    }
    Ok(())
}

/// Returns the position of the plan, m; at z = 0 without a height.
pub(super) fn planned_position(plan: &PlatePlan) -> Vec3 {
    Vec3::new(plan.position[0], plan.position[1], plan.z.unwrap_or(0.0))
}

/// Returns the height of the reference point where the plate starts, m: without one in the plan, the highest grain below
/// touches it.
fn start_height(plan: &PlatePlan, model: &Model, state: &State) -> Result<f64> {
    if let Some(z) = plan.z {
        return Ok(z);
    }
    let grains = (0..model.grains.len()).map(|g| {
        let pose = state.pose(g);
        let shape = &model.shapes[model.grains.shape[g] as usize];
        AxisBox::around(shape.vertices.iter().map(|v| pose.point(v)))
    });
    let grains: Vec<AxisBox> = grains.collect();
    let is_over = |part: &AxisBox, grain: &AxisBox| {
        (0..2).all(|k| part.low[k] < grain.high[k] && grain.low[k] < part.high[k])
    };
    let heights = plate_boxes(plan, planned_position(plan)).flat_map(|part| {
        let below = grains.iter().filter(move |grain| is_over(&part, grain));
        below.map(move |grain| grain.high.z - part.low.z)
    });
    let height = heights.fold(f64::NEG_INFINITY, f64::max);
    if height.is_finite() {
        return Ok(height);
    }
    Err(refused(plan, "grains below it, onto which it is lowered, or a height", "none".into()))
}

fn refused(plan: &PlatePlan, expected: &str, found: String) -> Error {
    Error::Model { place: format!("plate {:?}", plan.name), expected: expected.into(), found }
}

#[cfg(test)]
#[path = "plate_tests.rs"]
mod tests;
