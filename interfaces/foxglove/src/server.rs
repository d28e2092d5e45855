//! Server of a live view, as the program holds it.

use crate::ViewerAddress;
use crate::frame_queue::{FrameQueue, LiveFrame};
use crate::publisher::LivePublisher;
use ballast::component::Component;
use ballast_protocol::messages::AdvanceReply;
use foxglove::websocket::Capability;
use foxglove::{Context, FoxgloveError};
use std::sync::Arc;
use std::thread::JoinHandle;

/// Maximum number of queued messages for each viewer; beyond, the oldest are dropped.
///
/// A window has some messages per body and zone. A viewer that has read none while as many windows were sent is
/// disconnected when it reads again.
const MAX_QUEUED_MESSAGES: usize = 256;

/// Error at the start of a live view.
#[derive(Debug, thiserror::Error)]
#[error(
    "live view: expected an address that is free, found {address}: {reason}; choose another port"
)]
pub struct Error {
    address: ViewerAddress,
    reason: String,
}

impl Error {
    fn new(address: &ViewerAddress, reason: impl ToString) -> Self {
        Self { address: address.clone(), reason: reason.to_string() }
    }
}

/// Server of a live view, to which Foxglove viewers connect.
pub struct LiveViewServer {
    url: String,
    queue: Arc<FrameQueue>,
    thread: Option<JoinHandle<()>>,
}

impl LiveViewServer {
    /// Listens on `address`; viewers see `name` as the source.
    ///
    /// # Errors
    /// An address that is in use or does not belong to this computer.
    pub fn start(address: &ViewerAddress, name: &str) -> Result<Self, Error> {
        let (queue, context) = (Arc::<FrameQueue>::default(), Context::new());
        let server = context
            .websocket_server()
            .name(name)
            .bind(&address.host, address.port)
            .capabilities([Capability::Time])
            .message_backlog_size(MAX_QUEUED_MESSAGES)
            .listener(queue.clone())
            .start_blocking()
            .map_err(|error| match error {
                FoxgloveError::Bind(reason) => Error::new(address, reason),
                other => Error::new(address, other),
            })?;
        let url = format!("ws://{}:{}", address.host, server.port());
        let publisher = LivePublisher::new(Arc::clone(&queue), server, context);
        let thread = std::thread::Builder::new().name("live view".into());
        let thread = thread.spawn(move || publisher.run()).map_err(|e| Error::new(address, e))?;
        Ok(Self { url, queue, thread: Some(thread) })
    }

    /// Returns the address for viewers, `ws://HOST:PORT`.
    pub fn url(&self) -> &str {
        &self.url
    }

    /// Shows the state of a component, and the results of the window that has led to it.
    pub fn show(&self, component: &Component, reply: Option<&AdvanceReply>) {
        let (model, state) = (component.shared_model(), component.save());
        self.queue.push(LiveFrame { model, state, reply: reply.cloned() });
    }

    /// Shows a state that no window has led to; viewers forget earlier ones.
    pub fn restart(&self, component: &Component) {
        self.queue.restart();
        self.show(component, None);
    }
}

impl Drop for LiveViewServer {
    fn drop(&mut self) {
        self.queue.close();
        if let Some(thread) = self.thread.take() {
            // A thread that has panicked has printed its message; there is nothing left for it to do.
            let _ = thread.join();
        }
    }
}
