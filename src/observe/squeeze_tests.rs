use super::*;
use crate::math::Vec3;
use crate::model::{ContactStiffness, Grains, Solver, Stepping};
use crate::step::Reaction;
use std::f64::consts::TAU;

const H: f64 = 1e-3;
/// Steps of a period.
const PERIOD: u32 = 10;

fn model() -> Model {
    Model {
        shapes: vec![],
        grains: Grains::default(),
        driven: vec![],
        gravity: Vec3::zeros(),
        grain_friction: 0.5,
        grain_stiffness: ContactStiffness::RIGID,
        restitution: 0.0,
        stepping: Stepping { step_ns: 1_000_000, theta: 0.5, detection_distance: 0.0 },
        solver: Solver::default(),
    }
}

/// Body 0 is a wall; 1 and 2 face each other, 0.5 m apart.
fn rule(period: u32) -> Arc<SqueezeRule> {
    let pair = SqueezePair { name: "pair".into(), tines: vec![(1, 1.0), (2, -1.0)] };
    Arc::new(SqueezeRule::new(vec![pair], period).unwrap())
}

/// Step `i`: each side has closed by `closing`, is resisted by `force` and does `work`.
fn step(meter: &mut SqueezeMeter, i: u64, closing: f64, force: f64, work: f64) {
    let at = |x: f64| Vec3::new(x, 0.0, 0.0);
    let state = State {
        time_ns: i * 1_000_000,
        position: vec![Vec3::zeros(), at(closing), at(0.5 - closing)],
        ..State::default()
    };
    let reaction =
        |x: f64| Reaction { impulse: Vec3::new(x * H, 5.0, 7.0), work, ..Reaction::default() };
    let reactions = vec![Reaction::default(), reaction(-force), reaction(force)];
    meter.record(&model(), &state, &StepReport { reactions, ..StepReport::default() });
}

#[test]
fn a_linear_spring_gives_its_own_loop_and_energy_in_spite_of_vibration() {
    // 200 kN/m per side after 10 mm of free way; 0.05 mm per step; 5 mm of vibration with a period of ten steps.
    let mut meter = SqueezeMeter::new(rule(PERIOD));
    for i in 1..=1000 {
        let closing = i as f64 * 5e-5;
        let phase = (i as f64 * 0.1 * TAU).sin();
        let spring = 2e5 * (closing - 0.01_f64).max(0.0);
        let felt = if spring > 0.0 { spring + 30.0 * phase } else { 0.0 };
        step(&mut meter, i, closing + 5e-3 * phase, felt, 0.25);
    }
    let outcomes = meter.take_outcomes();
    let [SqueezeOutcome { name, is_finished: false, record }] = &outcomes[..] else {
        panic!("{outcomes:?}")
    };
    assert_eq!((&name[..], record.number, record.start_ns), ("pair", 1, 10_000_000));
    // Means over a period lag by half of one: 4.5 steps, 0.225 mm; the first of them is where closing is zero.
    assert!((record.onset_closing - 0.0105).abs() < 6e-4, "{}", record.onset_closing);
    assert!((record.onset_ns.unwrap() as f64 * 1e-9 - 0.22).abs() < 1e-2);
    assert!((record.closing - (0.05 - 5e-4)).abs() < 1e-12, "{}", record.closing);
    assert!((record.peak_force - (8000.0 - 45.0)).abs() < 1e-6, "{}", record.peak_force);
    assert_eq!(record.peak_closing, record.closing);
    assert!((record.peak_step_force - 8000.0).abs() < 30.0);
    // From the period on in which it has closed by more than 2 mm: the sixth.
    assert!((record.work - 475.0).abs() < 1e-9, "{}", record.work);
    // Two sides of k x²/2 with x = 39.775 mm.
    let energy = 2e5 * 0.039775_f64.powi(2);
    assert!((record.compaction_energy - energy).abs() < 0.5, "{}", record.compaction_energy);
    assert_eq!(record.loop_points.len(), 100);
    assert_eq!(record.loop_points[99], [record.closing, record.peak_force]);
}

