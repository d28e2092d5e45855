use super::*;
use crate::model::{ContactStiffness, Role};
use crate::state::DriverState;
use crate::step::Reaction;
use crate::track::TampingState;
use crate::track::plan::{ReleasePlan, TineShape};
use crate::track::test_plan::small_plan as plan;
use crate::track::{sleeper::sleeper, tine::tine};
use std::sync::Arc;

/// Sleeper and tines without grains; driven body 0 is a wall that must not move.
fn model(plan: &Plan) -> (Model, State) {
    let mut shapes = Vec::new();
    let mut driven = crate::track::boundary::boundaries(&plan.bed.size, [0.8; 5]);
    driven.truncate(1);
    driven.push(sleeper(&plan.sleepers[0], 1.0, &mut shapes).unwrap());
    for t in &plan.tines {
        driven.push(tine(t, 1.0, &mut shapes).unwrap());
    }
    assert_eq!(driven.iter().filter(|d| d.role == Role::Tine).count(), 2);
    let mut state = State::default();
    state.push(Pose::identity());
    state.push(Pose::at(Vec3::new(0.3, 0.35, 0.28)));
    for t in &plan.tines {
        state.push(Pose::at(start_position(plan, t)));
    }
    let model = Model {
        shapes,
        grains: Default::default(),
        driven,
        gravity: -Vec3::z() * 9.81,
        grain_friction: 1.0,
        grain_stiffness: ContactStiffness::RIGID,
        restitution: 0.0,
        stepping: plan.run.stepping,
        solver: plan.run.solver,
    };
    (model, state)
}

/// Runs the cycle against a given resistance (N: against the closing of each tine, and upwards) and
/// hands each new state to `look`.
fn run(
    plan: &Plan,
    resistance: impl Fn(f64) -> [f64; 2],
    mut look: impl FnMut(&TampingCycle, &State),
) -> State {
    let (model, mut state) = model(plan);
    let cycle = TampingCycle::new(plan, &model).unwrap();
    let mut targets = Vec::new();
    for _ in 0..plan.run.duration_ns / model.stepping.step_ns {
        one_step(&cycle, &model, &mut state, &mut targets, &resistance);
        look(&cycle, &state);
    }
    state
}

fn one_step(
    cycle: &TampingCycle,
    model: &Model,
    state: &mut State,
    targets: &mut Vec<Pose>,
    resistance: &impl Fn(f64) -> [f64; 2],
) {
    let h = model.stepping.h();
    let mut tamping = decoded(cycle, state);
    cycle.targets(model, state, &tamping, targets);
    for (b, target) in targets.iter().enumerate() {
        state.velocity[b] = (target.position - state.position[b]) / h;
        state.position[b] = target.position;
    }
    state.step += 1;
    state.time_ns += model.stepping.step_ns;
    let mut reactions = vec![Reaction::default(); model.driven.len()];
    let [closing, upwards] = resistance(state.time()).map(|f| f * h);
    reactions[2].impulse = Vec3::new(-closing, 0.0, upwards);
    reactions[3].impulse = Vec3::new(closing, 0.0, upwards);
    let report = StepReport { reactions, ..Default::default() };
    cycle.observe(model, &report, state, &mut tamping);
    state.driver = Arc::new(cycle.encode(&tamping));
}

fn decoded(cycle: &TampingCycle, state: &State) -> TampingState {
    cycle.decode(&state.driver).unwrap()
}

#[test]
fn phases_are_numbered_in_the_order_of_the_cycle() {
    for (number, phase) in TampingPhase::ALL.into_iter().enumerate() {
        assert_eq!((phase as usize, TampingPhase::named(phase.name())), (number, Some(phase)));
    }
    assert_eq!(TampingPhase::named("tamping"), None);
}

#[test]
fn a_phase_ends_with_the_step_that_ends_with_it() {
    let mut plan = plan();
    plan.run.stepping.step_ns = 200_000;
    let ends = {
        let tamping = plan.tamping.as_mut().unwrap();
        tamping.start = 0.0;
        (tamping.lift.duration, tamping.insertion.duration) = (0.2, 0.45);
        (tamping.squeeze.duration, tamping.hold) = (0.8, 0.1);
        // Their sums in seconds are 1.4500000000000002 and 1.5500000000000003.
        [200, 650, 1450, 1550].map(|ms| ms * 1_000_000_u64)
    };
    let (model, _) = model(&plan);
    let cycle = TampingCycle::new(&plan, &model).unwrap();
    for (before, end) in TampingPhase::ALL[1..].iter().zip(ends) {
        let at = |ns: u64| cycle.phase(ns as f64 / 1e9) as usize;
        assert_eq!([at(end - 200_000), at(end)], [*before as usize, *before as usize + 1]);
    }
}

