//! Problems whose solution is known.

use super::*;
use crate::math::Mat3;

const METHODS: [Method; 4] = [Method::Auto, Method::Nlgs, Method::Anderson, Method::Newton];

fn settings(method: Method) -> SolutionSettings {
    SolutionSettings { method, tolerance: 1e-12, max_sweeps: 20_000 }
}

/// Contacts that do not feel each other, with the same own block.
fn apart(block: Mat3, q: Vec<Vec3>, mu: f64) -> AssembledProblem {
    let entry = |c: usize, k: usize, l: usize| (3 * c + k, 3 * c + l, block[(k, l)]);
    let places = (0..q.len()).flat_map(|c| (0..9).map(move |p| (c, p / 3, p % 3)));
    let entries: Vec<_> = places.map(|(c, k, l)| entry(c, k, l)).collect();
    let friction = vec![mu; q.len()];
    AssembledProblem::from_entries(entries, q, friction).unwrap()
}

#[test]
fn open_sticking_and_slipping_contacts_are_what_they_must_be() {
    // W = diag(2, 4, 4), μ = 1/2: r_n = -q_n / 2; stick while |q_T| / 4 <= r_n / 2.
    let q = vec![Vec3::new(1.0, 3.0, 0.0), Vec3::new(-2.0, 1.2, 0.0), Vec3::new(-2.0, 3.0, -4.0)];
    let problem = apart(Mat3::from_diagonal(&Vec3::new(2.0, 4.0, 4.0)), q, 0.5);
    // Slip: u_T = q_T + 4 r_T against r_T = -μ r_n u_T/|u_T|, |u_T| = 5 - 4/2.
    let expected = [Vec3::zeros(), Vec3::new(1.0, -0.3, 0.0), Vec3::new(1.0, -0.3, 0.4)];
    for method in METHODS {
        let solution = solve(&problem, None, &settings(method));
        assert!(solution.converged, "{method:?}: {:?}", solution.errors);
        for (found, expected) in solution.impulse.iter().zip(&expected) {
            assert!((found - expected).norm() < 1e-11, "{method:?}: {found} for {expected}");
        }
    }
}

/// A block on `n` contact points in a row, pushed down and along: the sum of the impulses is known,
/// the single ones are not, and `W` is of rank 2.
fn block_on_points(n: usize, push: f64) -> AssembledProblem {
    let mut entries = Vec::new();
    for (a, b) in (0..n).flat_map(|a| (0..n).map(move |b| (a, b))) {
        let levers = [a, b].map(|k| k as f64 - 0.5 * (n as f64 - 1.0));
        entries.push((3 * a, 3 * b, 1.0 + 0.7 * levers[0] * levers[1]));
        entries.extend((1..3).map(|k| (3 * a + k, 3 * b + k, 1.0)));
    }
    let q = vec![Vec3::new(-1.0, push, 0.0); n];
    AssembledProblem::from_entries(entries, q, vec![0.4; n]).unwrap()
}

#[test]
fn impulses_that_are_not_unique_have_the_right_sums() {
    for (push, along) in [(0.3, -0.3), (2.0, -0.4)] {
        let problem = block_on_points(12, push);
        for method in METHODS {
            let solution = solve(&problem, None, &settings(method));
            let sum: Vec3 = solution.impulse.iter().sum();
            assert!(solution.converged, "{method:?}: {:?}", solution.errors);
            assert!((sum - Vec3::new(1.0, along, 0.0)).norm() < 1e-9, "{method:?}: {sum}");
        }
    }
}

