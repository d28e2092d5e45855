//! Status of calls, phases of instances.

/// Status of a call, with the numbers of both versions of FMI.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Status {
    /// Done.
    Ok = 0,
    /// Done; some time step did not converge.
    Warning = 1,
    /// Not done, nothing changed; other inputs or a shorter step may succeed.
    Discard = 2,
    /// Not done: an illegal call, or an internal error.
    Error = 3,
}

/// Reason for which a call was not done.
#[derive(Debug, Clone, PartialEq)]
pub struct Complaint {
    /// Status of the call.
    pub status: Status,
    /// Message for the log.
    pub text: String,
}

impl Complaint {
    /// Creates a complaint about an illegal call.
    pub fn error(text: impl Into<String>) -> Self {
        Self { status: Status::Error, text: text.into() }
    }

    /// Creates a complaint about values that cannot be used.
    pub fn discard(text: impl Into<String>) -> Self {
        Self { status: Status::Discard, text: text.into() }
    }
}

/// UnitPhase of an instance.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum UnitPhase {
    /// Created or reset.
    Instantiated = 1,
    /// Between the calls that enter and leave the initialisation.
    Initialization = 2,
    /// Ready for a step.
    Step = 4,
    /// Terminated by the importer.
    Terminated = 8,
    /// Stopped by an internal error: a reset or a restored state leads out of it.
    Failed = 16,
}

impl UnitPhase {
    /// Every phase.
    pub const ALL: [UnitPhase; 5] = [
        UnitPhase::Instantiated,
        UnitPhase::Initialization,
        UnitPhase::Step,
        UnitPhase::Terminated,
        UnitPhase::Failed,
    ];

    /// Returns the phase's name in messages.
    pub fn name(self) -> &'static str {
        match self {
            UnitPhase::Instantiated => "instantiated",
            UnitPhase::Initialization => "initialization mode",
            UnitPhase::Step => "step mode",
            UnitPhase::Terminated => "terminated",
            UnitPhase::Failed => "failed",
        }
    }
}
