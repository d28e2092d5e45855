//! A small scene that uses every field of model and state.

use ballast::geometry::{Edge, Polyhedron};
use ballast::math::{Pose, Quat, Vec3};
use ballast::model::*;
use ballast::state::*;
use ballast_hdf5::checkpoint::{Checkpoint, Kind};

/// A box with these half sizes, m.
pub fn cuboid(half: Vec3) -> Polyhedron {
    let corner = |i: usize| {
        let sign = |bit: usize| if i >> bit & 1 == 1 { 1.0 } else { -1.0 };
        Vec3::new(sign(0) * half.x, sign(1) * half.y, sign(2) * half.z)
    };
    // Faces -x +x -y +y -z +z, counter-clockwise from outside; corner bits are x, y, z.
    let faces: [[u16; 4]; 6] =
        [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let mut face_normals = vec![];
    for axis in 0..3 {
        for sign in [-1.0, 1.0] {
            let mut normal = Vec3::zeros();
            normal[axis] = sign;
            face_normals.push(normal);
        }
    }
    let s = half.component_mul(&half) * (4.0 / 3.0);
    let volume = 8.0 * half.x * half.y * half.z;
    Polyhedron {
        vertices: (0..8).map(corner).collect(),
        face_normals,
        face_offsets: vec![half.x, half.x, half.y, half.y, half.z, half.z],
        face_starts: (0..=6).map(|f| 4 * f).collect(),
        face_vertices: faces.as_flattened().to_vec(),
        edges: edges(&faces),
        volume,
        unit_inertia: Vec3::new(s.y + s.z, s.x + s.z, s.x + s.y) * (volume / 4.0),
        radius: half.norm(),
    }
}

fn edges(faces: &[[u16; 4]]) -> Vec<Edge> {
    let runs =
        |f: usize, a: u16, b: u16| (0..4).any(|k| faces[f][k] == a && faces[f][(k + 1) % 4] == b);
    let face = |a, b| (0..faces.len()).find(|&f| runs(f, a, b)).unwrap() as u16;
    let mut edges = vec![];
    for a in 0..8_u16 {
        for b in [a ^ 1, a ^ 2, a ^ 4] {
            if a < b {
                edges.push(Edge { vertices: [a, b], faces: [face(a, b), face(b, a)] });
            }
        }
    }
    edges.sort_by_key(|e| e.vertices);
    edges
}

fn turn(x: f64, y: f64, z: f64) -> Quat {
    Quat::from_scaled_axis(Vec3::new(x, y, z))
}

pub fn model() -> Model {
    let shapes = vec![
        cuboid(Vec3::new(0.02, 0.015, 0.01)),
        cuboid(Vec3::new(0.012, 0.014, 0.016)),
        cuboid(Vec3::new(0.12, 0.08, 0.05)),
        cuboid(Vec3::new(0.01, 0.03, 0.06)),
    ];
    let mut grains = Grains::default();
    for g in 0..27 {
        grains.push(g % 2, &shapes[g as usize % 2], 2700.0);
    }
    let part =
        |shape, position, orientation| Part::Convex { shape, pose: Pose { position, orientation } };
    let driven =
        |name: &str, role, friction, parts| DrivenBody { name: name.into(), role, friction, parts };
    let driven = vec![
        driven(
            "floor",
            Role::Boundary,
            1.0,
            vec![Part::HalfSpace { normal: Vec3::z(), offset: -0.02 }],
        ),
        driven(
            "wall",
            Role::Boundary,
            0.0,
            vec![Part::HalfSpace { normal: Vec3::x(), offset: -0.05 }],
        ),
        driven(
            "sleeper 1",
            Role::Sleeper,
            0.7,
            vec![
                part(2, Vec3::new(0.0, -0.2, 0.0), Quat::identity()),
                part(2, Vec3::new(0.0, 0.2, 0.0), turn(0.0, 0.0, 0.3)),
            ],
        ),
        driven("tine Ä/1", Role::Tine, 0.2, vec![part(3, Vec3::zeros(), turn(0.1, 0.2, 0.3))]),
    ];
    Model {
        shapes,
        grains,
        driven,
        gravity: Vec3::new(0.0, -0.0, -9.81),
        grain_friction: 0.8,
        restitution: 0.1,
        stepping: Stepping { step_ns: 100_000, theta: 0.5, alert: 1e-3 },
        solver: Solver { partition: PartitionRule::Boxes([3, 2, 1]), ..Solver::default() },
    }
}

/// Values that a careless text or f32 round trip would change.
pub fn state(model: &Model) -> State {
    let mut state = State { step: 12_345, time_ns: u64::MAX / 3, ..State::default() };
    for g in 0..model.grains.len() {
        let k = g as f64;
        let at = |n: usize| 0.05 * n as f64;
        let position = Vec3::new(at(g % 3), at(g / 3 % 3) + 0.1 * 0.2, at(g / 9) + k * 1e-17);
        state.push(Pose { position, orientation: turn(0.3 * k, 0.1 - k, 0.7) });
        state.velocity[g] = Vec3::new(0.1 + 0.2, -0.0, 5e-324 * k);
        state.spin[g] = Vec3::new(1.0 / 3.0, f64::MIN_POSITIVE / 7.0, 1e300);
    }
    for position in
        [Vec3::zeros(), Vec3::zeros(), Vec3::new(0.05, 0.05, 0.3), Vec3::new(0.2, 0.05, 0.2)]
    {
        state.push(Pose::at(position));
    }
    for (c, a) in [(0, 1), (0, 1), (0, 27), (3, 29), (25, 26)] {
        let memory = &mut state.contacts;
        memory.feature.push(u64::MAX - memory.bodies.len() as u64);
        memory.bodies.push([c, a]);
        memory.local_point.push(Vec3::new(0.01, -0.02, 1.0 / 3.0));
        memory.impulse.push(Vec3::new(-0.0, 1e-9, 2.0 / 7.0));
    }
    state.drive = vec![0.25, -0.0, 1e-310];
    state.energy.work_in = 0.1 + 0.7;
    state.energy.dissipated = 3.3;
    state
}

pub fn checkpoint() -> Checkpoint {
    let model = model();
    Checkpoint {
        state: state(&model),
        model,
        kind: Kind::Run,
        case_name: "Stück".into(),
        case_text: "name = \"Stück\"\n".into(),
        key: "abc".into(),
        extra: [("git".to_string(), "1".to_string()), ("empty".into(), String::new())].into(),
    }
}
