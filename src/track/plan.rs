//! Plan of a scenario as plain numbers. `interfaces/scenario` reads files into it.
//!
//! SI units throughout. x runs along the track, y across it, z up; the box of the bed spans
//! `[0, box[0]] × [0, box[1]]`, its floor is z = 0.

mod plate;

use crate::geometry::GrainShape;
use crate::math::Vec3;
use crate::model::{ContactStiffness, DrivenBody, Model, Mount, Role, Solver, Stepping};
use crate::track::boundary::BOUNDARY_NAMES;
pub use plate::{PlateBox, PlatePlan, PlateVibration, VectorKnot};
use std::f64::consts::FRAC_PI_6;

/// A whole scenario: the bed, what stands in it, the machine's motion, and how it is run.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Name of the scenario.
    pub name: String,
    /// Bed and its preparation.
    pub bed: BedPlan,
    /// Sleepers in the bed.
    pub sleepers: Vec<SleeperPlan>,
    /// Tines of the machine.
    pub tines: Vec<TinePlan>,
    /// Plates in and on the bed.
    pub plates: Vec<PlatePlan>,
    /// Motion of the machine; `None`: no tamping, the bed just rests.
    pub tamping: Option<TampingPlan>,
    /// Settings of the run and its output.
    pub run: RunPlan,
}

impl Plan {
    /// True if only the prepared bed shows where some of the bodies start.
    pub fn has_lowered_plates(&self) -> bool {
        self.plates.iter().any(|plate| plate.z.is_none())
    }
}

/// The bed and how it is prepared (`deposit`).
#[derive(Debug, Clone, PartialEq)]
pub struct BedPlan {
    /// Inner size of the box, m.
    pub size: Vec3,
    /// Seed of the random shapes and positions of grains.
    pub seed: u64,
    /// Density of the stone, kg/m³.
    pub density: f64,
    /// Sizes and shapes of the grains.
    pub grains: GrainPlan,
    /// Friction coefficients of the run.
    pub friction: FrictionPlan,
    /// Stiffness of the contacts of grains with each kind of partner.
    pub stiffness: StiffnessPlan,
    /// Acceleration of gravity, downwards, m/s².
    pub gravity: f64,
    /// Settings of pouring and settling.
    pub preparation: PreparationPlan,
    /// Soil under the floor; `None`: a rigid floor.
    pub subgrade: Option<SubgradePlan>,
    /// Traffic over the bed after it has been poured; `None`: a bed that has carried nothing.
    pub traffic: Option<TrafficPlan>,
}

/// Soil under the floor: springs and dampers spread over its area (Winkler foundation). The floor moves vertically, without
/// tilting.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SubgradePlan {
    /// Modulus of subgrade reaction: pressure over settlement, N/m³.
    pub modulus: f64,
    /// Damping over critical damping.
    pub damping_ratio: f64,
    /// Mass of soil that moves with the floor, per area, kg/m².
    pub mass_per_area: f64,
}

/// Share of a prepared bed up to its fill level that is stone, sleepers and walls included; for estimates only.
pub const EXPECTED_COMPACTNESS: f64 = 0.54;

impl BedPlan {
    /// Number of grains of the prepared bed, to within some tenths; how many there are is found by pouring them.
    pub fn expected_grains(&self) -> f64 {
        let volume = self.size.x * self.size.y * self.preparation.fill_level;
        EXPECTED_COMPACTNESS * volume / self.grains.mean_volume()
    }
}

/// Ballast grains: random ones, or given stones.
#[derive(Debug, Clone, PartialEq)]
pub struct GrainPlan {
    /// Size classes; their shares by number sum to 1. Either all of them or none are spread between sieves.
    pub classes: Vec<SizeClass>,
    /// Parameters of the random shapes.
    pub shape: GrainShape,
    /// Number of different shapes, shared over the classes.
    pub templates: u32,
    /// Corners of each given stone, in any unit; scaled to the sizes of the grains. Empty: random shapes.
    pub stones: Vec<Vec<Vec3>>,
}

impl GrainPlan {
    /// Mean size of the grains by number, m.
    pub fn mean_size(&self) -> f64 {
        let shares: f64 = self.classes.iter().map(|c| c.share).sum();
        self.classes.iter().map(|c| c.share * c.size).sum::<f64>() / shares
    }

