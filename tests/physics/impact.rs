//! Falling, coming to rest, rebounding (T-8), (T-15).

use crate::common::scene::{GRAVITY, SCHEDULES, Scene};
use ballast::geometry::cuboid;
use ballast::math::{Pose, Quat, Vec3};
use ballast::model::Schedule;

const EDGE: f64 = 0.1;
const HEIGHT: f64 = 0.3;
const STEPS_NS: [u64; 3] = [1_000_000, 500_000, 250_000];

/// `count` cubes on top of each other, the lowest one `HEIGHT` above the floor.
fn cubes(count: usize, step_ns: u64, schedule: Schedule) -> Scene {
    let mut scene = Scene::new(step_ns, 0.5).scheduled(schedule, [1, 1, count as u32]);
    let cube = scene.shape(cuboid(Vec3::repeat(0.5 * EDGE)));
    for k in 0..count {
        scene.grain(cube, Pose::at(Vec3::new(0.0, 0.0, HEIGHT + EDGE * (k as f64 + 0.5))));
    }
    scene.plane("floor", Pose::identity(), 0.5);
    scene
}

#[test]
fn cubes_fall_and_rest_without_rebound_nor_penetration() {
    let fall = (2.0 * HEIGHT / GRAVITY).sqrt();
    for schedule in SCHEDULES {
        for step_ns in STEPS_NS {
            let mut scene = cubes(2, step_ns, schedule);
            let mut landing = f64::INFINITY;
            while scene.state.time() < 0.6 {
                let report = scene.step();
                if report.reactions[0].contacts > 0 {
                    landing = landing.min(scene.state.time());
                }
                assert!(report.max_penetration < 1e-7, "{schedule:?}: {report:?}");
            }
            let h = scene.h();
            // The impulse of the step in which the gap closes stands for an instant inside it.
            assert!((landing - fall).abs() <= h, "{schedule:?}: at {landing} s, not {fall} s");
            for k in 0..2 {
                let z = scene.state.position[k].z;
                let expected = EDGE * (k as f64 + 0.5);
                assert!((z - expected).abs() < 1e-7, "{schedule:?}: cube {k} rests at {z}");
            }
            assert!(scene.fastest() < 1e-7, "{schedule:?}: {} m/s", scene.fastest());
        }
    }
}

/// Heights of the first `count` tops of the lower face's flight above the floor, m.
fn tops(restitution: f64, step_ns: u64, schedule: Schedule, count: usize) -> Vec<f64> {
    let mut scene = cubes(1, step_ns, schedule);
    scene.model.restitution = restitution;
    let mut tops = vec![];
    let mut before = -1.0;
    while tops.len() < count {
        let report = scene.step();
        let speed = scene.state.velocity[0].z;
        if before > 0.0 && speed <= 0.0 && report.reactions[0].contacts == 0 {
            tops.push(scene.state.position[0].z - 0.5 * EDGE);
        }
        before = speed;
        assert!(scene.state.time() < 3.0, "{schedule:?}: only {} tops", tops.len());
    }
    tops
}

#[test]
fn rebounds_reach_the_heights_of_newtons_law() {
    let restitution: f64 = 0.7;
    for schedule in SCHEDULES {
        for step_ns in STEPS_NS {
            let h = step_ns as f64 * 1e-9;
            for (n, top) in tops(restitution, step_ns, schedule, 3).into_iter().enumerate() {
                let expected = restitution.powi(2 * (n as i32 + 1)) * HEIGHT;
                // Each impact may happen up to a step's way from the floor, at most the first
                // impact's speed times h; ways and losses of n impacts add up.
                let speed = (2.0 * GRAVITY * HEIGHT).sqrt();
                let bound = 2.0 * (n as f64 + 1.0) * speed * h;
                assert!(
                    (top - expected).abs() < bound,
                    "{schedule:?}, h = {h}: top {n} at {top} m, expected {expected} ± {bound} m"
                );
            }
        }
    }
}

#[test]
fn a_perfectly_elastic_cube_keeps_bouncing_to_its_height() {
    for schedule in SCHEDULES {
        let tops = tops(1.0, 250_000, schedule, 3);
        for top in tops {
            assert!((top - HEIGHT).abs() < 0.01 * HEIGHT, "{schedule:?}: {top} m");
        }
    }
}

