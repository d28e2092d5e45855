//! `ballast bench detection SCENE`: cost of contact detection per grain and step.
//!
//! From nothing: a detector without cached pairs. Nearly still: grains are displaced by a micrometre in each step, as in a
//! settled bed. In a run: the steps themselves, between solves.

use super::StageLabel;
use super::args::DetectionArgs;
use super::machine_info::MachineInfo;
use super::pools::pools;
use super::result_sheet::{ResultSheet, cells};
use super::scene::BenchScene;
use super::stop_rule::StopRule;
use super::variant::{DETECTION, Variant, alternate, mean, ratios};
use ballast::detection::{Contacts, DetectionRange, Detector};
use ballast::drive::StepInputs;
use ballast::math::Vec3;
use ballast::motion::Motion;
use ballast::step::{Phase, StepObserver};
use ballast_session::profile::{PhaseTime, Profile};
use ballast_session::statistics::Quartiles;
use ballast_session::table::on_threads;
use ballast_session::{Failure, Reporter, Result};
use rayon::ThreadPool;
use std::sync::Arc;

const COLUMNS: &[&str] = &[
    "way",
    "threads",
    "steps",
    "contacts",
    "pairs_listed",
    "broad_us",
    "narrow_us",
    "whole_us",
    "whole_low_us",
    "whole_high_us",
    "cpu_us",
    "speedup",
];

/// Displacement of the grains between two configurations, m.
const DISPLACEMENT_M: f64 = 1e-6;

/// Measures contact detection.
///
/// # Errors
/// A file that cannot be read or written, or a step that fails.
pub fn detection(args: &DetectionArgs, console: &dyn Reporter) -> Result {
    let machine = MachineInfo::observe();
    let scene = BenchScene::load(&args.scene, &args.start, console)?;
    let pools = pools(&args.threads)?;
    let mut sheet = ResultSheet::new(COLUMNS);
    sheet.note("scene", scene.describe());
    sheet
        .note("times", "µs per grain and step: median, and quartiles of the whole; CPU time: mean");
    let motion = predicted(&scene)?;
    let [fresh, still] = standing(&scene, motion, &pools, args, console)?;
    add(&mut sheet, "from nothing", &scene, &fresh);
    add(&mut sheet, "nearly still", &scene, &still);
    add(&mut sheet, "in a run", &scene, &moving(&scene, &pools, args, console)?);
    sheet.publish(&machine, args.csv.csv.as_deref(), console)
}

/// Detections on one number of threads.
struct DetectionTrial {
    threads: usize,
    /// Times of broad and narrow phase in each step.
    times: Vec<[PhaseTime; 2]>,
    contacts: f64,
    /// Pairs in the list of the detector; `None` in a run, where it is not accessible.
    pairs: Option<usize>,
}

/// Returns the configuration in which the first step detects contacts.
fn predicted(scene: &BenchScene) -> Result<Motion> {
    let targets = scene.targets();
    let inputs = StepInputs::from_targets(&targets);
    let mut motion = Motion::default();
    let predicted = motion.predict(&scene.model, &scene.state, &inputs);
    predicted?;
    Ok(motion)
}

/// Measures detection in slightly displaced configurations on all numbers of threads in alternation.
///
/// Returns the times from nothing and with the lists of the configuration before.
fn standing(
    scene: &BenchScene,
    mut motion: Motion,
    pools: &[Arc<ThreadPool>],
    args: &DetectionArgs,
    console: &dyn Reporter,
) -> Result<[Vec<DetectionTrial>; 2]> {
    let trial = |pool: &Arc<ThreadPool>| {
        let threads = pool.current_num_threads();
        DetectionTrial { threads, times: Vec::new(), contacts: 0.0, pairs: None }
    };
    let new = || pools.iter().map(trial).collect::<Vec<_>>();
    let (mut fresh, mut still) = (new(), new());
    let mut detectors: Vec<(Detector, Contacts)> =
        pools.iter().map(|_| Default::default()).collect();
    let (warm_up, steps) = (args.range.warm_up.max(1), args.range.steps);
    let mut progress = console.start_progress("standing");
    for step in 0..warm_up + steps {
        displace(&mut motion, step);
        for slot in 0..pools.len() {
            let k = (slot + step as usize) % pools.len();
            let mut uncached = Default::default();
            let from_nothing = detect(scene, &motion, &pools[k], &mut uncached);
            let again = detect(scene, &motion, &pools[k], &mut detectors[k]);
            if uncached.1 != detectors[k].1 {
                return Err(Failure::Mismatch(format!(
                    "{}: expected the contacts of a detector without cached pairs, {}; found others, {}",
                    scene.name,
                    uncached.1.len(),
                    detectors[k].1.len()
                )));
            }
            if step >= warm_up {
                for (trial, times, (detector, contacts)) in [
                    (&mut fresh[k], from_nothing, &uncached),
                    (&mut still[k], again, &detectors[k]),
                ] {
                    trial.times.push(times);
                    trial.contacts += contacts.len() as f64 / f64::from(steps);
                    trial.pairs = Some(detector.pair_count());
                }
            }
        }
        let share = f64::from(step + 1) / f64::from(warm_up + steps);
        progress.advance(share, &StageLabel(format!("configuration {}", step + 1)));
    }
    Ok([fresh, still])
}

