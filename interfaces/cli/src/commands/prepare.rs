//! `ballast prepare CASE`: preparation of a bed.

use crate::args::PrepareArgs;
use crate::case::{self, CaseOverrides};
use crate::console::Console;
use crate::{beds, interrupt};
use ballast_session::Result;

pub fn prepare(args: PrepareArgs, console: Console) -> Result {
    interrupt::install()?;
    let choices = CaseOverrides { seed: args.seed, ..CaseOverrides::default() };
    let case = case::load(&args.case, &choices, &console)?;
    beds::prepare(&case, &args.beds.bed_cache, args.force, &console)
}
