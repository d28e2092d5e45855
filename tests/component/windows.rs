//! A window is a function of state and inputs.

use crate::common::scene::Scene;
use crate::{FLOOR, MS, floor, heap, same, shaken};
use ballast::component::{
    Component, Interpolation, Knot, Limits, MotionInput, Parameters, Refusal, StepCallback,
    StopReason, Waveform, WindowResult, WindowStatus,
};
use ballast::drive::StepInputs;
use ballast::math::{Pose, Quat, Vec3};
use ballast::model::{ContactStiffness, Part, Role};
use ballast::observe::Zone;
use ballast::state::State;
use ballast::step::{StepReport, step};
use ballast::workspace::Workspace;
use std::ops::ControlFlow;
use std::slice::from_ref;
use std::sync::Arc;

/// The heap shaken from `now` to `t1`, in windows of `window` ms.
fn shake(component: &mut Component, rest: ballast::math::Pose, t1_ms: u64, window: u64) {
    while component.now_ns() < t1_ms * MS {
        let t0 = component.now_ns();
        let t1 = t0 + window * MS;
        let outcome = component.advance_to(t1, &[shaken(rest, t0, t1)]).expect("a good window");
        assert!(matches!(outcome.status, WindowStatus::Ok | WindowStatus::Warn), "{outcome:?}");
    }
}

#[test]
fn how_time_is_cut_into_windows_changes_nothing() {
    let ends: Vec<_> = [100, 50, 10, 5]
        .map(|window| {
            let mut component = heap(Limits::default());
            let rest = floor(&component);
            shake(&mut component, rest, 100, window);
            component.save()
        })
        .into();
    for end in &ends[1..] {
        assert!(same(end, &ends[0]));
    }
}

#[test]
fn a_window_is_its_steps() {
    let mut component = heap(Limits::default());
    let rest = floor(&component);
    let input = shaken(rest, 0, 50 * MS);
    let mut state = (*component.save()).clone();
    let model = component.model().clone();
    let outcome = component.advance_to(50 * MS, from_ref(&input)).expect("a good window");

    let floor_index = model.driven_index(FLOOR).expect("the floor");
    let mut workspace = Workspace::default();
    let (mut impulse, mut work) = (Vec3::zeros(), 0.0);
    let (mut peak, mut peak_torque) = (0.0, Vec3::zeros());
    for k in 1..=50 {
        let mut targets: Vec<_> =
            (0..model.driven.len()).map(|d| state.imposed(&model, d)).collect();
        targets[floor_index] = input.waveform.pose(k * MS);
        let inputs = StepInputs::from_targets(&targets);
        let report = step(&model, &mut state, &inputs, &mut workspace, &mut ()).expect("a step");
        impulse += report.reactions[floor_index].impulse;
        work += report.reactions[floor_index].work;
        let reaction = &report.reactions[floor_index];
        if reaction.impulse.norm() / 1e-3 > peak {
            peak = reaction.impulse.norm() / 1e-3;
            peak_torque = reaction.angular_impulse / 1e-3;
        }
    }
    assert!(same(&state, component.state()));
    let body = &outcome.bodies[floor_index];
    assert!(impulse.norm() > 0.0, "the floor shakes the stones");
    assert_eq!((body.impulse, body.work), (impulse, work));
    assert!((body.peak_force.norm() - peak).abs() < 1e-12 * peak);
    // Of the same step.
    assert!(body.peak_torque.norm() > 0.0);
    assert!((body.peak_torque - peak_torque).norm() < 1e-12 * peak_torque.norm());
    assert!((body.mean_force * 0.05 - impulse).norm() < 1e-12 * impulse.norm());
    assert_eq!((outcome.t0_ns, outcome.t1_ns, outcome.steps), (0, 50 * MS, 50));
    assert_eq!(outcome.energy, state.energy);
}