    /// Mean volume of the grains by number, m³.
    pub fn mean_volume(&self) -> f64 {
        let shares: f64 = self.classes.iter().map(|c| c.share).sum();
        FRAC_PI_6 * self.classes.iter().map(|c| c.share * c.size.powi(3)).sum::<f64>() / shares
    }

    /// Size of the smallest grains, m; between sieves it is an estimate.
    pub fn min_size(&self) -> f64 {
        self.classes.iter().map(|c| c.size_range()[0]).fold(f64::INFINITY, f64::min)
    }

    /// Size of the largest grains, m; between sieves it is an estimate.
    pub fn max_size(&self) -> f64 {
        self.classes.iter().map(|c| c.size_range()[1]).fold(0.0, f64::max)
    }
}

/// Sieve size over nominal size, mean over random grains of the default shape; for estimates only.
const SIEVE_RATIO: f64 = 0.93;

/// One size class.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SizeClass {
    /// Nominal size, m: diameter of the sphere of equal volume; between sieves an estimate of the mean.
    pub size: f64,
    /// Share by number; between sieves an estimate.
    pub share: f64,
    /// Sieves between which the grains are spread; `None`: all grains have the nominal size.
    pub fraction: Option<SieveFraction>,
}

impl SizeClass {
    /// Creates a class of grains of one size (m) with its share by number.
    pub fn of_size(size: f64, share: f64) -> Self {
        Self { size, share, fraction: None }
    }

    /// Nominal sizes of the smallest and the largest grains, m.
    fn size_range(&self) -> [f64; 2] {
        self.fraction.map_or([self.size; 2], |f| f.sieves.map(|sieve| sieve / SIEVE_RATIO))
    }
}

/// Grains between two sieves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SieveFraction {
    /// Size of the square holes that retain and that pass all grains, m.
    pub sieves: [f64; 2],
    /// Share by mass.
    pub mass_share: f64,
}

/// Returns the size classes of a sieve curve: sizes of square holes (m, ascending) and the shares by mass that pass,
/// from 0 to 1. Fractions without grains are left out.
pub fn classes_of_grading(curve: &[[f64; 2]]) -> Vec<SizeClass> {
    let mut classes = Vec::new();
    for points in curve.windows(2) {
        let ([low, below], [high, passing]) = (points[0], points[1]);
        let mass_share = passing - below;
        if mass_share > 0.0 {
            let size = (low * high).sqrt() / SIEVE_RATIO;
            let fraction = Some(SieveFraction { sieves: [low, high], mass_share });
            classes.push(SizeClass { size, share: mass_share / (size * size * size), fraction });
        }
    }
    let total: f64 = classes.iter().map(|c| c.share).sum();
    classes.iter_mut().for_each(|c| c.share /= total);
    classes
}

/// Values of the contacts of grains with each kind of partner.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PartnerValues<T> {
    /// Value between two grains.
    pub grain: T,
    /// Value between grain and sleeper.
    pub sleeper: T,
    /// Value between grain and tine.
    pub tine: T,
    /// Values between grain and floor or wall, in the order of [`BOUNDARY_NAMES`].
    pub boundary: [T; 5],
}

/// Coulomb friction coefficients; 0 at a wall makes it a plane of symmetry.
pub type FrictionPlan = PartnerValues<f64>;

/// Stiffness of the contacts.
pub type StiffnessPlan = PartnerValues<ContactStiffness>;

impl<T: Copy> PartnerValues<T> {
    /// Returns the value of the contacts of grains with a driven body; `None` for a plate, which has values of the plate.
    fn of(&self, body: &DrivenBody) -> Option<T> {
        match body.role {
            Role::Boundary => {
                let place = BOUNDARY_NAMES.iter().position(|name| *name == body.name);
                Some(self.boundary[place.unwrap_or(0)])
            }
            Role::Sleeper => Some(self.sleeper),
            Role::Tine => Some(self.tine),
            Role::Plate => None,
        }
    }
}

impl StiffnessPlan {
    /// Sets the stiffness of all contacts of a model but those with plates.
    pub(super) fn apply(&self, model: &mut Model) {
        model.grain_stiffness = self.grain;
        for body in &mut model.driven {
            body.stiffness = self.of(body).unwrap_or(body.stiffness);
        }
    }
}

