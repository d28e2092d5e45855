//! Conversions between messages and types of the core.
//!
//! Contract: numbers are bitwise unchanged.

use super::time::checked_core_ns;
use super::*;
use crate::MessageError;
use ballast::component;
use ballast::drive::Load;
use ballast::math::{self, Quat, Vec3};

/// Maximum deviation of the norm of a quaternion from 1.
const NORM_TOLERANCE: f64 = 1e-6;

macro_rules! vectors {
    ($($name:ident),*) => {$(
        impl From<Vec3> for $name {
            fn from(v: Vec3) -> Self {
                Self { x: v.x, y: v.y, z: v.z }
            }
        }

        impl From<$name> for Vec3 {
            fn from(v: $name) -> Self {
                Vec3::new(v.x, v.y, v.z)
            }
        }
    )*};
}

vectors!(Vector3, Point);

impl From<Quat> for Quaternion {
    fn from(q: Quat) -> Self {
        Self { x: q.i, y: q.j, z: q.k, w: q.w }
    }
}

// Checked but not normalised, which would change bits.
impl TryFrom<Quaternion> for Quat {
    type Error = MessageError;

    fn try_from(q: Quaternion) -> Result<Self, MessageError> {
        let plain = nalgebra::Quaternion::new(q.w, q.x, q.y, q.z);
        let norm = plain.norm();
        if (norm - 1.0).abs() <= NORM_TOLERANCE {
            return Ok(Quat::new_unchecked(plain));
        }
        Err(MessageError::new(
            "orientation",
            "a unit quaternion (x, y, z, w)",
            format!("{:?}, of norm {norm}", [q.x, q.y, q.z, q.w]),
        ))
    }
}

impl From<math::Pose> for Pose {
    fn from(pose: math::Pose) -> Self {
        Self { position: pose.position.into(), orientation: pose.orientation.into() }
    }
}

impl TryFrom<Pose> for math::Pose {
    type Error = MessageError;

    fn try_from(pose: Pose) -> Result<Self, MessageError> {
        Ok(Self { position: pose.position.into(), orientation: pose.orientation.try_into()? })
    }
}

impl From<component::Interpolation> for InterpolationMode {
    fn from(between: component::Interpolation) -> Self {
        match between {
            component::Interpolation::Hold => InterpolationMode::Hold,
            component::Interpolation::Linear => InterpolationMode::Linear,
            component::Interpolation::Hermite => InterpolationMode::Hermite,
        }
    }
}

impl From<InterpolationMode> for component::Interpolation {
    fn from(between: InterpolationMode) -> Self {
        match between {
            InterpolationMode::Hold => component::Interpolation::Hold,
            InterpolationMode::Linear => component::Interpolation::Linear,
            InterpolationMode::Hermite => component::Interpolation::Hermite,
        }
    }
}

impl From<component::Twist> for Twist {
    fn from(twist: component::Twist) -> Self {
        Self { linear: twist.velocity.into(), angular: twist.angular_velocity.into() }
    }
}

impl From<Twist> for component::Twist {
    fn from(twist: Twist) -> Self {
        Self { velocity: twist.linear.into(), angular_velocity: twist.angular.into() }
    }
}

impl From<component::Knot> for MotionKnot {
    fn from(knot: component::Knot) -> Self {
        let twist =
            component::Twist { velocity: knot.velocity, angular_velocity: knot.angular_velocity }
                .into();
        Self { time_ns: ns(knot.time_ns), pose: knot.pose.into(), twist }
    }
}

impl TryFrom<MotionKnot> for component::Knot {
    type Error = MessageError;

    fn try_from(knot: MotionKnot) -> Result<Self, MessageError> {
        Ok(Self {
            time_ns: checked_core_ns("time_ns", knot.time_ns)?,
            pose: math::Pose::try_from(knot.pose).map_err(|e| e.inside("pose"))?,
            velocity: knot.twist.linear.into(),
            angular_velocity: knot.twist.angular.into(),
        })
    }
}

