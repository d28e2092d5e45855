use super::iteration::AdaptiveRelaxation;
use super::sweep_set::SweepSet;
use super::{Decomposition, SolveOutcome, solve};
use crate::detection::{ContactHistory, Contacts};
use crate::geometry::cuboid;
use crate::local_problem::LocalProblem;
use crate::math::{Pose, Vec3};
use crate::model::{
    Acceleration, ContactStiffness, DrivenBody, Grains, Model, Part, PartitionRule, Role, Schedule,
    Solver, Stepping,
};
use crate::motion::Motion;
use crate::state::State;

const EDGE: f64 = 0.04;

/// A wall of cubes, `n` wide and `m` high, on a floor; four contact points per face.
pub(super) fn wall(n: usize, m: usize, solver: Solver) -> (Model, State, Contacts) {
    let cube = cuboid(Vec3::repeat(EDGE / 2.0));
    let mut grains = Grains::default();
    let mut state = State::default();
    for k in 0..m {
        for i in 0..n {
            grains.push(0, &cube, 2700.0);
            state.push(Pose::at(Vec3::new(i as f64 * EDGE, 0.0, (k as f64 + 0.5) * EDGE)));
        }
    }
    state.push(Pose::identity());
    let floor = DrivenBody {
        name: "floor".into(),
        role: Role::Boundary,
        friction: 0.8,
        stiffness: ContactStiffness::RIGID,
        parts: vec![Part::HalfSpace { normal: Vec3::z(), offset: 0.0 }],
        mount: None,
    };
    let mut contacts = Contacts::default();
    for k in 0..m {
        for i in 0..n {
            let me = (k * n + i) as u32;
            let centre = state.position[me as usize];
            if i + 1 < n {
                face(&mut contacts, [me, me + 1], centre, Vec3::x(), Vec3::y(), Vec3::z());
            }
            if k + 1 < m {
                face(&mut contacts, [me, me + n as u32], centre, Vec3::z(), Vec3::x(), Vec3::y());
            }
            if k == 0 {
                let floor = (n * m) as u32;
                face(&mut contacts, [me, floor], centre, -Vec3::z(), Vec3::x(), Vec3::y());
            }
        }
    }
    let model = Model {
        shapes: vec![cube],
        grains,
        driven: vec![floor],
        gravity: Vec3::new(0.3, 0.0, -9.81),
        grain_friction: 0.6,
        grain_stiffness: ContactStiffness::RIGID,
        restitution: 0.0,
        stepping: Stepping { step_ns: 1_000_000, theta: 0.5, detection_distance: 1e-3 },
        solver,
    };
    (model, state, contacts)
}

/// Four corners of the face of the cube at `centre` that looks along `out`.
fn face(contacts: &mut Contacts, bodies: [u32; 2], centre: Vec3, out: Vec3, a: Vec3, b: Vec3) {
    for (feature, (sa, sb)) in
        [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].iter().enumerate()
    {
        let point = centre + (out + a * *sa + b * *sb) * (EDGE / 2.0);
        contacts.push(bodies, feature as u64, point, -out, 0.0);
    }
}

pub(super) struct Solved {
    pub outcome: SolveOutcome,
    pub velocity: Vec<Vec3>,
    pub impulse: Vec<Vec3>,
}

fn run(model: &Model, state: &State, contacts: &Contacts, threads: usize) -> Solved {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let work = |d: &mut Decomposition, problem: &LocalProblem| {
        solve(d, problem, &model.solver, &mut || None).expect("the step is not cancelled")
    };
    pool.install(|| run_with(model, state, contacts, &[], work))
}

/// One step of a scene from the impulses `start`, solved by `work`.
pub(super) fn run_with(
    model: &Model,
    state: &State,
    contacts: &Contacts,
    start: &[Vec3],
    work: impl FnOnce(&mut Decomposition, &LocalProblem) -> SolveOutcome,
) -> Solved {
    let targets = vec![Pose::identity(); model.driven.len()];
    let mut motion = Motion::default();
    motion.predict(model, state, &crate::drive::StepInputs::from_targets(&targets)).unwrap();
    let mut problem = LocalProblem::default();
    problem.build(model, state, &motion, contacts, start, &ContactHistory::default());
    let mut decomposition = Decomposition::default();
    let grains = model.grains.len();
    let partition = decomposition.partition_mut();
    if model.solver.schedule == Schedule::Sequential {
        partition.assign_single_set(grains, contacts);
    } else {
        partition.divide(model.solver.partition, &motion.position[..grains], contacts);
    }
    decomposition.pack(&problem);
    let outcome = work(&mut decomposition, &problem);
    let mut impulse = vec![Vec3::zeros(); contacts.len()];
    let (mut velocity, mut angular_velocity) = (Vec::new(), Vec::new());
    decomposition.unpack_impulses(&problem, &mut impulse);
    decomposition.unpack_velocities(&problem, &mut velocity, &mut angular_velocity);
    Solved { outcome, velocity, impulse }
}

