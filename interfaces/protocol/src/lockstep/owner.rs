//! Ownership of a component: at most one client may change its state.

use super::control::AttachRequest;
use super::error::RequestError;

/// Current owner of a component, identified by its ticket, and the number of owners so far.
#[derive(Debug, Default)]
pub struct Ownership {
    owner: Option<Owner>,
    /// Most recent owner; empty before the first one.
    last_client: String,
    /// Number of ownership changes in this run.
    owner_count: u64,
}

#[derive(Debug)]
struct Owner {
    client: String,
    ticket: String,
    since_ms: u64,
}

impl Ownership {
    /// Restores the history from a checkpoint.
    pub(super) fn set_history(&mut self, last_client: String, owner_count: u64) {
        self.last_client = last_client;
        self.owner_count = owner_count;
    }

    /// Returns the most recent owner and the number of owners so far.
    pub(super) fn history(&self) -> (&str, u64) {
        (&self.last_client, self.owner_count)
    }

    /// Makes a client the owner and returns the number of owners so far, including this one.
    ///
    /// # Errors
    /// `busy` if another client is the owner.
    pub(super) fn attach(
        &mut self,
        request: &AttachRequest,
        ticket: &str,
        now_ms: u64,
    ) -> Result<u64, RequestError> {
        if let Some(owner) = &self.owner
            && request.ticket.as_ref() != Some(&owner.ticket)
        {
            let since_ms = now_ms.saturating_sub(owner.since_ms);
            return Err(RequestError::busy(&owner.client, since_ms, ""));
        }
        let client = request.client.clone();
        if self.owner_count == 0 || self.last_client != client {
            self.owner_count += 1;
            self.last_client.clone_from(&client);
        }
        self.owner = Some(Owner { client, ticket: ticket.into(), since_ms: now_ms });
        Ok(self.owner_count)
    }

    /// Ends the ownership.
    pub(super) fn detach(&mut self) {
        self.owner = None;
    }

    /// Ends the ownership of a disconnected client; returns true if it was the owner.
    pub(super) fn disconnect(&mut self, client: &str) -> bool {
        self.owner.take_if(|owner| owner.client == client).is_some()
    }

    /// Returns an error unless the ticket is that of the owner.
    pub(super) fn check(&self, ticket: &str) -> Result<(), RequestError> {
        match &self.owner {
            Some(owner) if owner.ticket == ticket => Ok(()),
            owner => Err(RequestError::not_owner(ticket, owner.as_ref().map(|o| &o.client[..]))),
        }
    }

    /// Returns the name of the owner.
    pub fn client(&self) -> Option<&str> {
        self.owner.as_ref().map(|o| &o.client[..])
    }

    /// Returns the owner's ticket, which must not be shown to other clients.
    pub fn ticket(&self) -> Option<&str> {
        self.owner.as_ref().map(|o| &o.ticket[..])
    }

    /// Returns the duration of the ownership, wall ms.
    pub(super) fn since_ms(&self, now_ms: u64) -> Option<u64> {
        self.owner.as_ref().map(|o| now_ms.saturating_sub(o.since_ms))
    }
}
