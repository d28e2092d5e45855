//! Message with its topic and time, ready to be written, sent or compared.

use crate::messages::{Message, schema};
use crate::{MessageError, to_cdr};

/// Message with its topic and time.
#[derive(Debug, Clone)]
pub struct TopicMessage {
    /// Name of the topic.
    pub topic: String,
    /// Simulated time, ns.
    pub time_ns: u64,
    /// Name of the type, such as `geometry_msgs/msg/Pose`.
    pub kind: &'static str,
    /// Content in CDR.
    pub bytes: Vec<u8>,
    /// Definition of the type.
    pub schema: fn() -> String,
}

impl TopicMessage {
    /// Encodes a message.
    ///
    /// # Errors
    /// A message that CDR cannot represent.
    pub fn of<T: Message>(
        topic: impl Into<String>,
        time_ns: u64,
        message: &T,
    ) -> Result<Self, MessageError> {
        let bytes = to_cdr(message)?;
        Ok(Self { topic: topic.into(), time_ns, kind: T::NAME, bytes, schema: schema::<T> })
    }
}

/// Converts a name to a segment of a topic: letters, digits and `_`, as ROS 2 requires.
pub fn topic_part(name: &str) -> String {
    name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect()
}
