//! Standard message types of ROS 2.
//!
//! The fields are those of the definitions in `msg`.

#![allow(missing_docs)]

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

macro_rules! message {
    ($(#[$doc:meta])* $name:ident { $($(#[$field_doc:meta])* $field:ident: $type:ty),* $(,)? }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
        #[serde(deny_unknown_fields)]
        pub struct $name { $($(#[$field_doc])* pub $field: $type),* }
    };
}
pub(super) use message;

message!(
    /// Time: whole seconds, and nanoseconds from 0 to 999 999 999.
    #[derive(Copy, Eq)]
    Time { sec: i32, nanosec: u32 }
);
message!(
    /// Duration: whole seconds, and nanoseconds from 0 to 999 999 999.
    #[derive(Copy, Eq)]
    Duration { sec: i32, nanosec: u32 }
);
message!(
    /// Time stamp and frame of a message.
    Header { stamp: Time, frame_id: String });
message!(
    /// Vector in space.
    #[derive(Copy)]
    Vector3 { x: f64, y: f64, z: f64 }
);
message!(
    /// Position in space, m.
    #[derive(Copy)]
    Point { x: f64, y: f64, z: f64 }
);

/// Rotation, body to world.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Quaternion {
    pub x: f64,
    pub y: f64,
    pub z: f64,
    pub w: f64,
}

impl Default for Quaternion {
    fn default() -> Self {
        Self { x: 0.0, y: 0.0, z: 0.0, w: 1.0 }
    }
}

message!(
    /// Position and orientation.
    #[derive(Copy)]
    Pose { position: Point, orientation: Quaternion }
);
message!(
    /// Velocity, m/s, and angular velocity, rad/s.
    #[derive(Copy)]
    Twist { linear: Vector3, angular: Vector3 }
);
message!(
    /// Force, N, and torque, N m.
    #[derive(Copy)]
    Wrench { force: Vector3, torque: Vector3 }
);
message!(
    /// Pose with time and frame.
    PoseStamped { header: Header, pose: Pose });
message!(
    /// Twist with time and frame.
    TwistStamped { header: Header, twist: Twist });
message!(
    /// Wrench with time and frame.
    WrenchStamped { header: Header, wrench: Wrench });
message!(
    /// Translation, m, and rotation between two frames.
    #[derive(Copy)]
    Transform { translation: Vector3, rotation: Quaternion }
);
message!(
    /// Transform from the frame of the header to a child frame, with time.
    TransformStamped { header: Header, child_frame_id: String, transform: Transform });
message!(
    /// Transforms of several frames.
    TFMessage { transforms: Vec<TransformStamped> });
message!(
    /// Simulated time.
    #[derive(Copy, Eq)]
    Clock { clock: Time }
);
message!(
    /// Field of the points of a cloud; `datatype` 7 is a 32-bit float.
    PointField { name: String, offset: u32, datatype: u8, count: u32 }
);
message!(
    /// Point cloud with binary data.
    PointCloud2 {
    header: Header,
    height: u32,
    width: u32,
    fields: Vec<PointField>,
    is_bigendian: bool,
    point_step: u32,
    row_step: u32,
    data: Vec<u8>,
    is_dense: bool,
});
message!(
    /// Log message; `level` is 10 debug, 20 info, 30 warning, 40 error, 50 fatal.
    Log {
        stamp: Time,
        level: u8,
        name: String,
        msg: String,
        file: String,
        function: String,
        line: u32,
    }
);

impl Time {
    /// Converts simulated time, ns; times beyond 68 years become the last one.
    pub fn from_ns(ns: u64) -> Self {
        match i32::try_from(ns / 1_000_000_000) {
            Ok(sec) => Self { sec, nanosec: (ns % 1_000_000_000) as u32 },
            Err(_) => Self { sec: i32::MAX, nanosec: 999_999_999 },
        }
    }

    /// Returns the time, ns.
    pub fn ns(self) -> i64 {
        i64::from(self.sec) * 1_000_000_000 + i64::from(self.nanosec)
    }
}

impl Log {
    /// Creates an information message at a simulated time, ns.
    pub fn info(time_ns: u64, name: &str, text: &str) -> Self {
        let (stamp, name, msg) = (Time::from_ns(time_ns), name.into(), text.into());
        Self { stamp, level: 20, name, msg, ..Self::default() }
    }
}

impl Header {
    /// Creates the header of data in the world frame at a simulated time, ns.
    pub fn world(time_ns: u64) -> Self {
        Self { stamp: Time::from_ns(time_ns), frame_id: super::WORLD.into() }
    }
}
