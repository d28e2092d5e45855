//! Impulses of a set that its iterations are looked at by and led by: those of the contacts that carried one at the
//! beginning. The others are left to the sweeps.

use crate::nlgs::{Chosen, ContactSet};

#[derive(Debug, Default)]
pub(super) struct Carried {
    chosen: Chosen,
    /// Where the iterations began that are under way, and where they led, N s `[n]`.
    pub before: Vec<f64>,
    pub image: Vec<f64>,
}

impl Carried {
    /// Chooses the contacts that carry an impulse now.
    pub fn begin(&mut self, contacts: &ContactSet) {
        contacts.choose_awake(&mut self.chosen);
        self.resume(contacts);
    }

    /// Takes the present impulses as those that the next iterations begin with.
    pub fn resume(&mut self, contacts: &ContactSet) {
        self.before.clear();
        self.before.extend(contacts.chosen_impulses(&self.chosen));
    }

    /// Takes the present impulses as those that the iterations have led to.
    pub fn observe(&mut self, contacts: &ContactSet) {
        self.image.clear();
        self.image.extend(contacts.chosen_impulses(&self.chosen));
    }

    /// Makes impulses comparable: the root of a third of `tr W_αα` for each of them, kg^(-1/2).
    pub fn weights<'a>(&'a self, contacts: &'a ContactSet) -> impl Iterator<Item = f64> + 'a {
        contacts.chosen_weights(&self.chosen)
    }

    /// Gives the contacts the impulses of their cones nearest to `impulses` `[n]`, and the grains their velocities.
    pub fn replace(&self, contacts: &mut ContactSet, impulses: &[f64]) {
        contacts.replace_impulses(&self.chosen, impulses);
    }
}
