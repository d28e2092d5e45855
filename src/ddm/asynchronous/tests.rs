//! Threads of the asynchronous schedule played by one, so that overlaps come from a seed.

use super::*;
use crate::ddm::tests::{Solved, momentum_error, run_with, solver, wall};
use crate::detection::Contacts;
use crate::model::{Model, Schedule};
use crate::state::State;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// What a played thread is about to do.
#[derive(Clone, Copy, PartialEq)]
enum Next {
    Draw,
    Begin(usize),
    End(usize),
    Leave,
}

/// Plays `threads` threads; `pick` says which of those that can go on does.
fn play(run: &Run, threads: usize, mut pick: impl FnMut(&[(usize, Next)]) -> usize) {
    let mut next = vec![Next::Draw; threads];
    loop {
        let can: Vec<(usize, Next)> = (0..threads)
            .map(|t| (t, next[t]))
            .filter(|&(_, n)| match n {
                Next::Begin(s) => !next.contains(&Next::End(s)),
                n => n != Next::Leave,
            })
            .collect();
        if can.is_empty() {
            return;
        }
        let (t, now) = can[pick(&can)];
        next[t] = match now {
            Next::Draw => run.draw().map_or(Next::Leave, Next::Begin),
            Next::Begin(s) => {
                run.decomposition.with_set(s, |set| run.begin(set));
                Next::End(s)
            }
            Next::End(s) => {
                run.decomposition.with_set(s, |set| run.end(s, set));
                Next::Draw
            }
            Next::Leave => Next::Leave,
        };
    }
}

/// Threads of very different, random speeds.
fn at_random(run: &Run, threads: usize, seed: u64) {
    let mut rng = Pcg64::seed_from_u64(seed);
    let speed: Vec<f64> = (0..threads).map(|_| 10_f64.powf(rng.random_range(-3.0..0.0))).collect();
    play(run, threads, |can| {
        let mut left = rng.random_range(0.0..can.iter().map(|&(t, _)| speed[t]).sum());
        let chosen = can.iter().position(|&(t, _)| {
            left -= speed[t];
            left < 0.0
        });
        chosen.unwrap_or(can.len() - 1)
    });
}

/// All threads in step: as many visits as there are threads answer the same velocities.
fn in_step(run: &Run, threads: usize) {
    play(run, threads, |can| {
        let rank = |n: Next| match n {
            Next::Draw => 0,
            Next::Begin(_) => 1,
            Next::End(_) | Next::Leave => 2,
        };
        (0..can.len()).min_by_key(|&i| rank(can[i].1)).unwrap_or(0)
    });
}

/// Number of a way to play: in step, or a seed.
fn played(number: u64) -> impl Fn(&Run, usize) {
    move |run, threads| match number {
        0 => in_step(run, threads),
        seed => at_random(run, threads, seed),
    }
}

fn reference(model: &Model, state: &State, contacts: &Contacts) -> Solved {
    run_with(model, state, contacts, &[], |d, _| {
        d.apply_impulses();
        synchronous::iterate(d, &model.solver)
    })
}

#[test]
fn however_visits_overlap_the_step_is_solved_in_about_as_many_iterations() {
    for subdomains in [2, 4, 9, 30] {
        let (model, state, contacts) = wall(6, 5, solver(Schedule::Asynchronous, subdomains));
        let expected = reference(&model, &state, &contacts);
        assert!(expected.outcome.converged);
        for threads in [1, 2, 3, 4, 8, 16].into_iter().filter(|&t| t <= subdomains) {
            for number in 0..4 {
                let solved = run_with(&model, &state, &contacts, &[], |d, _| {
                    let play = played(number);
                    iterate_with(d, &model.solver, |run| play(run, threads as usize))
                        .expect("no false alarm")
                });
                let place = format!("{subdomains} {threads} {number}: {:?}", solved.outcome);
                assert!(solved.outcome.converged, "{place}");
                let most = expected.outcome.iterations * 3 / 2;
                println!("{place} {}", expected.outcome.iterations);
                assert!(solved.outcome.iterations < most, "{place}, expected {most}");
                assert!(momentum_error(&model, &contacts, &solved) < 1e-12, "{place}");
                for (a, b) in expected.velocity.iter().zip(&solved.velocity) {
                    // Free fall gains 1e-2 m/s in this step.
                    assert!((a - b).norm() < 1e-7, "{place}: {a:?} {b:?}");
                }
            }
        }
    }
}
