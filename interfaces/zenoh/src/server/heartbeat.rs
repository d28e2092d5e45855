//! A sign of life at every beat, also while a window is computed.

use super::shared::Shared;
use crate::{Error, HEARTBEAT_INTERVAL, Keys};
use std::sync::Arc;
use std::sync::mpsc::{RecvTimeoutError, SyncSender, sync_channel};
use std::thread::JoinHandle;
use zenoh::bytes::Encoding;
use zenoh::{Session, Wait};

/// A thread that tells the status.
pub(super) struct Heartbeat {
    stop: SyncSender<()>,
    thread: JoinHandle<()>,
}

impl Heartbeat {
    pub fn start(session: &Session, keys: &Keys, shared: &Arc<Shared>) -> Result<Self, Error> {
        let (stop, stopped) = sync_channel::<()>(0);
        // Dropped under congestion, as Zenoh does by default: a sign of life is worth nothing when it is
        // late, and no observer may hold it up for the others.
        let publisher = session
            .declare_publisher(keys.out("status"))
            .encoding(Encoding::APPLICATION_JSON)
            .wait()
            .map_err(|e| Error::link("zenoh", e))?;
        let shared = Arc::clone(shared);
        let beats = move || {
            loop {
                let stops = !matches!(
                    stopped.recv_timeout(HEARTBEAT_INTERVAL),
                    Err(RecvTimeoutError::Timeout)
                );
                let text = serde_json::to_string(&shared.status()).unwrap_or_default();
                if publisher.put(text).wait().is_err() || stops {
                    break;
                }
            }
        };
        let thread = std::thread::Builder::new().name("heartbeat".into());
        let thread = thread.spawn(beats).map_err(|e| Error::link("heartbeat", e))?;
        Ok(Self { stop, thread })
    }

    /// The last one, after which nothing more is told.
    pub fn end(self) {
        drop(self.stop);
        // A thread that has failed has message so; there is nothing left for it to do.
        let _ = self.thread.join();
    }
}
