//! Contact problems of a run, kept in the FCLIB form.
//!
//! Reads: the workspace of a step. Writes: one file per problem. Contract: dumping changes no bit of the run; the
//! problem is the one that was solved, without the impulses that its solution started from.

use crate::files::create_folder;
use ballast::nlgs::assembled_problem::AssembledProblem;
use ballast::track::TampingPhase;
use ballast_hdf5::fclib::{self, Storage};
use ballast_session::case_stepper::CaseStepper;
use ballast_session::{Failure, Result};
use std::path::PathBuf;

/// Selection of the contact problems that are written, and their folder.
#[derive(Debug, Clone)]
pub struct ProblemDump {
    folder: PathBuf,
    /// Steps from one to the next.
    every: u64,
    /// All phases if empty.
    phases: Vec<TampingPhase>,
}

impl ProblemDump {
    /// Makes the folder; files of an earlier run in it are kept unless they have the same name.
    pub fn to(folder: PathBuf, every: u64, phases: Vec<TampingPhase>) -> Result<Self> {
        create_folder(&folder)?;
        Ok(Self { folder, every: every.max(1), phases })
    }

    /// Keeps the problem of the step that was just taken, if it is one of those wanted and has contacts.
    pub fn step(&self, name: &str, run: &CaseStepper) -> Result {
        let (state, phase) = (run.state(), run.phase());
        let wanted = self.phases.is_empty() || self.phases.contains(&phase);
        let problem = run.component().workspace().problem();
        if !wanted || !state.step.is_multiple_of(self.every) || problem.contacts.is_empty() {
            return Ok(());
        }
        let assembled = AssembledProblem::from_problem(problem);
        let contacts = assembled.contact_count();
        let file = format!("{name}-{}-i{:06}-{contacts}.hdf5", phase.name(), state.step);
        let path = self.folder.join(file);
        fclib::write_local(&path, &assembled, Storage::Rows).map_err(Failure::from)
    }
}
