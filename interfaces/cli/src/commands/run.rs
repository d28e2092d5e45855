//! `ballast run CASE`: run of a case from its bed.

use crate::args::{DumpArgs, RunArgs};
use crate::case::{self, CaseOverrides};
use crate::case_run::CaseRun;
use crate::console::Console;
use crate::problem_dump::ProblemDump;
use crate::{beds, interrupt};
use ballast_session::Result;
use ballast_session::case_stepper::CaseStepper;
use ballast_session::driver::{RunDriver, tamping_driver};
use ballast_session::run_files::RunFiles;
use std::path::Path;

pub fn run(args: RunArgs, console: Console) -> Result {
    interrupt::install()?;
    let case = case::load(&args.case, &CaseOverrides::from(&args.overrides), &console)?;
    let folder = args.out.unwrap_or_else(|| Path::new("runs").join(&case.plan.name));
    let files = RunFiles::create_in(folder)?;
    if !args.force {
        files.refuse_unfinished("start over with --force")?;
        files.refuse_another(&case.text)?;
        if let Some(steps) = args.stop.steps {
            files.refuse_longer(steps)?;
        }
    }
    // Before a bed is prepared or a file replaced.
    files.check_recording(args.record.as_deref())?;
    let DumpArgs { dump_problems, dump_every, dump_phases } = args.dump;
    let dump =
        dump_problems.map(|folder| ProblemDump::to(folder, dump_every.get().into(), dump_phases));
    let dump = dump.transpose()?;
    let (model, state) = beds::scene(&case, &args.beds.bed_cache, &console)?;
    let driver = RunDriver::Cycle(tamping_driver(&case, &model, &state)?);
    let run = CaseStepper::new(&case, model, state, driver)?;
    let session = CaseRun::begin(case, run, files, args.record.as_deref(), console)?;
    let session = session.with_checkpoint_interval(args.checkpoint.checkpoint_every);
    session.dumping(dump).run(args.stop.steps, args.stop.expect_hash)
}