#[test]
fn a_squeeze_is_over_when_the_pair_opens_and_the_next_one_has_its_own_record() {
    let mut meter = SqueezeMeter::new(rule(1));
    let there = (0..=100).map(|i| (i as f64 * 1e-4, 1000.0));
    let back = (0..=100).rev().map(|i| (i as f64 * 1e-4, 400.0));
    let mut outcomes = vec![];
    let mut at = 0;
    for _ in 0..2 {
        for (closing, force) in there.clone().chain(back.clone()) {
            at += 1;
            step(&mut meter, at, closing, force, 0.0);
            outcomes.extend(meter.take_outcomes());
        }
    }
    let over: Vec<_> = outcomes.iter().filter(|s| s.is_finished).map(|s| &s.record).collect();
    assert_eq!(over.len(), 2);
    assert_eq!(over.iter().map(|r| r.number).collect::<Vec<_>>(), [1, 2]);
    // Where it was at its widest before it closed.
    assert_eq!(over.iter().map(|r| r.start_ns / 1_000_000).collect::<Vec<_>>(), [1, 203]);
    for record in over {
        let back = 0.01 - record.closing;
        assert!((2e-3 - 1e-9..2.2e-3).contains(&back), "{back}");
        // 10 mm at 1000 N, two sides.
        assert!((record.compaction_energy - 2.0 * 10.0).abs() < 1e-9, "{record:?}");
        assert!((record.peak_force, record.onset_closing) == (1000.0, 0.0), "{record:?}");
    }
    // It is reported while it closes, from its first 2 mm on.
    assert!(
        !outcomes[0].is_finished
            && outcomes[0].record.closing > 2e-3
            && outcomes[0].record.closing < 2.2e-3
    );
}

#[test]
fn a_touch_before_the_squeeze_is_not_its_onset() {
    let mut meter = SqueezeMeter::new(rule(1));
    // Grains brush past the tine while it hardly moves; it closes freely, then meets the bed after 10 mm.
    for i in 0..300 {
        let closing = if i < 100 { i as f64 * 1e-6 } else { (i - 100) as f64 * 1e-4 };
        let force = if (20..30).contains(&i) || closing > 0.01 { 500.0 } else { 0.0 };
        step(&mut meter, i, closing, force, 1.0);
    }
    let outcomes = meter.take_outcomes();
    let record = &outcomes[0].record;
    assert_eq!(record.onset_ns, Some(201_000_000));
    assert!((record.onset_closing - 0.0101).abs() < 1e-9, "{}", record.onset_closing);
    // Work of the two tines, from 2 mm on.
    assert!((record.work - 2.0 * 179.0).abs() < 3.0, "{}", record.work);
}

#[test]
fn vibration_and_travel_along_the_track_are_no_squeeze() {
    let mut meter = SqueezeMeter::new(rule(PERIOD));
    for i in 0..2000 {
        // Of another frequency than the period's: an eighth faster.
        step(&mut meter, i, 5e-3 * (i as f64 * 0.1125 * TAU).sin(), 500.0, 0.0);
    }
    assert_eq!(meter.take_outcomes(), []);
    let mut meter = SqueezeMeter::new(rule(1));
    for i in 0..100 {
        let at = |x: f64| Vec3::new(x + 0.01 * i as f64, 0.0, 0.0);
        let position = vec![Vec3::zeros(), at(0.0), at(0.5)];
        let report = StepReport { reactions: vec![Reaction::default(); 3], ..Default::default() };
        meter.record(&model(), &State { position, ..State::default() }, &report);
    }
    assert_eq!(meter.take_outcomes(), []);
}

#[test]
fn tines_that_the_ballast_pushes_together_do_not_squeeze_it() {
    let mut meter = SqueezeMeter::new(rule(1));
    // Bent by 4.4 mm and straight again, then a squeeze of 9.9 mm.
    let bent = (0..=40).chain((0..40).rev()).map(|i| (i as f64 * 1.1e-4, -500.0));
    let squeezed = (0..=90).map(|i| (i as f64 * 1.1e-4, 1000.0));
    for (i, (closing, force)) in bent.chain(squeezed).enumerate() {
        step(&mut meter, i as u64, closing, force, 1.0);
        // 2.09 mm are more than two.
        assert_eq!(meter.take_outcomes().is_empty(), i < 81 + 19, "{i}");
    }
    let outcomes = meter.take_outcomes();
    let [SqueezeOutcome { is_finished: false, record, .. }] = &outcomes[..] else {
        panic!("{outcomes:?}")
    };
    assert_eq!((record.number, record.start_ns), (1, 81_000_000));
    assert!((record.compaction_energy - 2.0 * 9.9).abs() < 1e-9, "{record:?}");
    // Pushed for 3 mm, then resisted: it begins where it is no longer pushed.
    let mut meter = SqueezeMeter::new(rule(1));
    for i in 0..100 {
        step(&mut meter, i, i as f64 * 1.1e-4, if i < 28 { -500.0 } else { 1000.0 }, 1.0);
        assert_eq!(meter.take_outcomes().is_empty(), i < 27 + 19, "{i}");
    }
}

