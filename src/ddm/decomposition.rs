//! The sets of contacts of a step: one per subdomain, one per group of the interface.
//!
//! Sets are numbered subdomains first. Between the visits of the synchronous schedule velocities
//! live in the subdomains' lines. A group of the interface works on
//! copies of the lines of its grains, gathered before and scattered after: what shares a subdomain has its turns one
//! after another ([`super::turns`]), so locks are never waited for and the order of threads has no effect.

use super::asynchronous::Report;
use super::boundary::{Boundary, BoundaryLine};
use super::turns::{Stretch, Turn, Turns};
use super::{acceleration, momentum};
use crate::local_problem::LocalProblem;
use crate::math::Vec3;
use crate::model::Solver;
use crate::nlgs::{ContactSet, NaturalMapSums, VisitNorms};
use crate::partition::Partition;
use rayon::prelude::*;
use std::ops::AddAssign;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// A set of contacts.
#[derive(Debug, Default)]
pub(super) struct Set {
    pub contacts: ContactSet,
    /// Of the last measured sweep.
    pub norms: VisitNorms,
    /// Of when the natural map was last asked for.
    pub map: NaturalMapSums,
    /// For the asynchronous schedule: visits since the velocities were split into parts, and the
    /// lines that are sums of parts.
    pub visits: u32,
    pub boundary: Vec<BoundaryLine>,
    pub momentum: momentum::Memory,
    /// For iterations that do not get on.
    pub memory: acceleration::Memory,
}

impl Set {
    /// Forgets visits and parts.
    pub fn restart(&mut self) {
        self.visits = 0;
        self.boundary.clear();
    }

    /// Sweeps `n` times over what carries, or, to be `measured`, first and last over all. The first sweep is measured: it
    /// sees what the other sets have changed, of which nothing is left in the last one.
    pub fn sweeps(&mut self, n: u32, relaxation: f64, measured: bool) {
        for sweep in 1..=n {
            if measured && sweep == 1 {
                self.norms = self.contacts.measured_sweep(relaxation);
            } else if measured && sweep == n {
                self.contacts.sweep(relaxation);
            } else {
                self.contacts.sweep_awake(relaxation);
            }
            if measured && (sweep == 1 || sweep == n) {
                self.contacts.wake();
            }
        }
    }
}

/// A group of the interface.
#[derive(Debug, Default)]
pub(super) struct Group {
    pub set: Set,
    /// Grains of the group, ascending; line `k` of the set is grain `grains[k]`.
    pub grains: Vec<u32>,
    /// Where each grain's velocity lives: which of the pair's subdomains, and its line there.
    pub home: Vec<(u8, u32)>,
}

/// All sets of a step.
#[derive(Debug, Default)]
pub struct Decomposition {
    pub(super) subdomains: Vec<Mutex<Set>>,
    pub(super) groups: Vec<Mutex<Group>>,
    pub(super) partition: Partition,
    /// BodyVelocity of each grain in its subdomain `[ng]`.
    pub(super) line_of: Vec<u32>,
    pub(super) boundary: Boundary,
    /// Of the problem, m/s.
    pub(super) fall: f64,
    /// Buffers: of the tests of the asynchronous schedule, and of what velocities are read from.
    pub(super) reports: Vec<Report>,
    sets: Vec<&'static ContactSet>,
    turns: Turns,
}

/// Access to a lock that no panic leaves in a state to fear: lines hold plain numbers.
pub(super) fn open<T>(lock: &mut Mutex<T>) -> &mut T {
    lock.get_mut().unwrap_or_else(PoisonError::into_inner)
}