pub(super) fn solver(schedule: Schedule, subdomains: u32) -> Solver {
    Solver {
        schedule,
        partition: PartitionRule::Balanced(subdomains),
        max_iterations: 20_000,
        tolerance: Some(1e-9),
        ..Solver::default()
    }
}

/// Momentum of the grains = momentum at the start + weight + impulses of the floor.
pub(super) fn momentum_error(model: &Model, contacts: &Contacts, solved: &Solved) -> f64 {
    let grains = model.grains.len();
    let h = model.stepping.h();
    let mut error = Vec3::zeros();
    for i in 0..grains {
        error += model.grains.mass[i] * (solved.velocity[i] - model.gravity * h);
    }
    for (bodies, f) in contacts.bodies.iter().zip(&solved.impulse) {
        if bodies[1] as usize >= grains {
            error -= f;
        }
    }
    let weight: f64 = model.grains.mass.iter().sum::<f64>() * 9.81 * h;
    error.norm() / weight
}

#[test]
fn every_schedule_finds_the_same_velocities_and_keeps_momentum() {
    let (_, _, contacts) = wall(6, 5, Solver::default());
    let mut reference: Option<Solved> = None;
    for schedule in Schedule::ALL {
        for threads in [1, 2, 4] {
            let (model, state, _) = wall(6, 5, solver(schedule, 4));
            let solved = run(&model, &state, &contacts, threads);
            assert!(solved.outcome.converged, "{schedule:?} {threads}: {:?}", solved.outcome);
            assert!(momentum_error(&model, &contacts, &solved) < 1e-12, "{schedule:?}");
            if let Some(reference) = &reference {
                for (a, b) in reference.velocity.iter().zip(&solved.velocity) {
                    // Free fall gains 1e-2 m/s in this step.
                    assert!((a - b).norm() < 1e-7, "{schedule:?} {threads}: {a:?} {b:?}");
                }
            }
            reference.get_or_insert(solved);
        }
    }
}

#[test]
fn the_synchronous_schedule_gives_the_same_bits_for_any_number_of_threads() {
    let capped = Solver { max_iterations: 100, ..solver(Schedule::Synchronous, 6) };
    let (model, state, contacts) = wall(9, 7, capped);
    let one = run(&model, &state, &contacts, 1);
    for threads in [2, 3, 4, 8] {
        let many = run(&model, &state, &contacts, threads);
        assert_eq!(one.velocity, many.velocity);
        assert_eq!(one.impulse, many.impulse);
        assert_eq!(one.outcome, many.outcome);
    }
}

#[test]
fn one_subdomain_is_the_same_problem_for_every_schedule() {
    let all: Vec<Solved> = Schedule::ALL
        .map(|schedule| {
            let (model, state, contacts) = wall(6, 5, solver(schedule, 1));
            run(&model, &state, &contacts, 2)
        })
        .into();
    for other in &all[1..] {
        assert_eq!(all[0].velocity, other.velocity);
        assert_eq!(all[0].impulse, other.impulse);
        assert_eq!(all[0].outcome.iterations, other.outcome.iterations);
        assert_eq!(all[0].outcome.residuals, other.outcome.residuals);
    }
}