#[test]
fn a_window_can_be_redone() {
    let mut component = heap(Limits::default());
    let rest = floor(&component);
    shake(&mut component, rest, 40, 40);
    let input = shaken(rest, 40 * MS, 90 * MS);
    let first = component.advance_to(90 * MS, from_ref(&input)).expect("a good window");
    let end = component.save();
    for _ in 0..3 {
        assert_eq!(component.redo(from_ref(&input)).expect("a redo"), first);
        assert!(same(component.state(), &end));
    }
    let mut other = input.clone();
    for knot in &mut other.waveform.knots[1..] {
        knot.pose.position.z += 1e-4;
    }
    let changed = component.redo(&[other]).expect("a redo");
    assert_ne!(changed.bodies, first.bodies);
    // A redo that is refused leaves the end of the last one.
    let before = component.save();
    assert_eq!(component.redo(&[]).expect_err("the floor moves").code(), "input_jump");
    assert_eq!(component.save(), before);
    assert_eq!(component.redo(&[input]).expect("a redo"), first);
    assert_eq!(component.save(), end);
}

#[test]
fn restored_and_forked_are_never_interrupted() {
    let mut component = heap(Limits::default());
    let rest = floor(&component);
    shake(&mut component, rest, 40, 20);
    let kept = component.save();
    let mut fork = component.fork();
    shake(&mut component, rest, 100, 20);
    let end = component.save();
    shake(&mut fork, rest, 100, 10);
    assert_eq!(fork.save(), end, "forked");
    component.restore(kept.clone()).expect("its own snapshot");
    assert_eq!(component.redo(&[]).expect_err("nothing yet").code(), "nothing_to_redo");
    shake(&mut component, rest, 100, 60);
    assert_eq!(component.save(), end, "restored");
    // A state that another drive has left knows no twists of the last window; the motion continues.
    let foreign = ballast::state::State { window: Default::default(), ..(*kept).clone() };
    let mut other = heap(Limits::default());
    other.restore(foreign).expect("a state of this model");
    shake(&mut other, rest, 100, 60);
    assert!(same(other.state(), &end), "from a state alone");
}

#[test]
fn a_watcher_ends_a_window_in_a_valid_state() {
    let mut component = heap(Limits::default());
    let rest = floor(&component);
    let mut watch = StepCallback(|state: &ballast::state::State, _: &_| {
        if state.time_ns == 20 * MS {
            ControlFlow::Break(StopReason::Early)
        } else {
            ControlFlow::Continue(())
        }
    });
    let input = shaken(rest, 0, 50 * MS);
    let outcome = component.advance_observed(50 * MS, &[input], &mut watch).expect("a window");
    assert_eq!((outcome.status, outcome.t1_ns, outcome.steps), (WindowStatus::Early, 20 * MS, 20));
    assert!(outcome.error.is_none());
    let mut straight = heap(Limits::default());
    shake(&mut straight, rest, 20, 20);
    assert!(same(component.state(), straight.state()));
}

#[test]
fn a_window_that_is_cancelled_counts_as_never_requested() {
    let mut component = heap(Limits::default());
    let rest = floor(&component);
    shake(&mut component, rest, 20, 10);
    let (end, last) = (component.save(), component.last_window());
    let mut abandon = StepCallback(|_: &_, _: &_| ControlFlow::Break(StopReason::Cancel));
    let next = shaken(rest, 20 * MS, 30 * MS);
    let refusal = component.advance_observed(30 * MS, &[next], &mut abandon).unwrap_err();
    assert_eq!(
        (refusal.code(), component.save(), component.last_window()),
        ("cancelled", end.clone(), last)
    );
    // Neither was the redo that is given up, nor does it stand in the way of the next one.
    let again = [shaken(rest, 10 * MS, 20 * MS)];
    assert_eq!(component.redo_observed(&again, &mut abandon), Err(Refusal::Cancelled));
    assert_eq!(component.save(), end);
    component.redo(&again).expect("the last window");
    assert_eq!(component.save(), end);
}

