//! Heartbeat: publishes the status periodically, also while a window is computed.

use super::status::SharedStatus;
use crate::{Error, HEARTBEAT_INTERVAL, Keys};
use std::sync::Arc;
use std::sync::mpsc::{RecvTimeoutError, SyncSender, sync_channel};
use std::thread::JoinHandle;
use zenoh::bytes::Encoding;
use zenoh::{Session, Wait};

/// Thread that publishes the status.
pub(super) struct Heartbeat {
    stop: SyncSender<()>,
    thread: JoinHandle<()>,
}

impl Heartbeat {
    pub fn start(
        session: &Session,
        keys: &Keys,
        shared: &Arc<SharedStatus>,
    ) -> Result<Self, Error> {
        let (stop, stopped) = sync_channel::<()>(0);
        // Dropped under congestion: a late heartbeat is useless, and no observer may delay the others.
        let publisher = session
            .declare_publisher(keys.out("status"))
            .encoding(Encoding::APPLICATION_JSON)
            .wait()
            .map_err(|e| Error::transport("zenoh", e))?;
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
        let thread = thread.spawn(beats).map_err(|e| Error::transport("heartbeat", e))?;
        Ok(Self { stop, thread })
    }

    /// Publishes the last status and ends the thread.
    pub fn stop(self) {
        drop(self.stop);
        // A thread that has failed has message so; there is nothing left for it to do.
        let _ = self.thread.join();
    }
}
