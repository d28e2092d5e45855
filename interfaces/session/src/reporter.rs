//! Messages, events and progress of long computations, for whatever shows them.

use serde_json::Value;
use std::time::Duration;

/// Receiver of messages, events and progress.
pub trait Reporter: Sync {
    /// Shows a message about the course of the computation.
    fn note(&self, text: &str);

    /// Shows a message about something that the user should know although the computation continues.
    fn warning(&self, text: &str);

    /// Emits a machine-readable event with its fields.
    fn event(&self, name: &str, fields: Value);

    /// Shows a result to a person.
    fn result(&self, text: &str);

    /// Writes a line of data to standard output, whatever the format of other results.
    fn line(&self, text: &str);

    /// Starts to show the progress of a task.
    fn start_progress(&self, task: &str) -> Box<dyn ProgressMeter>;
}

/// Display of the progress of one task.
pub trait ProgressMeter: Send {
    /// Shows that the fraction `fraction` (0 to 1) of the task is done.
    fn advance(&mut self, fraction: f64, label: &dyn ProgressLabel);

    /// Wall time since the task began.
    fn elapsed(&self) -> Duration;

    /// Ends the display.
    fn finish(&self);
}

/// Description of the point that a task has reached.
pub trait ProgressLabel {
    /// Returns one line for a person, without the fraction.
    fn text(&self) -> String;

    /// Returns the fields of an event.
    fn fields(&self) -> Value;
}
