//! Checks with known answers, on small samples.

use crate::setup::{Ended, Place};
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use serde_json::Value;
use std::io::{BufRead, BufReader};
use std::process::Stdio;

#[test]
fn quick_checks_find_nothing_worse_than_what_is_documented() {
    let place = Place::new();
    place.call("validate --quick --out checked").with_code(0);
    let found: Value = serde_json::from_str(&place.text("checked/validation.json")).unwrap();
    let checks = found["checks"].as_array().unwrap();
    assert_eq!((&found["complete"], checks.len()), (&true.into(), 12));
    let mut known = 0;
    for check in checks {
        let name = check["check"].as_str().unwrap();
        let findings = check["findings"].as_array().unwrap();
        assert!(!findings.is_empty(), "{name} found nothing");
        for finding in findings.iter().filter(|f| f["verdict"] == "known deviation") {
            let deviation = finding["deviation"].as_f64().unwrap();
            let documented = &finding["known_deviation"];
            assert!(deviation > 0.0 && deviation <= documented["largest"].as_f64().unwrap());
            assert!(!documented["reason"].as_str().unwrap().is_empty(), "{name}");
            known += 1;
        }
    }
    assert_eq!((&found["failed"], &found["known_deviations"]), (&0.into(), &known.into()));
    let page = place.text("checked/validation.html");
    assert!(
        !page.contains("<script") && !page.contains("http") && page.matches("<svg").count() >= 2
    );

    place.call("validate --only incline --out one").with_code(0);
    let message = place.call("validate --only inclines").with_code(2).stderr();
    assert!(message.contains("incline, column") && message.contains("inclines"), "{message}");
}

#[test]
fn a_check_that_takes_long_can_be_stopped() {
    let place = Place::new();
    // Columns take many minutes in full.
    let mut child = place
        .command("validate --only incline,collapse --json --out stopped")
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
    assert!(lines.any(|line| line.unwrap().contains("incline")), "the first check says nothing");
    kill(Pid::from_raw(child.id() as i32), Signal::SIGTERM).unwrap();
    let ended = Ended(child.wait_with_output().unwrap()).with_code(130);
    assert!(ended.stderr().contains("stopped inside a check"), "{}", ended.stderr());
    // What was found before is kept, and says that it is not all.
    let found: Value = serde_json::from_str(&place.text("stopped/validation.json")).unwrap();
    assert_eq!((&found["complete"], found["checks"].as_array().unwrap().len()), (&false.into(), 1));
    assert!(place.text("stopped/validation.html").contains("Unfinished"));
}

#[test]
fn a_page_that_cannot_be_written_is_reported_before_the_checks() {
    let place = Place::new();
    for out in ["tiny.toml", "/proc"] {
        let ended =
            place.call(&format!("validate --quick --only incline --out {out}")).with_code(1);
        assert!(
            !ended.stderr().contains("incline") && ended.stderr().contains(out),
            "{}",
            ended.stderr()
        );
    }
}
