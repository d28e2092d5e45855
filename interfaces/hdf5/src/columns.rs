//! Model and state as named columns: the one list that is hashed, written and documented.
//!
//! Reads: model, state. Writes: nothing. Cost: one copy of everything.
//! Contract: every field of [`Model`] and [`State`] is here, f64 bit for bit; variable lengths are
//! stored as starts `[n + 1]` into flat arrays.

use ballast::geometry::Polyhedron;
use ballast::math::{Pose, Quat, Vec3};
use ballast::model::{
    DrivenBody, Freedom, Model, Mount, Norm, Part, PartitionRule, Recovery, Role, Schedule, Solver,
};
use ballast::state::State;

/// A named array `[rows]` or, where `width` is above 1, `[rows, width]`.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Column {
    pub name: &'static str,
    pub width: usize,
    pub data: Data,
}

impl Column {
    /// What the column belongs to: the first part of its name.
    pub fn group(&self) -> &'static str {
        self.name.split('/').next().unwrap_or_default()
    }
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Data {
    F64(Vec<f64>),
    U64(Vec<u64>),
    U32(Vec<u32>),
    U16(Vec<u16>),
    U8(Vec<u8>),
    Text(Vec<String>),
}

/// Names of the schedules, in files.
pub(crate) const SCHEDULES: [(Schedule, &str); 3] = [
    (Schedule::Sequential, "sequential"),
    (Schedule::Synchronous, "synchronous"),
    (Schedule::Asynchronous, "asynchronous"),
];
/// Names of the norms, in files.
pub(crate) const NORMS: [(Norm, &str); 3] =
    [(Norm::Qm16, "qm16"), (Norm::Quad, "quad"), (Norm::NaturalMap, "natural map")];
/// Names of the roles, in files.
pub(crate) const ROLES: [(Role, &str); 3] =
    [(Role::Boundary, "boundary"), (Role::Sleeper, "sleeper"), (Role::Tine, "tine")];

/// Kinds of parts, in files.
pub(crate) const CONVEX: u8 = 0;
pub(crate) const HALF_SPACE: u8 = 1;

