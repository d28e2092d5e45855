//! The words of Ballast on every wire and in every recording: messages, and how they become bytes.
//!
//! [`lockstep`]: who may ask for what, in which order, and what is answered to a retry.
//! [`messages`]: the types, their ROS 2 definitions, and conversions from and to the core.
//! [`cdr`]: messages as CDR. [`json`]: messages as JSON. [`description`]: what a component says of itself.
//! [`pacer`]: time that runs by itself. [`pictures`]: states for viewers.
//! [`schema`]: the JSON Schema of all that is asked and answered. No I/O here.

pub mod cdr;
pub mod description;
pub mod json;
pub mod lockstep;
pub mod messages;
pub mod pacer;
pub mod pictures;
pub mod schema;

mod malformed;

pub use cdr::{from_cdr, to_cdr};
pub use json::{from_json, from_json_called, to_json};
pub use malformed::MessageError;
