//! Free running by a script: no clock, no network.

#[path = "../../../tests/common/mod.rs"]
mod common;
mod shaken;

use ballast::component::{Component, Limits};
use ballast::model::Schedule;
use ballast_protocol::lockstep::{ComponentState, ErrorCode, StatusReport};
use ballast_protocol::messages::{
    AdvanceRequest, BodyMotion, InterpolationMode, MotionKnot, Twist,
};
use ballast_protocol::pacer::{MAX_SAMPLES_PER_BODY, NextAction, Pacer};
use ballast_protocol::real_time::RealTimeMode;
use common::scene::Random;
use std::sync::Arc;

const MS: u64 = 1_000_000;

fn component() -> Component {
    let mut scene = common::heap::falling(1, MS).scheduled(Schedule::Synchronous, [2, 1, 1]);
    scene.model.solver.max_iterations = 10;
    scene.model.solver.tolerance = Some(1e-2);
    Component::new(Arc::new(scene.model), scene.state, Limits::default()).expect("a scene")
}

/// Twice as slow as the wall; 5 ms of latency, 20 ms of silence.
fn asked() -> RealTimeMode {
    RealTimeMode {
        real_time_factor: 0.5,
        window_ns: MS,
        latency_ns: 5 * MS,
        max_sample_age_ms: 20,
        bodies: vec!["floor".into()],
        interpolation: InterpolationMode::Hermite,
    }
}

/// Component in real-time mode, with the ends and wall times of its windows.
struct Running {
    component: Component,
    pacer: Pacer,
    windows: Vec<(u64, u64)>,
    motions: Vec<BodyMotion>,
}

impl Running {
    fn new(asked: RealTimeMode) -> Self {
        let component = component();
        let pacer = Pacer::new(asked, &component, 0).expect("sound settings");
        Self { component, pacer, windows: vec![], motions: vec![] }
    }

    /// Does what is due at a wall time; what comes after that.
    fn work(&mut self, wall_ns: u64) -> NextAction {
        loop {
            let NextAction::Compute { t1_ns, motions } = self.pacer.next_action(wall_ns) else {
                return self.pacer.next_action(wall_ns);
            };
            let request = AdvanceRequest { motions, ..AdvanceRequest::default() };
            let inputs = request.inputs().expect("good inputs");
            self.component.advance_to(t1_ns, &inputs.motions[..]).expect("a good window");
            self.windows.push((t1_ns, wall_ns));
            self.motions.extend(request.motions);
            self.pacer.window_finished(self.component.now_ns());
        }
    }

    fn status(&self, wall_ns: u64) -> StatusReport {
        let mut status = StatusReport { owner: Some("driver".into()), ..StatusReport::default() };
        self.pacer.write_status(&mut status, wall_ns);
        status
    }
}

#[test]
fn time_keeps_its_pace_and_the_latency() {
    let mut run = Running::new(asked());
    assert_eq!(run.work(3 * MS), NextAction::WaitForSamples);
    let status = run.status(3 * MS);
    assert_eq!(status.state, ComponentState::WaitingForInput);
    assert_eq!(status.waiting_for.as_deref(), Some("samples of floor from driver"));
    assert_eq!(status.waiting_since_ms, Some(3));
    // From 10 ms on a sample per 2 ms of wall time, 1 ms of the sender's clock, which begins anywhere.
    let begin = 7_000_000_000_000;
    for k in 0..100 {
        let wall = 10 * MS + k * 2 * MS;
        run.pacer.add_sample("floor", shaken::floor((begin + k * MS) as i64), wall);
        let next = run.work(wall);
        assert_eq!(next, NextAction::WaitUntil(wall + 2 * MS), "{k}");
    }
    // A window is computed when its end has come.
    assert_eq!(run.windows[..3], [(MS, 12 * MS), (2 * MS, 14 * MS), (3 * MS, 16 * MS)]);
    assert_eq!(run.windows.len(), 99);
    // The first sample is reached 5 ms after it came.
    assert_eq!(run.motions[0].knots[1].time_ns as u64, 5 * MS);
    assert_eq!(run.motions[20].knots.len(), 2);
    let status = run.status(10 * MS + 198 * MS);
    assert_eq!(
        (status.state, status.real_time.unwrap().dropped_samples),
        (ComponentState::Running, 0)
    );
}