#[test]
fn diverging_asynchronous_iterations_fall_back_to_the_synchronous_schedule() {
    // A relaxation of 2.6 diverges; the fallback uses at most 1.
    let overshoot = Solver {
        relaxation: 2.6,
        convergence_check_interval: 2,
        ..solver(Schedule::Asynchronous, 4)
    };
    let (model, state, contacts) = wall(6, 5, overshoot);
    let solved = run(&model, &state, &contacts, 2);
    assert!(solved.outcome.sync_fallback, "{:?}", solved.outcome);
    assert!(solved.outcome.converged, "{:?}", solved.outcome);
    assert!(momentum_error(&model, &contacts, &solved) < 1e-12);
    // The diverged iterations are counted as well.
    let fallback = Solver {
        relaxation: 1.0,
        convergence_check_interval: 2,
        ..solver(Schedule::Synchronous, 4)
    };
    let (model, state, contacts) = wall(6, 5, fallback);
    let alone = run(&model, &state, &contacts, 2).outcome;
    assert!(solved.outcome.iterations > alone.iterations && solved.outcome.visits > alone.visits);
    let (model, state, contacts) = wall(6, 5, solver(Schedule::Asynchronous, 4));
    assert!(!run(&model, &state, &contacts, 2).outcome.sync_fallback);
}

#[test]
fn sets_far_from_a_disturbance_are_visited_less_often() {
    let tight = Solver {
        tolerance: Some(1e-5),
        skip_converged_subdomains: true,
        ..solver(Schedule::Synchronous, 6)
    };
    let (model, mut state, contacts) = wall(24, 4, tight);
    let resting = run(&model, &state, &contacts, 2);
    // The cube at the right end of the upper row is pushed to the left.
    state.velocity[95] = Vec3::new(-0.2, 0.0, 0.0);
    let mut sweeps = vec![];
    let solved = run_with(&model, &state, &contacts, &resting.impulse, |sets, problem| {
        let outcome = solve(sets, problem, &model.solver, &mut || None).expect("not cancelled");
        sweeps.extend((0..sets.subdomains.len()).map(|s| {
            let of_set = |set: &mut SweepSet| (set.contacts.visits(), set.contacts.contact_count());
            let (visits, contacts) = sets.with_set(s, of_set);
            let cubes = sets.partition().grains.list(s);
            let x = cubes.iter().map(|&cube| cube % 24).sum::<u32>() / cubes.len() as u32;
            (x, visits as f64 / contacts as f64)
        }));
        outcome
    });
    assert!(solved.outcome.converged && solved.outcome.iterations >= 40, "{:?}", solved.outcome);
    sweeps.sort_by_key(|&(x, _)| x);
    let (near, far) = (sweeps[sweeps.len() - 1].1, sweeps[0].1);
    assert!(far < 0.6 * near, "sweeps by place: {sweeps:?}");
    // What was skipped is solved, too.
    let all = Solver { partition: PartitionRule::Balanced(1), ..tight };
    let (model, _, _) = wall(24, 4, all);
    let whole = run_with(&model, &state, &contacts, &resting.impulse, |sets, problem| {
        solve(sets, problem, &model.solver, &mut || None).expect("not cancelled")
    });
    for (a, b) in whole.velocity.iter().zip(&solved.velocity) {
        assert!((a - b).norm() < 2e-3, "{a:?} {b:?}");
    }
}

#[test]
fn nncg_needs_a_fraction_of_the_iterations() {
    for schedule in [Schedule::Sequential, Schedule::Synchronous] {
        let tight = Solver { tolerance: Some(1e-4), ..solver(schedule, 3) };
        let (model, state, contacts) = wall(6, 20, tight);
        let solved = run(&model, &state, &contacts, 1);
        let outcome = solved.outcome;
        assert!(outcome.converged, "{schedule:?}: {outcome:?}");
        assert!(momentum_error(&model, &contacts, &solved) < 1e-11);
        let threads = run(&model, &state, &contacts, 3);
        assert_eq!((solved.impulse, solved.velocity), (threads.impulse, threads.velocity));
        let plain = Solver { acceleration: Acceleration::None, ..tight };
        let (model, state, contacts) = wall(6, 20, plain);
        let plain = run(&model, &state, &contacts, 1).outcome;
        assert!(3 * outcome.iterations < plain.iterations, "{schedule:?}: {outcome:?}, {plain:?}");
    }
}

