//! Decomposition of a step's problem into contact sets: one per subdomain, one per group of the interface.
//!
//! Sets are numbered subdomains first. Between the visits of the synchronous schedule the subdomains hold the body
//! velocities. A group of the interface works on copies for its bodies, gathered before and scattered after a visit.
//! Sets that share a subdomain are visited one after another ([`super::sweep_scheduler`]), so no lock is ever waited
//! for, and the order of threads has no effect.

use super::boundary::Boundary;
use super::sweep_scheduler::{PassBatch, SweepScheduler, SweepTask};
use super::sweep_set::{InterfaceGroup, SweepSet, get_mut, load_free_velocities, lock};
use crate::lanes::BodyVelocity;
use crate::local_problem::LocalProblem;
use crate::math::Vec3;
use crate::model::Solver;
use crate::nlgs::{ComplementarityGap, VisitNorms};
use crate::partition::Partition;
use rayon::prelude::*;
use std::ops::AddAssign;
use std::sync::{Mutex, MutexGuard};

/// Visit count of a set when its norms were taken, and these norms.
pub(super) type SetReport = (u32, VisitNorms);

/// All contact sets of a step.
#[derive(Debug, Default)]
pub struct Decomposition {
    pub(super) subdomains: Vec<Mutex<SweepSet>>,
    pub(super) groups: Vec<Mutex<InterfaceGroup>>,
    pub(super) partition: Partition,
    /// Index of each body in its subdomain `[ng]`.
    pub(super) line_of: Vec<u32>,
    pub(super) boundary: Boundary,
    /// Velocity that gravity adds in a step, m/s.
    pub(super) gravity_dv: f64,
    /// Buffer of the convergence tests of the asynchronous schedule.
    pub(super) reports: Vec<SetReport>,
    /// Buffer for reading out the velocities; empty in between.
    velocities: Vec<Vec<BodyVelocity>>,
    scheduler: SweepScheduler,
}

impl Decomposition {
    /// Returns the partition, to be filled before [`Self::pack`].
    pub fn partition_mut(&mut self) -> &mut Partition {
        &mut self.partition
    }

    /// Returns the partition of the step.
    pub fn partition(&self) -> &Partition {
        &self.partition
    }

