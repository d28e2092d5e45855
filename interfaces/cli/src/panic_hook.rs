//! Message of a panic, which is a bug of the program: version, command, and the checkpoint to resume from.

use crate::console::write_err;
use crate::files::shell_word;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

/// Last checkpoint that this process has written.
static CHECKPOINT: Mutex<Option<PathBuf>> = Mutex::new(None);

/// Sets the checkpoint that the message names.
pub fn set_checkpoint(path: PathBuf) {
    *CHECKPOINT.lock().unwrap_or_else(PoisonError::into_inner) = Some(path);
}

/// Installs the hook. The message of the standard library, with the location, comes first.
pub fn install() {
    let standard = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        standard(panic);
        let words = std::env::args_os().skip(1).map(shell_word).collect::<Vec<_>>();
        let version = env!("CARGO_PKG_VERSION");
        let command = words.join(" ");
        write_err(&format!(
            "internal error: ballast {version} failed at `ballast {command}`; this is a bug, please report it with the \
             case and the message above"
        ));
        let checkpoint = CHECKPOINT.try_lock().ok().and_then(|path| path.clone());
        if let Some(path) = checkpoint {
            write_err(&format!("continue the run with: ballast resume {}", shell_word(path)));
        }
    }));
}