#[test]
fn a_long_loop_keeps_its_course_with_fewer_points() {
    let mut meter = SqueezeMeter::new(rule(1));
    for i in 0..5000 {
        let closing = i as f64 * 1e-5;
        step(&mut meter, i, closing, 1e5 * closing, 0.0);
        for outcomes in meter.take_outcomes() {
            assert!(outcomes.record.loop_points.len() < MAX_LOOP_POINTS);
        }
    }
    let points = &meter.take_outcomes()[0].record.loop_points;
    assert!(points.len() >= MAX_LOOP_POINTS / 2);
    assert!(points.iter().all(|[c, f]| (f - 1e5 * c).abs() < 1e-6));
    assert!(points.windows(2).all(|p| p[0][0] < p[1][0]) && points[points.len() - 1][0] > 0.049);
}

#[test]
fn a_restored_meter_continues_as_if_never_interrupted() {
    let mut whole = SqueezeMeter::new(rule(PERIOD));
    let mut broken = whole.clone();
    for i in 0..700 {
        let closing = 0.02 * (1.0 - (i as f64 * 0.01).cos());
        let (force, work) = (3e5 * closing + (i % 7) as f64, 0.1 * (i % 3) as f64);
        step(&mut whole, i, closing, force, work);
        step(&mut broken, i, closing, force, work);
        assert_eq!(broken.take_outcomes(), whole.take_outcomes());
        let mut numbers = SqueezeTrack::encode(&broken.into_tracks());
        let tracks = SqueezeTrack::decode(&numbers).expect("numbers of a track");
        broken = SqueezeMeter::resume(rule(PERIOD), &tracks);
        assert_eq!(broken, whole);
        numbers.push(0.0);
        assert!(SqueezeTrack::decode(&numbers).is_none());
    }
}

/// Checkpoints are read by this order.
#[test]
fn numbers_are_kept_in_their_order() {
    let track = SqueezeTrack {
        period: PeriodSums { steps: 1, force: 2.0, place: 3.0, work: 4.0, peak_step_force: 5.0 },
        is_squeezing: true,
        count: 7,
        widest: Some(9.0),
        farthest: 10.0,
        last_force: 11.0,
        per_point: 12,
        waiting: 13,
        waiting_sum: [14.0, 15.0],
        record: SqueezeRecord {
            number: 16,
            start_ns: 17,
            onset_ns: Some(18),
            onset_closing: 19.0,
            peak_force: 20.0,
            peak_closing: 21.0,
            peak_step_force: 22.0,
            closing: 23.0,
            work: 24.0,
            compaction_energy: 25.0,
            loop_points: vec![[27.0, 28.0]],
        },
    };
    let numbers = SqueezeTrack::encode(std::slice::from_ref(&track));
    let mut expected: Vec<f64> = (1..=28).map(f64::from).collect();
    // What is or is not, and how many points there are.
    (expected[5], expected[7], expected[25]) = (1.0, 1.0, 1.0);
    assert_eq!(numbers, expected);
    assert_eq!(SqueezeTrack::decode(&numbers), Some(vec![track]));
    let numbers = SqueezeTrack::encode(&[SqueezeTrack::default()]);
    let mut nothing = [0.0; 26];
    nothing[17] = -1.0;
    assert_eq!(numbers, nothing);
    assert_eq!(SqueezeTrack::decode(&numbers), Some(vec![SqueezeTrack::default()]));
}

#[test]
fn unusable_rules_are_refused() {
    let rule = |tines: PairTines, period| {
        SqueezeRule::new(vec![SqueezePair { name: "p".into(), tines }], period).is_err()
    };
    assert!(rule(vec![], 1) && rule(vec![(1, 0.5)], 1) && rule(vec![(1, 1.0)], 0));
    assert!(!rule(vec![(1, 1.0)], 1));
    // Tines on one arm add up.
    let impulse = |_| -350.0 * H;
    assert!((side_force(&vec![(0, 1.0), (1, 1.0)], impulse, H) - 700.0).abs() < 1e-9);
}

#[test]
fn a_side_of_two_tines_closes_as_one() {
    // Two tines come on by 10 mm, the one that faces them stands: 5 mm averaged over the sides.
    let pair = vec![(1, 1.0), (2, 1.0), (3, -1.0)];
    let closing = |moved: f64| mean_closing(&pair, |d| if d == 3 { 0.5 } else { moved });
    assert!((closing(0.01) - closing(0.0) - 0.005).abs() < 1e-15);
    assert_eq!(mean_closing(&vec![(1, -1.0)], |_| 0.25), -0.25);
}