#[test]
fn a_sample_from_before_the_run_does_not_shift_the_time_of_all() {
    let begin = 5_000_000_000_i64;
    let end = |old: Option<i64>| {
        let mut run = Running::new(asked());
        for k in 0..100 {
            let wall = 10 * MS + k * 2 * MS;
            run.pacer.add_sample("floor", shaken::floor(begin + (k * MS) as i64), wall);
            if let Some(old) = old.filter(|_| k == 50) {
                run.pacer.add_sample("floor", shaken::floor(old), wall);
            }
            run.work(wall);
        }
        let dropped = run.status(210 * MS).real_time.unwrap().dropped_samples;
        (run.windows, run.component.save(), dropped)
    };
    let (windows, state, dropped) = end(None);
    assert_eq!(dropped, 0);
    for old in [0, 1_000_000_000, begin - 6 * MS as i64, i64::MIN] {
        assert_eq!(end(Some(old)), (windows.clone(), state.clone(), 1), "{old}");
    }
}

#[test]
fn what_comes_early_or_late_within_the_latency_changes_nothing() {
    let steady = |jitter: f64| {
        let mut run = Running::new(asked());
        let mut random = Random(7);
        let mut events: Vec<(u64, Option<u64>)> = (0..150)
            .map(|k| (20 * MS + k * 2 * MS, k))
            // The first one sets the time.
            .map(|(wall, k)| {
                let late = if k == 0 { 0.0 } else { jitter * random.next() };
                (wall + (late * MS as f64) as u64, Some(k))
            })
            .chain((0..3000).map(|k| (k * MS / 10, None)))
            .collect();
        events.sort();
        for (wall, event) in events {
            if let Some(k) = event {
                run.pacer.add_sample("floor", shaken::floor((k * MS) as i64), wall);
            }
            run.work(wall);
        }
        let status = run.status(300 * MS).real_time.unwrap();
        assert_eq!((status.dropped_samples, status.overruns), (0, 0));
        let (windows, state) = (run.windows.len(), run.component.save());
        assert!(windows > 120, "{windows}");
        (windows, state)
    };
    // 1.5 ms of wall time, less than the 2 ms between two samples: they stay in order.
    let (windows, state) = steady(0.0);
    let (shaken, same) = steady(1.5);
    assert_eq!((windows, state.step), (shaken, same.step));
    assert!(state == same, "the same motion, the same bytes");
}

#[test]
fn silence_stops_time_and_input_lets_it_go_on_without_a_jump() {
    let mut run = Running::new(asked());
    for k in 0..50 {
        run.pacer.add_sample("floor", shaken::floor((k * MS) as i64), k * 2 * MS);
        run.work(k * 2 * MS);
    }
    let last = 49 * 2 * MS;
    // 5 ms of latency are left, at half pace; then it waits, and stands 20 ms after the last sample.
    let mut wall = last;
    while let NextAction::WaitUntil(at) = run.work(wall) {
        assert!(at > wall && at <= last + 20 * MS, "{at}");
        wall = at;
    }
    assert_eq!(wall, last + 20 * MS);
    let stands = run.component.now_ns();
    assert_eq!(stands, 54 * MS, "as far as there was input");
    // Ten seconds nothing; time stands, and it is message since when.
    for s in 1..10 {
        assert_eq!(run.work(wall + s * 1_000_000_000), NextAction::WaitForSamples);
    }
    let status = run.status(last + 5_000 * MS);
    assert_eq!(
        (status.state, status.waiting_since_ms),
        (ComponentState::WaitingForInput, Some(5000))
    );
    assert_eq!(run.component.now_ns(), stands);
    // The sender is back, its clock has gone on, its motion too.
    let back = last + 10_000 * MS;
    for k in 0..50 {
        let wall = back + k * 2 * MS;
        run.pacer.add_sample("floor", shaken::floor((5_049 * MS + k * MS) as i64), wall);
        run.work(wall);
    }
    // Windows continue from the pause, at the old pace: `advance_to` has refused no jump.
    assert_eq!(run.component.now_ns(), stands + 49 * MS);
    assert_eq!(run.status(back + 98 * MS).state, ComponentState::Running);
}

