//! Scene messages for viewers: `foxglove_msgs/SceneUpdate` and its parts.
//!
//! The fields are those of the definitions in `msg`.

#![allow(missing_docs)]

use super::ros::{Duration, Point, Pose, Time, Vector3, message};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

message!(
    /// Update of a scene: deleted and added entities.
    SceneUpdate { deletions: Vec<SceneEntityDeletion>, entities: Vec<SceneEntity> });
message!(
    /// Deletion of entities: of the one named `id` if `type` is 0, of all if it is 1.
    SceneEntityDeletion { timestamp: Time, r#type: u8, id: String }
);
message!(
    /// Entity of a scene: a group of primitives in one frame.
    SceneEntity {
    timestamp: Time,
    frame_id: String,
    id: String,
    lifetime: Duration,
    frame_locked: bool,
    metadata: Vec<KeyValuePair>,
    arrows: Vec<ArrowPrimitive>,
    cubes: Vec<CubePrimitive>,
    spheres: Vec<SpherePrimitive>,
    cylinders: Vec<CylinderPrimitive>,
    lines: Vec<LinePrimitive>,
    triangles: Vec<TriangleListPrimitive>,
    texts: Vec<TextPrimitive>,
    models: Vec<ModelPrimitive>,
});
message!(
    /// Key with its value.
    KeyValuePair { key: String, value: String });
message!(
    /// Colour, with components from 0 to 1.
    #[derive(Copy)]
    Color { r: f64, g: f64, b: f64, a: f64 }
);
message!(
    /// Arrow along the x axis of its pose; lengths in m.
    ArrowPrimitive {
    pose: Pose,
    shaft_length: f64,
    shaft_diameter: f64,
    head_length: f64,
    head_diameter: f64,
    color: Color,
});
message!(
    /// Box with its size, m.
    CubePrimitive { pose: Pose, size: Vector3, color: Color });
message!(
    /// Ellipsoid with its size, m.
    SpherePrimitive { pose: Pose, size: Vector3, color: Color });
message!(
    /// Cylinder or truncated cone with its size, m.
    CylinderPrimitive {
    pose: Pose,
    size: Vector3,
    bottom_scale: f64,
    top_scale: f64,
    color: Color,
});
message!(
    /// Line strip, loop or list.
    LinePrimitive {
    r#type: u8,
    pose: Pose,
    thickness: f64,
    scale_invariant: bool,
    points: Vec<Point>,
    color: Color,
    colors: Vec<Color>,
    indices: Vec<u32>,
});
message!(
    /// Triangle mesh.
    TriangleListPrimitive {
    pose: Pose,
    points: Vec<Point>,
    color: Color,
    colors: Vec<Color>,
    indices: Vec<u32>,
});
message!(
    /// Text in the scene.
    TextPrimitive {
    pose: Pose,
    billboard: bool,
    font_size: f64,
    scale_invariant: bool,
    color: Color,
    text: String,
});
message!(
    /// Mesh from a file or from embedded data.
    ModelPrimitive {
    pose: Pose,
    scale: Vector3,
    color: Color,
    override_color: bool,
    url: String,
    media_type: String,
    data: Vec<u8>,
});