#[test]
fn vibration_of_35_hz_and_5_mm_peaks_at_1_10_m_per_s_and_24_6_g() {
    let mut plan = plan();
    if let Some(t) = &mut plan.tamping {
        t.squeeze.stroke = 0.0;
    }
    let (mut fastest, mut strongest, mut before) = (0.0_f64, 0.0_f64, 0.0);
    run(
        &plan,
        |_| [0.0; 2],
        |cycle, state| {
            let v = state.velocity[2].x;
            fastest = fastest.max(v.abs());
            // While the amplitude grows, its own acceleration comes on top (less than 1 %).
            if cycle.phase(state.time()) == TampingPhase::Squeeze {
                strongest = strongest.max((v - before).abs() / 2e-4);
            }
            before = v;
        },
    );
    assert!((fastest - 1.0996).abs() < 2e-3, "{fastest}");
    assert!((strongest / 9.81 - 24.65).abs() < 0.02, "{}", strongest / 9.81);
}

#[test]
fn facing_rows_move_in_opposition() {
    let mut apart = 0.0_f64;
    run(
        &plan(),
        |_| [0.0; 2],
        |_, state| {
            apart = apart.max((state.position[2].x + state.position[3].x - 0.6).abs());
            assert_eq!(state.position[2].y, 0.35);
        },
    );
    assert!(apart < 1e-14, "{apart}");
}

#[test]
fn positions_and_velocities_never_jump() {
    // Accelerations bound the change of velocity: vibration (a little more while it grows), the
    // ramps of insertion and withdrawal (0.27 m in 0.4 s at most), squeeze and brakes (within a period).
    let bound_x = 1.1 * 0.005 * (std::f64::consts::TAU * 35.0_f64).powi(2) + 10.0;
    let bound_z = 1.25 * 1.5 * 0.27 / (0.2 * 0.4 * 0.4) + 35.0 * 1.25 * 0.27 / 0.4;
    // The forces switch closing and lowering off and on again.
    let between = |t: f64, from: f64, to: f64| if t > from && t < to { 2e4 } else { 0.0 };
    let resistance = |t: f64| [between(t, 1.0, 1.2), between(t, 0.4, 0.5)];
    let mut before: Option<Vec<Vec3>> = None;
    run(&plan(), resistance, |_, state| {
        let speeds = &state.velocity;
        if let Some(before) = &before {
            for b in 0..speeds.len() {
                let a = (speeds[b] - before[b]) / 2e-4;
                assert!(a.x.abs() < bound_x && a.z.abs() < bound_z, "{b} {} {a}", state.time());
            }
        }
        before = Some(speeds.clone());
    });
}

#[test]
fn the_cycle_goes_where_the_plan_says() {
    let end = run(
        &plan(),
        |_| [0.0; 2],
        |cycle, state| {
            let t = state.time();
            let phase = cycle.phase(t);
            let expected = match t {
                t if t < 0.05 => TampingPhase::Waiting,
                t if t < 0.25 => TampingPhase::Lift,
                t if t < 0.7 => TampingPhase::Insertion,
                t if t < 1.5 => TampingPhase::Squeeze,
                t if t < 1.6 => TampingPhase::Hold,
                t if t < 2.0 => TampingPhase::Withdrawal,
                _ => TampingPhase::Done,
            };
            // Sums of phases are rounded: the boundary itself may fall to either side.
            let near = [0.05, 0.25, 0.7, 1.5, 1.6, 2.0].iter().any(|e: &f64| (e - t).abs() < 1e-9);
            assert!(near || phase == expected, "{t}");
            if phase == TampingPhase::Squeeze {
                assert!((state.position[1].z - 0.30).abs() < 1e-12, "lifted");
                assert!((state.position[2].z - 0.28).abs() < 1e-12, "at depth");
            }
            if phase == TampingPhase::Hold && t > 1.55 {
                assert!((cycle.closing(&decoded(cycle, state), 0) - 0.06).abs() < 1e-9, "stroke");
            }
        },
    );
    assert!((end.position[2].x - 0.05).abs() < 1e-9, "open again, and no vibration is left");
    assert!((end.position[2].z - 0.53).abs() < 1e-12, "back at the start height");
    assert_eq!(end.position[0], Vec3::zeros());
}

