//! A message with its topic and time, ready to be written or compared.

use ballast_protocol::messages::{Message, schema};
use ballast_protocol::{MessageError, to_cdr};

/// A message of a recording.
#[derive(Debug, Clone)]
pub struct Entry {
    pub topic: String,
    /// Simulated time, ns.
    pub time_ns: u64,
    /// Type, as `geometry_msgs/msg/Pose`.
    pub kind: &'static str,
    /// CDR.
    pub bytes: Vec<u8>,
    /// The definition that goes with the type.
    pub(crate) schema: fn() -> String,
}

impl Entry {
    /// The entry of a message.
    ///
    /// # Errors
    /// A message that cannot be written as CDR.
    pub fn of<T: Message>(
        topic: impl Into<String>,
        time_ns: u64,
        message: &T,
    ) -> Result<Self, MessageError> {
        let bytes = to_cdr(message)?;
        Ok(Self { topic: topic.into(), time_ns, kind: T::NAME, bytes, schema: schema::<T> })
    }
}

/// A name as part of a topic: letters, digits and `_`, all that ROS 2 allows.
pub(crate) fn topic_part(name: &str) -> String {
    name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect()
}
