//! Runs the program in a temporary folder, with one prepared bed for all tests.

use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::LazyLock;
use tempfile::TempDir;

pub const CASE: &str = include_str!("../data/tiny.toml");

/// Steps of the case.
pub const STEPS: u64 = 180;

/// Prepared once: the tests are about runs, and a bed takes longer than they do.
static BEDS: LazyLock<TempDir> = LazyLock::new(|| {
    let beds = tempfile::tempdir().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let case = folder.path().join("tiny.toml");
    std::fs::write(&case, CASE).unwrap();
    let output = program().arg("prepare").arg(&case).arg("--bed-cache").arg(beds.path()).output();
    let output = output.unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    beds
});

pub fn program() -> Command {
    Command::new(env!("CARGO_BIN_EXE_ballast"))
}

/// A working folder with the tiny case in it.
pub struct Place {
    folder: TempDir,
}

impl Place {
    pub fn new() -> Self {
        Self::with(CASE)
    }

    pub fn with(case: &str) -> Self {
        let place = Self { folder: tempfile::tempdir().unwrap() };
        std::fs::write(place.path("tiny.toml"), case).unwrap();
        place
    }

    pub fn path(&self, name: impl AsRef<Path>) -> PathBuf {
        self.folder.path().join(name)
    }

    /// A call of the program in this folder; arguments are separated by blanks.
    pub fn command(&self, arguments: &str) -> Command {
        let mut command = program();
        command.current_dir(self.folder.path()).args(arguments.split_whitespace());
        command
    }

    pub fn call(&self, arguments: &str) -> Ended {
        Ended(self.command(arguments).output().unwrap())
    }

    /// `ballast run tiny.toml` with the shared bed, and more arguments.
    pub fn run_command(&self, arguments: &str) -> Command {
        let mut command = self.command("run tiny.toml --bed-cache");
        command.arg(BEDS.path()).args(arguments.split_whitespace());
        command
    }

    pub fn run(&self, arguments: &str) -> Ended {
        Ended(self.run_command(arguments).output().unwrap())
    }

    /// A call of the program in this folder, with the shared bed.
    pub fn with_beds_command(&self, arguments: &str) -> Command {
        let mut command = self.command(arguments);
        command.arg("--bed-cache").arg(BEDS.path());
        command
    }

    pub fn with_beds(&self, arguments: &str) -> Ended {
        Ended(self.with_beds_command(arguments).output().unwrap())
    }

    /// The summary of the run in `folder`, without what depends on the machine.
    pub fn summary(&self, folder: &str) -> Value {
        let path = self.path(folder).join("summary.json");
        let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{path:?}: {e}"));
        let mut summary: Value = serde_json::from_str(&text).unwrap();
        let timing = summary.as_object_mut().unwrap().remove("timing").unwrap();
        assert!(timing["wall_s"].as_f64().unwrap() > 0.0);
        summary
    }

    pub fn hash(&self, folder: &str) -> String {
        self.summary(folder)["state_hash"].as_str().unwrap().to_string()
    }

    pub fn text(&self, name: &str) -> String {
        std::fs::read_to_string(self.path(name)).unwrap()
    }
}

/// Output of a finished call.
pub struct Ended(pub Output);

impl Ended {
    pub fn code(&self) -> i32 {
        self.0.status.code().expect("a process without a signal")
    }

    pub fn stdout(&self) -> String {
        String::from_utf8(self.0.stdout.clone()).unwrap()
    }

    pub fn stderr(&self) -> String {
        String::from_utf8(self.0.stderr.clone()).unwrap()
    }

    /// Checks the exit code; shows the messages if it differs.
    #[track_caller]
    pub fn with_code(self, code: i32) -> Self {
        assert_eq!(self.code(), code, "stderr: {}\nstdout: {}", self.stderr(), self.stdout());
        self
    }

    /// stdout as one JSON value per line.
    pub fn events(&self) -> Vec<Value> {
        self.stdout().lines().map(|line| serde_json::from_str(line).expect(line)).collect()
    }
}
