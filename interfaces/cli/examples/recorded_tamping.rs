//! Writes `examples/recorded_tamping.mcap`: the motion of a machine over `examples/first.toml`, as a
//! measurement on a machine or another simulator would leave it.
//!
//! Poses and twists of two tines and the sleeper at 1 kHz for 0.6 s, by formula: the sleeper is lifted,
//! the tines go down, close and leave, each along a polynomial of degree 5, and vibrate at 35 Hz meanwhile.
//! Nothing in it knows of forces: this machine does not give way.
//!
//!     cargo run --release --example recorded_tamping -p ballast-cli -- examples/first.toml OUT.mcap

use ballast::track::plan::{Plan, TinePlan};
use ballast::track::tamping_cycle::start_position;
use ballast_mcap::{McapWriter, TopicMessage};
use ballast_protocol::messages::{Header, PoseStamped, TwistStamped, Vector3};
use std::error::Error;
use std::path::Path;

/// ms: a pose per millisecond.
const DURATION: u64 = 600;
/// Begin and end of each movement, s.
const LIFT: [f64; 2] = [0.0, 0.08];
const DOWN: [f64; 2] = [0.04, 0.26];
const CLOSE: [f64; 2] = [0.26, 0.46];
const OPEN: [f64; 2] = [0.46, 0.56];
const UP: [f64; 2] = [0.46, 0.6];
/// The vibration grows and dies in these times.
const GROW: [f64; 2] = [0.04, 0.1];
const FADE: [f64; 2] = [0.46, 0.54];
/// m, Hz.
const STROKE: f64 = 0.02;
const AMPLITUDE: f64 = 0.002;
const FREQUENCY: f64 = 35.0;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [case, out] = &arguments[..] else { return Err("usage: recorded_tamping CASE OUT".into()) };
    let text = std::fs::read_to_string(case)?;
    let plan = ballast_scenario::read_case(&text, case).map_err(|e| e.to_string())?.plan;
    let mut writer = McapWriter::create(Path::new(out), None)?;
    for ms in 0..=DURATION {
        for (body, place) in machine(&plan, ms as f64 * 1e-3)? {
            let header = Header::world(ms * 1_000_000);
            let mut pose = PoseStamped { header: header.clone(), ..PoseStamped::default() };
            (pose.pose.position.x, pose.pose.position.y, pose.pose.position.z) =
                (place[0].value, place[1].value, place[2].value);
            writer.write(&TopicMessage::of(format!("/{body}/pose"), ms * 1_000_000, &pose)?)?;
            let linear = Vector3 { x: place[0].rate, y: place[1].rate, z: place[2].rate };
            let mut twist = TwistStamped { header, ..TwistStamped::default() };
            twist.twist.linear = linear;
            writer.write(&TopicMessage::of(format!("/{body}/twist"), ms * 1_000_000, &twist)?)?;
        }
    }
    writer.finish()?;
    Ok(())
}

/// Name of a body, and its reference point.
type Placed = (String, [Moving; 3]);

/// A coordinate, m, and its rate, m/s.
#[derive(Clone, Copy)]
struct Moving {
    value: f64,
    rate: f64,
}

/// From 0 to 1 between two times, at rest at both ends.
fn travel(t: f64, [from, to]: [f64; 2]) -> Moving {
    let span = to - from;
    let u = ((t - from) / span).clamp(0.0, 1.0);
    let value = u * u * u * (10.0 + u * (6.0 * u - 15.0));
    Moving { value, rate: 30.0 * u * u * (1.0 - u) * (1.0 - u) / span }
}

/// Each moving body at a time, s.
fn machine(plan: &Plan, t: f64) -> Result<Vec<Placed>, Box<dyn Error>> {
    let tamping = plan.tamping.ok_or("the case has no tamping")?;
    let still = |value: f64| Moving { value, rate: 0.0 };
    let lift = travel(t, LIFT);
    let depth = plan.bed.preparation.ballast_depth;
    let mut bodies = Vec::new();
    for sleeper in plan.sleepers.iter().filter(|s| s.tamped) {
        let height = tamping.lift.height;
        let z = Moving { value: depth + height * lift.value, rate: height * lift.rate };
        let [x, y] = sleeper.centre;
        bodies.push((sleeper.name.clone(), [still(x), still(y), z]));
    }
    let deep = tamping.deep_edge(&plan.bed);
    for tine in &plan.tines {
        bodies.push((tine.name.clone(), tine_place(plan, tine, deep, t)));
    }
    Ok(bodies)
}

fn tine_place(plan: &Plan, tine: &TinePlan, deep: f64, t: f64) -> [Moving; 3] {
    let start = start_position(plan, tine);
    let (down, up) = (travel(t, DOWN), travel(t, UP));
    let (close, open) = (travel(t, CLOSE), travel(t, OPEN));
    let way = deep - start.z;
    let z = Moving {
        value: start.z + way * (down.value - up.value),
        rate: way * (down.rate - up.rate),
    };
    let (grow, fade) = (travel(t, GROW), travel(t, FADE));
    let swing = Moving { value: grow.value - fade.value, rate: grow.rate - fade.rate };
    let turn = std::f64::consts::TAU * FREQUENCY;
    let (sine, cosine) = (turn * (t - GROW[0])).sin_cos();
    let vibration = AMPLITUDE * swing.value * sine;
    let speed = AMPLITUDE * (swing.rate * sine + swing.value * turn * cosine);
    let x = Moving {
        value: start.x + tine.direction * (STROKE * (close.value - open.value) + vibration),
        rate: tine.direction * (STROKE * (close.rate - open.rate) + speed),
    };
    [x, Moving { value: start.y, rate: 0.0 }, z]
}
