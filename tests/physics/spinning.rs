//! No blow on fixed bodies raises the energy of a body without restitution, at any angular velocity (T-41).

use crate::common::scene::{Random, Scene};
use ballast::geometry::{GrainShape, Polyhedron, cuboid, random_grain};
use ballast::math::{Pose, Vec3};
use rand::SeedableRng;
use rand_pcg::Pcg64;

/// Kinetic energy of a body that starts with an angular velocity between two floors, over that at the start: after each step
/// in which it touches, and the largest in flight.
fn energies(
    shape: Polyhedron,
    angular_velocity: Vec3,
    step_ns: u64,
    random: &mut Random,
) -> Vec<f64> {
    let mut scene = Scene::new(step_ns, 0.5);
    scene.model.gravity = Vec3::zeros();
    scene.model.stepping.detection_distance = 1e-3;
    let height = 0.5 * shape.radius;
    let shape = scene.shape(shape);
    let orientation = random.orientation();
    scene.grain(shape, Pose { position: Vec3::zeros(), orientation });
    let up = Pose::at(Vec3::new(0.0, 0.0, -height));
    let down = ballast::math::rotation::exp(&(Vec3::x() * std::f64::consts::PI));
    scene.plane("floor", up, 0.5);
    scene.plane(
        "ceiling",
        Pose { position: Vec3::new(0.0, 0.0, 3.0 * height), orientation: down },
        0.5,
    );
    scene.state.angular_velocity[0] = angular_velocity;
    let mut start = 0.0;
    let mut found = vec![];
    for _ in 0..125 {
        scene.step();
        let energy = &scene.state.energy;
        if start == 0.0 {
            start = energy.initial_kinetic;
        }
        found.push(energy.kinetic / start);
    }
    found
}

#[test]
fn blows_raise_no_energy_at_any_angular_velocity() {
    let mut random = Random(3);
    let stone =
        random_grain(&mut Pcg64::seed_from_u64(2), &GrainShape::default(), 0.04).expect("a stone");
    let mut worst = [0.0_f64; 2];
    for i in 0..200_usize {
        let shape = match i % 4 {
            0 => cuboid(Vec3::new(0.2, 0.005, 0.005)),
            1 => cuboid(Vec3::new(0.05, 0.04, 0.003)),
            2 => cuboid(Vec3::new(0.06, 0.03, 0.015)),
            _ => stone.clone(),
        };
        let speed = 10f64.powf(1.0 + 2.3 * random.next());
        let step_ns = [200_000, 800_000, 1_000_000][i % 3];
        let slenderness = (shape.unit_inertia.max() / shape.unit_inertia.min()).sqrt();
        let is_far = speed * slenderness * step_ns as f64 * 1e-9 > 0.1;
        let found = energies(shape, random.direction() * speed, step_ns, &mut random);
        let highest = found.iter().copied().fold(0.0, f64::max);
        worst[usize::from(is_far)] = worst[usize::from(is_far)].max(highest);
    }
    // Below the bound of (T-41), the energy of free rotation errs with the square of the step.
    let [near, far] = worst;
    assert!(near <= 1.0 + 1.5e-5, "{near}");
    assert!(far <= 1.0 + 1e-9, "{far}");
}
