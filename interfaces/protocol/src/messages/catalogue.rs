//! Message types with their names and ROS 2 definitions.

use super::*;
use crate::{MessageError, from_cdr};
use std::collections::BTreeSet;

macro_rules! catalogue {
    ($($package:literal $name:ident),* $(,)?) => {
        $(impl Message for $name {
            const NAME: &'static str = concat!($package, "/msg/", stringify!($name));
        })*

        /// Definitions by name, in the form `package/Type`.
        const DEFINITIONS: &[(&str, &str)] = &[$((
            concat!($package, "/", stringify!($name)),
            include_str!(concat!("../../msg/", $package, "/", stringify!($name), ".msg")),
        )),*];

        /// Decodes a message of the named type (`geometry_msgs/msg/Pose`) from CDR into a JSON value.
        ///
        /// # Errors
        /// An unknown type, or bytes that are no message of it.
        pub fn decode_to_json(name: &str, bytes: &[u8]) -> Result<serde_json::Value, MessageError> {
            match name {
                $(<$name as Message>::NAME => value::<$name>(bytes),)*
                _ => Err(MessageError::new("schema", "a type of this program", format!("{name:?}"))),
            }
        }

        #[cfg(test)]
        pub(super) fn for_each(visitor: &mut impl super::tests::ForEach) {
            $(visitor.visit::<$name>();)*
        }
    };
}

fn value<T: Message>(bytes: &[u8]) -> Result<serde_json::Value, MessageError> {
    serde_json::to_value(from_cdr::<T>(bytes)?)
        .map_err(|e| MessageError::new(T::NAME, "a value that can be written", e))
}

catalogue!(
    "builtin_interfaces" Time,
    "builtin_interfaces" Duration,
    "std_msgs" Header,
    "geometry_msgs" Vector3,
    "geometry_msgs" Point,
    "geometry_msgs" Quaternion,
    "geometry_msgs" Pose,
    "geometry_msgs" Twist,
    "geometry_msgs" Wrench,
    "geometry_msgs" PoseStamped,
    "geometry_msgs" TwistStamped,
    "geometry_msgs" WrenchStamped,
    "geometry_msgs" Transform,
    "geometry_msgs" TransformStamped,
    "tf2_msgs" TFMessage,
    "rosgraph_msgs" Clock,
    "sensor_msgs" PointField,
    "sensor_msgs" PointCloud2,
    "rcl_interfaces" Log,
    "foxglove_msgs" Color,
    "foxglove_msgs" KeyValuePair,
    "foxglove_msgs" ArrowPrimitive,
    "foxglove_msgs" CubePrimitive,
    "foxglove_msgs" SpherePrimitive,
    "foxglove_msgs" CylinderPrimitive,
    "foxglove_msgs" LinePrimitive,
    "foxglove_msgs" TriangleListPrimitive,
    "foxglove_msgs" TextPrimitive,
    "foxglove_msgs" ModelPrimitive,
    "foxglove_msgs" SceneEntity,
    "foxglove_msgs" SceneEntityDeletion,
    "foxglove_msgs" SceneUpdate,
    "ballast_msgs" MotionKnot,
    "ballast_msgs" BodyMotion,
    "ballast_msgs" WrenchKnot,
    "ballast_msgs" BodyLoad,
    "ballast_msgs" AdvanceRequest,
    "ballast_msgs" WrenchImpulse,
    "ballast_msgs" ZoneMeasurement,
    "ballast_msgs" SqueezeReport,
    "ballast_msgs" SolverStats,
    "ballast_msgs" SolverParameters,
    "ballast_msgs" EnergyLedger,
    "ballast_msgs" StateHash,
    "ballast_msgs" BodySeries,
    "ballast_msgs" StepSeries,
    "ballast_msgs" AdvanceReply,
    "ballast_msgs" WindowRecord,
);

/// Returns the definition of a type, named `package/Type` or `package/msg/Type`.
pub fn definition(name: &str) -> Option<&'static str> {
    let short = name.replacen("/msg/", "/", 1);
    DEFINITIONS.iter().find(|(known, _)| *known == short).map(|(_, text)| *text)
}

/// Returns the definitions of a type and of all types it contains, as recordings embed them (`ros2msg`).
pub fn schema<T: Message>() -> String {
    let short = T::NAME.replacen("/msg/", "/", 1);
    let mut text = definition(&short).unwrap_or_default().to_string();
    let mut visited = BTreeSet::from([short.clone()]);
    let mut open = field_types(&short);
    open.reverse();
    while let Some(name) = open.pop() {
        if !visited.insert(name.clone()) {
            continue;
        }
        text += &"=".repeat(80);
        text += &format!("\nMSG: {name}\n{}", definition(&name).unwrap_or_default());
        open.extend(field_types(&name).into_iter().rev());
    }
    text
}

/// Returns the message types of the fields of a type, in order.
fn field_types(name: &str) -> Vec<String> {
    let lines = definition(name).unwrap_or_default().lines();
    let types = lines.filter_map(|line| line.split_whitespace().next());
    let composite = types.filter(|t| t.contains('/') && !t.starts_with('#'));
    composite.map(|t| t.split('[').next().unwrap_or(t).to_string()).collect()
}