#[test]
fn all_bodies_must_be_heard_of_and_set_the_time_together() {
    let bodies = vec!["floor".into(), "west".into()];
    let mut run = Running::new(RealTimeMode { bodies, ..asked() });
    let wall_at = run.component.state().imposed(run.component.model(), 1);
    let west = |time_ns: i64| MotionKnot { time_ns, pose: wall_at.into(), twist: Twist::default() };
    // One of them alone: time stands, however much it says.
    for k in 0..3000 {
        run.pacer.add_sample("floor", shaken::floor((k * MS) as i64 % 1000), k * 2 * MS);
        run.pacer.add_sample("floor", shaken::floor((k * MS) as i64), k * 2 * MS);
        assert_eq!(run.work(k * 2 * MS), NextAction::WaitForSamples);
    }
    assert!(run.status(6_000 * MS).waiting_for.unwrap().contains("west"));
    // The other one joins, by the same clock: both continue together.
    for k in 3000..3050 {
        run.pacer.add_sample("west", west((k * MS) as i64), k * 2 * MS);
        run.pacer.add_sample("floor", shaken::floor((k * MS) as i64), k * 2 * MS);
        run.work(k * 2 * MS);
    }
    assert!(run.windows.len() >= 40, "{}", run.windows.len());
}

#[test]
fn bodies_that_are_told_of_in_turn_may_be_farther_apart_than_the_latency() {
    let bodies = vec!["floor".into(), "west".into()];
    let mut run = Running::new(RealTimeMode { bodies, max_sample_age_ms: 100, ..asked() });
    let wall_at = run.component.state().imposed(run.component.model(), 1);
    let west = |time_ns: i64| MotionKnot { time_ns, pose: wall_at.into(), twist: Twist::default() };
    let still = |time_ns: i64| MotionKnot { twist: Twist::default(), time_ns, ..shaken::floor(0) };
    // Each every 30 ms of the wall, 15 ms of the sender's clock: half of that is more than the latency, 5 ms.
    for k in 0..40 {
        let wall = 10 * MS + k * 15 * MS;
        let time_ns = (k * 15 * MS / 2) as i64;
        match k % 2 {
            0 => run.pacer.add_sample("floor", still(time_ns), wall),
            _ => run.pacer.add_sample("west", west(time_ns), wall),
        }
        run.work(wall);
    }
    assert!(run.windows.len() > 250, "{} windows", run.windows.len());
    assert_eq!(run.status(610 * MS).real_time.unwrap().dropped_samples, 0);
}

#[test]
fn who_cannot_keep_the_pace_takes_up_the_samples_of_now() {
    let mut run = Running::new(asked());
    for k in 0..20 {
        run.pacer.add_sample("floor", shaken::floor((k * MS) as i64), k * 2 * MS);
        run.work(k * 2 * MS);
    }
    // The machine is busy elsewhere for half a second; samples come all the while.
    for k in 20..270 {
        run.pacer.add_sample("floor", shaken::floor((k * MS) as i64), k * 2 * MS);
    }
    let before = run.component.now_ns();
    assert_eq!(run.work(540 * MS), NextAction::WaitForSamples);
    assert_eq!(
        (run.status(540 * MS).real_time.unwrap().overruns, run.component.now_ns()),
        (1, before)
    );
    for k in 270..300 {
        run.pacer.add_sample("floor", shaken::floor((k * MS) as i64), k * 2 * MS);
        run.work(k * 2 * MS);
    }
    assert_eq!(run.component.now_ns(), before + 29 * MS);
}

#[test]
fn samples_of_no_use_are_dropped_within_bounded_memory() {
    let mut run = Running::new(asked());
    for k in 0..2 * MAX_SAMPLES_PER_BODY as u64 {
        run.pacer.add_sample("floor", shaken::floor((k * 500) as i64), 0);
    }
    let mut bad = shaken::floor(MS as i64 * 1000);
    bad.pose.position.x = f64::NAN;
    run.pacer.add_sample("floor", bad, 0);
    bad = shaken::floor(MS as i64 * 1000);
    bad.pose.orientation.w = 3.0;
    run.pacer.add_sample("floor", bad, 0);
    run.pacer.add_sample("ceiling", shaken::floor(0), 0);
    run.pacer.add_sample("floor", shaken::floor(i64::MIN), 0);
    run.pacer.add_sample("floor", shaken::floor(i64::MAX), 0);
    let dropped = run.status(0).real_time.unwrap().dropped_samples;
    assert!(dropped >= MAX_SAMPLES_PER_BODY as u64 + 5, "{dropped}");
    run.work(MS);
}

