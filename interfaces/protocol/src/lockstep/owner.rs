//! Who drives.

use super::{AttachRequest, ErrorCode, RequestError};

/// At most one client that may change the state, known by its ticket.
#[derive(Debug, Default)]
pub struct Ownership {
    owner: Option<Owner>,
    /// The client that has driven last, and how many have one after another.
    last: String,
    owners: u64,
}

#[derive(Debug)]
struct Owner {
    client: String,
    ticket: String,
    since_ms: u64,
}

impl Ownership {
    /// So many have driven the run one after another, `last` as the last.
    pub(super) fn remember(&mut self, last: String, owners: u64) {
        (self.last, self.owners) = (last, owners);
    }

    /// The client that has driven last, and how many have one after another.
    pub(super) fn history(&self) -> (&str, u64) {
        (&self.last, self.owners)
    }

    /// Makes the caller the owner; how many there have been with it.
    ///
    /// # Errors
    /// [`ErrorCode::Busy`] while another one drives.
    pub(super) fn take(
        &mut self,
        ask: &AttachRequest,
        ticket: &str,
        now_ms: u64,
    ) -> Result<u64, RequestError> {
        if let Some(owner) = &self.owner
            && ask.ticket.as_ref() != Some(&owner.ticket)
        {
            let since = now_ms.saturating_sub(owner.since_ms);
            let message = format!("{:?} drives, for {:.1} s", owner.client, since as f64 * 1e-3);
            let fault = RequestError::new(ErrorCode::Busy, message);
            return Err(RequestError {
                owner: Some(owner.client.clone()),
                since_ms: Some(since),
                ..fault
            });
        }
        let client = ask.client.clone();
        if self.owners == 0 || self.last != client {
            self.owners += 1;
            self.last.clone_from(&client);
        }
        self.owner = Some(Owner { client, ticket: ticket.into(), since_ms: now_ms });
        Ok(self.owners)
    }

    /// Nobody drives any more.
    pub(super) fn leave(&mut self) {
        self.owner = None;
    }

    /// A client is lost; whether it was the owner.
    pub(super) fn lose(&mut self, client: &str) -> bool {
        let was = self.owner.as_ref().is_some_and(|o| o.client == client);
        if was {
            self.owner = None;
        }
        was
    }

    /// Refuses who does not drive.
    pub(super) fn check(&self, ticket: &str) -> Result<(), RequestError> {
        match &self.owner {
            Some(owner) if owner.ticket == ticket => Ok(()),
            owner => Err(RequestError::not_owner(ticket, owner.as_ref().map(|o| &o.client[..]))),
        }
    }

    /// Who drives.
    pub fn client(&self) -> Option<&str> {
        self.owner.as_ref().map(|o| &o.client[..])
    }

    /// The owner's ticket, which is for no one else to see.
    pub fn ticket(&self) -> Option<&str> {
        self.owner.as_ref().map(|o| &o.ticket[..])
    }

    /// For how long it has driven, wall ms.
    pub(super) fn since_ms(&self, now_ms: u64) -> Option<u64> {
        self.owner.as_ref().map(|o| now_ms.saturating_sub(o.since_ms))
    }
}
