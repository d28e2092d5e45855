//! Stop reasons, and the token that requests a stop from another thread.

use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};

/// Reason why an observer ends a window, which says what becomes of its steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum StopReason {
    /// The steps computed so far are kept.
    Early,
    /// The window is rolled back to its beginning, and may be redone.
    Discard,
    /// The window is rolled back as if it had not been requested: the window before it can still be redone.
    Cancel,
}

impl StopReason {
    const ALL: [StopReason; 3] = [StopReason::Early, StopReason::Discard, StopReason::Cancel];
}

/// Shared flag through which any thread requests the end of the running window.
///
/// Clones share one flag. The first request stays until [`CancelToken::reset`].
#[derive(Debug, Clone, Default)]
pub struct CancelToken(Arc<AtomicU8>);

impl CancelToken {
    /// Requests the end of the running window; a request that was made before stays.
    pub fn cancel(&self, reason: StopReason) {
        let _ = self.0.compare_exchange(0, reason as u8 + 1, Ordering::Relaxed, Ordering::Relaxed);
    }

    /// Withdraws the request.
    pub fn reset(&self) {
        self.0.store(0, Ordering::Relaxed);
    }

    /// Returns the requested reason, or `None` without a request.
    pub fn reason(&self) -> Option<StopReason> {
        StopReason::ALL.get(usize::from(self.0.load(Ordering::Relaxed)).checked_sub(1)?).copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_request_of_all_clones_counts() {
        let token = CancelToken::default();
        assert_eq!(token.reason(), None);
        for reason in StopReason::ALL {
            token.clone().cancel(reason);
            token.cancel(StopReason::Early);
            assert_eq!(token.reason(), Some(reason));
            token.reset();
        }
    }
}