impl From<&component::MotionInput> for BodyMotion {
    fn from(input: &component::MotionInput) -> Self {
        Self {
            body: input.body.clone(),
            interpolation: input.waveform.interpolation.into(),
            allow_jump: input.allow_jump,
            knots: input.waveform.knots.iter().map(|k| MotionKnot::from(*k)).collect(),
        }
    }
}

impl TryFrom<&BodyMotion> for component::MotionInput {
    type Error = MessageError;

    fn try_from(input: &BodyMotion) -> Result<Self, MessageError> {
        let knot = |(i, knot): (usize, &MotionKnot)| {
            component::Knot::try_from(*knot).map_err(|e| e.inside(&format!("knots[{i}]")))
        };
        let knots = input.knots.iter().enumerate().map(knot).collect::<Result<_, _>>();
        let knots = knots.map_err(|e| e.inside(&format!("input of {:?}", input.body)))?;
        let waveform = component::Waveform { interpolation: input.interpolation.into(), knots };
        Ok(Self { body: input.body.clone(), waveform, allow_jump: input.allow_jump })
    }
}

impl From<&component::LoadInput> for BodyLoad {
    fn from(input: &component::LoadInput) -> Self {
        let wave = &input.waveform;
        let interpolation =
            if wave.is_held { InterpolationMode::Hold } else { InterpolationMode::Linear };
        let knot = |k: &component::LoadKnot| WrenchKnot {
            time_ns: ns(k.time_ns),
            wrench: Wrench { force: k.load.force.into(), torque: k.load.torque.into() },
        };
        let knots = wave.knots.iter().map(knot).collect();
        Self { body: input.body.clone(), interpolation, knots }
    }
}

impl TryFrom<&BodyLoad> for component::LoadInput {
    type Error = MessageError;

    fn try_from(input: &BodyLoad) -> Result<Self, MessageError> {
        let place = format!("load on {:?}", input.body);
        let is_held = match input.interpolation {
            InterpolationMode::Hold => true,
            InterpolationMode::Linear => false,
            InterpolationMode::Hermite => {
                let expected = "hold or linear: loads have no rates";
                let e = MessageError::new("interpolation", expected, "hermite");
                return Err(e.inside(&place));
            }
        };
        let knot = |(i, knot): (usize, &WrenchKnot)| {
            let time_ns = checked_core_ns(&format!("knots[{i}].time_ns"), knot.time_ns)?;
            let load = Load { force: knot.wrench.force.into(), torque: knot.wrench.torque.into() };
            Ok(component::LoadKnot { time_ns, load })
        };
        let knots: Result<_, MessageError> = input.knots.iter().enumerate().map(knot).collect();
        let knots = knots.map_err(|e| e.inside(&place))?;
        Ok(Self { body: input.body.clone(), waveform: component::LoadWaveform { is_held, knots } })
    }
}

/// Inputs of a window, decoded from a request.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct AdvanceInputs {
    /// End of the window, ns.
    pub t1_ns: u64,
    /// Motions of bodies.
    pub motions: Vec<component::MotionInput>,
    /// Loads on bodies.
    pub loads: Vec<component::LoadInput>,
}

impl AdvanceRequest {
    /// Decodes end and inputs of the window for [`component::Component::advance_to`].
    ///
    /// # Errors
    /// Times before the start of the run, quaternions without unit norm, or loads with cubic interpolation.
    pub fn inputs(&self) -> Result<AdvanceInputs, MessageError> {
        let motions = self.motions.iter().map(component::MotionInput::try_from);
        let loads = self.loads.iter().map(component::LoadInput::try_from);
        Ok(AdvanceInputs {
            t1_ns: checked_core_ns("t1_ns", self.t1_ns)?,
            motions: motions.collect::<Result<_, _>>()?,
            loads: loads.collect::<Result<_, _>>()?,
        })
    }
}
