//! Contact sets of a decomposition: one per subdomain, one per group of the interface.

use super::nncg::NncgMemory;
use crate::local_problem::LocalProblem;
use crate::nlgs::anderson::{History, HistoryProducts};
use crate::nlgs::{BlockSubset, ContactLawSums, ContactSet, VisitNorms};
use crate::partition::Partition;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Number of velocity components of a body.
pub(super) const COMPONENTS: usize = 6;

/// Velocity components of a body: linear, then whitened angular velocity.
pub(super) type VelocityParts = [f64; COMPONENTS];

/// Velocity of a set whose body other sets change as well, as a sum of parts (T-13).
#[derive(Debug, Clone, Copy)]
pub(super) struct BoundaryBody {
    /// Index of the body in its set.
    pub line: u32,
    /// Slot in which this set publishes its part.
    pub slot: u32,
    /// Range of the slots of all parts of the body.
    pub slots: [u32; 2],
    /// Part of this set.
    pub part: VelocityParts,
    /// Sum of the other parts when they were last read.
    pub others: VelocityParts,
}

/// Contact set with its measurements and the memory of the accelerations.
#[derive(Debug, Default)]
pub(super) struct SweepSet {
    pub contacts: ContactSet,
    /// Norms of the last measured sweep.
    pub norms: VisitNorms,
    /// Distance of the contacts from their law when last computed.
    pub law: ContactLawSums,
    /// True if the last convergence test found this set converged: the synchronous schedule skips it until the next test.
    pub is_converged: bool,
    /// True if the last test found this set no longer converged, so that its search direction is out of date.
    pub was_skipped: bool,
    /// Visits of the asynchronous schedule since the velocities were split into parts.
    pub visits: u32,
    /// Bodies shared with other sets, in the asynchronous schedule.
    pub boundary: Vec<BoundaryBody>,
    pub nncg: NncgMemory,
    pub anderson: AndersonMemory,
}

impl SweepSet {
    /// Updates after a convergence test whether the set has converged.
    pub fn mark_converged(&mut self, is_converged: bool) {
        self.was_skipped = self.is_converged && !is_converged;
        self.is_converged = is_converged;
        if is_converged {
            self.nncg.change_squared = 0.0;
        }
    }

    /// Resets the visit count and removes the velocity parts.
    pub fn reset(&mut self) {
        self.visits = 0;
        self.boundary.clear();
    }

    /// Sweeps `n` times over the active contacts or, if `measured`, first and last over all contacts.
    ///
    /// The first sweep is the measured one: it sees the changes of the other sets, which the last one no longer does.
    pub fn sweeps(&mut self, n: u32, relaxation: f64, measured: bool) {
        for sweep in 1..=n {
            if measured && sweep == 1 {
                self.norms = self.contacts.measured_sweep(relaxation);
            } else if measured && sweep == n {
                self.contacts.sweep(relaxation);
            } else {
                self.contacts.sweep_active(relaxation);
            }
            if measured && (sweep == 1 || sweep == n) {
                self.contacts.update_active();
            }
        }
    }
}

/// Set of the contacts between two subdomains.
#[derive(Debug, Default)]
pub(super) struct InterfaceGroup {
    pub set: SweepSet,
    /// Bodies of the group, ascending; line `k` of the set is body `grains[k]`.
    pub grains: Vec<u32>,
    /// Place of each body's velocity: which of the two subdomains (0 or 1), and its line there.
    pub home: Vec<(u8, u32)>,
}

impl InterfaceGroup {
    /// Copies the newest velocities of the bodies from the two subdomains.
    pub fn gather(&mut self, homes: &[MutexGuard<'_, SweepSet>; 2]) {
        for (line, &(side, from)) in self.set.contacts.lines.iter_mut().zip(&self.home) {
            *line = homes[side as usize].contacts.lines[from as usize];
        }
    }

    /// Packs the contacts of group `g`; `line_of` is the line of each body in its subdomain.
    pub fn pack(
        &mut self,
        problem: &LocalProblem,
        partition: &Partition,
        line_of: &[u32],
        g: usize,
    ) {
        let contacts = partition.interface.contacts.list(g);
        self.grains.clear();
        self.grains.extend(contacts.iter().flat_map(|&c| problem.contacts[c as usize].bodies));
        self.grains.sort_unstable();
        self.grains.dedup();
        let first = partition.interface.pairs[g][0];
        self.home.clear();
        self.home.extend(self.grains.iter().map(|&grain| {
            (u8::from(partition.owner[grain as usize] != first), line_of[grain as usize])
        }));
        let Self { set, grains, .. } = self;
        set.mark_converged(false);
        set.contacts.pack(problem, contacts, grains.len(), |grain| {
            grains.partition_point(|&other| other < grain) as u32
        });
        load_free_velocities(&mut set.contacts, grains, problem);
    }
}

/// Sets the velocities of `set` to the free velocities of `grains`.
pub(super) fn load_free_velocities(set: &mut ContactSet, grains: &[u32], problem: &LocalProblem) {
    debug_assert!(grains.is_sorted());
    let first_mounted = problem.lines.len() - problem.responses.len();
    set.grains = grains.partition_point(|&body| (body as usize) < first_mounted);
    for (line, &grain) in set.lines.iter_mut().zip(grains) {
        *line = problem.lines[grain as usize];
    }
}

/// Data of Anderson acceleration of one set. Contacts that were open at the start are left to the sweeps.
#[derive(Debug, Default)]
pub(super) struct AndersonMemory {
    pub subset: BlockSubset,
    pub history: History,
    /// Impulses of the subset before the iterations since the last mixing.
    before: Vec<f64>,
    /// Impulses of the subset after these iterations.
    pub image: Vec<f64>,
    /// Mixed impulses.
    pub mixed: Vec<f64>,
    /// Impulses of least change so far.
    pub safe: Vec<f64>,
    pub products: HistoryProducts,
}

impl AndersonMemory {
    /// Starts from the current impulses with an empty history.
    pub fn start(&mut self, contacts: &ContactSet) {
        contacts.copy_active_blocks(&mut self.subset);
        self.history.reset(contacts.subset_weights(&self.subset));
        self.resume(contacts);
        self.safe.clone_from(&self.before);
    }

    /// Stores the current impulses as those that the next iterations start from.
    pub fn resume(&mut self, contacts: &ContactSet) {
        self.before.clear();
        self.before.extend(contacts.subset_impulses(&self.subset));
    }

    /// Adds the impulses after the iterations to the history.
    pub fn observe(&mut self, contacts: &ContactSet, slot: Option<usize>, stored: usize) {
        self.image.clear();
        self.image.extend(contacts.subset_impulses(&self.subset));
        self.products = self.history.observe(slot, stored, &self.before, &self.image);
    }

    /// Restores the impulses of least change.
    pub fn restore(&mut self, contacts: &mut ContactSet) {
        contacts.replace_impulses(&self.subset, &self.safe);
    }
}

/// Returns the content of a lock that is borrowed exclusively, also after a panic: it holds plain numbers.
pub(super) fn get_mut<T>(lock: &mut Mutex<T>) -> &mut T {
    lock.get_mut().unwrap_or_else(PoisonError::into_inner)
}

/// Locks, also after a panic of an earlier holder.
pub(super) fn lock<T>(lock: &Mutex<T>) -> MutexGuard<'_, T> {
    lock.lock().unwrap_or_else(PoisonError::into_inner)
}
