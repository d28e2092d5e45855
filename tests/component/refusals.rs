//! Requests that are refused: with a code, the place, and nothing changed.

use crate::{FLOOR, MS, floor, floor_knot, heap, shaken};
use ballast::component::{Component, Interpolation, Knot, Limits, MotionInput, Refusal, Twist};
use ballast::math::{Quat, Vec3, rotation};

/// A good window to 50 ms, changed into a bad one; the refusal.
fn refused(change: impl Fn(&mut MotionInput)) -> Refusal {
    let mut component = heap(Limits::default());
    let start = component.save();
    let mut input = shaken(floor(&component), 0, 50 * MS);
    change(&mut input);
    let refusal = component.advance_to(50 * MS, &[input]).expect_err("a refusal");
    assert_eq!(component.save(), start, "nothing has changed");
    refusal
}

fn check(refusal: &Refusal, code: &str, words: &[&str]) {
    let text = refusal.to_string();
    assert_eq!(refusal.code(), code, "{text}");
    assert!(words.iter().all(|w| text.contains(w)), "{text}");
    assert!(text.contains("expected") && text.contains("found"), "{text}");
}

#[test]
fn times_off_the_grid_are_told_their_neighbours() {
    let mut component = heap(Limits::default());
    for (t1, neighbours) in [
        (0, ["1000000", "2000000"]),
        (1, ["1000000", "2000000"]),
        (1_500_000, ["1000000", "2000000"]),
        (7 * MS + 1, ["7000000", "8000000"]),
    ] {
        let refusal = component.advance_to(t1, &[]).expect_err("off the grid");
        check(&refusal, "time_grid", &neighbours);
    }
    component.advance_to(2 * MS, &[]).expect("on the grid");
    check(
        &component.advance_to(2 * MS, &[]).expect_err("no later time"),
        "time_grid",
        &["3000000"],
    );
    check(&component.advance_to(MS, &[]).expect_err("the past"), "time_grid", &["3000000"]);
    let far = component.advance_to(u64::MAX, &[]).expect_err("off the grid");
    assert_eq!(far.code(), "time_grid");
}

#[test]
fn knots_must_cover_the_window() {
    let short = refused(|input| {
        input.waveform.knots.pop();
    });
    check(&short, "input_gap", &[FLOOR, "50000000", "45000000"]);
    let late = refused(|input| {
        input.waveform.knots.remove(0);
    });
    check(&late, "input_gap", &[FLOOR, "5000000"]);
    check(&refused(|input| input.waveform.knots.clear()), "input_invalid", &["knot"]);
}

#[test]
fn windows_must_join() {
    let away = refused(|input| input.waveform.knots[0].pose.position.z += 2e-6);
    check(&away, "input_jump", &[FLOOR, "2.000e-6 m"]);
    let turned = refused(|input| {
        let pose = &mut input.waveform.knots[0].pose;
        pose.orientation = Quat::from_scaled_axis(Vec3::z() * 1e-3) * pose.orientation;
    });
    check(&turned, "input_jump", &[FLOOR, "1.000e-3 rad"]);
    // A jump that is allowed moves the body there.
    let mut component = heap(Limits::default());
    let mut input = shaken(floor(&component), 0, 50 * MS);
    input.waveform.knots[0].pose.position.z += 2e-6;
    input.allow_jump = true;
    component.advance_to(50 * MS, &[input]).expect("rebased");
}

#[test]
fn a_body_in_motion_does_not_stop_or_jerk_unasked() {
    let mut component = heap(Limits::default());
    let rest = floor(&component);
    let d = component.model().driven_index(FLOOR).expect("the floor");
    assert_eq!(component.twist(d), Some(Twist::default()));
    component.advance_to(30 * MS, &[shaken(rest, 0, 30 * MS)]).expect("a window");
    let last = floor_knot(rest, 30 * MS);
    assert_eq!(
        component.twist(d),
        Some(Twist { velocity: last.velocity, angular_velocity: last.angular_velocity })
    );
    assert_eq!(component.twist(d), component.save().end_twist(d));
    let stopped = component.advance_to(40 * MS, &[]).expect_err("it moves");
    check(&stopped, "input_jump", &[FLOOR, "moved"]);
    let mut jerked = shaken(rest, 30 * MS, 40 * MS);
    jerked.waveform.knots[0].velocity.x += 0.01;
    check(&component.advance_to(40 * MS, &[jerked]).expect_err("a jerk"), "input_jump", &["m/s"]);
    component.advance_to(40 * MS, &[shaken(rest, 30 * MS, 40 * MS)]).expect("the motion continues");
}

#[test]
fn a_body_at_rest_does_not_start_at_speed_unasked() {
    let mut component = heap(Limits::default());
    let rest = floor(&component);
    let begun = |t0: u64, allow_jump: bool| {
        let mut input = shaken(rest, 0, 5 * MS);
        for (knot, time_ns) in input.waveform.knots.iter_mut().zip([t0, t0 + 5 * MS]) {
            (knot.time_ns, knot.velocity.z) = (time_ns, -0.5);
        }
        MotionInput { allow_jump, ..input }
    };
    // Neither before the first step nor after a window without a motion.
    check(
        &component.advance_to(MS, &[begun(0, false)]).expect_err("a jerk"),
        "input_jump",
        &["m/s"],
    );
    component.advance_to(MS, &[]).expect("it stays");
    let jerk = component.advance_to(2 * MS, &[begun(MS, false)]).expect_err("a jerk");
    check(&jerk, "input_jump", &[FLOOR, "0.000e0", "-5.000e-1"]);
    component.advance_to(2 * MS, &[begun(MS, true)]).expect("an allowed jump");
}

