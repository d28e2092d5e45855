//! `ballast resume CHECKPOINT`: goes on where a run stopped.

use crate::args::Resume;
use crate::console::Console;
use crate::exit::Outcome;
use crate::interrupt;
use crate::session::Session;

pub fn resume(args: Resume, console: Console) -> Outcome {
    interrupt::install()?;
    let session = Session::resume(&args.checkpoint, console)?;
    session.run(args.until.steps, args.until.expect)
}