/// Settings of pouring and settling the bed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PreparationPlan {
    /// Level of the sleepers' underside after preparation, m.
    pub ballast_depth: f64,
    /// Level up to which cribs are filled, m.
    pub fill_level: f64,
    /// Grain friction while pouring and settling.
    pub friction: f64,
    /// Time step while pouring and settling, ns.
    pub step_ns: u64,
    /// Maximum number of iterations of a step while pouring and settling.
    pub iterations: u32,
    /// Rest is reached below this mean grain speed, m/s.
    pub rest_speed: f64,
    /// Longest settling of each stage, s of simulated time.
    pub max_settling: f64,
}

/// Traffic over a bed before the run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrafficPlan {
    /// Load on each sleeper; its number of cycles is the maximum.
    pub load: LoadCycles,
    /// Settlement of a cycle below which the traffic ends, m; 0: after all cycles.
    pub settlement_limit: f64,
}

/// Vertical load cycles on each sleeper.
///
/// The load follows a cosine between its smallest and largest value; the first rise begins at zero, and after the last fall
/// the smallest load is taken off.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LoadCycles {
    /// Number of load cycles.
    pub cycles: u32,
    /// Largest load on a sleeper, downwards, N.
    pub max_load: f64,
    /// Smallest load between two cycles, downwards, N.
    pub min_load: f64,
    /// Number of cycles per second, Hz.
    pub frequency: f64,
}

impl LoadCycles {
    /// Returns the duration of all cycles, s.
    pub fn duration(&self) -> f64 {
        f64::from(self.cycles) / self.frequency
    }

    /// Returns the load at a time since the beginning of the first cycle (s), downwards, N; 0 before and after.
    pub fn load(&self, time: f64) -> f64 {
        let phase = time * self.frequency;
        let last = f64::from(self.cycles);
        if !(0.0..last).contains(&phase) {
            return 0.0;
        }
        let low = if phase < 0.5 { 0.0 } else { self.min_load };
        low + (self.max_load - low) * 0.5 * (1.0 - libm::cos(std::f64::consts::TAU * phase))
    }
}

/// A sleeper of one or two blocks (twin-block).
#[derive(Debug, Clone, PartialEq)]
pub struct SleeperPlan {
    /// Name of the driven body.
    pub name: String,
    /// Centre of the sleeper's underside in x and y, m.
    pub centre: [f64; 2],
    /// Blocks: offset of the block's centre in y and size (x, y, z), m.
    pub blocks: Vec<BlockPlan>,
    /// True if the tamping cycle lifts it.
    pub tamped: bool,
    /// Mount on which contacts move it in the run; `None`: rigid. It stands still while the bed is prepared.
    pub mount: Option<Mount>,
}

/// Cuboid block of a sleeper.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BlockPlan {
    /// Offset of the block's centre from that of the sleeper, across the track, m.
    pub offset_y: f64,
    /// Size in x, y and z, m.
    pub size: Vec3,
}

/// One tine. Its reference point is the middle of the blade's upper edge.
#[derive(Debug, Clone, PartialEq)]
pub struct TinePlan {
    /// Name of the driven body.
    pub name: String,
    /// Start position of the reference point in x and y, m.
    pub position: [f64; 2],
    /// +1: squeezes towards +x, -1: towards -x.
    pub direction: f64,
    /// Tines with the same number close together and share one force limit.
    pub pair: u32,
    /// Blade and shaft.
    pub shape: TineShape,
    /// Mount of the blade; `None`: rigid.
    pub mount: Option<Mount>,
}

/// Shape of a tine about its reference point: the blade below, the shaft above.
#[derive(Debug, Clone, PartialEq)]
pub enum TineShape {
    /// Boxes with their middles over each other.
    Boxes {
        /// Size of the blade in x (thickness), y (width) and z (height), m.
        blade: Vec3,
        /// Size of the shaft in x, y and z, m.
        shaft: Vec3,
    },
    /// Corners of convex parts, m, of a tine that squeezes towards +x; the one that squeezes towards -x is its mirror image.
    Parts(Vec<Vec<Vec3>>),
}

/// The motion of the machine: lift, insertion, squeeze, hold, withdrawal, release; then traffic.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TampingPlan {
    /// Start of the cycle, s.
    pub start: f64,
    /// Lift of the tamped sleepers.
    pub lift: LiftPlan,
    /// Insertion of the tines.
    pub insertion: InsertionPlan,
    /// Squeeze between the tines of each pair.
    pub squeeze: SqueezePlan,
    /// Time of the hold after the squeeze, s.
    pub hold: f64,
    /// Time of the withdrawal, s.
    pub withdrawal: f64,
    /// Vibration of the tines.
    pub vibration: VibrationPlan,
    /// Release of the lifted sleepers after the withdrawal; `None`: they stay lifted.
    pub release: Option<ReleasePlan>,
    /// Traffic over the tamped sleepers after the release.
    pub traffic: Option<LoadCycles>,
}