/// Takes a lock, whatever happened to its last holder.
pub(super) fn enter<T>(lock: &Mutex<T>) -> MutexGuard<'_, T> {
    lock.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Decomposition {
    /// The partition, to be filled before [`Self::pack`].
    pub fn partition_mut(&mut self) -> &mut Partition {
        &mut self.partition
    }

    /// The partition of the step.
    pub fn partition(&self) -> &Partition {
        &self.partition
    }

    /// Lays out the contacts of `problem` in sets, velocities at their free values.
    pub fn pack(&mut self, problem: &LocalProblem) {
        self.fall = problem.fall;
        let partition = &self.partition;
        self.line_of.resize(partition.owner.len(), 0);
        for s in 0..partition.grains.len() {
            for (line, &grain) in (0u32..).zip(partition.grains.list(s)) {
                self.line_of[grain as usize] = line;
            }
        }
        let line_of = &self.line_of;
        self.subdomains.resize_with(partition.grains.len(), Mutex::default);
        self.subdomains.par_iter_mut().enumerate().for_each(|(s, set)| {
            let set = &mut open(set).contacts;
            let grains = partition.grains.list(s);
            set.pack(problem, partition.contacts.list(s), grains.len(), |g| line_of[g as usize]);
            fill(set, grains, problem);
        });
        self.groups.resize_with(partition.interface.pairs.len(), Mutex::default);
        self.groups.par_iter_mut().enumerate().for_each(|(g, group)| {
            open(group).pack(problem, partition, line_of, g);
        });
    }

    /// Starts from the impulses that the sets hold: `V = V_free + M⁻¹ H r`.
    pub(super) fn apply_impulses(&mut self) {
        self.on_sets_in_turn(|set| set.contacts.apply_impulses());
    }

    /// Does `work` that needs no velocities on every set, in parallel.
    pub(super) fn on_sets(&mut self, work: impl Fn(&mut Set) + Sync + Send) {
        let Self { subdomains, groups, .. } = self;
        let sets = subdomains.par_iter_mut().map(open);
        sets.chain(groups.par_iter_mut().map(|group| &mut open(group).set)).for_each(work);
    }

    /// Does `work` on every set in the order of the synchronous schedule, velocities at hand.
    pub(super) fn on_sets_in_turn(&mut self, work: impl Fn(&mut Set) + Sync) {
        let mut once = Some((1, ()));
        self.in_stretches(|set, _, ()| work(set), |_| once.take());
    }

    /// Does `work` on every set in the order of the synchronous schedule, velocities at hand, pass after pass: on
    /// all subdomains, then on the groups of the interface, colour by colour. `next` gives the first stretch of passes
    /// and, when it has been made, what follows.
    pub(super) fn in_stretches<P: Copy + Send + Sync>(
        &mut self,
        work: impl Fn(&mut Set, Turn, &P) + Sync,
        mut next: impl FnMut(&Self) -> Option<Stretch<P>> + Send,
    ) {
        let mut turns = std::mem::take(&mut self.turns);
        let visit = |turn: Turn, plan: &P| self.visit(turn.set, |set| work(set, turn, plan));
        turns.run(&self.partition.interface, visit, || next(self));
        self.turns = turns;
    }

    /// Does `work` on set number `s`, velocities at hand.
    fn visit(&self, s: usize, work: impl FnOnce(&mut Set)) {
        let Some(g) = s.checked_sub(self.subdomains.len()) else {
            return work(&mut enter(&self.subdomains[s]));
        };
        let mut group = enter(&self.groups[g]);
        let mut homes = self.homes(g);
        group.gather(&homes);
        work(&mut group.set);
        for (line, &(side, to)) in group.set.contacts.lines.iter().zip(&group.home) {
            homes[side as usize].contacts.lines[to as usize] = *line;
        }
    }

    /// Number of sets.
    pub(super) fn sets(&self) -> usize {
        self.subdomains.len() + self.groups.len()
    }

    /// Number of the set whose turn is `k`-th in the synchronous schedule: subdomains, then groups
    /// colour by colour.
    pub(super) fn in_order(&self, k: usize) -> usize {
        let first = self.subdomains.len();
        if k < first {
            k
        } else {
            first + self.partition.interface.colours.items[k - first] as usize
        }
    }

    /// Does `work` on set number `s`, alone.
    pub(super) fn with_set<T>(&self, s: usize, work: impl FnOnce(&mut Set) -> T) -> T {
        match s.checked_sub(self.subdomains.len()) {
            None => work(&mut enter(&self.subdomains[s])),
            Some(g) => work(&mut enter(&self.groups[g]).set),
        }
    }

    /// Sweeps over set number `s` per DDM iteration.
    pub(super) fn sweeps(&self, s: usize, solver: &Solver) -> u32 {
        if s < self.subdomains.len() { solver.subdomain_sweeps } else { solver.interface_sweeps }
    }

    /// Iterations begun since the velocities were split into parts.
    pub(super) fn begun(&self) -> u32 {
        (0..self.sets()).map(|s| self.with_set(s, |set| set.visits)).max().unwrap_or(0)
    }

    /// Sum over the sets, in their order.
    pub(super) fn sum<T: AddAssign + Default>(&self, of: impl Fn(&Set) -> T) -> T {
        let mut sum = T::default();
        (0..self.sets()).for_each(|s| sum += self.with_set(s, |set| of(set)));
        sum
    }

    /// Contact visits since the contacts were packed.
    pub(super) fn visits(&self) -> u64 {
        self.sum(|set| set.contacts.visits())
    }

    /// Norms of the last measured sweeps.
    pub(super) fn visit_norms(&self) -> VisitNorms {
        self.sum(|set| set.norms)
    }

    /// Natural map residual of the whole problem at the present velocities and impulses.
    pub(super) fn natural_map(&mut self) -> f64 {
        self.on_sets_in_turn(|set| set.map = set.contacts.natural_map());
        self.last_map()
    }

    /// The same of the sets as they were last looked at. Impulses that fade away with what is left of the map say nothing.
    pub(super) fn last_map(&self) -> f64 {
        if self.visit_norms().are_of_rounding() {
            return 0.0;
        }
        self.sum(|set| set.map).residual()
    }

    /// The two subdomains between which group `g` lies, locked in ascending order.
    fn homes(&self, g: usize) -> [MutexGuard<'_, Set>; 2] {
        self.partition.interface.pairs[g].map(|s| enter(&self.subdomains[s as usize]))
    }

    /// Writes out the impulses of the solution: on the candidates, world axes, N s `[nc]`.
    pub fn unpack_impulses(&mut self, problem: &LocalProblem, impulse: &mut [Vec3]) {
        for group in &mut self.groups {
            open(group).set.contacts.unpack(impulse);
        }
        for set in &mut self.subdomains {
            open(set).contacts.unpack(impulse);
        }
        (impulse, &problem.contacts)
            .into_par_iter()
            .with_min_len(4096)
            .for_each(|(impulse, contact)| *impulse = contact.world(impulse));
    }

    /// Writes out the velocities of the solution, of the mobile bodies `[ng + nm]`: m/s and rad/s.
    pub fn unpack_velocities(
        &mut self,
        problem: &LocalProblem,
        velocity: &mut Vec<Vec3>,
        angular_velocity: &mut Vec<Vec3>,
    ) {
        let Self { subdomains, partition, line_of, .. } = self;
        let mut sets = emptied(std::mem::take(&mut self.sets));
        sets.extend(subdomains.iter_mut().map(|set| &open(set).contacts));
        (&partition.owner, &*line_of)
            .into_par_iter()
            .enumerate()
            .with_min_len(1024)
            .map(|(g, (&s, &line))| problem.velocity(g, &sets[s as usize].lines[line as usize]))
            .unzip_into_vecs(velocity, angular_velocity);
        self.sets = emptied(sets);
    }
}

