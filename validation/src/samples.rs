//! Side by side with LMGC90: the same sample settled by both programs, with the same settings.
//!
//! Both final states are measured by one ruler: a step of Ballast from that state, solved to 1e-4.

use super::check::{Check, Finding};
use super::world::World;
use ballast::observe;
use ballast_report::plot::{Chart, Mark};
use ballast_scenario::sample::Sample;
use ballast_session::Outcome;
use ballast_session::files::read_sample;
use std::path::Path;

/// How LMGC90 settled the sample: steps, step (ns), sweeps, alert distance (m).
const STEPS: u64 = 1200;
const STEP_NS: u64 = 1_000_000;
const SWEEPS: u32 = 60;
const ALERT: f64 = 2e-3;

fn world(path: &Path) -> Outcome<World> {
    let Sample { model, state, .. } = read_sample(path)?;
    let targets = state.driven_poses(&model);
    Ok(World { model, state, workspace: Default::default(), targets })
}

/// What the ruler says of a state.
struct Measured {
    height: f64,
    /// Before the step.
    kinetic: f64,
    coordination: f64,
    mean_penetration: f64,
    max_penetration: f64,
    /// Normal forces over their mean, rising.
    forces: Vec<f64>,
}

fn measure(mut world: World) -> Outcome<Measured> {
    let height = world.height();
    let kinetic = observe::energy(&world.model, &world.state).kinetic;
    world.model.solver.tolerance = Some(1e-4);
    world.model.solver.max_iterations = 20_000;
    let report = world.step()?;
    let [coordination, _] = observe::coordination(&world.model, &world.state).mean_neighbours;
    let workspace = &world.workspace;
    let normal = workspace.impulse.iter().zip(&workspace.contacts.normal).map(|(f, n)| f.dot(n));
    let mut forces: Vec<f64> = normal.filter(|f| *f > 0.0).collect();
    let mean = forces.iter().sum::<f64>() / forces.len().max(1) as f64;
    forces.iter_mut().for_each(|f| *f /= mean);
    forces.sort_by(f64::total_cmp);
    let (mean_penetration, max_penetration) = (report.mean_penetration, report.max_penetration);
    Ok(Measured { height, kinetic, coordination, mean_penetration, max_penetration, forces })
}

/// The comparison; `folder` holds `loose500.json` and `settled500.json`.
pub fn samples(folder: &Path) -> Outcome<Check> {
    let mut check = Check::new(
        "side by side with LMGC90",
        format!(
            "The sample loose500 settled in {STEPS} steps of 1 ms with {SWEEPS} sweeps, alert distance 2 mm, by both programs."
        ),
        "final state of LMGC90, the sample settled500; both measured by one step of Ballast to 1e-4",
    );
    let mut own = world(&folder.join("loose500.json"))?;
    let settled = world(&folder.join("settled500.json"))?;
    own.model.solver.tolerance = None;
    own.model.solver.max_iterations = SWEEPS;
    own.model.stepping.step_ns = STEP_NS;
    own.model.stepping.detection_distance = ALERT;
    for _ in 0..STEPS {
        own.step()?;
    }
    own.model.stepping = settled.model.stepping;
    own.model.solver.norm = settled.model.solver.norm;
    let (ours, theirs) = (measure(own)?, measure(settled)?);
    let height = Finding::near(
        "height of the centre of mass over LMGC90's",
        ours.height / theirs.height,
        1.0,
        0.05,
    );
    check.findings.push(height);
    for (name, a, b) in [
        ("height of the centre of mass (m)", ours.height, theirs.height),
        ("kinetic energy (J)", ours.kinetic, theirs.kinetic),
        ("touching neighbours per grain", ours.coordination, theirs.coordination),
        ("mean penetration (m)", ours.mean_penetration, theirs.mean_penetration),
        ("largest penetration (m)", ours.max_penetration, theirs.max_penetration),
    ] {
        check.findings.push(Finding::told(
            format!("{name}; expected: LMGC90"),
            a,
            format!("{b:.4e}"),
        ));
    }
    // Share of contacts whose normal force exceeds a multiple of the mean.
    let tail = |m: &Measured| -> Vec<[f64; 2]> {
        let n = m.forces.len() as f64;
        m.forces.iter().enumerate().map(|(k, f)| [*f, 1.0 - k as f64 / n]).collect()
    };
    let chart =
        Chart::new("Normal forces of contacts", "force over its mean", "share of contacts above")
            .log_y()
            .with("Ballast", tail(&ours), Mark::Line)
            .with("LMGC90's state", tail(&theirs), Mark::Line);
    check.charts.push(chart.svg());
    check.remark = "LMGC90's stones rest on gaps of some tenths of a millimetre, which its detection counts as \
                    contacts; under exact contacts they carry less (docs/src/developer/performance.md). Heights of two pourings of \
                    500 stones differ."
        .into();
    Ok(check)
}
