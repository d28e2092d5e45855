//! `ballast resume CHECKPOINT`: continues an interrupted run.

use super::expected_file::ExpectedFile;
use crate::args::ResumeArgs;
use crate::case_run::CaseRun;
use crate::console::Console;
use crate::interrupt;
use ballast_session::Result;

pub fn resume(args: ResumeArgs, console: Console) -> Result {
    interrupt::install()?;
    let checkpoint = ExpectedFile::Checkpoint.find(&args.checkpoint)?;
    let session = CaseRun::resume(&checkpoint, args.stop.steps, console)?;
    let session = session.with_checkpoint_interval(args.written.checkpoint_every);
    session.run(args.stop.steps, args.stop.expect_hash)
}
