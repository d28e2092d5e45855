//! Small models and configurations.

use ballast::detection::{Contacts, DetectionRange, Detector};
use ballast::geometry::{Polyhedron, convex_hull};
use ballast::math::{Pose, Quat, Vec3};
use ballast::model::{ContactStiffness, DrivenBody, Grains, Model, Solver, Stepping};
use ballast::motion::Motion;
use rand::RngExt;
use rand_pcg::Pcg64;

/// A model of the given shapes, one grain each.
pub fn model(shapes: Vec<Polyhedron>, driven: Vec<DrivenBody>, alert: f64) -> Model {
    let mut grains = Grains::default();
    for (s, shape) in shapes.iter().enumerate() {
        grains.push(s as u32, shape, 2700.0);
    }
    Model {
        shapes,
        grains,
        driven,
        gravity: Vec3::new(0.0, 0.0, -9.81),
        grain_friction: 0.5,
        grain_stiffness: ContactStiffness::RIGID,
        restitution: 0.0,
        stepping: Stepping { step_ns: 200_000, theta: 0.5, detection_distance: alert },
        solver: Solver::default(),
    }
}

/// A configuration of bodies at rest.
pub fn at_rest(poses: &[Pose]) -> Motion {
    let zeros = vec![Vec3::zeros(); poses.len()];
    Motion {
        position: poses.iter().map(|p| p.position).collect(),
        orientation: poses.iter().map(|p| p.orientation).collect(),
        velocity: zeros.clone(),
        angular_velocity: zeros,
        responses: vec![],
    }
}

/// Contacts of a new detector.
pub fn fresh(model: &Model, motion: &Motion) -> Contacts {
    detect(&mut Detector::default(), model, motion)
}

/// Contacts of a detector with caches of earlier calls.
pub fn detect(detector: &mut Detector, model: &Model, motion: &Motion) -> Contacts {
    let mut contacts = Contacts::default();
    let reach = DetectionRange::new(model, motion);
    detector.broad_phase(model, motion, &reach);
    detector.narrow_phase(model, motion, &reach, &mut contacts);
    contacts
}

pub fn random_unit(rng: &mut Pcg64) -> Vec3 {
    loop {
        let v = Vec3::from_fn(|_, _| rng.random_range(-1.0..1.0));
        let n: f64 = v.norm();
        if n > 0.1 && n < 1.0 {
            return v / n;
        }
    }
}

pub fn random_turn(rng: &mut Pcg64) -> Quat {
    let axis = nalgebra::Unit::new_normalize(random_unit(rng));
    Quat::from_axis_angle(&axis, rng.random_range(0.0..std::f64::consts::PI))
}

/// Hull of 8 to 40 points on a squashed sphere of about `size`.
pub fn random_hull(rng: &mut Pcg64, size: f64) -> Polyhedron {
    let count = rng.random_range(8..=40);
    let squash = Vec3::from_fn(|_, _| rng.random_range(0.4..1.0));
    loop {
        let points: Vec<Vec3> =
            (0..count).map(|_| random_unit(rng).component_mul(&squash) * size).collect();
        if let Ok((shape, _)) = convex_hull(&points) {
            return shape;
        }
    }
}
