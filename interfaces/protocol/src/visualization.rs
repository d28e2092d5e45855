//! Visualization of a state: points, polyhedra, and forces as arrows.

use crate::messages::{
    self, AdvanceReply, ArrowPrimitive, Color, Header, Point, PointCloud2, PointField, SceneEntity,
    SceneUpdate, Time, TriangleListPrimitive, WORLD,
};
use ballast::geometry::Polyhedron;
use ballast::math::{Pose, Quat, Vec3};
use ballast::model::{Model, Part, Role};
use ballast::state::State;

/// Maximum number of points of a cloud; with more grains, every n-th one is shown.
const MAX_POINTS: usize = 5000;
/// Data type of a 32-bit float in `PointField`.
const FLOAT32: u8 = 7;
/// Fields of the cloud.
const COLUMNS: [&str; 5] = ["x", "y", "z", "speed", "grain"];

/// Scale of force arrows: 10 kN are 0.2 m.
const METRES_PER_NEWTON: f64 = 2e-5;
/// Maximum length of a force arrow, m.
const MAX_ARROW_LENGTH: f64 = 1.0;
/// Length of an arrow head, m.
const ARROW_HEAD_LENGTH: f64 = 0.04;

const FORCE: Color = Color { r: 0.1, g: 0.45, b: 0.9, a: 1.0 };
const GRAIN: Color = Color { r: 0.62, g: 0.58, b: 0.52, a: 1.0 };
const SLEEPER: Color = Color { r: 0.75, g: 0.75, b: 0.72, a: 0.5 };
const TINE: Color = Color { r: 0.85, g: 0.35, b: 0.15, a: 1.0 };

/// Returns the centres of the grains (m), their speeds (m/s) and indices as a point cloud of 32-bit floats.
pub fn grain_cloud(model: &Model, state: &State) -> PointCloud2 {
    let every = model.grains.len().div_ceil(MAX_POINTS).max(1);
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

/// Returns the forces of the ballast on the driven bodies that scenes show: averages over 4 ms, N `[nd]`.
pub fn forces(reply: &AdvanceReply) -> Vec<Vec3> {
    reply.bodies.iter().map(|body| body.moving_average.force.into()).collect()
}

/// Returns polyhedra of all grains, tines and sleepers.
///
/// `forces` of the ballast on the driven bodies, N `[nd]` or empty, become arrows at the bodies' reference points.
pub fn scene(model: &Model, state: &State, forces: &[Vec3]) -> SceneUpdate {
    let mut grains = Mesh::default();
    for (i, shape) in model.grains.shape.iter().enumerate() {
        grains.add(&model.shapes[*shape as usize], &state.pose(i));
    }
    let mut scene = bodies(model, state, forces);
    scene.entities.insert(0, entity("grains", state.time_ns, grains, GRAIN));
    scene
}

/// Returns polyhedra of tines, sleepers and plates with their `forces` as in [`scene`]; viewers keep the grains that they have.
pub fn bodies(model: &Model, state: &State, forces: &[Vec3]) -> SceneUpdate {
    let ng = model.grains.len();
    let mut entities = Vec::new();
    for (d, body) in model.driven.iter().enumerate() {
        let color = match body.role {
            Role::Boundary => continue,
            Role::Sleeper | Role::Plate => SLEEPER,
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

/// Returns an arrow along the x axis of its pose, or `None` without a force.
fn arrow(at: &Vec3, force: &Vec3) -> Option<ArrowPrimitive> {
    // NaN has no arrow either.
    if !(force.norm() > 0.0) {
        return None;
    }
    let length = (force.norm() * METRES_PER_NEWTON).min(MAX_ARROW_LENGTH);
    // Opposite to x, the shortest rotation is not unique.
    let turn = Quat::rotation_between(&Vec3::x(), force)
        .unwrap_or_else(|| Quat::from_axis_angle(&Vec3::z_axis(), std::f64::consts::PI));
    let head = ARROW_HEAD_LENGTH.min(0.5 * length);
    Some(ArrowPrimitive {
        pose: messages::Pose { position: (*at).into(), orientation: turn.into() },
        shaft_length: length - head,
        shaft_diameter: 0.3 * ARROW_HEAD_LENGTH,
        head_length: head,
        head_diameter: 0.6 * ARROW_HEAD_LENGTH,
        color: FORCE,
    })
}

/// Triangle mesh in world coordinates.
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
