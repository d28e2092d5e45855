//! `ballast validate`: validation suite, as a page and as JSON.

use crate::args::ValidateArgs;
use crate::console::Console;
use crate::files::{check_writable, create_folder, replace_text};
use crate::interrupt;
use ballast_session::{Failure, Reporter, Result};
use ballast_validation::{self as validate, CheckVerdict, SuiteSize};
use serde_json::json;

pub fn validate(args: ValidateArgs, console: Console) -> Result {
    interrupt::install()?;
    let size = SuiteSize { quick: args.quick };
    let (beds, samples) = (&args.beds.bed_cache, args.samples.as_deref());
    validate::check_inputs(&args.only, samples)?;
    create_folder(&args.out)?;
    let (page, data) = (args.out.join("validation.html"), args.out.join("validation.json"));
    [&page, &data].into_iter().try_for_each(|file| check_writable(file))?;
    let report = validate::checks(size, &args.only, beds, samples, &console, |report| {
        replace_text(&page, &report.page().html())?;
        replace_text(&data, &format!("{:#}\n", report.json()))
    })?;
    let tables: Vec<String> = report.checks.iter().map(|c| validate::table(c).text()).collect();
    console.result(&format!("{}\n{}\n{}", tables.join("\n"), page.display(), data.display()));
    let [passed, known, failed] =
        [CheckVerdict::Passed, CheckVerdict::KnownDeviation, CheckVerdict::Failed]
            .map(|verdict| report.count(verdict));
    console.event(
        "done",
        json!({
            "passed": passed, "known_deviations": known, "failed": failed, "page": page, "json": data
        }),
    );
    if failed == 0 {
        return Ok(());
    }
    let failing = report.checks.iter().filter(|c| c.count(CheckVerdict::Failed) > 0);
    let names: Vec<&str> = failing.map(|c| &c.name[..]).collect();
    Err(Failure::Mismatch(format!(
        "{failed} of {} figures are beyond their tolerance and what is documented: {}",
        passed + known + failed,
        names.join(", ")
    )))
}
