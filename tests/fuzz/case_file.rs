//! Case files and samples: read, or refused with a reason.
#![no_main]

use ballast_scenario::{read_case, sample};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let text = String::from_utf8_lossy(data);
    match read_case(&text, "fuzz.toml") {
        Ok(case) => assert!(case.plan.run.stepping.step_ns > 0),
        Err(errors) => assert!(!errors.errors.is_empty() && !errors.to_string().is_empty()),
    }
    if let Err(error) = sample::read(&text, "fuzz.json") {
        assert!(!error.to_string().is_empty());
    }
});
