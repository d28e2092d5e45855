//! What can be asked of a component: a word on every wire.

use super::WindowKind;

/// A request; [`schema`](crate::schema) knows what each is asked with and answered.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum RequestKind {
    Attach,
    Init,
    Window(WindowKind),
    Save,
    Restore,
    Drop,
    Reset,
    Param,
    Status,
    Detach,
    Shutdown,
}

impl RequestKind {
    /// All of them, in the order in which people are told them.
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

    /// The word on the wire.
    pub fn word(self) -> &'static str {
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

    /// The request that has this word.
    pub fn of(word: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|verb| verb.word() == word)
    }
}

/// The word on the wire.
impl std::fmt::Display for RequestKind {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.write_str(self.word())
    }
}