/// The memory of a list of references, for a list of others.
fn emptied<'b, T>(mut list: Vec<&T>) -> Vec<&'b T> {
    list.clear();
    // Nothing is left to be mapped; what is collected is the list's own memory.
    list.into_iter().map(|_| unreachable!()).collect()
}

/// Sets the lines of `set` to the free velocities of `grains`.
fn fill(set: &mut ContactSet, grains: &[u32], problem: &LocalProblem) {
    debug_assert!(grains.is_sorted());
    let first_mounted = problem.lines.len() - problem.responses.len();
    set.grains = grains.partition_point(|&body| (body as usize) < first_mounted);
    for (line, &grain) in set.lines.iter_mut().zip(grains) {
        *line = problem.lines[grain as usize];
    }
}

impl Group {
    /// Copies its grains' newest velocities into its own lines.
    fn gather(&mut self, homes: &[MutexGuard<'_, Set>; 2]) {
        for (line, &(side, from)) in self.set.contacts.lines.iter_mut().zip(&self.home) {
            *line = homes[side as usize].contacts.lines[from as usize];
        }
    }

    fn pack(&mut self, problem: &LocalProblem, partition: &Partition, line_of: &[u32], g: usize) {
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
        set.contacts.pack(problem, contacts, grains.len(), |grain| {
            grains.partition_point(|&other| other < grain) as u32
        });
        fill(&mut set.contacts, grains, problem);
    }
}
