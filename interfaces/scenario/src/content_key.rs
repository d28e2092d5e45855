//! The key under which a prepared bed is kept: equal keys, equal beds.
//!
//! A hash of everything that preparing reads: the bed and its preparation, the sleepers, and the
//! run's time step, at which the last settling runs. The bytes that are hashed are
//! written out field by field, so the key survives changes of other formats.

use ballast::geometry::GrainShape;
use ballast::model::Stepping;
use ballast::track::plan::{
    BedPlan, BlockPlan, FrictionPlan, GrainPlan, Plan, PreparationPlan, RunPlan, SizeClass,
    SleeperPlan,
};

/// Raised when the same plan is prepared into another bed: old keys then match nothing.
const VERSION: u64 = 13;

/// 128-bit key of the bed that `plan` prepares, as 32 hexadecimal digits.
///
/// Tines, tamping, duration, solver and output do not change it, nor does which sleeper is tamped.
/// The time step does: the last settling runs at that of the run.
pub fn content_key(plan: &Plan) -> String {
    let mut key = Key::new();
    key.integer(VERSION);
    key.bed(&plan.bed);
    key.integer(plan.sleepers.len() as u64);
    for sleeper in &plan.sleepers {
        key.sleeper(sleeper);
    }
    key.run(&plan.run);
    format!("{:032x}", key.hash)
}

/// FNV-1a, 128 bits: short, and the same on every machine. Nobody attacks a cache of beds.
struct Key {
    hash: u128,
}

impl Key {
    const OFFSET: u128 = 0x6c62272e07bb014262b821756295c58d;
    const PRIME: u128 = 0x0000000001000000000000000000013b;

    fn new() -> Self {
        Self { hash: Self::OFFSET }
    }

    fn bytes(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.hash = (self.hash ^ u128::from(*byte)).wrapping_mul(Self::PRIME);
        }
    }

    fn integer(&mut self, value: u64) {
        self.bytes(&value.to_le_bytes());
    }

    fn number(&mut self, value: f64) {
        // 0 and -0 prepare the same bed.
        self.integer((value + 0.0).to_bits());
    }

    fn numbers<'a>(&mut self, values: impl IntoIterator<Item = &'a f64>) {
        values.into_iter().for_each(|v| self.number(*v));
    }

    // The patterns name every field, so that a new one cannot be forgotten here.

    fn bed(&mut self, bed: &BedPlan) {
        let BedPlan { size, seed, density, grains, friction, gravity, preparation } = bed;
        self.numbers(size.iter());
        self.integer(*seed);
        self.numbers([density, gravity]);
        self.grains(grains);
        let FrictionPlan { grain, sleeper, tine: _, boundary } = friction;
        self.numbers([grain, sleeper, boundary]);
        self.preparation(preparation);
    }

    fn grains(&mut self, grains: &GrainPlan) {
        let GrainPlan { classes, shape, templates } = grains;
        let GrainShape { elongation, flatness, vertices, angularity } = shape;
        self.integer(classes.len() as u64);
        for SizeClass { size, share } in classes {
            self.numbers([size, share]);
        }
        self.numbers(elongation.iter().chain(flatness));
        vertices.iter().for_each(|v| self.integer(u64::from(*v)));
        self.number(*angularity);
        self.integer(u64::from(*templates));
    }

    fn preparation(&mut self, preparation: &PreparationPlan) {
        let PreparationPlan {
            ballast_depth,
            fill_level,
            friction,
            step_ns,
            iterations,
            rest_speed,
            max_settling,
        } = preparation;
        self.numbers([ballast_depth, fill_level, friction, rest_speed, max_settling]);
        self.integer(*step_ns);
        self.integer(u64::from(*iterations));
    }

    fn run(&mut self, run: &RunPlan) {
        let RunPlan {
            stepping: Stepping { step_ns, theta, detection_distance: alert },
            solver: _,
            restitution,
            duration_ns: _,
            output_ns: _,
            checkpoint_ns: _,
        } = run;
        self.integer(*step_ns);
        self.numbers([theta, alert, restitution]);
    }

    fn sleeper(&mut self, sleeper: &SleeperPlan) {
        let SleeperPlan { name, centre, blocks, tamped: _, mount: _ } = sleeper;
        self.integer(name.len() as u64);
        self.bytes(name.as_bytes());
        self.numbers(centre);
        self.integer(blocks.len() as u64);
        for BlockPlan { offset_y, size } in blocks {
            self.number(*offset_y);
            self.numbers(size.iter());
        }
    }
}
