//! Pictures of a state for viewers: points, true polyhedra, and forces as arrows.

use crate::messages::{
    self, ArrowPrimitive, Color, Header, Point, PointCloud2, PointField, SceneEntity, SceneUpdate,
    Time, TriangleListPrimitive, WORLD,
};
use ballast::geometry::Polyhedron;
use ballast::math::{Pose, Quat, Vec3};
use ballast::model::{Model, Part, Role};
use ballast::state::State;

/// Most points of a cloud; of more grains every n-th is shown.
const MOST_POINTS: usize = 5000;
/// 32-bit float, in the words of `PointField`.
const FLOAT32: u8 = 7;
/// Columns of the cloud.
const COLUMNS: [&str; 5] = ["x", "y", "z", "speed", "grain"];

/// Length of an arrow: 10 kN are 0.2 m, and none is longer than a metre. Length of its head, m.
const METRES_PER_NEWTON: f64 = 2e-5;
const LONGEST_ARROW: f64 = 1.0;
const HEAD: f64 = 0.04;

const FORCE: Color = Color { r: 0.1, g: 0.45, b: 0.9, a: 1.0 };
const STONE: Color = Color { r: 0.62, g: 0.58, b: 0.52, a: 1.0 };
const SLEEPER: Color = Color { r: 0.75, g: 0.75, b: 0.72, a: 0.5 };
const TINE: Color = Color { r: 0.85, g: 0.35, b: 0.15, a: 1.0 };

/// Centres of the grains (m), their speed (m/s) and number, as 32-bit floats.
pub fn stones(model: &Model, state: &State) -> PointCloud2 {
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
    PointCloud2 {
        header: Header::world(state.time_ns),
        height: 1,
        width: (data.len() / step) as u32,
        fields: COLUMNS.iter().enumerate().map(field).collect(),
        is_bigendian: false,
        point_step: step as u32,
        row_step: data.len() as u32,
        data,
        is_dense: true,
    }
}

/// All grains, tines and sleepers as they are; `forces` of the ballast on the driven bodies, N `[nd]`, or none, are
/// arrows from the bodies' reference points.
pub fn scene(model: &Model, state: &State, forces: &[Vec3]) -> SceneUpdate {
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
        let mut entity = entity(&body.name, state.time_ns, mesh, color);
        entity.arrows.extend(forces.get(d).and_then(|f| arrow(&state.position[ng + d], f)));
        entities.push(entity);
    }
    SceneUpdate { deletions: Vec::new(), entities }
}

/// A force as an arrow, which points along the x axis of its pose; none where there is no force.
fn arrow(at: &Vec3, force: &Vec3) -> Option<ArrowPrimitive> {
    // A number that is none has no arrow either.
    if !(force.norm() > 0.0) {
        return None;
    }
    let length = (force.norm() * METRES_PER_NEWTON).min(LONGEST_ARROW);
    // Opposite to x there is no shortest way round.
    let turn = Quat::rotation_between(&Vec3::x(), force)
        .unwrap_or_else(|| Quat::from_axis_angle(&Vec3::z_axis(), std::f64::consts::PI));
    let head = HEAD.min(0.5 * length);
    Some(ArrowPrimitive {
        pose: messages::Pose { position: (*at).into(), orientation: turn.into() },
        shaft_length: length - head,
        shaft_diameter: 0.3 * HEAD,
        head_length: head,
        head_diameter: 0.6 * HEAD,
        color: FORCE,
    })
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrows_point_along_their_force() {
        for force in [Vec3::new(-5e3, 0.0, 0.0), Vec3::new(1.0, 2.0, 3e3), Vec3::new(1e9, 1e9, 0.0)]
        {
            let arrow = arrow(&Vec3::new(1.0, 2.0, 3.0), &force).expect("a force");
            let turn = Quat::try_from(arrow.pose.orientation).expect("a rotation");
            assert!((turn * Vec3::x() - force.normalize()).norm() < 1e-9, "{force:?}");
            let length = arrow.shaft_length + arrow.head_length;
            assert!((length - (2e-5 * force.norm()).min(1.0)).abs() < 1e-12);
        }
        assert!(arrow(&Vec3::zeros(), &Vec3::zeros()).is_none());
        assert!(arrow(&Vec3::zeros(), &Vec3::new(f64::NAN, 0.0, 0.0)).is_none());
    }
}
