//! `ballast bench detection SCENE`: what detection costs per grain and step.
//!
//! From nothing: a detector that has seen no configuration yet. Nearly still: grains are nudged by a micrometre
//! in each step, as in a settled bed. In a run: the steps themselves, between solves.

use super::Said;
use super::args::BenchDetection;
use super::machine::Machine;
use super::pools::pools;
use super::rule::Rule;
use super::scene::Scene;
use super::sheet::{Sheet, cells};
use super::trial::{Contender, DETECTION, alternate, mean, ratios};
use ballast::detection::{Contacts, DetectionRange, Detector};
use ballast::drive::StepInputs;
use ballast::math::Vec3;
use ballast::motion::Motion;
use ballast::step::{Phase, StepObserver};
use ballast_session::Reporter;
use ballast_session::profile::{Profile, Spent};
use ballast_session::statistics::Quartiles;
use ballast_session::table::on_threads;
use ballast_session::{Failure, Outcome};
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

/// How far grains are nudged, m.
const NUDGE: f64 = 1e-6;

pub fn detection(args: &BenchDetection, console: &dyn Reporter) -> Outcome {
    let machine = Machine::watch();
    let scene = Scene::load(&args.scene, &args.start, console)?;
    let pools = pools(&args.threads)?;
    let mut sheet = Sheet::new(COLUMNS);
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

/// Detections on some number of threads.
struct Trial {
    threads: usize,
    /// Broad and narrow phase of each step.
    times: Vec<[Spent; 2]>,
    contacts: f64,
    /// Where the detector tells.
    pairs: Option<usize>,
}

/// The configuration in which the first step looks for contacts.
fn predicted(scene: &Scene) -> Outcome<Motion> {
    let targets = scene.targets();
    let inputs = StepInputs::from_targets(&targets);
    let mut motion = Motion::default();
    let predicted = motion.predict(&scene.model, &scene.state, &inputs);
    predicted?;
    Ok(motion)
}

/// Detection in nudged configurations on all numbers of threads in turn: from nothing, and by a detector that
/// has seen those before.
fn standing(
    scene: &Scene,
    mut motion: Motion,
    pools: &[Arc<ThreadPool>],
    args: &BenchDetection,
    console: &dyn Reporter,
) -> Outcome<[Vec<Trial>; 2]> {
    let trial = |pool: &Arc<ThreadPool>| {
        let threads = pool.current_num_threads();
        Trial { threads, times: Vec::new(), contacts: 0.0, pairs: None }
    };
    let new = || pools.iter().map(trial).collect::<Vec<_>>();
    let (mut fresh, mut still) = (new(), new());
    let mut detectors: Vec<(Detector, Contacts)> =
        pools.iter().map(|_| Default::default()).collect();
    let (warm_up, steps) = (args.window.warm_up.max(1), args.window.steps);
    let mut progress = console.start_progress("standing");
    for step in 0..warm_up + steps {
        nudge(&mut motion, step);
        for turn in 0..pools.len() {
            let k = (turn + step as usize) % pools.len();
            let mut newly = Default::default();
            let from_nothing = detect(scene, &motion, &pools[k], &mut newly);
            let again = detect(scene, &motion, &pools[k], &mut detectors[k]);
            if newly.1 != detectors[k].1 {
                return Err(Failure::Mismatch(format!(
                    "{}: expected the contacts of a detector without memory, {}; found others, {}",
                    scene.name,
                    newly.1.len(),
                    detectors[k].1.len()
                )));
            }
            if step >= warm_up {
                for (trial, times, (detector, contacts)) in
                    [(&mut fresh[k], from_nothing, &newly), (&mut still[k], again, &detectors[k])]
                {
                    trial.times.push(times);
                    trial.contacts += contacts.len() as f64 / f64::from(steps);
                    trial.pairs = Some(detector.pair_count());
                }
            }
        }
        let share = f64::from(step + 1) / f64::from(warm_up + steps);
        progress.advance(share, &Said(format!("configuration {}", step + 1)));
    }
    Ok([fresh, still])
}

fn nudge(motion: &mut Motion, step: u32) {
    for (k, x) in motion.position.iter_mut().enumerate() {
        let phase = f64::from(step) + k as f64;
        *x += Vec3::new(phase.sin(), (1.3 * phase).cos(), (0.7 * phase).sin()) * NUDGE;
    }
}

/// Finds the contacts of a configuration.
fn detect(
    scene: &Scene,
    motion: &Motion,
    pool: &ThreadPool,
    memory: &mut (Detector, Contacts),
) -> [Spent; 2] {
    let (detector, contacts) = memory;
    pool.install(|| {
        let mut profile = Profile::start();
        let reach = DetectionRange::new(&scene.model, motion);
        detector.broad_phase(&scene.model, motion, &reach);
        profile.phase_finished(Phase::BroadPhase);
        detector.narrow_phase(&scene.model, motion, &reach, contacts);
        profile.phase_finished(Phase::NarrowPhase);
        DETECTION.map(|phase| profile.of(phase))
    })
}

/// Detection within the steps of the scene.
fn moving(
    scene: &Scene,
    pools: &[Arc<ThreadPool>],
    args: &BenchDetection,
    console: &dyn Reporter,
) -> Outcome<Vec<Trial>> {
    let solver = Rule::fixed(args.iterations, scene.model.solver);
    let mut contenders: Vec<Contender> = pools
        .iter()
        .map(|p| Contender::new(on_threads(p.current_num_threads()), scene, solver, p))
        .collect();
    alternate(scene, &mut contenders, &args.window, console)?;
    let trial = |contender: &Contender| Trial {
        threads: contender.threads(),
        times: contender.samples.iter().map(|s| DETECTION.map(|phase| s.of(&[phase]))).collect(),
        contacts: contender.mean(|r| r.contacts as f64),
        pairs: None,
    };
    Ok(contenders.iter().map(trial).collect())
}

fn add(sheet: &mut Sheet, way: &str, scene: &Scene, trials: &[Trial]) {
    sheet.section(way);
    let per_grain = 1e6 / scene.model.grains.len().max(1) as f64;
    let of = |trial: &Trial, part: fn(&[Spent; 2]) -> f64| -> Vec<f64> {
        trial.times.iter().map(|times| per_grain * part(times)).collect()
    };
    let whole = |t: &[Spent; 2]| (t[0].wall + t[1].wall).as_secs_f64();
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
