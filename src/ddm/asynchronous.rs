//! No barrier: subdomains and interface groups are swept in one parallel loop with the newest
//! values at hand (HSDA, version 3, without its lost updates).
//!
//! The velocity of a boundary grain is the sum of parts, one per set that has contacts on it:
//! `V = V_E + Σ V_Γ`. A part is written by its set only and read by the others on the fly, so
//! nothing is lost and momentum is exact to rounding, whatever the interleaving.
//!
//! Work is handed out as tickets: ticket `k` is the `k / sets`-th iteration of set `k % sets`. One
//! thread therefore walks through the sets in order, and one set alone is swept as by the other
//! schedules.

use super::decomposition::{Set, enter, open};
use super::{Decomposition, Outcome, is_solved, is_test, synchronous};
use crate::model::{Norm, Solver};
use crate::nlgs::{Residuals, VisitNorms};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// Residuals may rise while contacts open and close; above this multiple of the smallest seen, and
/// above [`ALARM`], they never came back in trials.
const GROWTH: f64 = 1e3;

/// Smallest residual that counts as diverging: visits change velocities a hundred times more than
/// the impulses explain.
const ALARM: f64 = 1e2;

/// Velocity components of a line.
const COMPONENTS: usize = 6;

/// A part of a boundary grain's velocity, shared between threads.
#[derive(Debug, Default)]
struct Part([AtomicU64; COMPONENTS]);

impl Part {
    fn store(&self, value: &[f64; COMPONENTS]) {
        for (to, from) in self.0.iter().zip(value) {
            to.store(from.to_bits(), Ordering::Relaxed);
        }
    }

    fn add_to(&self, sum: &mut [f64; COMPONENTS]) {
        for (to, from) in sum.iter_mut().zip(&self.0) {
            *to += f64::from_bits(from.load(Ordering::Relaxed));
        }
    }
}

/// A line of a set whose grain other sets work on as well.
#[derive(Debug, Clone, Copy)]
struct Shared {
    line: u32,
    /// This set's part, and all parts of the grain.
    own: u32,
    parts: [u32; 2],
}

/// The boundary of all sets: subdomains first, then groups.
struct Boundary {
    parts: Vec<Part>,
    /// Shared lines of each set.
    shared: Vec<Vec<Shared>>,
}

impl Boundary {
    /// Numbers the parts of every boundary grain: its subdomain's first, then those of the groups.
    fn new(decomposition: &mut Decomposition) -> Self {
        let subdomains = decomposition.subdomains.len();
        let mut uses: Vec<(u32, u32, u32)> = Vec::new();
        for (g, group) in decomposition.groups.iter_mut().enumerate() {
            let grains = &open(group).grains;
            uses.extend(
                grains.iter().zip(0u32..).map(|(&grain, k)| (grain, (subdomains + g) as u32, k)),
            );
        }
        uses.sort_unstable();
        let mut shared = vec![Vec::new(); subdomains + decomposition.groups.len()];
        let mut next = 0;
        for same in uses.chunk_by(|a, b| a.0 == b.0) {
            let grain = same[0].0 as usize;
            let parts = [next, next + 1 + same.len() as u32];
            let owner = decomposition.partition.owner[grain];
            let home = (owner, decomposition.line_of[grain]);
            let sets = std::iter::once(home).chain(same.iter().map(|&(_, set, line)| (set, line)));
            for (own, (set, line)) in (next..).zip(sets) {
                shared[set as usize].push(Shared { line, own, parts });
            }
            next = parts[1];
        }
        let parts = (0..next).map(|_| Part::default()).collect();
        Self { parts, shared }
    }

    /// Publishes what `set` number `s` holds in its lines as its part.
    fn publish_lines(&self, s: usize, set: &Set) {
        for shared in &self.shared[s] {
            self.parts[shared.own as usize].store(&velocity(set, shared.line));
        }
    }