#[test]
fn trouble_is_discarded_or_cut_off() {
    // From 30 ms on the floor runs away, or turns away under the stones, far beyond half a grain in a step.
    let away = |pose: &mut Pose| pose.position.x -= 1.0;
    let around = |pose: &mut Pose| pose.orientation = Quat::from_scaled_axis(Vec3::y() * 0.5);
    for (keep_partial_window, change) in
        [(false, &away as &dyn Fn(&mut Pose)), (true, &away), (false, &around), (true, &around)]
    {
        let zones = vec![Zone::new("all", Vec3::zeros(), Vec3::repeat(0.3)).expect("a box")];
        let limits = Limits { keep_partial_window, ..Limits::default() };
        let mut component = heap(limits).with_zones(zones.clone());
        let rest = floor(&component);
        let start = component.save();
        let mut input = shaken(rest, 0, 50 * MS);
        for knot in &mut input.waveform.knots[7..] {
            change(&mut knot.pose);
        }
        let outcome =
            component.advance_to(50 * MS, from_ref(&input)).expect("a request in good form");
        let trouble = outcome.error.clone().expect("a word on it");
        assert_eq!(trouble.code(), "over_speed");
        // A discarded window has nothing to measure.
        assert_eq!(outcome.zones.len(), usize::from(keep_partial_window));
        let trouble = trouble.to_string();
        assert!(trouble.contains("half of the smallest grain"), "{trouble}");
        if !keep_partial_window {
            assert_eq!((outcome.status, outcome.steps), (WindowStatus::Discard, 0));
            assert_eq!(component.save(), start);
        } else {
            assert_eq!(outcome.status, WindowStatus::Early);
            assert_eq!(
                (outcome.t1_ns, outcome.steps),
                (component.now_ns(), component.now_ns() / MS)
            );
            assert!((30..50).contains(&outcome.steps), "{}", outcome.steps);
            component.state().check(component.model()).expect("a valid state");
            // Zones are those of the last sound step, not of the one that failed.
            let mut sound = heap(Limits::default()).with_zones(zones);
            let again = sound.advance_to(outcome.t1_ns, &[input]).expect("a sound window");
            assert_eq!(outcome.zones, again.zones);
        }
    }
}

#[test]
fn a_step_that_penetrates_too_deep_is_trouble() {
    let mut component = heap(Limits { penetration: 1e-12, ..Limits::default() });
    let start = component.save();
    let outcome = component.advance_to(50 * MS, &[]).expect("a request in good form");
    assert_eq!(outcome.status, WindowStatus::Discard);
    assert_eq!(outcome.error.expect("a word").code(), "penetration");
    assert_eq!(component.save(), start);
}

/// Two cubes beside each other on a floor, each below a lid that does not yield.
fn pressed(limits: Limits) -> Component {
    let mut scene = Scene::new(MS, 0.5);
    scene.model.solver.max_iterations = 50;
    let cube = scene.shape(ballast::geometry::cuboid(Vec3::repeat(0.05)));
    let lid = scene.shape(ballast::geometry::cuboid(Vec3::new(0.06, 0.06, 0.01)));
    let places = [0.0, 1.0].map(|x| Vec3::new(x, 0.0, 0.05));
    for place in places {
        scene.grain(cube, Pose::at(place));
    }
    scene.plane("floor", Pose::identity(), 0.5);
    for (name, place) in ["lid", "other lid"].into_iter().zip(places) {
        let part = Part::Convex { shape: lid, pose: Pose::identity() };
        scene.driven(name, part, Pose::at(place + Vec3::z() * 0.06), 0.5);
    }
    Component::new(scene.model.into(), scene.state, limits).expect("a sound scene")
}

/// The next window of one step, in which the lid moves down by `way`, m.
fn press(component: &mut Component, way: f64) -> WindowResult {
    press_with(component, "lid", way)
}