#[test]
fn a_pair_stops_above_its_force_limit_and_goes_on_below() {
    let mut closings = Vec::new();
    let resistance = |t: f64| [if t > 1.0 && t < 1.2 { 9000.0 } else { 5000.0 }, 0.0];
    run(&plan(), resistance, |cycle, state| {
        let tamping = decoded(cycle, state);
        closings.push((state.time(), cycle.closing(&tamping, 0), cycle.mean_force(&tamping, 0)));
    });
    let at = |t: f64| closings.iter().find(|c| c.0 >= t - 1e-9).unwrap();
    assert!((at(0.95).2 - 5000.0).abs() < 1e-6, "steady mean: {}", at(0.95).2);
    // The mean passes 7.8 kN 70 % into the period after the rise; one period more to brake.
    assert!(at(1.12).1 - at(1.08).1 < 1e-12, "held");
    assert!(at(1.06).1 > at(1.0).1, "still closing while the mean rises");
    assert!(at(1.3).1 > at(1.25).1 + 1e-3, "closing again");
    let end = closings.last().unwrap().1;
    assert!(end > 0.035 && end < 0.055, "short of the stroke by the time held: {end}");
}

#[test]
fn the_unit_goes_down_no_further_while_the_bed_carries_it() {
    let mut depths = Vec::new();
    let resistance = |t: f64| [0.0, if t > 0.4 && t < 0.6 { 8500.0 } else { 5000.0 }];
    let end = run(&plan(), resistance, |cycle, state| {
        depths.push((state.time(), cycle.insertion(&decoded(cycle, state)), state.position[2].z));
    });
    let at = |t: f64| depths.iter().find(|d| d.0 >= t - 1e-9).unwrap();
    // The mean passes 8 kN after 86 % of a period; one period more to brake.
    assert!(at(0.6).1 - at(0.46).1 < 1e-12 && at(0.6).2 == at(0.46).2, "held");
    assert!(at(0.42).1 > at(0.4).1, "still going down while the mean rises");
    assert!(at(0.7).1 < 0.9, "short of the depth at the end of the insertion: {}", at(0.7).1);
    assert!((at(1.5).1 - 1.0).abs() < 1e-12, "the rest of the way during the squeeze");
    assert!((end.position[2].z - 0.53).abs() < 1e-12, "back at the start height");
}

#[test]
fn a_restored_run_continues_bit_for_bit() {
    let plan = plan();
    let resistance = |t: f64| [7800.0, 8000.0].map(|f| f + 3000.0 * (50.0 * t).sin());
    let mut kept = None;
    let end = run(&plan, resistance, |_, state| {
        if state.step == 6000 {
            kept = Some(state.clone());
        }
    });
    let (model, _) = model(&plan);
    let cycle = TampingCycle::new(&plan, &model).unwrap();
    let mut state = kept.unwrap();
    let mut targets = Vec::new();
    while state.step < end.step {
        one_step(&cycle, &model, &mut state, &mut targets, &resistance);
    }
    assert_eq!(state, end);
    let mut other = (*state.driver).clone();
    other.values.pop();
    assert!(cycle.decode(&other).is_err());
    assert!(
        cycle.decode(&DriverState { kind: "other".into(), ..(*state.driver).clone() }).is_err()
    );
    assert!(cycle.decode(&DriverState { version: 99, ..(*state.driver).clone() }).is_err());
    assert_eq!(cycle.decode(&DriverState::default()).unwrap(), TampingState::default());
}

#[test]
fn tines_that_would_meet_a_sleeper_or_a_wall_are_refused_by_name() {
    let mut long = plan();
    if let Some(t) = &mut long.tamping {
        t.squeeze.stroke = 0.09;
    }
    let (model, _) = model(&plan());
    let message = TampingCycle::new(&long, &model).unwrap_err().to_string();
    assert!(message.contains("\"left\"") && message.contains("\"sleeper\""), "{message}");
    let mut outside = plan();
    outside.tines[1].position[0] = 0.59;
    let message = TampingCycle::new(&outside, &model).unwrap_err().to_string();
    assert!(message.contains("\"right\"") && message.contains("inside the box"), "{message}");
    let mut flush = plan();
    flush.bed.size.y = 0.24;
    flush.sleepers[0].centre[1] = 0.02;
    flush.sleepers[0].blocks[0].size.y = 0.04;
    for tine in &mut flush.tines {
        tine.position[1] = 0.17;
        let TineShape::Boxes { blade, .. } = &mut tine.shape else { panic!("boxes") };
        blade.y = 0.14;
    }
    let tine = &flush.tines[0];
    let edge = tine.position[1] + tine.bounds().high.y;
    assert!(edge > flush.bed.size.y, "the sum of these decimal numbers: {edge}");
    TampingCycle::new(&flush, &model).unwrap();
}

