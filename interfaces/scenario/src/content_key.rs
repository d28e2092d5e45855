//! Content key of a prepared bed: equal keys mean equal beds.
//!
//! The key is a hash of everything that the preparation reads: the bed and its preparation, the sleepers, the plates that
//! stand in the bed while it is prepared, and the stepping of the run, with which the last settling runs. Fields are hashed one by one, so the key does not depend on
//! names or other formats.

use ballast::geometry::GrainShape;
use ballast::model::{ContactStiffness, Stepping};
use ballast::track::plan::{
    BedPlan, BlockPlan, FrictionPlan, GrainPlan, LoadCycles, Plan, PlateBox, PlatePlan,
    PreparationPlan, RunPlan, SieveFraction, SizeClass, SleeperPlan, StiffnessPlan, SubgradePlan,
    TrafficPlan,
};

/// Version of the preparation, raised when the same plan gives another bed: old keys then match no bed.
const VERSION: u64 = 17;

/// Returns the 128-bit content key of the bed of `plan` as 32 hexadecimal digits.
///
/// It does not depend on tines, plates of the run, tamping, duration, solver, output and the choice of tamped sleepers. It depends on the
/// time step, with which the last settling runs.
pub fn content_key(plan: &Plan) -> String {
    let mut hasher = ContentHasher::new();
    hasher.integer(VERSION);
    hasher.bed(&plan.bed);
    hasher.integer(plan.sleepers.len() as u64);
    for sleeper in &plan.sleepers {
        hasher.sleeper(sleeper);
    }
    hasher.run(&plan.run);
    if let Some(traffic) = &plan.bed.traffic {
        hasher.traffic(traffic, &plan.sleepers);
    }
    plan.plates.iter().filter(|p| p.in_preparation).for_each(|p| hasher.plate(p));
    format!("{:032x}", hasher.hash)
}

/// FNV-1a hasher, 128 bits: short, and the same on every machine. A bed cache needs no protection from attacks.
struct ContentHasher {
    hash: u128,
}

impl ContentHasher {
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

    // The patterns list every field, so that a new one cannot be forgotten here.

    fn bed(&mut self, bed: &BedPlan) {
        let BedPlan {
            size,
            seed,
            density,
            grains,
            friction,
            stiffness,
            gravity,
            preparation,
            subgrade,
            traffic: _,
        } = bed;
        self.numbers(size.iter());
        self.integer(*seed);
        self.numbers([density, gravity]);
        self.grains(grains);
        let FrictionPlan { grain, sleeper, tine: _, boundary } = friction;
        self.numbers([grain, sleeper, &boundary[0]]);
        self.stiffness(stiffness);
        self.preparation(preparation);
        self.walls(friction, stiffness);
        if let Some(SubgradePlan { modulus, damping_ratio, mass_per_area }) = subgrade {
            self.numbers([modulus, damping_ratio, mass_per_area]);
        }
    }

    /// Hashes floor and walls; nothing where they are all equal and belong to the kinds of contact above.
    fn walls(&mut self, friction: &FrictionPlan, stiffness: &StiffnessPlan) {
        let (mu, springs) = (&friction.boundary, &stiffness.boundary);
        if mu.iter().any(|m| *m != mu[0]) || springs.iter().any(|s| *s != springs[0]) {
            self.numbers(mu);
            springs.iter().for_each(|s| self.contact_stiffness(s));
        }
    }

    fn contact_stiffness(&mut self, stiffness: &ContactStiffness) {
        let ContactStiffness { normal, tangential_ratio, damping_time } = stiffness;
        self.numbers([normal, tangential_ratio, damping_time]);
    }

    /// Hashes the stiffness; nothing where all contacts are rigid, as before there was one.
    fn stiffness(&mut self, stiffness: &StiffnessPlan) {
        let StiffnessPlan { grain, sleeper, tine: _, boundary } = stiffness;
        let of_bed = [grain, sleeper, &boundary[0]];
        if of_bed.iter().any(|s| !s.is_rigid()) {
            of_bed.into_iter().for_each(|s| self.contact_stiffness(s));
        }
    }

    fn grains(&mut self, grains: &GrainPlan) {
        let GrainPlan { classes, shape, templates, stones } = grains;
        let GrainShape { elongation, flatness, vertices, angularity } = shape;
        self.integer(classes.len() as u64);
        for SizeClass { size, share, fraction } in classes {
            self.numbers([size, share]);
            if let Some(SieveFraction { sieves, mass_share }) = fraction {
                self.numbers(sieves.iter().chain([mass_share]));
            }
        }
        self.numbers(elongation.iter().chain(flatness));
        vertices.iter().for_each(|v| self.integer(u64::from(*v)));
        self.number(*angularity);
        self.integer(u64::from(*templates));
        for corners in stones {
            self.integer(corners.len() as u64);
            corners.iter().for_each(|corner| self.numbers(corner));
        }
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

    /// Hashes the traffic over the bed and the masses of the sleepers that it moves.
    fn traffic(&mut self, traffic: &TrafficPlan, sleepers: &[SleeperPlan]) {
        let TrafficPlan { load, settlement_limit } = traffic;
        let LoadCycles { cycles, max_load, min_load, frequency } = load;
        self.integer(u64::from(*cycles));
        self.numbers([max_load, min_load, frequency, settlement_limit]);
        for sleeper in sleepers {
            self.number(sleeper.mount.map_or(0.0, |mount| mount.mass));
        }
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

    fn plate(&mut self, plate: &PlatePlan) {
        let PlatePlan {
            name,
            position,
            z,
            boxes,
            friction,
            stiffness,
            mount: _,
            in_preparation: _,
            motion: _,
            vibration: _,
            load: _,
        } = plate;
        self.integer(name.len() as u64);
        self.bytes(name.as_bytes());
        self.numbers(position.iter().chain(z).chain([friction]));
        self.contact_stiffness(stiffness);
        self.integer(boxes.len() as u64);
        for PlateBox { offset, size } in boxes {
            self.numbers(offset.iter().chain(size.iter()));
        }
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
