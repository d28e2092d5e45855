//! Trait of all messages.

use serde::Serialize;
use serde::de::DeserializeOwned;

/// Message type with a ROS 2 definition.
pub trait Message: Serialize + DeserializeOwned {
    /// Full name: package, `msg` and type, such as `geometry_msgs/msg/Pose`.
    const NAME: &'static str;
}