/// Advances one step, in which `lid` moves down by `way`, m.
fn press_with(component: &mut Component, lid: &str, way: f64) -> WindowResult {
    let t0 = component.now_ns();
    let body = component.model().driven_index(lid).expect("a lid");
    let from = component.state().imposed(component.model(), body);
    let to = Pose { position: from.position - Vec3::z() * way, ..from };
    let knot = |time_ns, pose| Knot {
        time_ns,
        pose,
        velocity: Vec3::zeros(),
        angular_velocity: Vec3::zeros(),
    };
    let knots = vec![knot(t0, from), knot(t0 + MS, to)];
    let waveform = Waveform { interpolation: Interpolation::Linear, knots };
    let input = MotionInput { body: lid.into(), waveform, allow_jump: false };
    component.advance_to(t0 + MS, &[input]).expect("a request in good form")
}

#[test]
fn the_window_that_presses_too_deep_is_taken_back_and_not_the_one_after_it() {
    let way = 1e-4;
    let mut free = pressed(Limits::default());
    // What a step presses in is there to be measured in the next one.
    let depths: Vec<f64> = (0..8).map(|_| press(&mut free, way).solver.max_penetration).collect();
    assert!(depths.windows(2).all(|d| d[1] > d[0]), "{depths:?}");
    let between = 0.5 * (depths[4] + depths[5]);
    let mut component = pressed(Limits { penetration: between, ..Limits::default() });
    for step in 0..4 {
        assert_ne!(press(&mut component, way).status, WindowStatus::Discard, "{step}");
    }
    let before = component.save();
    let outcome = press(&mut component, way);
    assert_eq!(outcome.status, WindowStatus::Discard);
    assert_eq!(outcome.error.expect("a word").code(), "penetration");
    assert_eq!(component.save(), before);
    // It continues from there, even if the limit is below the present penetration.
    for penetration in [between, 0.5 * depths[4]] {
        let parameters = Parameters { penetration, ..component.parameters() };
        component.set_parameters(&parameters).expect("a limit");
        assert_ne!(press(&mut component, 0.0).status, WindowStatus::Discard);
        assert_ne!(press(&mut component, -0.1 * way).status, WindowStatus::Discard);
        assert_eq!(press(&mut component, 2.0 * way).status, WindowStatus::Discard);
    }
}

#[test]
fn a_limit_of_penetration_holds_for_each_pair_whatever_is_deeper_elsewhere() {
    let mut component = pressed(Limits::default());
    let depths: Vec<f64> =
        (0..5).map(|_| press(&mut component, 1e-4).solver.max_penetration).collect();
    let penetration = 0.5 * depths[4];
    let parameters = Parameters { penetration, ..component.parameters() };
    component.set_parameters(&parameters).expect("a limit");
    // Penetration that exceeds the limit already is accepted; the other cube is not pressed in as deep.
    let mut kept = 0;
    while press_with(&mut component, "other lid", 1e-4).status != WindowStatus::Discard {
        kept += 1;
        assert!(kept < 5, "pressed in as deep as the first");
    }
    assert!(kept > 0);
    assert_ne!(press(&mut component, 0.0).status, WindowStatus::Discard);
}

#[test]
fn a_window_can_be_taken_back_after_its_last_step() {
    let mut component = heap(Limits::default());
    let before = component.save();
    let mut discard = StepCallback(|_: &_, _: &_| ControlFlow::Break(StopReason::Discard));
    let outcome = component.advance_observed(MS, &[], &mut discard).expect("a window");
    assert_eq!((outcome.status, component.save()), (WindowStatus::Discard, before.clone()));
    let mut abandon = StepCallback(|_: &_, _: &_| ControlFlow::Break(StopReason::Cancel));
    let refusal = component.advance_observed(MS, &[], &mut abandon).unwrap_err();
    assert_eq!((refusal.code(), component.save()), ("cancelled", before));
    // What is complete is not early.
    let mut early = StepCallback(|_: &_, _: &_| ControlFlow::Break(StopReason::Early));
    let outcome = component.advance_observed(MS, &[], &mut early).expect("a window");
    assert!(
        matches!(outcome.status, WindowStatus::Ok | WindowStatus::Warn),
        "{:?}",
        outcome.status
    );
}

