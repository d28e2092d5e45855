//! `ballast resume CHECKPOINT`: goes on where a run stopped.

use super::given::Expected;
use crate::args::Resume;
use crate::console::Console;
use crate::exit::Outcome;
use crate::interrupt;
use crate::session::Session;

pub fn resume(args: Resume, console: Console) -> Outcome {
    interrupt::install()?;
    let checkpoint = Expected::Checkpoint.file(&args.checkpoint)?;
    let session = Session::resume(&checkpoint, args.until.steps, console)?;
    session.run(args.until.steps, args.until.expect)
}
