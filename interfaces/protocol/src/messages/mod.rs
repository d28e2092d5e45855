//! The types of messages, one Rust structure per ROS 2 definition in `msg`.
//!
//! Contract: fields stand in the order of the definition, which is what CDR relies on; a test compares
//! them. SI units, world frame with z up, quaternions x, y, z, w, wrenches and impulses *by the ballast
//! on the body*.

mod catalogue;
mod convert;
mod hash;
mod input;
mod reply;
mod scene;
mod series;
mod stock;
mod words;

pub use catalogue::{Message, decode_to_json, definition, schema};
pub use convert::{AdvanceInputs, core_ns, ns};
pub use hash::{Digest, StateHash};
pub use input::{AdvanceRequest, BodyLoad, BodyMotion, MotionKnot, WrenchKnot};
pub use reply::{
    AdvanceReply, EnergyBalance, SolverParameters, SolverStats, SqueezeReport, WindowRecord,
    WrenchImpulse, ZoneMeasurement,
};
pub use scene::{
    ArrowPrimitive, Color, CubePrimitive, CylinderPrimitive, KeyValuePair, LinePrimitive,
    ModelPrimitive, SceneEntity, SceneEntityDeletion, SceneUpdate, SpherePrimitive, TextPrimitive,
    TriangleListPrimitive,
};
pub use series::{BodySeries, MAX_SERIES_ENTRIES, StepSeries};
pub use stock::{
    Clock, Duration, Header, Log, Point, PointCloud2, PointField, Pose, PoseStamped, Quaternion,
    TFMessage, Time, Transform, TransformStamped, Twist, TwistStamped, Vector3, Wrench,
    WrenchStamped,
};
pub use words::{DeadlinePolicy, InterpolationMode, ReplyStatus};

/// The frame that all positions of this program are given in.
pub const WORLD: &str = "world";

#[cfg(test)]
mod tests;