/// A cube at rest whose face is `gap` before a wall that faces +x, without gravity and friction.
fn before_a_wall(gap: f64, restitution: f64, schedule: Schedule) -> Scene {
    let mut scene = Scene::new(1_000_000, 0.0).scheduled(schedule, [1, 1, 1]);
    scene.model.gravity = Vec3::zeros();
    scene.model.restitution = restitution;
    let cube = scene.shape(cuboid(Vec3::repeat(0.5 * EDGE)));
    scene.grain(cube, Pose::at(Vec3::new(gap + 0.5 * EDGE, 0.0, 0.0)));
    let facing = Quat::rotation_between(&Vec3::z(), &Vec3::x()).expect("no half turn");
    scene.plane("wall", Pose { position: Vec3::zeros(), orientation: facing }, 0.0);
    scene
}

/// A wall of imposed motion approaches with the velocity of the step (T-14), not with that of the step before.
#[test]
fn a_wall_rebounds_as_it_moves_now() {
    for schedule in SCHEDULES {
        for restitution in [0.0, 0.5, 1.0] {
            // It starts beside the cube.
            let mut scene = before_a_wall(0.0, restitution, schedule);
            for _ in 0..3 {
                scene.targets[0].position.x += 1e-3;
                scene.step();
                let speed = scene.state.velocity[0].x;
                let expected = 1.0 + restitution;
                assert!((speed - expected).abs() < 1e-9, "{schedule:?}: {speed}, not {expected}");
            }
            // It stops before it is there.
            let mut scene = before_a_wall(10.8e-3, restitution, schedule);
            for step in 0..15 {
                scene.targets[0].position.x += if step < 10 { 1e-3 } else { 0.0 };
                let report = scene.step();
                assert_eq!(report.active_contacts, 0, "{schedule:?}, step {step}");
            }
            assert_eq!(scene.state.velocity[0], Vec3::zeros());
        }
    }
}

/// A column of light cubes at rest, a much heavier cube, half an edge above it, and perhaps one that
/// flies far away.
struct Struck {
    cubes: usize,
    ratio: f64,
    passes_by: bool,
}

/// Returns the energy that the heavy cube gains in steps solved to the usual tolerance, over that of its fall.
fn gained(struck: &Struck, schedule: Schedule) -> f64 {
    let mut scene = Scene::new(1_000_000, 0.5).scheduled(schedule, [1, 1, 2]);
    scene.model.solver.tolerance = Some(1.666e-4);
    scene.model.solver.max_iterations = 1000;
    let cube = scene.shape(cuboid(Vec3::repeat(0.5 * EDGE)));
    for k in 0..struck.cubes {
        scene.grain(cube, Pose::at(Vec3::z() * (EDGE * (k as f64 + 0.5))));
    }
    let above = EDGE * (struck.cubes as f64 + 1.0);
    let heavy = scene.grain(cube, Pose::at(Vec3::new(1e-3, 0.0, above)));
    scene.model.grains.mass[heavy] *= struck.ratio;
    scene.model.grains.inertia[heavy] *= struck.ratio;
    if struck.passes_by {
        let stone = scene.grain(cube, Pose::at(Vec3::new(1.0, 0.0, 2.0)));
        scene.state.velocity[stone] = Vec3::new(10.0, 0.0, 1.5);
    }
    scene.plane("floor", Pose::identity(), 0.5);
    let energy = |scene: &Scene| {
        let v = scene.state.velocity[heavy];
        scene.model.grains.mass[heavy]
            * (0.5 * v.norm_squared() + GRAVITY * scene.state.position[heavy].z)
    };
    let mut gained = 0.0;
    for _ in 0..300 {
        let before = energy(&scene);
        if scene.step().converged {
            gained += (energy(&scene) - before).max(0.0);
        }
    }
    gained / (scene.model.grains.mass[heavy] * GRAVITY * 0.5 * EDGE)
}

/// The impulses of the impact, which the next step begins with, are not taken for those of rest (T-11).
#[test]
fn no_heavy_cube_is_flung_up_in_a_step_that_counts_as_solved() {
    for schedule in SCHEDULES {
        for (cubes, ratio, passes_by) in [
            (1, 1e3, false),
            (1, 1e4, false),
            (1, 1e5, false),
            (1, 1e4, true),
            (5, 3e3, true),
            (15, 3e3, false),
            (20, 1e3, false),
        ] {
            let gained = gained(&Struck { cubes, ratio, passes_by }, schedule);
            assert!(gained < 0.03, "{schedule:?}, {cubes}, {ratio}, {passes_by}: {gained}");
        }
    }
}
