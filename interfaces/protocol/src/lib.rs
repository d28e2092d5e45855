//! Protocol of served components and recordings: messages, their encodings, and the rules of their exchange.
//!
//! [`lockstep`]: ownership, the sequence of windows, and repeated replies.
//! [`messages`]: message types, their ROS 2 definitions, and conversions from and to the core.
//! [`cdr`] and [`json`]: encodings. [`description`]: static description of a component.
//! [`motion_starts`]: where the next motions begin. [`pacer`] and [`real_time`]: real-time mode. [`topics`]: messages of recordings and live views.
//! [`visualization`]: states for viewers.
//! [`schema`]: JSON Schema of requests and replies. The crate does no I/O.

pub mod cdr;
pub mod description;
pub mod json;
pub mod lockstep;
pub mod messages;
pub mod motion_starts;
pub mod pacer;
pub mod real_time;
pub mod schema;
pub mod topics;
pub mod visualization;

mod message_error;
mod topic_message;

pub use cdr::{from_cdr, to_cdr};
pub use json::{from_json, from_json_named, to_json};
pub use message_error::MessageError;
pub use topic_message::{TopicMessage, topic_part};
