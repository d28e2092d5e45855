//! `ballast run CASE`: run of a case from its bed.

use crate::args::{DumpArgs, RunArgs};
use crate::case::{self, CaseOverrides};
use crate::console::Console;
use crate::dump::Dump;
use crate::engine::Engine;
use crate::session::Session;
use crate::{beds, interrupt, machine};
use ballast_session::Result;
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
    }
    // Before a bed is prepared or a file replaced.
    files.check_recording(args.record.as_deref())?;
    let DumpArgs { dump_problems, dump_every, dump_phases } = args.dump;
    let dump = dump_problems.map(|folder| Dump::to(folder, dump_every.get().into(), dump_phases));
    let dump = dump.transpose()?;
    let (model, state) = beds::scene(&case, &args.beds.bed_cache, &console)?;
    let cycle = machine::cycle(&case, &model, &state)?;
    // Otherwise the first checkpoint would fail.
    model.check().map_err(|e| case::invalid(&case, e))?;
    let engine = Engine::machine(model, state, cycle);
    let session = Session::begin(case, engine, files, args.record.as_deref(), console)?;
    session.dumping(dump).run(args.stop.steps, args.stop.expect_hash)
}