/// Impulses of a wall are not unique: iterations that hardly change anything wander among them.
#[test]
fn wandering_iterations_are_solved_in_restart_cycles_of_more_sweeps() {
    for schedule in [Schedule::Sequential, Schedule::Synchronous] {
        let tight = Solver { tolerance: Some(1e-6), max_iterations: 20_000, ..solver(schedule, 3) };
        let (model, state, contacts) = wall(6, 20, tight);
        let solved = run(&model, &state, &contacts, 1);
        let outcome = solved.outcome;
        assert!(outcome.converged && outcome.iterations > 1500, "{schedule:?}: {outcome:?}");
        assert!(momentum_error(&model, &contacts, &solved) < 1e-11);
        let threads = run(&model, &state, &contacts, 3);
        assert_eq!((solved.impulse, solved.velocity), (threads.impulse, threads.velocity));
        // Plain iterations keep their number of sweeps.
        let plain = Solver { acceleration: Acceleration::None, max_iterations: 2000, ..tight };
        let (model, state, contacts) = wall(6, 20, plain);
        let plain = run(&model, &state, &contacts, 1).outcome;
        assert!(plain.visits <= 2000 * contacts.len() as u64, "{schedule:?}: {plain:?}");
    }
}

/// Size of a wall so high that sweeps stagnate: weight diffuses one layer per sweep.
const HIGH: (usize, usize) = (2, 90);

#[test]
fn stagnating_iterations_are_accelerated() {
    let tight = |schedule| Solver { tolerance: Some(1e-6), ..solver(schedule, 3) };
    for schedule in [Schedule::Sequential, Schedule::Synchronous] {
        let (model, state, contacts) = wall(HIGH.0, HIGH.1, tight(schedule));
        let solved = run(&model, &state, &contacts, 1);
        let outcome = solved.outcome;
        assert!(outcome.converged && outcome.iterations > 600, "{schedule:?}: {outcome:?}");
        // Mixed impulses are Gauss-Seidel states: impulses in their cones, and velocities that go with them.
        assert!(momentum_error(&model, &contacts, &solved) < 1e-11);
        for (normal, f) in contacts.normal.iter().zip(&solved.impulse) {
            let along = f.dot(normal);
            assert!((f - normal * along).norm() <= 0.800_001 * along + 1e-15, "{f}");
        }
        let threads = run(&model, &state, &contacts, 3);
        assert_eq!((solved.impulse, solved.velocity), (threads.impulse, threads.velocity));
        // Twice as many plain iterations (no tolerance: nothing is accelerated) leave more to do.
        let plain =
            Solver { tolerance: None, max_iterations: 2 * outcome.iterations, ..tight(schedule) };
        let (model, state, contacts) = wall(HIGH.0, HIGH.1, plain);
        let left = run(&model, &state, &contacts, 1).outcome.residuals.natural_map;
        assert!(left > 3.0 * outcome.residuals.natural_map, "{schedule:?}: {left}, {outcome:?}");
    }
}

#[test]
fn the_maximum_number_of_iterations_ends_an_acceleration_with_sweeps_from_its_best_impulses() {
    let capped = |max_iterations, tolerance| Solver {
        tolerance,
        max_iterations,
        ..solver(Schedule::Synchronous, 3)
    };
    for iterations in [2000, 2800] {
        let left = |tolerance| {
            let (model, state, contacts) = wall(HIGH.0, HIGH.1, capped(iterations, tolerance));
            let solved = run(&model, &state, &contacts, 2);
            assert!(solved.outcome.iterations == iterations, "{:?}", solved.outcome);
            assert!(momentum_error(&model, &contacts, &solved) < 1e-11);
            solved.outcome.residuals.natural_map
        };
        // The tolerance is out of reach: the maximum is met during an acceleration.
        let (accelerated, plain) = (left(Some(1e-30)), left(None));
        assert!(accelerated < 0.1 * plain, "{iterations}: {accelerated}, plain {plain}");
    }
}

#[test]
fn relaxation_is_reduced_three_times_at_most_over_all_restarts() {
    let stalled = |tolerance| {
        let mut relaxation = AdaptiveRelaxation::new(&Solver { tolerance, ..Solver::default() });
        for _ in 0..10 {
            relaxation = relaxation.restarted();
            (1..=30).for_each(|k| relaxation.observe(10 * k, 1.0, 0.0));
        }
        relaxation
    };
    let relaxation = stalled(Some(1e-3));
    assert!(relaxation.is_exhausted());
    assert!((relaxation.relaxation - 0.512).abs() < 1e-15, "{relaxation:?}");
    // Without a tolerance all iterations are plain.
    let relaxation = stalled(None);
    assert!(!relaxation.is_exhausted() && relaxation.relaxation == 1.0, "{relaxation:?}");
}