    /// Sweeps `set` with the others' newest parts and publishes its own.
    fn visit(&self, s: usize, set: &mut Set, sweep: impl FnOnce(&mut Set)) {
        let shared = &self.shared[s];
        let others: Vec<[f64; COMPONENTS]> = shared.iter().map(|x| self.others(x)).collect();
        for (x, others) in shared.iter().zip(&others) {
            let mut own = [0.0; COMPONENTS];
            self.parts[x.own as usize].add_to(&mut own);
            let line = &mut set.contacts.lines[x.line as usize].0;
            for k in 0..COMPONENTS {
                line[k] = own[k] + others[k];
            }
        }
        sweep(set);
        for (x, others) in shared.iter().zip(&others) {
            let mut own = velocity(set, x.line);
            for k in 0..COMPONENTS {
                own[k] -= others[k];
            }
            self.parts[x.own as usize].store(&own);
        }
    }

    fn others(&self, shared: &Shared) -> [f64; COMPONENTS] {
        let mut sum = [0.0; COMPONENTS];
        for part in (shared.parts[0]..shared.parts[1]).filter(|&part| part != shared.own) {
            self.parts[part as usize].add_to(&mut sum);
        }
        sum
    }

    /// Writes the sum of all parts into the subdomains' lines.
    fn settle(&self, decomposition: &mut Decomposition) {
        for (set, shared) in decomposition.subdomains.iter_mut().zip(&self.shared) {
            let lines = &mut open(set).contacts.lines;
            for x in shared {
                let mut sum = self.others(x);
                self.parts[x.own as usize].add_to(&mut sum);
                lines[x.line as usize].0[..COMPONENTS].copy_from_slice(&sum);
            }
        }
    }
}

fn velocity(set: &Set, line: u32) -> [f64; COMPONENTS] {
    std::array::from_fn(|k| set.contacts.lines[line as usize].0[k])
}

/// What the threads share about the course of the iterations.
struct Course<'a> {
    solver: &'a Solver,
    sets: u64,
    ticket: AtomicU64,
    stop: AtomicBool,
    diverged: AtomicBool,
    /// Sets that have ended each test's iteration, and its norms.
    tests: Mutex<Tests>,
}

#[derive(Default)]
struct Tests {
    norms: Vec<VisitNorms>,
    ended: u64,
    /// Iterations that the last complete test counts.
    iterations: u32,
    residuals: Residuals,
    least: Option<f64>,
    /// Largest `Σ ‖Δv‖²` of a test so far, (m/s)².
    largest_change: f64,
    solved: bool,
}

impl Course<'_> {
    /// Takes the norms of set `s` after iteration `done`; judges once every set has reported since
    /// the last judgement.
    fn report(&self, s: usize, done: u32, norms: &VisitNorms) {
        let mut tests = enter(&self.tests);
        tests.norms[s] = *norms;
        tests.ended += 1;
        if tests.ended < self.sets {
            return;
        }
        tests.ended = 0;
        let mut sum = VisitNorms::default();
        tests.norms.iter().for_each(|part| sum += *part);
        tests.iterations = done;
        tests.residuals = sum.residuals();
        let value = tests.residuals.qm16();
        let least = tests.least.map_or(value, |least| least.min(value));
        tests.least = Some(least);
        // The residual alone grows, up to infinity, where all contacts open and no impulse is left
        // to compare with: there the changes fade. Where iterations diverge they grow.
        let overflowed = !(sum.dv_squared + sum.wr_squared).is_finite();
        let fades = sum.dv_squared <= tests.largest_change;
        tests.largest_change = tests.largest_change.max(sum.dv_squared);
        let grown = !fades && value > ALARM.max(GROWTH * least);
        if overflowed || grown {
            self.diverged.store(true, Ordering::Relaxed);
            self.stop.store(true, Ordering::Relaxed);
        }
        // The natural map needs a state at rest: here the norms of the visits decide.
        let norm = if self.solver.norm == Norm::NaturalMap { Norm::Qm16 } else { self.solver.norm };
        if is_solved(&Solver { norm, ..*self.solver }, &tests.residuals) {
            tests.solved = true;
            self.stop.store(true, Ordering::Relaxed);
        }
    }
}