    /// Packs the contacts of `problem` into sets with free velocities.
    pub fn pack(&mut self, problem: &LocalProblem) {
        self.gravity_dv = problem.gravity_dv;
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
            let set = get_mut(set);
            set.mark_converged(false);
            let set = &mut set.contacts;
            let grains = partition.grains.list(s);
            set.pack(problem, partition.contacts.list(s), grains.len(), |g| line_of[g as usize]);
            load_free_velocities(set, grains, problem);
        });
        self.groups.resize_with(partition.interface.pairs.len(), Mutex::default);
        self.groups.par_iter_mut().enumerate().for_each(|(g, group)| {
            get_mut(group).pack(problem, partition, line_of, g);
        });
    }

    /// Adds the effect of the sets' impulses to the velocities: `V = V_free + M⁻¹ H r`.
    pub(super) fn apply_impulses(&mut self) {
        self.for_each_set_in_order(|set| set.contacts.apply_impulses());
    }

    /// Calls `work`, which must not use velocities, for every set, in parallel.
    pub(super) fn for_each_set(&mut self, work: impl Fn(&mut SweepSet) + Sync + Send) {
        let Self { subdomains, groups, .. } = self;
        let sets = subdomains.par_iter_mut().map(get_mut);
        sets.chain(groups.par_iter_mut().map(|group| &mut get_mut(group).set)).for_each(work);
    }

    /// Calls `work` for every set in the order of the synchronous schedule, with current velocities.
    pub(super) fn for_each_set_in_order(&mut self, work: impl Fn(&mut SweepSet) + Sync) {
        let mut once = Some(PassBatch { passes: 1, plan: () });
        self.for_each_pass(|_, _, ()| true, |set, _, ()| work(set), |_| once.take());
    }

    /// Calls `work`, pass after pass, for every set that `needs` it, in the order of the synchronous schedule and with
    /// current velocities.
    ///
    /// A pass visits all subdomains, then the groups of the interface, colour by colour. `next` returns the first
    /// batch of passes and, when all visits of a batch have ended, the following one.
    pub(super) fn for_each_pass<P: Copy + Send + Sync>(
        &mut self,
        needs: impl Fn(&SweepSet, SweepTask, &P) -> bool + Sync,
        work: impl Fn(&mut SweepSet, SweepTask, &P) + Sync,
        mut next: impl FnMut(&Self) -> Option<PassBatch<P>> + Send,
    ) {
        let mut scheduler = std::mem::take(&mut self.scheduler);
        let visit = |task: SweepTask, plan: &P| {
            self.visit(task.set, |set| needs(set, task, plan), |set| work(set, task, plan));
        };
        scheduler.run(&self.partition.interface, visit, || next(self));
        self.scheduler = scheduler;
    }

    /// Calls `work` for set number `s` with current velocities, if the set `needs` it.
    fn visit(
        &self,
        s: usize,
        needs: impl FnOnce(&SweepSet) -> bool,
        work: impl FnOnce(&mut SweepSet),
    ) {
        let Some(g) = s.checked_sub(self.subdomains.len()) else {
            let set = &mut lock(&self.subdomains[s]);
            if needs(set) {
                work(set);
            }
            return;
        };
        let mut group = lock(&self.groups[g]);
        if !needs(&group.set) {
            return;
        }
        let mut homes = self.lock_homes(g);
        group.gather(&homes);
        work(&mut group.set);
        for (line, &(side, to)) in group.set.contacts.lines.iter().zip(&group.home) {
            homes[side as usize].contacts.lines[to as usize] = *line;
        }
    }

    /// Number of sets.
    pub(super) fn set_count(&self) -> usize {
        self.subdomains.len() + self.groups.len()
    }

    /// Number of the set that is the `k`-th in the synchronous order: subdomains, then groups colour by colour.
    pub(super) fn set_in_order(&self, k: usize) -> usize {
        let first = self.subdomains.len();
        if k < first {
            k
        } else {
            first + self.partition.interface.colours.items[k - first] as usize
        }
    }

    /// Calls `work` for set number `s` under its lock.
    pub(super) fn with_set<T>(&self, s: usize, work: impl FnOnce(&mut SweepSet) -> T) -> T {
        match s.checked_sub(self.subdomains.len()) {
            None => work(&mut lock(&self.subdomains[s])),
            Some(g) => work(&mut lock(&self.groups[g]).set),
        }
    }

    /// Number of sweeps over set number `s` per DDM iteration.
    pub(super) fn sweeps_per_iteration(&self, s: usize, solver: &Solver) -> u32 {
        if s < self.subdomains.len() { solver.subdomain_sweeps } else { solver.interface_sweeps }
    }

    /// Number of iterations begun since [`Self::split_velocities`].
    pub(super) fn begun_iterations(&self) -> u32 {
        (0..self.set_count()).map(|s| self.with_set(s, |set| set.visits)).max().unwrap_or(0)
    }

    /// Returns the sum over the sets, in their order.
    pub(super) fn sum<T: AddAssign + Default>(&self, of: impl Fn(&SweepSet) -> T) -> T {
        let mut sum = T::default();
        (0..self.set_count()).for_each(|s| sum += self.with_set(s, |set| of(set)));
        sum
    }

    /// Number of contact visits since the contacts were packed.
    pub(super) fn visits(&self) -> u64 {
        self.sum(|set| set.contacts.visits())
    }

    /// Norms of the last measured sweeps.
    pub(super) fn visit_norms(&self) -> VisitNorms {
        self.sum(|set| set.norms)
    }

    /// Marks the sets whose norms of the last measured sweep are small beside `norms`, those of all sets; none without a
    /// tolerance.
    pub(super) fn mark_converged_sets(&self, tolerance: Option<f64>, norms: &VisitNorms) {
        let is_converged = |part: &VisitNorms| {
            tolerance.is_some_and(|limit| part.is_part_converged(norms, limit, self.gravity_dv))
        };
        for s in 0..self.set_count() {
            self.with_set(s, |set| set.mark_converged(is_converged(&set.norms)));
        }
    }

    /// Computes the natural map residual and the complementarity gap of the whole problem at the current velocities and
    /// impulses.
    pub(super) fn law_errors(&mut self) -> (f64, ComplementarityGap) {
        self.for_each_set_in_order(|set| set.law = set.contacts.law_sums());
        (self.last_natural_map(), self.sum(|set| set.law).complementarity)
    }

    /// Returns the natural map residual from the last sums of the sets; zero if only rounding changes the impulses.
    pub(super) fn last_natural_map(&self) -> f64 {
        if self.visit_norms().is_rounding_noise() {
            return 0.0;
        }
        self.sum(|set| set.law).natural_map()
    }

    /// Locks the two subdomains of group `g` in ascending order.
    fn lock_homes(&self, g: usize) -> [MutexGuard<'_, SweepSet>; 2] {
        self.partition.interface.pairs[g].map(|s| lock(&self.subdomains[s as usize]))
    }

    /// Splits the velocities of boundary bodies into parts, for the asynchronous schedule.
    pub(super) fn split_velocities(&mut self) {
        let Self { subdomains, groups, boundary, partition, line_of, .. } = self;
        boundary.split(subdomains, groups, &partition.owner, line_of);
    }

    /// Writes the sums of all parts into the velocities of the subdomains.
    pub(super) fn join_velocities(&mut self) {
        let Self { subdomains, boundary, .. } = self;
        subdomains.par_iter_mut().for_each(|set| boundary.gather(get_mut(set)));
    }

    /// Writes the impulses of the solution: on the candidates, world axes, N s `[nc]`.
    pub fn unpack_impulses(&mut self, problem: &LocalProblem, impulse: &mut [Vec3]) {
        for group in &mut self.groups {
            get_mut(group).set.contacts.unpack(impulse);
        }
        for set in &mut self.subdomains {
            get_mut(set).contacts.unpack(impulse);
        }
        (impulse, &problem.contacts)
            .into_par_iter()
            .with_min_len(4096)
            .for_each(|(impulse, contact)| *impulse = contact.world(impulse));
    }

    /// Writes the velocities of the solution, of the mobile bodies `[ng + nm]`: m/s and rad/s.
    pub fn unpack_velocities(
        &mut self,
        problem: &LocalProblem,
        velocity: &mut Vec<Vec3>,
        angular_velocity: &mut Vec<Vec3>,
    ) {
        let Self { subdomains, partition, line_of, velocities, .. } = self;
        // Moved out of their locks, so that all threads can read them.
        let lines = subdomains.iter_mut().map(|set| &mut get_mut(set).contacts.lines);
        velocities.clear();
        velocities.extend(lines.map(std::mem::take));
        (&partition.owner, &*line_of)
            .into_par_iter()
            .enumerate()
            .with_min_len(1024)
            .map(|(g, (&s, &line))| problem.velocity(g, &velocities[s as usize][line as usize]))
            .unzip_into_vecs(velocity, angular_velocity);
        for (set, lines) in subdomains.iter_mut().zip(velocities.drain(..)) {
            get_mut(set).contacts.lines = lines;
        }
    }
}