/// A floor that moves and turns, with two knots that are far apart.
fn far_knots(component: &Component) -> MotionInput {
    let mut input = shaken(floor(component), 0, 40 * MS);
    let knots = &mut input.waveform.knots;
    knots.drain(1..knots.len() - 1);
    let pose = &mut knots[1].pose;
    pose.orientation = Quat::from_scaled_axis(Vec3::new(0.01, -0.02, 0.03)) * pose.orientation;
    knots[0].angular_velocity = Vec3::new(0.3, 0.1, -0.2);
    input
}

#[test]
fn nor_between_its_knots() {
    let limits = Limits { join_speed: 1e-6, join_angular_velocity: 1e-6, ..Limits::default() };
    for end in [7 * MS, 20 * MS, 33 * MS] {
        let mut component = heap(limits);
        let input = far_knots(&component);
        // It turns from the first instant.
        component
            .advance_to(end, &[MotionInput { allow_jump: true, ..input.clone() }])
            .expect("a window");
        let stopped = component.advance_to(40 * MS, &[]).expect_err("it moves");
        check(&stopped, "input_jump", &[FLOOR, "moved"]);

        // As fast as it is, by a look at where it is just before and after.
        let [before, after] = [end - 500, end + 500].map(|t| input.waveform.pose(t));
        let turn = after.orientation * before.orientation.inverse();
        let mut joined = input.clone();
        joined.waveform.knots[0] = Knot {
            time_ns: end,
            pose: input.waveform.pose(end),
            velocity: (after.position - before.position) / 1e-6,
            angular_velocity: rotation::log(&turn) / 1e-6,
        };
        let mut jerked = joined.clone();
        jerked.waveform.knots[0].angular_velocity.y += 1e-5;
        let refusal = component.advance_to(40 * MS, &[jerked]).expect_err("a jerk");
        check(&refusal, "input_jump", &["rad/s"]);
        let state = component.save();
        component.advance_to(40 * MS, &[joined]).expect("the motion continues");
        component.restore(state).expect("its own state");
        component.advance_to(40 * MS, &[input]).expect("the motion continues, by the same knots");
    }
}

#[test]
fn inputs_that_are_no_motion_are_refused() {
    let order = refused(|input| input.waveform.knots.swap(1, 2));
    check(&order, "input_invalid", &["order of time", "knot 1"]);
    let nan = refused(|input| input.waveform.knots[3].velocity.y = f64::NAN);
    check(&nan, "input_invalid", &["finite", "knot 3"]);
    let infinite = refused(|input| input.waveform.knots[2].pose.position.x = f64::INFINITY);
    check(&infinite, "input_invalid", &["finite"]);
    let turn = refused(|input| {
        let pose = &mut input.waveform.knots[4].pose;
        pose.orientation = Quat::from_scaled_axis(Vec3::z() * 2.5) * pose.orientation;
    });
    check(&turn, "input_invalid", &["2 rad", "2.500 rad"]);
    let length = refused(|input| {
        let q = &mut input.waveform.knots[4].pose.orientation;
        *q = Quat::new_unchecked(q.into_inner() * 1.1);
    });
    check(&length, "input_invalid", &["unit"]);
    let name = refused(|input| input.body = "wset".into());
    check(&name, "unknown_body", &["wset", FLOOR]);
    let mut component = heap(Limits::default());
    let input = shaken(floor(&component), 0, 50 * MS);
    let twice = component.advance_to(50 * MS, &[input.clone(), input]).expect_err("twice");
    check(&twice, "input_invalid", &["one waveform"]);
}

#[test]
fn a_held_input_needs_no_end() {
    let mut component = heap(Limits::default());
    let mut input = shaken(floor(&component), 0, 50 * MS);
    input.waveform.interpolation = Interpolation::Hold;
    input.waveform.knots.truncate(1);
    component.advance_to(50 * MS, &[input]).expect("held");
}

#[test]
fn models_and_states_that_do_not_fit_are_refused() {
    let component = heap(Limits::default());
    let model = std::sync::Arc::new(component.model().clone());
    let mut state = (*component.save()).clone();
    state.energy.dissipated = f64::NAN;
    let refusal = Component::new(model.clone(), state, Limits::default()).expect_err("no ledger");
    check(&refusal, "state_invalid", &["energy", "NaN"]);
    let mut state = (*component.save()).clone();
    state.velocity.pop();
    let refusal = Component::new(model, state.clone(), Limits::default()).expect_err("no fit");
    check(&refusal, "state_invalid", &["body arrays"]);
    let mut component = component;
    let before = component.save();
    check(&component.restore(state).expect_err("no fit"), "state_invalid", &["body arrays"]);
    assert_eq!(component.save(), before);
}
