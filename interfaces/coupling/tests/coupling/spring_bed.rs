//! A spring as the ballast: a substitute of the simulation with known answers.

use ballast_coupling::Simulation;
use ballast_protocol::description::{
    BodyDescription, ComponentDescription, ContinuityTolerance, PROTOCOL_VERSION,
};
use ballast_protocol::lockstep::{ErrorCode, RequestError, WindowKind};
use ballast_protocol::messages::{
    AdvanceReply, BodyMotion, BodySeries, Point, Quaternion, ReplyStatus, StepSeries, Twist,
    Vector3, WrenchImpulse, ns,
};
use ballast_zenoh::Error;

pub const STEP_NS: u64 = 500_000;

/// Bed that resists the vertical motion of `tine` like a spring; `sprung` is on a mount.
pub struct SpringBed {
    pub stiffness: f64,
    /// Height beyond which a window is discarded, m.
    pub limit: f64,
    /// Number of the request that is refused, from 0.
    pub refused: Option<usize>,
    pub now_ns: u64,
    pub requests: Vec<(WindowKind, [u64; 2])>,
}

impl SpringBed {
    pub fn new(stiffness: f64) -> Self {
        Self { stiffness, limit: 1.0, refused: None, now_ns: 0, requests: vec![] }
    }
}

fn body(name: &str, mode: &str) -> BodyDescription {
    BodyDescription {
        name: name.into(),
        role: "tine".into(),
        dof_modes: [mode; 6].map(str::to_string),
        stiffness: [0.0; 6],
        damping: [0.0; 6],
        mass_kg: None,
        position: Point::default(),
        orientation: Quaternion::default(),
        twist: Some(Twist::default()),
    }
}

impl Simulation for SpringBed {
    fn now_ns(&self) -> u64 {
        self.now_ns
    }

    fn description(&self) -> Result<ComponentDescription, Error> {
        Ok(ComponentDescription {
            key: "yard/spring".into(),
            version: String::new(),
            protocol_version: PROTOCOL_VERSION,
            step_ns: STEP_NS,
            grains: 0,
            start_hash: String::new(),
            bodies: vec![body("tine", "prescribed"), body("sprung", "spring")],
            continuity: ContinuityTolerance {
                distance_m: 0.0,
                angle_rad: 0.0,
                speed: 0.0,
                angular_velocity: 0.0,
            },
            determinism: String::new(),
            units: String::new(),
            frame: String::new(),
            wrench_convention: String::new(),
            viewer_endpoints: vec![],
            tines: vec![],
            parameters: Default::default(),
        })
    }

    fn compute(
        &mut self,
        kind: WindowKind,
        ends: [u64; 2],
        motions: Vec<BodyMotion>,
    ) -> Result<AdvanceReply, Error> {
        let expected = if kind == WindowKind::Advance { ends[0] } else { ends[1] };
        assert_eq!(self.now_ns, expected, "{kind:?}");
        self.requests.push((kind, ends));
        if self.refused == Some(self.requests.len() - 1) {
            let refusal = RequestError::new(ErrorCode::InputInvalid, "too fast");
            return Err(Error::Rejected(refusal));
        }
        let heights = heights(&motions[0], ends);
        if heights.iter().any(|z| z.abs() > self.limit) {
            self.now_ns = ends[0];
            let message = "too far".into();
            return Ok(AdvanceReply {
                status: ReplyStatus::Discard,
                message,
                ..Default::default()
            });
        }
        self.now_ns = ends[1];
        let mut series = BodySeries { body: "tine".into(), ..BodySeries::default() };
        let mut work = 0.0;
        for pair in heights.windows(2) {
            let force = -self.stiffness * (pair[0] + pair[1]) / 2.0;
            work -= force * (pair[1] - pair[0]);
            let z = force * STEP_NS as f64 * 1e-9;
            series.impulse.push(Vector3 { z, ..Vector3::default() });
            series.angular_impulse.push(Vector3::default());
        }
        Ok(AdvanceReply {
            t0_ns: ns(ends[0]),
            t1_ns: ns(ends[1]),
            bodies: vec![WrenchImpulse { body: "tine".into(), work, ..Default::default() }],
            step_series: StepSeries { bodies: vec![series], ..StepSeries::default() },
            ..AdvanceReply::default()
        })
    }
}

/// Returns the heights of a cubic motion at the ends of all steps.
fn heights(motion: &BodyMotion, ends: [u64; 2]) -> Vec<f64> {
    let [a, b] = &motion.knots[..] else { panic!("two knots") };
    assert_eq!([a.time_ns, b.time_ns], ends.map(ns));
    let steps = (ends[1] - ends[0]) / STEP_NS;
    let length = (ends[1] - ends[0]) as f64 * 1e-9;
    let at = |s: f64| {
        let r = 1.0 - s;
        let (start, end) = (a.pose.position.z, b.pose.position.z);
        let speeds = s * r * r * a.twist.linear.z - s * s * r * b.twist.linear.z;
        start + s * s * (3.0 - 2.0 * s) * (end - start) + length * speeds
    };
    (0..=steps).map(|k| at(k as f64 / steps as f64)).collect()
}
