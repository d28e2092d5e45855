//! Pictures of a state for viewers: points, and true polyhedra.

use crate::entry::Entry;
use ballast::geometry::Polyhedron;
use ballast::math::Pose;
use ballast::model::{Model, Part, Role};
use ballast::state::State;
use ballast_protocol::Malformed;
use ballast_protocol::messages::{
    self, Color, Header, Point, PointCloud2, PointField, SceneEntity, SceneUpdate, Time,
    TriangleListPrimitive, WORLD,
};

/// Most points of a cloud; of more grains every n-th is shown.
const MOST_POINTS: usize = 5000;
/// 32-bit float, in the words of `PointField`.
const FLOAT32: u8 = 7;
/// Columns of the cloud.
const COLUMNS: [&str; 5] = ["x", "y", "z", "speed", "grain"];

const STONE: Color = Color { r: 0.62, g: 0.58, b: 0.52, a: 1.0 };
const SLEEPER: Color = Color { r: 0.75, g: 0.75, b: 0.72, a: 0.5 };
const TINE: Color = Color { r: 0.85, g: 0.35, b: 0.15, a: 1.0 };

/// Centres of the grains (m), their speed (m/s) and number, as 32-bit floats.
///
/// # Errors
/// None for a state of any sensible size.
pub fn stones(model: &Model, state: &State) -> Result<Entry, Malformed> {
    let every = model.grains.len().div_ceil(MOST_POINTS).max(1);
    let mut data = Vec::new();
    for i in (0..model.grains.len()).step_by(every) {
        let (p, v) = (state.position[i], state.velocity[i]);
        for value in [p.x, p.y, p.z, v.norm(), i as f64] {
            data.extend_from_slice(&(value as f32).to_le_bytes());
        }
    }
    let step = 4 * COLUMNS.len();
    let field = |(i, name): (usize, &&str)| PointField {
        name: name.to_string(),
        offset: 4 * i as u32,
        datatype: FLOAT32,
        count: 1,
    };
    let cloud = PointCloud2 {
        header: Header::world(state.time_ns),
        height: 1,
        width: (data.len() / step) as u32,
        fields: COLUMNS.iter().enumerate().map(field).collect(),
        is_bigendian: false,
        point_step: step as u32,
        row_step: data.len() as u32,
        data,
        is_dense: true,
    };
    Entry::of("/stones", state.time_ns, &cloud)
}

/// All grains, tines and sleepers as they are.
///
/// # Errors
/// None for a state of any sensible size.
pub fn scene(model: &Model, state: &State) -> Result<Entry, Malformed> {
    let ng = model.grains.len();
    let mut grains = Mesh::default();
    for (i, shape) in model.grains.shape.iter().enumerate() {
        grains.add(&model.shapes[*shape as usize], &state.pose(i));
    }
    let mut entities = vec![entity("stones", state.time_ns, grains, STONE)];
    for (d, body) in model.driven.iter().enumerate() {
        let color = match body.role {
            Role::Boundary => continue,
            Role::Sleeper => SLEEPER,
            Role::Tine => TINE,
        };
        let mut mesh = Mesh::default();
        for part in &body.parts {
            if let Part::Convex { shape, pose } = part {
                mesh.add(&model.shapes[*shape as usize], &state.pose(ng + d).then(pose));
            }
        }
        entities.push(entity(&body.name, state.time_ns, mesh, color));
    }
    let update = SceneUpdate { deletions: Vec::new(), entities };
    Entry::of("/scene", state.time_ns, &update)
}

/// Triangles in world coordinates.
#[derive(Default)]
struct Mesh {
    points: Vec<Point>,
    indices: Vec<u32>,
}

impl Mesh {
    /// Adds a polyhedron; each face becomes a fan of triangles.
    fn add(&mut self, shape: &Polyhedron, pose: &Pose) {
        let first = self.points.len() as u32;
        self.points.extend(shape.vertices.iter().map(|v| Point::from(pose.point(v))));
        for face in shape.face_starts.windows(2) {
            let corners = &shape.face_vertices[face[0] as usize..face[1] as usize];
            for pair in corners.windows(2).skip(1) {
                let triangle = [corners[0], pair[0], pair[1]];
                self.indices.extend(triangle.map(|corner| first + u32::from(corner)));
            }
        }
    }
}

fn entity(id: &str, time_ns: u64, mesh: Mesh, color: Color) -> SceneEntity {
    let Mesh { points, indices } = mesh;
    let pose = messages::Pose::default();
    let triangles = TriangleListPrimitive { pose, points, color, colors: Vec::new(), indices };
    SceneEntity {
        timestamp: Time::from_ns(time_ns),
        frame_id: WORLD.into(),
        id: id.into(),
        triangles: vec![triangles],
        ..SceneEntity::default()
    }
}
