//! Squeezes until a preset force: the shortest useful partner of a served component.
//!
//!     ballast serve examples/first.toml --key demo/bed
//!     cargo run --release -p ballast-zenoh --example controller_loop -- demo/bed 2000 0.1
//!
//! Lowers the tines into the bed (here by 0.1 m), then closes them on each other, millisecond by millisecond, until the mean
//! of their horizontal forces over the last 4 ms has reached the preset one.

use ballast_protocol::messages::{
    AdvanceReply, BodyMotion, InterpolationMode, MotionKnot, Point, Pose, Quaternion, ReplyStatus,
    Twist, Vector3,
};
use ballast_zenoh::session::DEFAULT_ENDPOINT;
use ballast_zenoh::{Client, SessionConfig, Timeouts};
use std::error::Error;

/// Speed of lowering, m/s.
const LOWERING_SPEED: f64 = 0.5;
/// Maximum closing of a tine, m.
const MAX_CLOSING: f64 = 0.04;
/// Speed of closing, m/s.
const CLOSING_SPEED: f64 = 0.1;
/// Acceleration of the tines, m/s².
const ACCELERATION: f64 = 20.0;

/// Motion of a tine, and the side to which it closes.
struct TineMotion {
    name: String,
    position: Point,
    orientation: Quaternion,
    velocity: Vector3,
    inward: f64,
}

impl TineMotion {
    /// Accelerates towards the velocity `target` and returns the motion of the window.
    ///
    /// With `allow_jump`, the velocity may differ from that of the last window's end.
    fn steer(&mut self, target: Vector3, t0_ns: u64, t1_ns: u64, allow_jump: bool) -> BodyMotion {
        let dt = (t1_ns - t0_ns) as f64 * 1e-9;
        let before = self.knot(t0_ns);
        let most = ACCELERATION * dt;
        for (v, target, p) in [
            (&mut self.velocity.x, target.x, &mut self.position.x),
            (&mut self.velocity.z, target.z, &mut self.position.z),
        ] {
            let faster = (target - *v).clamp(-most, most);
            *p += (*v + 0.5 * faster) * dt;
            *v += faster;
        }
        let knots = vec![before, self.knot(t1_ns)];
        BodyMotion {
            body: self.name.clone(),
            interpolation: InterpolationMode::Hermite,
            allow_jump,
            knots,
        }
    }

    fn knot(&self, time_ns: u64) -> MotionKnot {
        let pose = Pose { position: self.position, orientation: self.orientation };
        let twist = Twist { linear: self.velocity, ..Twist::default() };
        MotionKnot { time_ns: time_ns as i64, pose, twist }
    }
}

/// Result of a squeeze.
#[derive(Debug, Clone, PartialEq)]
pub struct SqueezeResult {
    /// Mean of the horizontal forces on the tines, N.
    pub force: f64,
    /// Inward displacement of each tine, m.
    pub closing: f64,
    /// Simulated time, s.
    pub time_s: f64,
    /// State hash.
    pub hash: String,
}

/// Lowers the tines by `depth` (m) and squeezes until `force` (N), or as far as it goes; the tines stand still
/// then.
pub fn squeeze(
    client: &mut Client,
    force: f64,
    depth: f64,
) -> Result<SqueezeResult, Box<dyn Error>> {
    let description = client.describe()?;
    // Whole steps, a millisecond if it can be.
    let window = (1_000_000 / description.step_ns).max(1) * description.step_ns;
    let bodies = description.bodies.iter().filter(|b| b.role == "tine");
    let middle = bodies.clone().map(|b| b.position.x).sum::<f64>() / bodies.clone().count() as f64;
    let mut tines: Vec<TineMotion> = bodies
        .map(|b| TineMotion {
            name: b.name.clone(),
            position: b.position,
            orientation: b.orientation,
            velocity: Vector3::default(),
            inward: (middle - b.position.x).signum(),
        })
        .collect();
    let start: Vec<Point> = tines.iter().map(|t| t.position).collect();
    let mut result = SqueezeResult { force: 0.0, closing: 0.0, time_s: 0.0, hash: String::new() };
    // A former owner may have left the tines moving; the first window starts from rest.
    let mut is_first = true;
    loop {
        let down = start[0].z - tines[0].position.z;
        result.closing = (tines[0].position.x - start[0].x).abs();
        let is_down = down >= depth;
        let is_done = is_down && (result.force >= force || result.closing >= MAX_CLOSING);
        if is_done && tines.iter().all(|t| t.velocity == Vector3::default()) {
            return Ok(result);
        }
        let (t0, t1) = (client.position().now_ns, client.position().now_ns + window);
        let motions = tines.iter_mut().map(|tine| {
            let x = if is_down && !is_done { tine.inward * CLOSING_SPEED } else { 0.0 };
            let z = if is_down { 0.0 } else { -LOWERING_SPEED };
            tine.steer(Vector3 { x, y: 0.0, z }, t0, t1, is_first)
        });
        let reply = client.advance_to(t1, motions.collect(), vec![])?;
        is_first = false;
        if !matches!(reply.status, ReplyStatus::Ok | ReplyStatus::Warn) {
            return Err(
                format!("window {}: {:?}, {}", reply.seq, reply.status, reply.message).into()
            );
        }
        result.force = horizontal(&reply, &tines);
        result.time_s = t1 as f64 * 1e-9;
        result.hash = reply.hash.to_string();
    }
}

/// Returns the mean outward force of the ballast on the tines, N.
fn horizontal(reply: &AdvanceReply, tines: &[TineMotion]) -> f64 {
    let outward = |tine: &TineMotion| {
        let body = reply.bodies.iter().find(|b| b.body == tine.name);
        body.map_or(0.0, |b| -tine.inward * b.moving_average.force.x)
    };
    tines.iter().map(outward).sum::<f64>() / tines.len().max(1) as f64
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [key, force, depth, rest @ ..] = &arguments[..] else {
        return Err("usage: controller_loop SITE/ID FORCE_N DEPTH_M [ENDPOINT]".into());
    };
    let endpoint = rest.first().map_or(DEFAULT_ENDPOINT, |e| e);
    let link = SessionConfig::connect_to(endpoint);
    let mut client = Client::attach(key, &link, "controller", None, Timeouts::default())?;
    let done = squeeze(&mut client, force.parse()?, depth.parse()?)?;
    println!(
        "{:.1} N after closing {:.1} mm, at {:.3} s; state {}",
        done.force,
        1e3 * done.closing,
        done.time_s,
        done.hash
    );
    client.detach()?;
    Ok(())
}
