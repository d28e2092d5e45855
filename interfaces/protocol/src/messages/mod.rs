//! Message types, one Rust structure per ROS 2 definition in `msg`.
//!
//! Contract: fields are in the order of the definition, on which CDR relies; a test compares them. SI units, world frame with z up, quaternions x, y, z, w, wrenches and impulses *by the ballast
//! on the body*.

mod catalogue;
mod convert;
mod convert_results;
mod enums;
mod hash;
mod input;
mod message;
mod reply;
mod ros;
mod scene;
mod series;
mod time;

pub use catalogue::{decode_to_json, definition, schema};
pub use convert::AdvanceInputs;
pub use enums::{DeadlinePolicy, InterpolationMode, ReplyStatus};
pub use hash::{Digest, StateHash};
pub use input::{AdvanceRequest, BodyLoad, BodyMotion, MotionKnot, WrenchKnot};
pub use message::Message;
pub use reply::{
    AdvanceReply, EnergyLedger, SolverParameters, SolverStats, SqueezeReport, WindowRecord,
    WrenchImpulse, ZoneMeasurement,
};
pub use ros::{
    Clock, Duration, Header, Log, Point, PointCloud2, PointField, Pose, PoseStamped, Quaternion,
    TFMessage, Time, Transform, TransformStamped, Twist, TwistStamped, Vector3, Wrench,
    WrenchStamped,
};
pub use scene::{
    ArrowPrimitive, Color, CubePrimitive, CylinderPrimitive, KeyValuePair, LinePrimitive,
    ModelPrimitive, SceneEntity, SceneEntityDeletion, SceneUpdate, SpherePrimitive, TextPrimitive,
    TriangleListPrimitive,
};
pub use series::{BodySeries, MAX_SERIES_ENTRIES, StepSeries};
pub use time::{core_ns, ns};

/// Name of the world frame, in which all positions are given.
pub const WORLD: &str = "world";

#[cfg(test)]
mod tests;
