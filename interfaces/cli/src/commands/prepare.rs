//! `ballast prepare CASE`: the bed alone, kept for runs.

use crate::args::Prepare;
use crate::case::{self, CaseOverrides};
use crate::console::Console;
use crate::exit::Outcome;
use crate::{beds, interrupt};

pub fn prepare(args: Prepare, console: Console) -> Outcome {
    interrupt::install()?;
    let choices = CaseOverrides { seed: args.seed, ..CaseOverrides::default() };
    let case = case::load(&args.case, &choices, &console)?;
    beds::prepare(&case, &args.beds.beds, args.force, &console)
}
