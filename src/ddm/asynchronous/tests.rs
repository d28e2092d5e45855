//! Threads of the asynchronous schedule simulated by one, so that overlaps follow a seed.

use super::*;
use crate::ddm::tests::{Solved, momentum_error, run_with, solver, wall};
use crate::detection::Contacts;
use crate::math::Vec3;
use crate::model::{Model, Schedule};
use crate::state::State;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::cell::Cell;

/// Next action of a simulated thread.
#[derive(Clone, Copy, PartialEq)]
enum NextAction {
    Draw,
    Begin(usize),
    End(usize),
    Leave,
}

/// Simulates `threads` threads; `pick` chooses the one to run among those that can.
fn simulate(
    run: &AsynchronousRun,
    threads: usize,
    mut pick: impl FnMut(&[(usize, NextAction)]) -> usize,
) {
    let mut next = vec![NextAction::Draw; threads];
    loop {
        let can: Vec<(usize, NextAction)> = (0..threads)
            .map(|t| (t, next[t]))
            .filter(|&(_, n)| match n {
                NextAction::Begin(s) => !next.contains(&NextAction::End(s)),
                n => n != NextAction::Leave,
            })
            .collect();
        if can.is_empty() {
            return;
        }
        let (t, now) = can[pick(&can)];
        next[t] = match now {
            NextAction::Draw => run.draw().map_or(NextAction::Leave, NextAction::Begin),
            NextAction::Begin(s) => {
                run.decomposition.with_set(s, |set| run.begin_visit(set));
                NextAction::End(s)
            }
            NextAction::End(s) => {
                run.decomposition.with_set(s, |set| run.end_visit(s, set));
                NextAction::Draw
            }
            NextAction::Leave => NextAction::Leave,
        };
    }
}

/// Simulates threads of very different, random speeds.
fn simulate_random(run: &AsynchronousRun, threads: usize, seed: u64) {
    let mut rng = Pcg64::seed_from_u64(seed);
    let speed: Vec<f64> = (0..threads).map(|_| 10_f64.powf(rng.random_range(-3.0..0.0))).collect();
    simulate(run, threads, |can| {
        let mut left = rng.random_range(0.0..can.iter().map(|&(t, _)| speed[t]).sum());
        let chosen = can.iter().position(|&(t, _)| {
            left -= speed[t];
            left < 0.0
        });
        chosen.unwrap_or(can.len() - 1)
    });
}

/// Simulates threads in step: as many visits as threads answer the same velocities.
fn simulate_in_step(run: &AsynchronousRun, threads: usize) {
    simulate(run, threads, |can| {
        let rank = |n: NextAction| match n {
            NextAction::Draw => 0,
            NextAction::Begin(_) => 1,
            NextAction::End(_) | NextAction::Leave => 2,
        };
        (0..can.len()).min_by_key(|&i| rank(can[i].1)).unwrap_or(0)
    });
}

/// Simulates threads in step for 0, otherwise with a seed.
fn simulate_numbered(run: &AsynchronousRun, threads: u32, number: u64) {
    match number {
        0 => simulate_in_step(run, threads as usize),
        seed => simulate_random(run, threads as usize, seed),
    }
}

/// Problem of the wall with its solution by the synchronous schedule.
struct SolvedWall {
    model: Model,
    state: State,
    contacts: Contacts,
    expected: Solved,
}

impl SolvedWall {
    fn new(solver: Solver) -> Self {
        let (model, state, contacts) = wall(6, 5, solver);
        let expected = run_with(&model, &state, &contacts, &[], |d, _| {
            d.apply_impulses();
            synchronous::iterate(d, &model.solver, &mut || None).expect("the step is not cancelled")
        });
        Self { model, state, contacts, expected }
    }

    /// Number of plain iterations that solve it.
    fn plain_iterations(&self) -> u32 {
        let plain = Solver { acceleration: Acceleration::None, ..self.model.solver };
        let solved = run_with(&self.model, &self.state, &self.contacts, &[], |d, _| {
            d.apply_impulses();
            synchronous::iterate(d, &plain, &mut || None).expect("the step is not cancelled")
        });
        assert!(solved.outcome.converged);
        solved.outcome.iterations
    }

    /// Solves with the asynchronous schedule from the impulses `start`; also returns the number of its runs.
    fn solve(&self, start: &[Vec3], threads: u32, number: u64) -> (Solved, u32) {
        let runs = Cell::new(0);
        let solved = run_with(&self.model, &self.state, &self.contacts, start, |d, _| {
            d.apply_impulses();
            let work = |run: &AsynchronousRun| {
                runs.set(runs.get() + 1);
                simulate_numbered(run, threads, number);
            };
            match iterate_with(d, &self.model.solver, &mut || None, work) {
                Ok(AsynchronousOutcome::Solved(outcome)) => outcome,
                other => panic!("unexpected divergence: {other:?}"),
            }
        });
        (solved, runs.get())
    }
}

