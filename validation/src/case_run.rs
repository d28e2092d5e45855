//! Runs of whole cases that write no files.

use super::check_interrupt;
use ballast::observe::Coordination;
use ballast::track;
use ballast_session::beds;
use ballast_session::case::Case;
use ballast_session::case_stepper::CaseStepper;
use ballast_session::driver::{RunDriver, RunObserver, tamping_driver};
use ballast_session::record;
use ballast_session::recorder::compactness;
use ballast_session::summary::{RunSummary, SummarySettings};
use ballast_session::{Reporter, Result};
use std::path::Path;

/// Runs the tamping cycle of a case, on a bed from the folder or prepared into it; returns its summary with the settings.
pub fn run_case(
    case: &Case,
    folder: &Path,
    console: &dyn Reporter,
) -> Result<(SummarySettings, RunSummary)> {
    let (model, state) = beds::scene_without_progress(case, folder, console)?;
    let driver = RunDriver::Cycle(tamping_driver(case, &model, &state)?);
    let setting = SummarySettings::for_case(case, &model);
    let mut summary = RunSummary::new(setting.clone());
    let mut run = CaseStepper::new(case, model, state, driver)?;
    let mut observer = RunObserver::start();
    let zones = track::zones(&case.plan);
    let measure = |run: &CaseStepper| compactness(run.model(), run.state(), &zones);
    summary.take_zones(&measure(&run));
    for _ in 0..case.steps() {
        let stepped = run.step(&mut observer);
        // Also within the step.
        check_interrupt()?;
        let Some((_, report)) = stepped? else { break };
        summary.take_step(&record::row(
            run.model().stepping.h(),
            run.state(),
            &report,
            run.phase(),
            &Coordination::default(),
            &setting.tracked,
        ));
    }
    summary.take_zones(&measure(&run));
    Ok((setting, summary))
}
