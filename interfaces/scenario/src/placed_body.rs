//! Bodies of a case with the keys that place them.

/// Sleeper, tine or plate with the paths of the keys that define its position.
pub struct PlacedBody<T> {
    pub plan: T,
    /// Path of its section.
    pub key: String,
    pub key_x: String,
    pub key_y: String,
}