fn displace(motion: &mut Motion, step: u32) {
    for (k, x) in motion.position.iter_mut().enumerate() {
        let phase = f64::from(step) + k as f64;
        *x += Vec3::new(phase.sin(), (1.3 * phase).cos(), (0.7 * phase).sin()) * DISPLACEMENT_M;
    }
}

/// Detects the contacts of a configuration and measures both phases.
fn detect(
    scene: &BenchScene,
    motion: &Motion,
    pool: &ThreadPool,
    cache: &mut (Detector, Contacts),
) -> [PhaseTime; 2] {
    let (detector, contacts) = cache;
    pool.install(|| {
        let mut profile = Profile::start();
        let range = DetectionRange::new(&scene.model, motion);
        detector.broad_phase(&scene.model, motion, &range);
        profile.phase_finished(Phase::BroadPhase);
        detector.narrow_phase(&scene.model, motion, &range, contacts);
        profile.phase_finished(Phase::NarrowPhase);
        DETECTION.map(|phase| profile.of(phase))
    })
}

/// Measures detection within the steps of the scene.
fn moving(
    scene: &BenchScene,
    pools: &[Arc<ThreadPool>],
    args: &DetectionArgs,
    console: &dyn Reporter,
) -> Result<Vec<DetectionTrial>> {
    let solver = StopRule::fixed(args.iterations, scene.model.solver);
    let mut variants: Vec<Variant> = pools
        .iter()
        .map(|p| Variant::new(on_threads(p.current_num_threads()), scene, solver, p))
        .collect();
    alternate(scene, &mut variants, &args.range, console)?;
    let trial = |variant: &Variant| DetectionTrial {
        threads: variant.threads(),
        times: variant.samples.iter().map(|s| DETECTION.map(|phase| s.of(&[phase]))).collect(),
        contacts: variant.mean(|r| r.contacts as f64),
        pairs: None,
    };
    Ok(variants.iter().map(trial).collect())
}

fn add(sheet: &mut ResultSheet, way: &str, scene: &BenchScene, trials: &[DetectionTrial]) {
    sheet.section(way);
    let per_grain = 1e6 / scene.model.grains.len().max(1) as f64;
    let of = |trial: &DetectionTrial, part: fn(&[PhaseTime; 2]) -> f64| -> Vec<f64> {
        trial.times.iter().map(|times| per_grain * part(times)).collect()
    };
    let whole = |t: &[PhaseTime; 2]| (t[0].wall + t[1].wall).as_secs_f64();
    let first = of(&trials[0], whole);
    for trial in trials {
        let times = of(trial, whole);
        let all = Quartiles::of(&times);
        let broad = Quartiles::of(&of(trial, |t| t[0].wall.as_secs_f64()));
        let narrow = Quartiles::of(&of(trial, |t| t[1].wall.as_secs_f64()));
        let cpu = mean(of(trial, |t| (t[0].cpu + t[1].cpu).as_secs_f64()).into_iter());
        sheet.row(cells![
            way,
            trial.threads,
            times.len(),
            trial.contacts,
            trial.pairs,
            broad.median,
            narrow.median,
            all.median,
            all.low,
            all.high,
            cpu,
            ratios(&first, &times).median,
        ]);
    }
}
