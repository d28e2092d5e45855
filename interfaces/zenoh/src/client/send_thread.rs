//! Thread that sends the messages of a connection, so that a full wire does not hold the caller.
//!
//! Zenoh blocks the sender of a message until the transport accepts it, and offers no timeout for a single message.
//! Contract: a caller that gives up returns at once; its message may still be sent, which is as safe as a repetition.

use crate::Error;
use std::sync::mpsc::{RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::time::Duration;

/// Interval of checks while a message is sent or the component computes.
pub(super) const POLL_INTERVAL: Duration = Duration::from_millis(50);

type SendTask = Box<dyn FnOnce() + Send>;

/// Handle to the thread, which ends after its last task when the handle is dropped.
pub(super) struct SendThread(SyncSender<SendTask>);

impl SendThread {
    pub fn start() -> Result<Self, Error> {
        let (tasks, queue) = sync_channel::<SendTask>(1);
        let thread = std::thread::Builder::new().name("send".into());
        let run = move || queue.iter().for_each(|task| task());
        thread.spawn(run).map_err(|e| Error::transport("send", e))?;
        Ok(Self(tasks))
    }

    /// Runs `send` on the thread and returns its result; an error of `check`, called at intervals, ends the wait.
    pub fn run<T: Send + 'static>(
        &self,
        send: impl FnOnce() -> T + Send + 'static,
        check: impl Fn() -> Result<(), Error>,
    ) -> Result<T, Error> {
        let (done, result) = sync_channel(1);
        let mut task: SendTask = Box::new(move || drop(done.send(send())));
        let ended = || Error::transport("send", "the thread has ended");
        loop {
            match self.0.try_send(task) {
                Ok(()) => break,
                Err(TrySendError::Full(unsent)) => task = unsent,
                Err(TrySendError::Disconnected(_)) => return Err(ended()),
            }
            check()?;
            std::thread::sleep(POLL_INTERVAL);
        }
        loop {
            match result.recv_timeout(POLL_INTERVAL) {
                Ok(sent) => return Ok(sent),
                Err(RecvTimeoutError::Timeout) => check()?,
                Err(RecvTimeoutError::Disconnected) => return Err(ended()),
            }
        }
    }
}
