//! Times detection on a settled sample: `detection_speed FILE [steps]`.
//!
//! Prints microseconds per grain and step for both phases. Grains are nudged a little in each step,
//! as in a settled bed.

use ballast::detection::{Contacts, Detector};
use ballast::geometry::convex_hull;
use ballast::math::{Pose, Quat, Vec3};
use ballast::model::{Grains, Model, Solver, Stepping};
use ballast::motion::Motion;
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut args = std::env::args().skip(1);
    let file = args.next().ok_or("which sample? (nscd-sample-1 JSON)")?;
    let steps: u32 = args.next().map_or(Ok(50), |n| n.parse())?;
    let copies: u32 = args.next().map_or(Ok(1), |n| n.parse())?;
    let (model, mut motion) =
        load(&serde_json::from_str(&std::fs::read_to_string(file)?)?, copies)?;
    let ng = model.grains.len() as f64;
    let mut detector = Detector::default();
    let mut contacts = Contacts::default();
    let mut best = [f64::INFINITY; 2];
    for step in 0..steps {
        for (k, x) in motion.position.iter_mut().enumerate() {
            let phase = f64::from(step) + k as f64;
            *x += Vec3::new(phase.sin(), (1.3 * phase).cos(), (0.7 * phase).sin()) * 1e-6;
        }
        let start = Instant::now();
        detector.broad_phase(&model, &motion);
        let middle = Instant::now();
        detector.narrow_phase(&model, &motion, &mut contacts);
        let times = [middle - start, middle.elapsed()].map(|t| t.as_secs_f64() * 1e6 / ng);
        if step == 0 {
            println!("first step: broad {:.2}, narrow {:.2} µs per grain", times[0], times[1]);
        } else {
            best = [best[0].min(times[0]), best[1].min(times[1])];
        }
    }
    println!(
        "{ng} grains, {} pairs listed, {} contact points; best later step: broad {:.3}, narrow {:.3} µs per grain",
        detector.pair_count(),
        contacts.len(),
        best[0],
        best[1]
    );
    Ok(())
}

fn load(
    sample: &serde_json::Value,
    copies: u32,
) -> Result<(Model, Motion), Box<dyn std::error::Error>> {
    let numbers = |v: &serde_json::Value| -> Vec<f64> {
        v.as_array().map(|a| a.iter().filter_map(|x| x.as_f64()).collect()).unwrap_or_default()
    };
    let vector = |v: &serde_json::Value| Vec3::from_iterator(numbers(v));
    let (mut shapes, mut grains, mut motion) = (vec![], Grains::default(), Motion::default());
    for copy in 0..copies {
        for (k, grain) in sample["grains"].as_array().ok_or("no grains")?.iter().enumerate() {
            if copy == 0 {
                let points: Vec<Vec3> =
                    grain["vertices"].as_array().ok_or("no vertices")?.iter().map(vector).collect();
                shapes.push(convex_hull(&points)?);
            }
            let q = numbers(&grain["quaternion"]);
            let turn = Quat::new_normalize(nalgebra::Quaternion::new(q[0], q[1], q[2], q[3]));
            let aside = Vec3::new(f64::from(copy) * 10.0, 0.0, 0.0);
            let position = vector(&grain["position"]) + aside;
            let pose = Pose { position, orientation: turn }.then(&shapes[k].1);
            grains.push(k as u32, &shapes[k].0, 2700.0);
            motion.position.push(pose.position);
            motion.orientation.push(pose.orientation);
            motion.velocity.push(Vec3::zeros());
            motion.spin.push(Vec3::zeros());
        }
    }
    let model = Model {
        shapes: shapes.into_iter().map(|s| s.0).collect(),
        grains,
        driven: vec![],
        gravity: Vec3::new(0.0, 0.0, -9.81),
        grain_friction: 0.5,
        restitution: 0.0,
        stepping: Stepping { step_ns: 200_000, theta: 0.5, alert: 1e-3 },
        solver: Solver::default(),
    };
    Ok((model, motion))
}
