//! Stones of the laboratory tests, and specimens of them.
//!
//! One kind of stones, one friction and one stiffness, chosen before the tests and used by all of them.

use super::world::{D, World, in_box, random, stack_spheres};
use ballast::geometry::{GrainShape, random_grain};
use ballast::math::Vec3;
use ballast::model::{ContactStiffness, DofMode, Mount, Solver};
use ballast_session::Result;
use rand::RngExt;

/// Shape of the stones, with flat and long ones among them as in quarried ballast.
pub const STONE_SHAPE: GrainShape = GrainShape {
    vertices: [7, 14],
    elongation: [0.72, 0.20],
    flatness: [0.70, 0.25],
    angularity: 0.8,
};
/// Smallest and largest diameter of the sphere of equal volume, m; each ratio of sizes has the same share of the mass.
const SIZES: [f64; 2] = [0.025, 0.050];
/// Friction between stones.
pub const STONE_FRICTION: f64 = 0.55;
/// Friction between stones and steel.
pub const STEEL_FRICTION: f64 = 0.3;
/// Stiffness of all contact points.
pub const STIFFNESS: ContactStiffness =
    ContactStiffness { normal: 5e6, tangential_ratio: 1.0, damping_time: 1e-3 };
/// Solid fraction of the specimens: 15.4 kN/m³, as in the experiments, over a density of the rock of 2700 kg/m³.
pub const SOLID_FRACTION: f64 = 0.58;
/// Time step of the tests, ns.
pub const STEP_NS: u64 = 1_000_000;

/// Number of steps in a row in which a plate must carry its force to end the compaction.
const CARRYING_STEPS: usize = 10;
/// Solid fraction of the suspension from which a specimen is compacted.
const SUSPENDED_FRACTION: f64 = 0.38;
/// Speed of the plate that compacts a specimen, m/s.
const COMPACTION_SPEED: f64 = 0.2;
/// Mass of a loaded plate, kg.
const PLATE_MASS: f64 = 15.0;
/// Mean speed of stones at rest, m/s.
const REST_SPEED: f64 = 2e-4;

/// Returns the mount of a loaded plate that moves along an axis only; prescribed until it is released.
pub fn plate() -> Mount {
    Mount {
        mass: PLATE_MASS,
        inertia: Vec3::zeros(),
        centre: Vec3::zeros(),
        dof_modes: [DofMode::Prescribed; 6],
    }
}

/// Creates a scene with a loose column of stones above a base `[x, y]` (m), enough for a specimen of a height (m).
pub fn column(base: [f64; 2], height: f64, seed: u64) -> Result<World> {
    let mut world = World::new(2 * STEP_NS, 0.0, 0.05 * D);
    world.model.solver = Solver {
        max_iterations: 200,
        tolerance: Some(1e-3),
        force_check_interval: 0,
        ..Solver::default()
    };
    world.model.grain_stiffness = STIFFNESS;
    world.wall_stiffness = STIFFNESS;
    let mut rng = random(seed);
    let mut missing = SOLID_FRACTION * base[0] * base[1] * height;
    let mut stones = vec![];
    while missing > 0.0 {
        // Equal shares of mass for equal ratios: the number density falls with the fourth power of the size.
        let [low, high] = SIZES.map(|d| d.powi(-3));
        let size = (high + (low - high) * rng.random::<f64>()).powf(-1.0 / 3.0);
        let stone = random_grain(&mut rng, &STONE_SHAPE, size)?;
        missing -= stone.volume;
        let radius = stone.radius;
        stones.push((world.shape(stone), radius));
    }
    stack_spheres(&mut world, &mut rng, &stones, 12, in_box(base));
    Ok(world)
}

/// Compacts the stones above a base of `area` (m²) without friction by the driven body `lid`, until it is at a height (m) or
/// carries a force (N), and gives stones and driven bodies their friction.
pub fn compact(world: &mut World, lid: usize, area: f64, height: f64, force: f64) -> Result {
    let friction: Vec<f64> = world.model.driven.iter().map(|body| body.friction).collect();
    world.model.driven.iter_mut().for_each(|body| body.friction = 0.0);
    world.suspend(area, SUSPENDED_FRACTION)?;
    let n = world.model.grains.len();
    let top = (0..n).flat_map(|i| world.corners(i)).map(|p| p.z).fold(height, f64::max);
    world.place(lid, Vec3::z() * (top + 1e-3));
    world.model.stepping.step_ns = STEP_NS;
    let h = world.model.stepping.h();
    let mut carrying = 0;
    while world.targets[lid].position.z > height && carrying < CARRYING_STEPS {
        let z = world.targets[lid].position.z - COMPACTION_SPEED * h;
        world.targets[lid].position.z = z.max(height);
        let carries = world.step()?.reactions[lid].impulse.z > force * h;
        carrying = if carries { carrying + 1 } else { 0 };
    }
    world.model.grain_friction = STONE_FRICTION;
    world.model.driven.iter_mut().zip(friction).for_each(|(body, mu)| body.friction = mu);
    Ok(())
}

/// Releases a plate along an axis (0 to 2).
pub fn release(world: &mut World, plate: usize, axis: usize) {
    let mount = world.model.driven[plate].mount.as_mut().expect("a plate has a mount");
    mount.dof_modes[axis] = DofMode::Free;
}

/// Takes steps until the stones are at rest, at most a second.
pub fn rest(world: &mut World) -> Result {
    let most = (1.0 / world.model.stepping.h()) as usize;
    for k in 0..most {
        world.step()?;
        if k > most / 10 && world.mean_speed() < REST_SPEED {
            break;
        }
    }
    Ok(())
}

/// Weight of a loaded plate, N.
pub const PLATE_WEIGHT: f64 = PLATE_MASS * super::world::GRAVITY;