impl TampingPlan {
    /// Level of the blades' upper edges at full depth, m: the insertion's depth below the lifted underside.
    pub fn deep_edge(&self, bed: &BedPlan) -> f64 {
        bed.preparation.ballast_depth + self.lift.height - self.insertion.depth
    }

    /// Times of the run at which lift, insertion, squeeze, hold, withdrawal, release and traffic end, s.
    pub fn ends(&self) -> [f64; 7] {
        let mut end = self.start;
        [
            self.lift.duration,
            self.insertion.duration,
            self.squeeze.duration,
            self.hold,
            self.withdrawal,
            self.release.map_or(0.0, |r| r.duration),
            self.traffic.map_or(0.0, |t| t.duration()),
        ]
        .map(|duration| {
            end += duration;
            end
        })
    }

    /// Time over which the machine averages its forces, s: a period; without vibration a tenth of the squeeze is a
    /// steady mean.
    pub fn averaging(&self) -> f64 {
        self.vibration.period().unwrap_or(0.1 * self.squeeze.duration)
    }
}

/// Lift of the tamped sleepers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LiftPlan {
    /// Height of the lift, m.
    pub height: f64,
    /// Time of the lift, s.
    pub duration: f64,
}

/// Release of the lifted sleepers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReleasePlan {
    /// Time of the release, s.
    pub duration: f64,
    /// Height of the sleepers' guides after the release, above that before the lift, m.
    pub height: f64,
}

/// Insertion of the tines into the ballast.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InsertionPlan {
    /// Time of the insertion, s.
    pub duration: f64,
    /// Depth of the blade's upper edge below the underside of the lifted sleeper, m.
    pub depth: f64,
    /// Clearance of the blade's lower edge above the fill level at the start, m.
    pub clearance: f64,
    /// Lowering stops while the bed carries more than this, N per tine over a vibration period; infinite: never.
    pub force_limit: f64,
}

/// Squeeze of the ballast between the tines of each pair.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SqueezePlan {
    /// Time of the squeeze, s.
    pub duration: f64,
    /// Largest closing per side, m.
    pub stroke: f64,
    /// Closing of a pair stops while its mean force over a vibration period exceeds this, N; infinite: never.
    pub force_limit: f64,
}

/// Sinusoidal vibration of the tines along x, facing rows in opposition.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VibrationPlan {
    /// Frequency, Hz.
    pub frequency: f64,
    /// Amplitude of the mount of a tine, m; on a springy shaft (T-28) the blade swings further in the air.
    pub amplitude: f64,
}

impl VibrationPlan {
    /// Period, s; `None` without vibration.
    pub fn period(&self) -> Option<f64> {
        (self.amplitude > 0.0 && self.frequency > 0.0).then(|| 1.0 / self.frequency)
    }
}

/// Settings of the run and its output.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RunPlan {
    /// Time step and its integration.
    pub stepping: Stepping,
    /// Settings of the contact solver.
    pub solver: Solver,
    /// Coefficient of restitution of all contacts.
    pub restitution: f64,
    /// Simulated time, ns: a whole number of time steps.
    pub duration_ns: u64,
    /// Simulated time between two frames of the results, ns; 0: none.
    pub output_ns: u64,
    /// Simulated time between two checkpoints, ns; 0: only the last.
    pub checkpoint_ns: u64,
}

/// Sets friction, stiffness, restitution, stepping and solver of a model to those of the plan.
pub(super) fn apply_run_settings(plan: &Plan, model: &mut Model) {
    let friction = &plan.bed.friction;
    model.grain_friction = friction.grain;
    for body in &mut model.driven {
        let plate = || plan.plates.iter().find(|p| p.name == body.name).map(|p| p.friction);
        body.friction = friction.of(body).or_else(plate).unwrap_or(body.friction);
    }
    plan.bed.stiffness.apply(model);
    model.restitution = plan.run.restitution;
    model.stepping = plan.run.stepping;
    model.solver = plan.run.solver;
}