/// Iterates until the tolerance or the cap is reached; `None` if the iterations diverged.
pub(super) fn iterate(decomposition: &mut Decomposition, solver: &Solver) -> Option<Outcome> {
    let boundary = Boundary::new(decomposition);
    let sets = boundary.shared.len();
    split_start(decomposition, &boundary);
    let course = Course {
        solver,
        sets: sets as u64,
        ticket: AtomicU64::new(0),
        stop: AtomicBool::new(sets == 0),
        diverged: AtomicBool::new(false),
        tests: Mutex::new(Tests { norms: vec![VisitNorms::default(); sets], ..Tests::default() }),
    };
    let shared: &Decomposition = decomposition;
    rayon::scope(|scope| {
        for _ in 0..rayon::current_num_threads().min(sets) {
            scope.spawn(|_| work(shared, &boundary, &course));
        }
    });
    if course.diverged.into_inner() {
        return None;
    }
    boundary.settle(decomposition);
    let tickets = course.ticket.into_inner();
    let tests = course.tests.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
    let iterations = if tests.solved { tests.iterations } else { solver.iterations };
    let share = tickets.min(u64::from(solver.iterations) * sets as u64) / (sets as u64).max(1);
    let mut outcome = Outcome {
        iterations,
        visits: decomposition.visits(solver) * share,
        residuals: tests.residuals,
        converged: solver.tolerance.is_none() || tests.solved,
        guarded: false,
    };
    if tests.solved && sets > 1 {
        confirm(decomposition, solver, &mut outcome);
    }
    outcome.residuals.natural_map = decomposition.natural_map();
    Some(outcome)
}

/// Measures the sets once more, one after another, and goes on like that if need be.
///
/// The norms of a run without barriers are taken at different times: a thread that was held up may
/// have news for the others that their small changes do not show.
fn confirm(decomposition: &mut Decomposition, solver: &Solver, outcome: &mut Outcome) {
    let left = solver.iterations.saturating_sub(outcome.iterations).max(1);
    let rest = Solver { iterations: left, check_every: 1, ..*solver };
    let confirmed = synchronous::iterate(decomposition, &rest);
    outcome.iterations += confirmed.iterations;
    outcome.visits += confirmed.visits;
    outcome.residuals = confirmed.residuals;
    outcome.converged = confirmed.converged;
}

/// Splits the velocities that the iterations start from into parts: a group's part is what its own
/// impulses have contributed, a subdomain's part is all the rest.
fn split_start(decomposition: &mut Decomposition, boundary: &Boundary) {
    let subdomains = decomposition.subdomains.len();
    for (g, group) in decomposition.groups.iter_mut().enumerate() {
        let set = &mut open(group).set;
        for line in &mut set.contacts.lines {
            line.0[..COMPONENTS].fill(0.0);
        }
        set.contacts.apply_impulses();
        boundary.publish_lines(subdomains + g, set);
    }
    for (s, set) in decomposition.subdomains.iter_mut().enumerate() {
        let set = open(set);
        for x in &boundary.shared[s] {
            let others = boundary.others(x);
            let mut own = velocity(set, x.line);
            for k in 0..COMPONENTS {
                own[k] -= others[k];
            }
            boundary.parts[x.own as usize].store(&own);
        }
    }
}

/// Draws tickets until the cap or a stop.
fn work(decomposition: &Decomposition, boundary: &Boundary, course: &Course) {
    let solver = course.solver;
    let subdomains = decomposition.subdomains.len();
    let last = u64::from(solver.iterations) * course.sets;
    while !course.stop.load(Ordering::Relaxed) {
        let ticket = course.ticket.fetch_add(1, Ordering::Relaxed);
        if ticket >= last {
            break;
        }
        let s = (ticket % course.sets) as usize;
        let done = (ticket / course.sets) as u32 + 1;
        let measured = is_test(solver, done);
        let sweep = |set: &mut Set, sweeps: u32| {
            boundary.visit(s, set, |set| set.sweeps(sweeps, solver.relaxation, measured));
            if measured {
                course.report(s, done, &set.norms);
            }
        };
        if s < subdomains {
            sweep(&mut enter(&decomposition.subdomains[s]), solver.subdomain_sweeps);
        } else {
            let mut group = enter(&decomposition.groups[s - subdomains]);
            sweep(&mut group.set, solver.interface_sweeps);
        }
    }
}
