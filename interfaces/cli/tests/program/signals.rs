//! Signals of schedulers stop every long command cleanly, and checkpoints follow the wall time.

use crate::setup::{CASE, Ended, Place};
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

const WARNINGS: [Signal; 3] = [Signal::SIGUSR1, Signal::SIGUSR2, Signal::SIGXCPU];

/// Maximum duration of a start or an end of the program.
const TIMEOUT: Duration = Duration::from_secs(120);

/// Case whose steps take long enough for a signal.
fn slow_place() -> Place {
    let slow = "max_iterations = 1000\ntolerance = 0";
    Place::with(&CASE.replace("max_iterations = 30\ntolerance = 1e-3", slow))
}

/// Starts `command`, sends `signal` once `file` exists, and returns the end of the command.
fn signalled(mut command: Command, place: &Place, file: &str, signal: Signal) -> Ended {
    let child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let id = Pid::from_raw(child.id() as i32);
    let start = Instant::now();
    while !place.path(file).exists() {
        assert!(start.elapsed() < TIMEOUT, "{file} is not there");
        std::thread::sleep(Duration::from_millis(10));
    }
    kill(id, signal).unwrap();
    Ended(child.wait_with_output().unwrap())
}

#[test]
fn signals_of_schedulers_end_a_run_at_a_checkpoint() {
    let place = slow_place();
    for signal in WARNINGS {
        let run = place.run_command("--out run --force");
        let ended = signalled(run, &place, "run/results.vtkhdf", signal).with_code(130);
        assert!(ended.stderr().contains(signal.as_str()), "{}", ended.stderr());
        assert!(
            place.path("run/checkpoint.h5").exists() && place.path("run/results.vtkhdf").exists()
        );
        // The lock is there again once the handler is installed.
        let _ = std::fs::remove_file(place.path("run/.lock"));
        let resume = place.command("resume run/checkpoint.h5");
        signalled(resume, &place, "run/.lock", signal).with_code(130);
        std::fs::remove_dir_all(place.path("run")).unwrap();
    }
}

#[test]
fn signals_of_schedulers_end_preparations_replays_and_sweeps() {
    let place = slow_place();
    place.run("--out recorded --steps 60 --record run.mcap").with_code(0);
    let plan = "case = 'tiny.toml'\n[grid]\n'tamping.vibration.frequency_Hz' = [30, 60]\n";
    std::fs::write(place.path("plan.toml"), plan).unwrap();
    let replay = place.with_beds_command("replay run.mcap --out replayed");
    signalled(replay, &place, "replayed/results.vtkhdf", Signal::SIGUSR1).with_code(130);
    let sweep = place.with_beds_command("sweep plan.toml --out swept");
    signalled(sweep, &place, "swept/00001/log", Signal::SIGUSR2).with_code(130);
    let prepare = place.command("prepare tiny.toml --bed-cache other --seed 3");
    signalled(prepare, &place, "other", Signal::SIGXCPU).with_code(130);
}

#[test]
fn a_run_writes_checkpoints_by_wall_time() {
    let case = CASE.replace("checkpoint_interval_s = 0.03\n", "");
    assert_ne!(case, CASE);
    let place = Place::with(&case);
    let written = |arguments: &str| {
        let run = place.run(&format!("--json --steps 20 {arguments}")).with_code(0);
        run.events().iter().filter(|event| event["event"] == "checkpoint").count()
    };
    assert_eq!(written("--out rarely"), 1);
    assert_eq!(written("--out always --checkpoint-every 0"), 20);
    assert_eq!(place.hash("always"), place.hash("rarely"));
    place.call("resume rarely/checkpoint.h5 --steps 25 --checkpoint-every 0").with_code(0);
}