#[test]
fn a_step_that_stops_at_the_cap_is_a_warning() {
    let mut scene = Scene::new(MS, 0.5);
    let stone = scene.shape(ballast::geometry::cuboid(Vec3::repeat(0.05)));
    for k in 0..6 {
        scene.grain(stone, ballast::math::Pose::at(Vec3::z() * (0.05 + 0.1 * f64::from(k))));
    }
    scene.plane("floor", ballast::math::Pose::identity(), 0.5);
    scene.model.solver.max_iterations = 1;
    let mut component =
        Component::new(scene.model.into(), scene.state, Limits::default()).expect("a stack");
    let outcome = component.advance_to(10 * MS, &[]).expect("a window");
    assert_eq!(outcome.status, WindowStatus::Warn);
    assert!(outcome.solver.steps_not_converged > 0 && outcome.solver.residual_qm16 > 1e-8);
}

#[test]
fn a_window_sums_gap_and_dissipation_of_its_steps() {
    let mut component = heap(Limits::default());
    let rest = floor(&component);
    let (mut gap, mut dissipated) = ([0.0; 2], 0.0);
    for t1 in [50 * MS, 100 * MS] {
        let mut sums = [0.0; 2];
        let mut steps = StepCallback(|_: &State, report: &StepReport| {
            sums[0] += report.complementarity.gap;
            sums[1] += report.complementarity.infeasible;
            ControlFlow::Continue(())
        });
        let inputs = [shaken(rest, t1 - 50 * MS, t1)];
        let solver = component.advance_observed(t1, &inputs, &mut steps).expect("a window").solver;
        assert_eq!([solver.complementarity_gap, solver.infeasible_work], sums);
        dissipated += solver.dissipated;
        gap = [gap[0] + sums[0], gap[1] + sums[1]];
    }
    assert!(gap[0] > 0.0 && gap[1] > 0.0, "{gap:?}");
    let ledger = component.state().energy.dissipated;
    assert!((dissipated - ledger).abs() < 1e-12 * ledger, "{dissipated} J, {ledger} J");
}

#[test]
fn checks_of_forces_leave_the_run_as_it_is() {
    let run = |interval: u32, soft: bool| {
        let component = heap(Limits::default());
        let mut model = component.model().clone();
        model.solver.force_check_interval = interval;
        // Forces on tools are compared, not those on boundaries.
        model.driven.iter_mut().for_each(|body| body.role = Role::Sleeper);
        if soft {
            let springs =
                ContactStiffness { normal: 1e6, tangential_ratio: 1.0, damping_time: 1e-3 };
            model.grain_stiffness = springs;
            model.driven.iter_mut().for_each(|body| body.stiffness = springs);
            model.solver.tolerance = Some(1e-9);
            model.solver.max_iterations = 5000;
        }
        let state = component.save();
        let mut component =
            Component::new(Arc::new(model), state, Limits::default()).expect("a component");
        let rest = floor(&component);
        let result =
            component.advance_to(100 * MS, &[shaken(rest, 0, 100 * MS)]).expect("a window");
        (component.save(), result.solver)
    };
    for soft in [false, true] {
        let (end, solver) = run(10, soft);
        let (undisturbed, unchecked) = run(0, soft);
        assert!(same(&end, &undisturbed));
        assert_eq!((unchecked.force_difference, unchecked.force_compared), (0.0, 0.0));
        assert!(solver.force_compared > 0.0);
        if soft {
            let error = solver.force_difference / solver.force_compared;
            assert!(error < 1e-5, "springs leave one solution: {error}");
        }
    }
}