#[test]
fn settings_that_make_no_sense_are_refused_with_their_place() {
    let component = component();
    for (wrong, place, code) in [
        (
            RealTimeMode { real_time_factor: 0.0, ..asked() },
            "real_time_factor",
            ErrorCode::ParameterInvalid,
        ),
        (
            RealTimeMode { real_time_factor: f64::NAN, ..asked() },
            "real_time_factor",
            ErrorCode::ParameterInvalid,
        ),
        (RealTimeMode { window_ns: MS + 1, ..asked() }, "window_ns", ErrorCode::ParameterInvalid),
        (RealTimeMode { window_ns: 0, ..asked() }, "window_ns", ErrorCode::ParameterInvalid),
        (RealTimeMode { latency_ns: 1, ..asked() }, "latency_ns", ErrorCode::ParameterInvalid),
        (
            RealTimeMode { latency_ns: u64::MAX, ..asked() },
            "latency_ns",
            ErrorCode::ParameterInvalid,
        ),
        (
            RealTimeMode { max_sample_age_ms: 0, ..asked() },
            "max_sample_age_ms",
            ErrorCode::ParameterInvalid,
        ),
        (RealTimeMode { bodies: vec![], ..asked() }, "bodies", ErrorCode::ParameterInvalid),
        (RealTimeMode { bodies: vec!["flor".into()], ..asked() }, "flor", ErrorCode::UnknownBody),
    ] {
        let fault = Pacer::new(wrong, &component, 0).expect_err("no settings");
        assert!(fault.code == code && fault.message.contains(place), "{fault}");
    }
}

#[test]
fn a_sample_from_far_ahead_does_not_hide_that_nothing_is_heard() {
    let hour = 3_600_000;
    for ahead in [hour, 60] {
        let mut run = Running::new(asked());
        for k in 0..20 {
            run.pacer.add_sample("floor", shaken::floor((k * MS) as i64), k * 2 * MS);
            run.work(k * 2 * MS);
        }
        let still = MotionKnot { time_ns: (ahead * MS) as i64, ..shaken::floor(19 * MS as i64) };
        run.pacer.add_sample("floor", MotionKnot { twist: Twist::default(), ..still }, 39 * MS);
        assert_eq!(run.status(39 * MS).real_time.unwrap().dropped_samples, 1);
        // What came after it is followed; then nothing comes.
        for k in 20..30 {
            run.pacer.add_sample("floor", shaken::floor((k * MS) as i64), k * 2 * MS);
            run.work(k * 2 * MS);
        }
        assert_eq!(run.component.now_ns(), 29 * MS);
        assert_eq!(run.work((58 + 20) * MS), NextAction::WaitForSamples, "{ahead}");
        assert_eq!(run.status(80 * MS).state, ComponentState::WaitingForInput);
    }
}

#[test]
fn silence_counts_although_there_are_samples_for_a_while() {
    // Half a second of samples lies ahead, of which a tenth may pass without a word.
    let mut run =
        Running::new(RealTimeMode { latency_ns: 500 * MS, max_sample_age_ms: 200, ..asked() });
    for k in 0..10 {
        run.pacer.add_sample("floor", shaken::floor((k * MS) as i64), k * 2 * MS);
    }
    let mut wall = 18 * MS;
    while let NextAction::WaitUntil(at) = run.work(wall) {
        assert!(wall < at && at <= 218 * MS);
        wall = at;
    }
    assert_eq!((wall, run.status(wall).state), (218 * MS, ComponentState::WaitingForInput));
    let stands = run.component.now_ns();
    assert_eq!(run.work(2 * wall), NextAction::WaitForSamples);
    // It continues with the next samples.
    for k in 300..310 {
        run.pacer.add_sample("floor", shaken::floor((k * MS) as i64), k * 2 * MS);
        run.work(k * 2 * MS);
    }
    assert_eq!(run.status(620 * MS).state, ComponentState::Running);
    assert!(run.component.now_ns() > stands);
}

