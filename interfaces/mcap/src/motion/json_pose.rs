//! Poses in JSON, in their usual forms.

use super::values::LEAVE_OUT;
use ballast_protocol::MessageError;
use ballast_protocol::messages::{Point, Pose, Quaternion, Twist, Vector3};
use serde_json::Value;

/// Pose, twist, time and frame of a JSON message.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct JsonPose {
    pub pose: Pose,
    pub twist: Option<Twist>,
    /// Time of the pose, ns; `None` if the message has none.
    pub stamp_ns: Option<i64>,
    /// Name of the frame; empty if the message has none.
    pub frame: String,
}

/// Parses `{pose: {position: {x, y, z}, orientation: {x, y, z, w}}}`, or the content of `pose` alone.
///
/// Optional keys are `twist: {linear, angular}`, the time as `time_ns`, `header.stamp` or `timestamp`
/// (`sec` and `nanosec` or `nsec`), and the frame as `header.frame_id` or `frame_id`. The twist of an odometry message,
/// `twist.twist`, is not read, because it is in the axes of the moving frame.
pub(super) fn read(text: &[u8]) -> Result<JsonPose, MessageError> {
    let value: Value = serde_json::from_slice(text).map_err(|e| {
        let found = match text.windows(3).any(|word| word == b"NaN") {
            true => "NaN, which JSON does not have".into(),
            false => format!("another text ({e})"),
        };
        MessageError::new("message", "JSON", format!("{found}; {LEAVE_OUT}"))
    })?;
    let pose = value.get("pose").unwrap_or(&value);
    let pose = pose.get("pose").unwrap_or(pose);
    let [x, y, z] = triple(pose, "position")?;
    let turn = "orientation";
    let quaternion = Quaternion {
        x: number(pose, turn, "x")?,
        y: number(pose, turn, "y")?,
        z: number(pose, turn, "z")?,
        w: number(pose, turn, "w")?,
    };
    let twist = match value.get("twist").filter(|twist| twist.get("twist").is_none()) {
        Some(twist) => {
            let vector = |[x, y, z]: [f64; 3]| Vector3 { x, y, z };
            let (linear, angular) = (triple(twist, "linear")?, triple(twist, "angular")?);
            Some(Twist { linear: vector(linear), angular: vector(angular) })
        }
        None => None,
    };
    let pose = Pose { position: Point { x, y, z }, orientation: quaternion };
    let frame = value.pointer("/header/frame_id").or_else(|| value.get("frame_id"));
    let frame = frame.and_then(Value::as_str).unwrap_or_default().to_string();
    Ok(JsonPose { pose, twist, stamp_ns: stamp(&value)?, frame })
}

fn triple(value: &Value, field: &str) -> Result<[f64; 3], MessageError> {
    Ok([number(value, field, "x")?, number(value, field, "y")?, number(value, field, "z")?])
}

fn number(value: &Value, field: &str, axis: &str) -> Result<f64, MessageError> {
    let found = value.get(field).and_then(|v| v.get(axis));
    found.and_then(Value::as_f64).ok_or_else(|| {
        let found = found.map_or("nothing".into(), Value::to_string);
        MessageError::new(format!("{field}.{axis}"), "a number", format!("{found}; {LEAVE_OUT}"))
    })
}

fn stamp(value: &Value) -> Result<Option<i64>, MessageError> {
    if let Some(time) = value.get("time_ns") {
        let wrong = || MessageError::new("time_ns", "a whole number", time);
        return time.as_i64().map(Some).ok_or_else(wrong);
    }
    let Some(stamp) = value.pointer("/header/stamp").or_else(|| value.get("timestamp")) else {
        return Ok(None);
    };
    let rest = stamp.get("nanosec").or_else(|| stamp.get("nsec"));
    let whole = stamp.get("sec").and_then(Value::as_i64).zip(rest.and_then(Value::as_i64));
    let whole = whole.filter(|(_, rest)| (0..1_000_000_000).contains(rest));
    let ns = whole.and_then(|(sec, rest)| sec.checked_mul(1_000_000_000)?.checked_add(rest));
    let wrong =
        || MessageError::new("stamp", "whole `sec` and `nanosec`, the latter below 10⁹", stamp);
    ns.map(Some).ok_or_else(wrong)
}