/// A tower of `n` blocks, each on two points: sweeps need about n² of them.
fn tower(n: usize) -> AssembledProblem {
    let mut entries = Vec::new();
    // Block k rests with the points 2k and 2k + 1 on block k - 1, block 0 on the ground.
    let touching = |k: usize| {
        let below = (0..2).map(move |s| (2 * k + s, s, 1.0));
        let above = (0..2).filter(move |_| k + 1 < n).map(move |s| (2 * k + 2 + s, s, -1.0));
        below.chain(above).collect::<Vec<_>>()
    };
    for k in 0..n {
        for (a, side_a, sign_a) in touching(k) {
            for (b, side_b, sign_b) in touching(k) {
                let lever = if side_a == side_b { 0.6 } else { -0.6 };
                let sign = sign_a * sign_b;
                entries.push((3 * a, 3 * b, sign * (1.0 + lever)));
                entries.extend((1..3).map(|t| (3 * a + t, 3 * b + t, sign)));
            }
        }
    }
    let falling = |c: usize| Vec3::new(if c < 2 { -1.0 } else { 0.0 }, 0.0, 0.0);
    let q = (0..2 * n).map(falling).collect();
    AssembledProblem::from_entries(entries, q, vec![0.3; 2 * n]).unwrap()
}

#[test]
fn slow_problems_need_fewer_sweeps_with_the_other_methods() {
    let problem = tower(40);
    let sweeps = |method| {
        let solution =
            solve(&problem, None, &SolutionSettings { tolerance: 1e-8, ..settings(method) });
        assert!(solution.converged, "{method:?}: {:?}", solution.errors);
        // The ground carries all blocks, each of momentum 1.
        let carried = solution.impulse[0].x + solution.impulse[1].x;
        assert!((carried - 40.0).abs() < 1e-4, "{method:?}: {carried}");
        solution.sweeps
    };
    let plain = sweeps(Method::Nlgs);
    for method in [Method::Auto, Method::Anderson, Method::Newton] {
        let fewer = sweeps(method);
        assert!(5 * fewer < plain, "{method:?}: {fewer} sweeps, without it {plain}");
    }
}

#[test]
fn sweeps_end_at_their_number_with_the_best_impulses() {
    let problem = tower(40);
    for method in METHODS {
        let cap = SolutionSettings { max_sweeps: 7, ..settings(method) };
        let solution = solve(&problem, None, &cap);
        assert!(!solution.converged && solution.sweeps == 7, "{method:?}: {}", solution.sweeps);
        assert_eq!(solution.errors, problem.natural_map(&solution.impulse));
        assert!(solution.errors.abh < problem.natural_map(&vec![Vec3::zeros(); 80]).abh);
    }
    let solved = solve(&problem, None, &settings(Method::Auto));
    let again = solve(&problem, Some(&solved.impulse), &settings(Method::Auto));
    assert_eq!((again.sweeps, again.newton_steps), (0, 0));
    assert_eq!(again.impulse, solved.impulse);
}

#[test]
fn problems_too_large_for_newton_are_left_to_the_sweeps() {
    let problem = tower(800);
    let cap = SolutionSettings { max_sweeps: 400, ..settings(Method::Auto) };
    let solution = solve(&problem, None, &cap);
    assert_eq!((solution.sweeps, solution.newton_steps), (400, 0));
}

#[test]
fn a_matrix_that_is_not_symmetric_is_taken_as_it_is() {
    // u_n = r_n + 0.5 r_t - 1 = 0, u_t = r_t - 0.25 r_n + 0.5 = 0 in the cone of μ = 2.
    let block = Mat3::new(1.0, 0.5, 0.0, -0.25, 1.0, 0.0, 0.0, 0.0, 1.0);
    let problem = apart(block, vec![Vec3::new(-1.0, 0.5, 0.0)], 2.0);
    for method in METHODS {
        let r = solve(&problem, None, &settings(method)).impulse[0];
        let expected = Vec3::new(1.25, -0.25, 0.0) / 1.125;
        assert!((r - expected).norm() < 1e-12, "{method:?}: {r}");
    }
}

#[test]
fn empty_and_resting_problems_are_solved_at_once() {
    let nothing = AssembledProblem::from_entries([], vec![], vec![]).unwrap();
    let rest = apart(Mat3::identity(), vec![Vec3::zeros(); 2], 0.5);
    for problem in [nothing, rest] {
        let solution = solve(&problem, None, &settings(Method::Auto));
        assert!(solution.converged && solution.sweeps == 0, "{solution:?}");
    }
}
