//! Scene messages for viewers: `foxglove_msgs/SceneUpdate` and its parts.

use super::ros::{Duration, Point, Pose, Time, Vector3, message};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

message!(SceneUpdate { deletions: Vec<SceneEntityDeletion>, entities: Vec<SceneEntity> });
message!(
    /// Deletion of entities: of the one named `id` if `type` is 0, of all if it is 1.
    SceneEntityDeletion { timestamp: Time, r#type: u8, id: String }
);
message!(SceneEntity {
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
message!(KeyValuePair { key: String, value: String });
message!(
    /// Colour, with components from 0 to 1.
    #[derive(Copy)]
    Color { r: f64, g: f64, b: f64, a: f64 }
);
message!(ArrowPrimitive {
    pose: Pose,
    shaft_length: f64,
    shaft_diameter: f64,
    head_length: f64,
    head_diameter: f64,
    color: Color,
});
message!(CubePrimitive { pose: Pose, size: Vector3, color: Color });
message!(SpherePrimitive { pose: Pose, size: Vector3, color: Color });
message!(CylinderPrimitive {
    pose: Pose,
    size: Vector3,
    bottom_scale: f64,
    top_scale: f64,
    color: Color,
});
message!(LinePrimitive {
    r#type: u8,
    pose: Pose,
    thickness: f64,
    scale_invariant: bool,
    points: Vec<Point>,
    color: Color,
    colors: Vec<Color>,
    indices: Vec<u32>,
});
message!(TriangleListPrimitive {
    pose: Pose,
    points: Vec<Point>,
    color: Color,
    colors: Vec<Color>,
    indices: Vec<u32>,
});
message!(TextPrimitive {
    pose: Pose,
    billboard: bool,
    font_size: f64,
    scale_invariant: bool,
    color: Color,
    text: String,
});
message!(ModelPrimitive {
    pose: Pose,
    scale: Vector3,
    color: Color,
    override_color: bool,
    url: String,
    media_type: String,
    data: Vec<u8>,
});
