//! Kinds of requests and their names on the wire.

/// Kind of a window request.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum WindowKind {
    /// Computes the next window.
    Advance,
    /// Computes the last window again from its beginning.
    Redo,
}

/// Kind of a request; [`schema`](crate::schema) lists the request and reply type of each.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum RequestKind {
    /// Makes the client the owner.
    Attach,
    /// Prepares a bed and starts a run in it.
    Init,
    /// Computes a window.
    Window(WindowKind),
    /// Saves the state under a name.
    Save,
    /// Restores a saved state.
    Restore,
    /// Deletes a saved state.
    Drop,
    /// Starts a new run from the initial state.
    Reset,
    /// Sets or returns parameters.
    Param,
    /// Returns the status.
    Status,
    /// Ends the ownership.
    Detach,
    /// Ends the component.
    Shutdown,
}

impl RequestKind {
    /// All kinds, in the order of messages to users.
    pub const ALL: [Self; 12] = [
        Self::Attach,
        Self::Init,
        Self::Window(WindowKind::Advance),
        Self::Window(WindowKind::Redo),
        Self::Save,
        Self::Restore,
        Self::Drop,
        Self::Reset,
        Self::Param,
        Self::Status,
        Self::Detach,
        Self::Shutdown,
    ];

    /// Returns the name on the wire.
    pub fn name(self) -> &'static str {
        match self {
            Self::Attach => "attach",
            Self::Init => "init",
            Self::Window(WindowKind::Advance) => "advance",
            Self::Window(WindowKind::Redo) => "redo",
            Self::Save => "save",
            Self::Restore => "restore",
            Self::Drop => "drop",
            Self::Reset => "reset",
            Self::Param => "param",
            Self::Status => "status",
            Self::Detach => "detach",
            Self::Shutdown => "shutdown",
        }
    }

    /// Returns the kind with this name on the wire.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }
}

impl std::fmt::Display for RequestKind {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.write_str(self.name())
    }
}
