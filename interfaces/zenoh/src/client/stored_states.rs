//! States that a component keeps for a client, which names and deletes them.

use crate::{Client, Error, lock_unpoisoned};
use ballast_protocol::lockstep::RunPosition;
use std::collections::BTreeSet;
use std::sync::{Arc, Mutex};

/// States that a component keeps for a client; clones share them.
#[derive(Debug, Clone, Default)]
pub struct StoredStates(Arc<Mutex<StateNames>>);

#[derive(Debug, Default)]
struct StateNames {
    /// Number of states saved so far.
    count: u64,
    /// States that are deleted when the client detaches.
    temporary: BTreeSet<String>,
    /// States without a reference, which are deleted before the next one is saved.
    unreferenced: Vec<String>,
}

impl StoredStates {
    /// Deletes the states without a reference, and saves the current one; returns its name and the run position.
    ///
    /// # Errors
    /// [`Error::Rejected`], or no reply.
    pub fn save(&self, client: &mut Client) -> Result<(String, RunPosition), Error> {
        self.delete_unreferenced(client)?;
        let name = self.new_name(client);
        let position = client.save(&name)?.clone();
        Ok((name, position))
    }

    /// Lets the component delete a state, which has no reference any more.
    pub fn release(&self, name: String) {
        lock_unpoisoned(&self.0).unreferenced.push(name);
    }

    /// Keeps a state after the client has detached.
    pub fn keep(&self, name: &str) {
        lock_unpoisoned(&self.0).temporary.remove(name);
    }

    /// Returns true if both are the states of one client.
    pub fn is_same(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }

    /// Deletes the states and detaches. A component that does not receive this notices the loss of its owner.
    pub fn detach(&self, mut client: Client) {
        let names = std::mem::take(&mut lock_unpoisoned(&self.0).temporary);
        // A computing component would not reply before the end of its window.
        let is_idle = !client.has_pending();
        let is_answered = |name: &String| match client.drop_state(name) {
            Ok(_) => true,
            Err(error) => error.request_error().is_some(),
        };
        if is_idle && names.iter().all(is_answered) {
            let _ = client.detach();
        }
    }

    fn new_name(&self, client: &Client) -> String {
        let mut names = lock_unpoisoned(&self.0);
        names.count += 1;
        let name = format!("{}-{}", client.id(), names.count);
        names.temporary.insert(name.clone());
        name
    }

    fn delete_unreferenced(&self, client: &mut Client) -> Result<(), Error> {
        let mut names = std::mem::take(&mut lock_unpoisoned(&self.0).unreferenced);
        let mut result = Ok(());
        while let Some(name) = names.last() {
            match client.drop_state(name) {
                // A component that was started again has none of them and refuses.
                Err(error) if error.request_error().is_none() => {
                    result = Err(error);
                    break;
                }
                _ => lock_unpoisoned(&self.0).temporary.remove(name),
            };
            names.pop();
        }
        // The rest is deleted next time.
        lock_unpoisoned(&self.0).unreferenced.append(&mut names);
        result
    }
}
