//! The core's types go through messages without losing a bit.

use super::*;
use ballast::component::{self, Input, Waveform};
use ballast::math::{self, Quat, Vec3};

fn input() -> Input {
    let axis = Vec3::new(0.3, -0.2, 0.9);
    let knot = |i: u64| component::Knot {
        time_ns: i * 800_000,
        pose: math::Pose {
            position: Vec3::new(0.1 * i as f64, -0.0, 1.0 / 3.0),
            orientation: Quat::new(axis * (0.1 * i as f64)),
        },
        velocity: Vec3::new(1e-300, 2.0, f64::MIN_POSITIVE),
        spin: Vec3::new(0.1, 0.2, 0.3),
    };
    let interpolation = component::Interpolation::Hermite;
    let waveform = Waveform { interpolation, knots: (0..4).map(knot).collect() };
    Input { body: "tine_1".into(), waveform, rebase: true }
}

#[test]
fn inputs_come_back_to_the_bit() {
    let message = BodyInput::from(&input());
    for back in [
        from_cdr::<BodyInput>(&to_cdr(&message).unwrap()).unwrap(),
        from_json::<BodyInput>(to_json(&message).unwrap().as_bytes()).unwrap(),
    ] {
        let back = Input::try_from(&back).unwrap();
        assert_eq!(back, input());
        assert!(back.waveform.knots[1].pose.position.y.is_sign_negative());
    }
}

#[test]
fn inputs_that_make_no_sense_are_refused_with_their_place() {
    let request = |change: &dyn Fn(&mut AdvanceRequest)| {
        let mut request = AdvanceRequest {
            t1_ns: 800_000,
            motions: vec![BodyInput::from(&input())],
            ..AdvanceRequest::default()
        };
        change(&mut request);
        request.inputs()
    };
    assert_eq!(request(&|_| {}).unwrap(), (800_000, vec![input()]));
    type Change<'a> = &'a dyn Fn(&mut AdvanceRequest);
    let wrong: [(Change, &str); 5] = [
        (&|r| r.t1_ns = -1, "t1_ns"),
        (&|r| r.motions[0].knots[2].time_ns = -5, "input of \"tine_1\".knots[2].time_ns"),
        (&|r| r.motions[0].knots[1].pose.orientation.w = 3.0, "knots[1].pose.orientation"),
        (&|r| r.motions[0].knots[1].pose.orientation.w = f64::NAN, "knots[1].pose.orientation"),
        (&|r| r.loads.push(LoadInput::default()), "loads"),
    ];
    for (change, place) in wrong {
        let error = request(change).unwrap_err();
        assert!(error.place.contains(place), "{error}");
    }
}

#[test]
fn outcomes_come_back_to_the_bit() {
    let energy = ballast::state::EnergyLedger { kinetic: 0.1, work_in: -3.0, ..Default::default() };
    assert_eq!(ballast::state::EnergyLedger::from(EnergyLedger::from(energy)), energy);
    let body = component::BodyOutcome {
        impulse: Vec3::new(1.0, 2.0, 3.0),
        angular_impulse: Vec3::new(4.0, 5.0, 6.0),
        mean_force: Vec3::new(7.0, 8.0, 9.0),
        mean_torque: Vec3::new(0.1, 0.2, 0.3),
        peak_force: Vec3::new(10.0, 11.0, 12.0),
        peak_time_ns: 77,
        work: -0.5,
        contacts: 3,
    };
    let model = ballast::model::Model {
        shapes: vec![],
        grains: Default::default(),
        driven: vec![ballast::model::DrivenBody {
            name: "plate".into(),
            role: ballast::model::Role::Tine,
            friction: 0.5,
            parts: vec![],
            mount: None,
        }],
        gravity: Vec3::zeros(),
        grain_friction: 0.5,
        restitution: 0.0,
        stepping: ballast::model::Stepping { step_ns: 1000, theta: 0.5, alert: 1e-3 },
        solver: ballast::model::Solver::default(),
    };
    let mut state = ballast::state::State { time_ns: 2_000_000_001, ..Default::default() };
    state.push(math::Pose::at(Vec3::new(0.5, 0.0, 0.0)));
    let message = WrenchImpulse::of(&model, &state, 0, &body);
    assert_eq!(component::BodyOutcome::from(&message), body);
    assert_eq!(message.header.stamp, Time { sec: 2, nanosec: 1 });
    assert_eq!(message.header.stamp.ns(), 2_000_000_001);
    assert_eq!(message.pose.position.x, 0.5);
    assert_eq!(Time::from_ns(u64::MAX).sec, i32::MAX);
}

#[test]
fn the_digest_of_a_reply_does_not_depend_on_the_run() {
    let reply = AdvanceReply { run_id: "a".into(), seq: 4, ..AdvanceReply::default() };
    let other = AdvanceReply { run_id: "b".into(), ..reply.clone() };
    assert_eq!(reply.digest().unwrap(), other.digest().unwrap());
    let changed = AdvanceReply { steps: 1, ..reply.clone() };
    assert_ne!(reply.digest().unwrap(), changed.digest().unwrap());
    let record = StepRecord::of(AdvanceRequest { seq: 4, ..Default::default() }, &reply).unwrap();
    assert_eq!((record.seq, record.reply_digest), (4, reply.digest().unwrap()));
}