#[test]
fn jumps_of_a_held_body_that_add_up_to_too_much_are_dropped() {
    // Ten samples in each step of 1 ms, each farther by a tenth of a step's way, or by as much as a step may have.
    for (share, dropped) in [(0.04, false), (0.9, true)] {
        let mut run =
            Running::new(RealTimeMode { interpolation: InterpolationMode::Hold, ..asked() });
        let most = ballast::drive::SpeedLimit::new(run.component.model()).max_displacement;
        let mut knot = shaken::floor(0);
        knot.twist = Twist::default();
        for k in 0..1000 {
            let wall = 10 * MS + k * MS / 5;
            knot.time_ns = (k * MS / 10) as i64;
            // There and back.
            knot.pose.position.y += share * most * if k / 100 % 2 == 0 { 1.0 } else { -1.0 };
            run.pacer.add_sample("floor", knot, wall);
            run.work(wall);
        }
        assert_eq!(run.status(210 * MS).real_time.unwrap().dropped_samples > 0, dropped, "{share}");
    }
}

#[test]
fn a_sample_that_would_end_the_run_is_dropped() {
    let end = |bad: &dyn Fn(MotionKnot) -> Option<MotionKnot>| {
        let mut run = Running::new(asked());
        for k in 0..100 {
            let wall = 10 * MS + k * 2 * MS;
            let good = shaken::floor((k * MS) as i64);
            run.pacer.add_sample("floor", good, wall);
            let later = MotionKnot { time_ns: good.time_ns + MS as i64 / 2, ..good };
            if let Some(bad) = bad(later).filter(|_| k == 50) {
                run.pacer.add_sample("floor", bad, wall);
            }
            run.work(wall);
        }
        let dropped = run.status(210 * MS).real_time.unwrap().dropped_samples;
        (run.windows, run.component.save(), dropped)
    };
    let (windows, state, dropped) = end(&|_| None);
    assert_eq!((windows.len(), dropped), (99, 0));
    // Turned over, in other units, at a speed that nothing has, at one that it does not say.
    let turned = |mut knot: MotionKnot| {
        (knot.pose.orientation.x, knot.pose.orientation.w) = (1.0, 0.0);
        Some(knot)
    };
    let far = |mut knot: MotionKnot| {
        knot.pose.position.x = 300.0;
        Some(knot)
    };
    let fast = |mut knot: MotionKnot| {
        knot.twist.linear.y = 1e6;
        Some(knot)
    };
    let jumped = |mut knot: MotionKnot| {
        knot.pose.position.y = 0.1;
        Some(knot)
    };
    let bad: [&dyn Fn(MotionKnot) -> Option<MotionKnot>; 4] = [&turned, &far, &fast, &jumped];
    for bad in bad {
        assert_eq!(end(bad), (windows.clone(), state.clone(), 1));
    }
}

#[test]
fn a_body_that_moves_goes_on_or_is_told() {
    let moving = || {
        let mut component = component();
        let motions = vec![BodyMotion {
            body: "floor".into(),
            interpolation: InterpolationMode::Hermite,
            allow_jump: false,
            knots: vec![shaken::floor(0), shaken::floor(25 * MS as i64)],
        }];
        let request = AdvanceRequest { motions, ..AdvanceRequest::default() };
        component.advance_to(25 * MS, &request.inputs().unwrap().motions[..]).expect("a window");
        component
    };
    let west = RealTimeMode { bodies: vec!["west".into()], ..asked() };
    let fault = Pacer::new(west, &moving(), 0).expect_err("the floor moves");
    assert_eq!(fault.code, ErrorCode::ParameterInvalid, "{fault}");
    assert!(fault.message.contains("floor") && fault.message.contains("m/s"), "{fault}");
    for interpolation in [InterpolationMode::Hermite, InterpolationMode::Linear] {
        let (component, asked) = (moving(), RealTimeMode { interpolation, ..asked() });
        let pacer = Pacer::new(asked, &component, 0).expect("it continues");
        let mut run = Running { component, pacer, windows: vec![], motions: vec![] };
        for k in 0..20 {
            // The sender knows of it: its sample lands the latency later.
            run.pacer.add_sample("floor", shaken::floor((30 * MS + k * MS) as i64), k * 2 * MS);
            run.work(k * 2 * MS);
        }
        assert_eq!(run.component.now_ns(), (25 + 19) * MS);
    }
}