#[test]
fn only_what_vibrates_needs_steps_for_its_period() {
    let (mut model, _) = model(&plan());
    model.stepping.step_ns = 4_000_000;
    let message = TampingCycle::new(&plan(), &model).unwrap_err().to_string();
    assert!(message.contains("at least 8 time steps") && message.contains("7.1"), "{message}");
    let mut still = plan();
    if let Some(t) = &mut still.tamping {
        t.vibration.amplitude = 0.0;
        // Of no account then, however slow; forces are averaged over a part of the squeeze.
        t.vibration.frequency = 1e-6;
        assert_eq!(t.averaging(), 0.1 * t.squeeze.duration);
    }
    TampingCycle::new(&still, &model).unwrap();
    let no_tines = Plan { tines: Vec::new(), ..plan() };
    TampingCycle::new(&no_tines, &model).unwrap();
}

#[test]
fn without_tamping_nothing_moves() {
    let mut plan = plan();
    let (model, state) = model(&plan);
    plan.tamping = None;
    let cycle = TampingCycle::new(&plan, &model).unwrap();
    let mut targets = Vec::new();
    cycle.targets(&model, &state, &TampingState::default(), &mut targets);
    for (b, target) in targets.iter().enumerate() {
        assert_eq!(*target, state.pose(b));
    }
    assert_eq!(cycle.duration(), 0.0);
    assert_eq!(cycle.phase(0.0), TampingPhase::Done);
}

#[test]
fn sleepers_are_released_and_loaded_after_the_withdrawal() {
    let mut plan = plan();
    let load = LoadCycles { cycles: 2, max_load: 10e3, min_load: 1e3, frequency: 5.0 };
    let tamping = plan.tamping.as_mut().unwrap();
    tamping.release = Some(ReleasePlan { duration: 0.1, height: 0.005 });
    tamping.traffic = Some(load);
    assert!((tamping.ends()[6] - 2.5).abs() < 1e-12);
    let (mut model, state) = model(&plan);
    let refused = TampingCycle::new(&plan, &model).unwrap_err().to_string();
    assert!(refused.contains("sleeper") && refused.contains("mount"), "{refused}");
    let mut modes = [DofMode::Prescribed; 6];
    modes[2] = DofMode::Spring { stiffness: 1e6, damping: 0.0 };
    let sleeper = plan.sleepers[0].clone();
    let body = model.driven_index(&sleeper.name).unwrap();
    model.driven[body].mount = Some(crate::track::sleeper_mount(&sleeper.blocks, None, modes));
    let cycle = TampingCycle::new(&plan, &model).unwrap();
    for (time, phase) in [
        (1.99, TampingPhase::Withdrawal),
        (2.05, TampingPhase::Release),
        (2.2, TampingPhase::Traffic),
        (2.5, TampingPhase::Done),
    ] {
        assert_eq!(cycle.phase(time), phase, "{time}");
    }
    let step = model.stepping.step_ns;
    let ns = |time: f64| (time * 1e9).round() as u64;
    let height = |time: f64| {
        let mut height = f64::NAN;
        let at = State { time_ns: ns(time) - step, ..state.clone() };
        cycle.positions(&model, &at, &decoded(&cycle, &state), |d, position| {
            height = if d == body { position.z - 0.28 } else { height };
        });
        height
    };
    assert!((height(2.0) - 0.02).abs() < 1e-12, "{}", height(2.0));
    assert!((height(2.05) - 0.0125).abs() < 1e-12, "{}", height(2.05));
    assert!((height(2.3) - 0.005).abs() < 1e-12, "{}", height(2.3));
    let loaded = |time: f64| {
        let mut found = 0.0;
        cycle.loads(&model, ns(time) - step / 2, |d, force| {
            assert_eq!(d, body);
            found = -force.z;
        });
        found
    };
    assert_eq!([loaded(2.05), loaded(2.6)], [0.0; 2]);
    assert!((loaded(2.2) - 10e3).abs() < 1e-3, "{}", loaded(2.2));
    assert!((loaded(2.3) - 1e3).abs() < 1e-3, "{}", loaded(2.3));
}