pub(crate) fn name_of<T: PartialEq + Copy>(table: &[(T, &'static str)], value: T) -> &'static str {
    table.iter().find(|(v, _)| *v == value).map_or("unknown", |(_, n)| n)
}

/// All columns of a model and a state, in the order of the format.
pub(crate) fn of(model: &Model, state: &State) -> Vec<Column> {
    let mut columns = shapes(&model.shapes);
    columns.extend(bodies(model));
    columns.extend(constants(model));
    columns.extend(of_state(state));
    columns
}

fn f64s(name: &'static str, data: Vec<f64>) -> Column {
    Column { name, width: 1, data: Data::F64(data) }
}

fn u64s(name: &'static str, data: Vec<u64>) -> Column {
    Column { name, width: 1, data: Data::U64(data) }
}

fn u32s(name: &'static str, data: Vec<u32>) -> Column {
    Column { name, width: 1, data: Data::U32(data) }
}

fn text(name: &'static str, data: Vec<String>) -> Column {
    Column { name, width: 1, data: Data::Text(data) }
}

fn vectors<'a>(name: &'static str, data: impl IntoIterator<Item = &'a Vec3>) -> Column {
    let data = data.into_iter().flat_map(|v| [v.x, v.y, v.z]).collect();
    Column { name, width: 3, data: Data::F64(data) }
}

/// Components w, x, y, z: as people and numpy programs write them.
fn quaternions(name: &'static str, data: &[Quat]) -> Column {
    let data = data.iter().flat_map(|q| [q.w, q.i, q.j, q.k]).collect();
    Column { name, width: 4, data: Data::F64(data) }
}

fn starts<T>(name: &'static str, items: &[T], len: impl Fn(&T) -> usize) -> Column {
    let mut sum = 0;
    let rest = items.iter().map(|item| {
        sum += len(item) as u64;
        sum
    });
    u64s(name, std::iter::once(0).chain(rest).collect())
}

fn shapes(shapes: &[Polyhedron]) -> Vec<Column> {
    let edges = shapes.iter().flat_map(|s| &s.edges);
    vec![
        starts("shapes/first_vertex", shapes, |s| s.vertices.len()),
        vectors("shapes/vertices", shapes.iter().flat_map(|s| &s.vertices)),
        starts("shapes/first_face", shapes, |s| s.face_normals.len()),
        vectors("shapes/face_normals", shapes.iter().flat_map(|s| &s.face_normals)),
        f64s("shapes/face_offsets", shapes.iter().flat_map(|s| &s.face_offsets).copied().collect()),
        u32s("shapes/face_starts", shapes.iter().flat_map(|s| &s.face_starts).copied().collect()),
        starts("shapes/first_face_vertex", shapes, |s| s.face_vertices.len()),
        Column {
            name: "shapes/face_vertices",
            width: 1,
            data: Data::U16(shapes.iter().flat_map(|s| &s.face_vertices).copied().collect()),
        },
        starts("shapes/first_edge", shapes, |s| s.edges.len()),
        Column {
            name: "shapes/edges",
            width: 4,
            data: Data::U16(
                edges
                    .flat_map(|e| [e.vertices[0], e.vertices[1], e.faces[0], e.faces[1]])
                    .collect(),
            ),
        },
        f64s("shapes/volume", shapes.iter().map(|s| s.volume).collect()),
        vectors("shapes/unit_inertia", shapes.iter().map(|s| &s.unit_inertia)),
        f64s("shapes/radius", shapes.iter().map(|s| s.radius).collect()),
    ]
}

fn bodies(model: &Model) -> Vec<Column> {
    let driven: &[DrivenBody] = &model.driven;
    let parts = || driven.iter().flat_map(|d| &d.parts);
    let mounts = driven.iter().map_while(|d| d.mount);
    let mounts = mounts.flat_map(|m| mount_row(&m)).collect();
    let kind = |p: &Part| match p {
        Part::Convex { .. } => CONVEX,
        Part::HalfSpace { .. } => HALF_SPACE,
    };
    let shape = |p: &Part| match p {
        Part::Convex { shape, .. } => *shape,
        Part::HalfSpace { .. } => 0,
    };
    vec![
        u32s("grains/shape", model.grains.shape.clone()),
        f64s("grains/mass", model.grains.mass.clone()),
        vectors("grains/inertia", &model.grains.inertia),
        text("driven/name", driven.iter().map(|d| d.name.clone()).collect()),
        text("driven/role", driven.iter().map(|d| name_of(&ROLES, d.role).into()).collect()),
        f64s("driven/friction", driven.iter().map(|d| d.friction).collect()),
        // Of the mounted bodies alone, which come first.
        Column { name: "driven/mount", width: MOUNT, data: Data::F64(mounts) },
        starts("driven/first_part", driven, |d| d.parts.len()),
        Column { name: "parts/kind", width: 1, data: Data::U8(parts().map(kind).collect()) },
        u32s("parts/shape", parts().map(shape).collect()),
        Column {
            name: "parts/placement",
            width: 7,
            data: Data::F64(parts().flat_map(placement).collect()),
        },
    ]
}

/// Numbers of a mount.
pub(crate) const MOUNT: usize = 25;
/// Modes of degrees of freedom, as numbers.
pub(crate) const HELD: f64 = 0.0;
pub(crate) const LOADED: f64 = 1.0;
pub(crate) const SPRUNG: f64 = 2.0;

/// Mass, inertia x y z, centre x y z, then mode, stiffness and damping of each degree of freedom.
fn mount_row(mount: &Mount) -> [f64; MOUNT] {
    let (j, c) = (&mount.inertia, &mount.centre);
    let mut row = [0.0; MOUNT];
    row[..7].copy_from_slice(&[mount.mass, j.x, j.y, j.z, c.x, c.y, c.z]);
    for (freedom, place) in mount.freedoms.iter().zip(row[7..].as_chunks_mut::<3>().0) {
        let mode = match freedom {
            Freedom::Held => HELD,
            Freedom::Loaded => LOADED,
            Freedom::Sprung { .. } => SPRUNG,
        };
        let [stiffness, damping] = freedom.spring();
        *place = [mode, stiffness, damping];
    }
    row
}

/// Position, orientation w x y z.
fn pose_row(pose: &Pose) -> [f64; 7] {
    let (p, q) = (&pose.position, &pose.orientation);
    [p.x, p.y, p.z, q.w, q.i, q.j, q.k]
}

/// Convex part: position, orientation w x y z. Half-space: normal, offset, zeros.
fn placement(part: &Part) -> [f64; 7] {
    match part {
        Part::Convex { pose, .. } => pose_row(pose),
        Part::HalfSpace { normal, offset } => [normal.x, normal.y, normal.z, *offset, 0., 0., 0.],
    }
}

/// Share and allowed penetration; only in files of models with recovery.
pub const RECOVERY: &str = "solver/recovery";

fn constants(model: &Model) -> Vec<Column> {
    let Solver {
        schedule,
        partition,
        iterations,
        subdomain_sweeps,
        interface_sweeps,
        tolerance,
        norm,
        check_every,
        relaxation,
        warm_start,
        recovery,
    } = model.solver;
    let (rule, numbers) = match partition {
        PartitionRule::Boxes(n) => ("boxes", n.to_vec()),
        PartitionRule::Balanced(n) => ("balanced", vec![n]),
        PartitionRule::ContactsPer(n) => ("contacts per", vec![n]),
    };
    let mut columns = vec![
        vectors("model/gravity", [&model.gravity]),
        f64s("model/grain_friction", vec![model.grain_friction]),
        f64s("model/restitution", vec![model.restitution]),
        u64s("stepping/step_ns", vec![model.stepping.step_ns]),
        f64s("stepping/theta", vec![model.stepping.theta]),
        f64s("stepping/alert", vec![model.stepping.alert]),
        text("solver/schedule", vec![name_of(&SCHEDULES, schedule).into()]),
        text("solver/partition", vec![rule.into()]),
        u32s("solver/partition_numbers", numbers),
        u32s("solver/iterations", vec![iterations]),
        u32s("solver/subdomain_sweeps", vec![subdomain_sweeps]),
        u32s("solver/interface_sweeps", vec![interface_sweeps]),
        // Empty: no tolerance.
        f64s("solver/tolerance", tolerance.into_iter().collect()),
        text("solver/norm", vec![name_of(&NORMS, norm).into()]),
        u32s("solver/check_every", vec![check_every]),
        f64s("solver/relaxation", vec![relaxation]),
        f64s("solver/warm_start", vec![warm_start]),
    ];
    // Not there: no recovery, as in files of before there was any.
    if let Some(Recovery { share, allowed, iterations }) = recovery {
        columns.push(f64s(RECOVERY, vec![share, allowed]));
        columns.push(u32s("solver/recovery_iterations", vec![iterations]));
    }
    columns
}

fn of_state(state: &State) -> Vec<Column> {
    let memory = &state.contacts;
    let energy = &state.energy;
    vec![
        u64s("state/step", vec![state.step]),
        u64s("state/time_ns", vec![state.time_ns]),
        vectors("state/position", &state.position),
        quaternions("state/orientation", &state.orientation),
        vectors("state/velocity", &state.velocity),
        vectors("state/spin", &state.spin),
        Column {
            name: "contacts/bodies",
            width: 2,
            data: Data::U32(memory.bodies.as_flattened().to_vec()),
        },
        u64s("contacts/feature", memory.feature.clone()),
        vectors("contacts/local_point", &memory.local_point),
        vectors("contacts/impulse", &memory.impulse),
        Column {
            name: "state/mount",
            width: 7,
            data: Data::F64(state.mount.iter().flat_map(pose_row).collect()),
        },
        f64s("state/drive", state.drive.clone()),
        f64s(
            "state/energy",
            vec![
                energy.initial_kinetic,
                energy.initial_potential,
                energy.kinetic,
                energy.potential,
                energy.work_in,
                energy.dissipated,
            ],
        ),
    ]
}