#[test]
fn overlapping_visits_need_about_as_many_iterations_as_synchronous_ones() {
    for (subdomains, convergence_check_interval) in [(2, 1), (4, 10), (9, 1)] {
        let case = SolvedWall::new(Solver {
            convergence_check_interval,
            ..solver(Schedule::Asynchronous, subdomains)
        });
        assert!(case.expected.outcome.converged);
        // Its visits are plain: about as many iterations as plain ones in parallel would take.
        let most = case.plain_iterations() * 13 / 10;
        for threads in [2, 4, 8].into_iter().filter(|&t| t <= subdomains) {
            for number in 0..3 {
                let (solved, runs) = case.solve(&[], threads, number);
                let place = format!("{subdomains} {threads} {number}: {:?}", solved.outcome);
                assert!(solved.outcome.converged, "{place}");
                assert!(solved.outcome.iterations < most, "{place}, expected {most}");
                // A run that ends too early costs a pass, and should be rare.
                assert!(runs <= 10, "{place}: {runs}");
                assert!(momentum_error(&case.model, &case.contacts, &solved) < 1e-12, "{place}");
                for (a, b) in case.expected.velocity.iter().zip(&solved.velocity) {
                    // Free fall gains 1e-2 m/s in this step.
                    assert!((a - b).norm() < 1e-7, "{place}: {a:?} {b:?}");
                }
            }
        }
    }
}

#[test]
fn a_step_that_opens_every_contact_is_not_taken_for_divergence() {
    for subdomains in [2, 9] {
        let mut case = SolvedWall::new(Solver {
            convergence_check_interval: 1,
            ..solver(Schedule::Asynchronous, subdomains)
        });
        let rest = case.expected.impulse.clone();
        // Every cube starts from the impulses that carried it, and flies off.
        case.model.gravity = Vec3::new(0.0, 0.0, 9.81);
        for threads in [2, 8] {
            for number in 0..5 {
                let (solved, _) = case.solve(&rest, threads, number);
                let place = format!("{subdomains} {threads} {number}: {:?}", solved.outcome);
                assert!(solved.outcome.converged, "{place}");
                for v in &solved.velocity {
                    assert!((v.z - 9.81e-3).abs() < 1e-8, "{place}: {v:?}");
                }
            }
        }
    }
}

#[test]
fn a_fixed_number_of_iterations_is_as_accurate_as_synchronous_ones() {
    let fixed =
        Solver { tolerance: None, max_iterations: 100, ..solver(Schedule::Asynchronous, 9) };
    let case = SolvedWall::new(fixed);
    let expected = case.expected.outcome;
    for threads in [1, 2, 4, 8] {
        for number in 0..10 {
            let (solved, runs) = case.solve(&[], threads, number);
            let place = format!("{threads} {number}: {:?}", solved.outcome);
            assert_eq!((solved.outcome.iterations, runs), (100, 1), "{place}");
            // Which contacts rest between the tests depends on the order of the visits.
            let (found, synchronous) = (solved.outcome.visits, expected.visits);
            assert!(5 * found.abs_diff(synchronous) < synchronous, "{place}: {synchronous}");
            assert!(solved.outcome.residuals.qm16() < 2.0 * expected.residuals.qm16(), "{place}");
            assert!(
                solved.outcome.residuals.natural_map < 2.0 * expected.residuals.natural_map,
                "{place}"
            );
        }
    }
}

/// Calls `check` with a run of a wall in four subdomains, tested after every visit.
fn with_run(check: impl Fn(&AsynchronousRun)) {
    let case = SolvedWall::new(Solver {
        convergence_check_interval: 1,
        ..solver(Schedule::Asynchronous, 4)
    });
    run_with(&case.model, &case.state, &case.contacts, &[], |d, _| {
        let mut never = || None;
        check(&AsynchronousRun::new(
            d,
            &case.model.solver,
            AdaptiveRelaxation::new(&case.model.solver),
            Vec::new(),
            &mut never,
        ));
        SolveOutcome::default()
    });
}

/// Reports `visits` of a set, the last of which changed velocities by `change` m/s, with 1 m/s borne by impulses or none.
fn report(run: &AsynchronousRun, s: usize, visits: u32, change: f64, borne: bool) {
    let borne = f64::from(u8::from(borne));
    let norms = VisitNorms {
        active: 1.0,
        dv_squared: change * change,
        max_dv_squared: change * change,
        wr_squared: borne,
        r_wr: borne,
        speed_squared: 1e-4,
        ..VisitNorms::default()
    };
    run.report(s, &SweepSet { visits, norms, ..SweepSet::default() });
}

fn stopped(run: &AsynchronousRun) -> (bool, bool) {
    (run.stop.load(Ordering::Relaxed), lock(&run.tests).diverged)
}

#[test]
fn a_test_waits_for_every_set() {
    with_run(|run| {
        let sets = run.decomposition.set_count();
        for visits in 1..=3 * sets as u32 {
            for s in 1..sets {
                report(run, s, visits, 0.0, true);
            }
            assert_eq!(stopped(run), (false, false));
        }
        // The last set has news: not solved. Without: solved.
        report(run, 0, 1, 1.0, true);
        assert_eq!(stopped(run), (false, false));
        report(run, 0, 2, 0.0, true);
        assert_eq!(stopped(run), (true, false));
    });
}

#[test]
fn vanishing_impulses_are_no_divergence_but_growing_changes_are() {
    with_run(|run| {
        let all = |visits, change, borne| {
            (0..run.decomposition.set_count()).for_each(|s| report(run, s, visits, change, borne));
            stopped(run)
        };
        assert_eq!(all(1, 1e-5, true), (false, false));
        // No impulse left to compare with, and larger changes than before: the residual is infinite.
        assert_eq!(all(2, 1e-2, false), (false, false));
        assert_eq!(all(3, 0.9, true), (false, false));
        // Grains moved at 1e-2 m/s at the first test.
        assert_eq!(all(4, 1.1, true), (true, true));
        // Reports that follow the stop change nothing.
        assert_eq!(all(5, 0.0, true), (true, true));
    });
}
