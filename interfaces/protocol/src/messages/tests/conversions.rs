//! The core's types go through messages without losing a bit.

use super::*;
use ballast::component::{self, MotionInput, Waveform};
use ballast::math::{self, Quat, Vec3};
use ballast::observe::{SqueezeOutcome, SqueezeRecord};

fn input() -> MotionInput {
    let axis = Vec3::new(0.3, -0.2, 0.9);
    let knot = |i: u64| component::Knot {
        time_ns: i * 800_000,
        pose: math::Pose {
            position: Vec3::new(0.1 * i as f64, -0.0, 1.0 / 3.0),
            orientation: Quat::new(axis * (0.1 * i as f64)),
        },
        velocity: Vec3::new(1e-300, 2.0, f64::MIN_POSITIVE),
        angular_velocity: Vec3::new(0.1, 0.2, 0.3),
    };
    let interpolation = component::Interpolation::Hermite;
    let waveform = Waveform { interpolation, knots: (0..4).map(knot).collect() };
    MotionInput { body: "tine_1".into(), waveform, allow_jump: true }
}

#[test]
fn inputs_come_back_to_the_bit() {
    let message = BodyMotion::from(&input());
    for back in [
        from_cdr::<BodyMotion>(&to_cdr(&message).unwrap()).unwrap(),
        from_json::<BodyMotion>(to_json(&message).unwrap().as_bytes()).unwrap(),
    ] {
        let back = MotionInput::try_from(&back).unwrap();
        assert_eq!(back, input());
        assert!(back.waveform.knots[1].pose.position.y.is_sign_negative());
    }
}

#[test]
fn inputs_that_make_no_sense_are_refused_with_their_place() {
    let request = |change: &dyn Fn(&mut AdvanceRequest)| {
        let mut request = AdvanceRequest {
            t1_ns: 800_000,
            motions: vec![BodyMotion::from(&input())],
            ..AdvanceRequest::default()
        };
        change(&mut request);
        request.inputs()
    };
    let asked = request(&|_| {}).unwrap();
    assert_eq!((asked.t1_ns, asked.motions), (800_000, vec![input()]));
    type Change<'a> = &'a dyn Fn(&mut AdvanceRequest);
    let wrong: [(Change, &str); 6] = [
        (&|r| r.t1_ns = -1, "t1_ns"),
        (&|r| r.motions[0].knots[2].time_ns = -5, "input of \"tine_1\".knots[2].time_ns"),
        (&|r| r.motions[0].knots[1].pose.orientation.w = 3.0, "knots[1].pose.orientation"),
        (&|r| r.motions[0].knots[1].pose.orientation.w = f64::NAN, "knots[1].pose.orientation"),
        (
            &|r| r.loads.push(load(InterpolationMode::Hermite, 0)),
            "load on \"sleeper\".interpolation",
        ),
        (
            &|r| r.loads.push(load(InterpolationMode::Hold, -1)),
            "load on \"sleeper\".knots[0].time_ns",
        ),
    ];
    for (change, place) in wrong {
        let error = request(change).unwrap_err();
        assert!(error.place.contains(place), "{error}");
    }
}

fn load(interpolation: InterpolationMode, time_ns: i64) -> BodyLoad {
    let wrench = Wrench {
        force: Vector3 { x: 0.1, y: -0.0, z: 1e-300 },
        torque: Vector3 { x: 1.0, y: 2.0, z: 3.0 },
    };
    BodyLoad { body: "sleeper".into(), interpolation, knots: vec![WrenchKnot { time_ns, wrench }] }
}

#[test]
fn loads_come_back_to_the_bit() {
    for interpolation in [InterpolationMode::Hold, InterpolationMode::Linear] {
        let message = load(interpolation, 77);
        let core = component::LoadInput::try_from(&message).unwrap();
        assert_eq!(BodyLoad::from(&core), message);
        assert_eq!(from_json::<BodyLoad>(to_json(&message).unwrap().as_bytes()).unwrap(), message);
    }
    let short = from_json::<BodyLoad>(br#"{"body": "sleeper", "knots": []}"#).unwrap();
    assert_eq!(short.interpolation, InterpolationMode::Linear);
}

#[test]
fn outcomes_come_back_to_the_bit() {
    let energy = ballast::state::EnergyLedger { kinetic: 0.1, work_in: -3.0, ..Default::default() };
    let message = EnergyLedger::from(energy);
    assert_eq!(message.balance_error, 0.1 + 3.0);
    assert_eq!(ballast::state::EnergyLedger::from(message), energy);
    let body = component::BodyResult {
        impulse: Vec3::new(1.0, 2.0, 3.0),
        angular_impulse: Vec3::new(4.0, 5.0, 6.0),
        mean_force: Vec3::new(7.0, 8.0, 9.0),
        mean_torque: Vec3::new(0.1, 0.2, 0.3),
        peak_force: Vec3::new(10.0, 11.0, 12.0),
        peak_torque: Vec3::new(0.7, 0.8, 0.9),
        peak_time_ns: 77,
        moving_average_force: Vec3::new(7.5, 8.5, 9.5),
        moving_average_torque: Vec3::new(0.4, 0.5, 0.6),
        work: -0.5,
        contacts: 3,
        pose: math::Pose::at(Vec3::new(0.5, -0.0, 0.1)),
        velocity: Vec3::new(1e-3, 2e-3, 3e-3),
        angular_velocity: Vec3::new(-1.0, 0.0, 1.0),
    };
    let message = WrenchImpulse::of("plate", 2_000_000_001, &body);
    assert_eq!(component::BodyResult::try_from(&message).unwrap(), body);
    assert_eq!(message.header.stamp, Time { sec: 2, nanosec: 1 });
    assert_eq!(message.header.stamp.ns(), 2_000_000_001);
    assert_eq!(Time::from_ns(u64::MAX).sec, i32::MAX);
}

#[test]
fn squeezes_come_back_to_the_bit() {
    let record = SqueezeRecord {
        number: 3,
        start_ns: 5,
        onset_ns: None,
        onset_closing: 0.1,
        peak_force: 1.0 / 3.0,
        peak_closing: 0.2,
        peak_step_force: 7.0,
        closing: -0.0,
        work: 1e-300,
        compaction_energy: 4.0,
        loop_points: vec![[0.1, 0.2], [0.3, 0.4]],
    };
    for onset_ns in [None, Some(77)] {
        let record = SqueezeRecord { onset_ns, ..record.clone() };
        let told = SqueezeOutcome { name: "pair".into(), is_finished: true, record };
        let message = SqueezeReport::of(99, &told);
        assert_eq!(message.header.stamp.ns(), 99);
        assert_eq!(SqueezeOutcome::try_from(&message).unwrap(), told);
    }
    let early = SqueezeReport { start_ns: -1, ..SqueezeReport::default() };
    let refused = SqueezeOutcome::try_from(&early).unwrap_err();
    assert!(refused.place.contains("start_ns"), "{refused}");
}

#[test]
fn the_digest_of_a_reply_does_not_depend_on_the_run() {
    let reply = AdvanceReply { run_id: "a".into(), seq: 4, ..AdvanceReply::default() };
    let other = AdvanceReply { run_id: "b".into(), ..reply.clone() };
    assert_eq!(reply.digest().unwrap(), other.digest().unwrap());
    let changed = AdvanceReply { steps: 1, ..reply.clone() };
    assert_ne!(reply.digest().unwrap(), changed.digest().unwrap());
    let record = WindowRecord::of(AdvanceRequest { seq: 4, ..Default::default() }, &reply).unwrap();
    assert_eq!((record.seq, record.reply_digest), (4, reply.digest().unwrap()));
}
