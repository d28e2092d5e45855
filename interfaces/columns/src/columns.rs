//! Model and state as named columns: the list that is hashed, written and documented.
//!
//! Reads: model, state. Writes: nothing. Cost: small, because large arrays are borrowed; the hash of a state is
//! computed after every window.
//! Contract: every field of [`Model`] and [`State`] is here, f64 bit for bit; memory of windows and driver is not
//! hashed. Variable lengths are stored as starts `[n + 1]` into flat arrays.

use ballast::geometry::Polyhedron;
use ballast::math::{Pose, Quat, Vec3};
use ballast::model::{
    Acceleration, DofMode, DrivenBody, Model, Mount, Part, PartitionRule, PenetrationCorrection,
    Solver,
};
use ballast::state::State;
use ballast::window_memory::{SQUEEZE_TRACK_VERSION, SqueezeTrack, Twist};
use std::borrow::Cow;

/// Named array `[rows]` or, where `width` is above 1, `[rows, width]`.
#[derive(Debug, Clone, PartialEq)]
pub struct Column<'a> {
    /// Path of the column in files.
    pub name: &'static str,
    /// Number of values per row.
    pub width: usize,
    /// Values, row by row.
    pub data: Data<'a>,
}

impl Column<'_> {
    /// Group of the column: the first segment of its name.
    pub fn group(&self) -> &'static str {
        self.name.split('/').next().unwrap_or_default()
    }
}

/// Values of a column.
#[derive(Debug, Clone, PartialEq)]
pub enum Data<'a> {
    /// Numbers.
    F64(Cow<'a, [f64]>),
    /// Rows of x, y, z.
    Vectors(&'a [Vec3]),
    /// Rows of w, x, y, z, the usual order in NumPy programs.
    Quaternions(&'a [Quat]),
    /// Times, counts and features.
    U64(Cow<'a, [u64]>),
    /// Numbers of bodies and shapes.
    U32(Cow<'a, [u32]>),
    /// Numbers of vertices and faces.
    U16(Vec<u16>),
    /// Kinds.
    U8(Vec<u8>),
    /// Texts.
    Text(Vec<String>),
}

/// Returns the components of a vector.
pub fn xyz(v: &Vec3) -> [f64; 3] {
    [v.x, v.y, v.z]
}

/// Returns the components of a quaternion, scalar first.
pub fn wxyz(q: &Quat) -> [f64; 4] {
    [q.w, q.i, q.j, q.k]
}

/// Numbers of the kinds of parts in files.
pub(crate) const CONVEX: u8 = 0;
pub(crate) const HALF_SPACE: u8 = 1;

/// Returns the hashed columns of a model and a state, in the order of the format.
pub fn of<'a>(model: &'a Model, state: &'a State) -> Vec<Column<'a>> {
    let mut columns = shapes(&model.shapes);
    columns.extend(bodies(model));
    columns.extend(constants(model));
    columns.extend(of_state(state));
    columns
}

fn f64s<'a>(name: &'static str, data: impl Into<Cow<'a, [f64]>>) -> Column<'a> {
    Column { name, width: 1, data: Data::F64(data.into()) }
}

fn u64s<'a>(name: &'static str, data: impl Into<Cow<'a, [u64]>>) -> Column<'a> {
    Column { name, width: 1, data: Data::U64(data.into()) }
}

fn u32s<'a>(name: &'static str, data: impl Into<Cow<'a, [u32]>>) -> Column<'a> {
    Column { name, width: 1, data: Data::U32(data.into()) }
}

fn text(name: &'static str, data: Vec<String>) -> Column<'static> {
    Column { name, width: 1, data: Data::Text(data) }
}

fn vectors<'a>(name: &'static str, data: &'a [Vec3]) -> Column<'a> {
    Column { name, width: 3, data: Data::Vectors(data) }
}

fn quaternions<'a>(name: &'static str, data: &'a [Quat]) -> Column<'a> {
    Column { name, width: 4, data: Data::Quaternions(data) }
}

/// Collects rows of numbers from items.
fn rows<const N: usize>(
    name: &'static str,
    rows: impl Iterator<Item = [f64; N]>,
) -> Column<'static> {
    Column { name, width: N, data: Data::F64(rows.flatten().collect()) }
}

fn starts<T>(name: &'static str, items: &[T], len: impl Fn(&T) -> usize) -> Column<'static> {
    let mut sum = 0;
    let rest = items.iter().map(|item| {
        sum += len(item) as u64;
        sum
    });
    u64s(name, std::iter::once(0).chain(rest).collect::<Vec<_>>())
}

fn shapes(shapes: &[Polyhedron]) -> Vec<Column<'static>> {
    let edges = shapes.iter().flat_map(|s| &s.edges);
    vec![
        starts("shapes/first_vertex", shapes, |s| s.vertices.len()),
        rows("shapes/vertices", shapes.iter().flat_map(|s| &s.vertices).map(xyz)),
        starts("shapes/first_face", shapes, |s| s.face_normals.len()),
        rows("shapes/face_normals", shapes.iter().flat_map(|s| &s.face_normals).map(xyz)),
        f64s(
            "shapes/face_offsets",
            shapes.iter().flat_map(|s| &s.face_offsets).copied().collect::<Vec<_>>(),
        ),
        u32s(
            "shapes/face_starts",
            shapes.iter().flat_map(|s| &s.face_starts).copied().collect::<Vec<_>>(),
        ),
        starts("shapes/first_face_vertex", shapes, |s| s.face_vertices.len()),
        Column {
            name: "shapes/face_vertices",
            width: 1,
            data: Data::U16(
                shapes.iter().flat_map(|s| &s.face_vertices).copied().collect::<Vec<_>>(),
            ),
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
        f64s("shapes/volume", shapes.iter().map(|s| s.volume).collect::<Vec<_>>()),
        rows("shapes/unit_inertia", shapes.iter().map(|s| xyz(&s.unit_inertia))),
        f64s("shapes/radius", shapes.iter().map(|s| s.radius).collect::<Vec<_>>()),
    ]
}

fn bodies(model: &Model) -> Vec<Column<'_>> {
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
        u32s("grains/shape", &model.grains.shape),
        f64s("grains/mass", &model.grains.mass),
        vectors("grains/inertia", &model.grains.inertia),
        text("driven/name", driven.iter().map(|d| d.name.clone()).collect()),
        text("driven/role", driven.iter().map(|d| d.role.name().into()).collect()),
        f64s("driven/friction", driven.iter().map(|d| d.friction).collect::<Vec<_>>()),
        // Only of the mounted bodies, which come first.
        Column { name: "driven/mount", width: MOUNT, data: Data::F64(mounts) },
        starts("driven/first_part", driven, |d| d.parts.len()),
        Column { name: "parts/kind", width: 1, data: Data::U8(parts().map(kind).collect()) },
        u32s("parts/shape", parts().map(shape).collect::<Vec<_>>()),
        Column {
            name: "parts/placement",
            width: 7,
            data: Data::F64(parts().flat_map(placement).collect()),
        },
    ]
}

/// Number of values of a mount.
pub(crate) const MOUNT: usize = 25;
/// Numbers of the modes of degrees of freedom.
pub(crate) const HELD: f64 = 0.0;
pub(crate) const LOADED: f64 = 1.0;
pub(crate) const SPRUNG: f64 = 2.0;

/// Returns mass, inertia x y z, centre x y z, then mode, stiffness and damping of each degree of freedom.
fn mount_row(mount: &Mount) -> [f64; MOUNT] {
    let (j, c) = (&mount.inertia, &mount.centre);
    let mut row = [0.0; MOUNT];
    row[..7].copy_from_slice(&[mount.mass, j.x, j.y, j.z, c.x, c.y, c.z]);
    for (freedom, place) in mount.dof_modes.iter().zip(row[7..].as_chunks_mut::<3>().0) {
        let mode = match freedom {
            DofMode::Prescribed => HELD,
            DofMode::Free => LOADED,
            DofMode::Spring { .. } => SPRUNG,
        };
        let [stiffness, damping] = freedom.spring();
        *place = [mode, stiffness, damping];
    }
    row
}

/// Returns position and orientation w x y z.
fn pose_row(pose: &Pose) -> [f64; 7] {
    let (p, q) = (&pose.position, &pose.orientation);
    [p.x, p.y, p.z, q.w, q.i, q.j, q.k]
}

/// Returns position and orientation w x y z of a convex part, or normal, offset and zeros of a half-space.
fn placement(part: &Part) -> [f64; 7] {
    match part {
        Part::Convex { pose, .. } => pose_row(pose),
        Part::HalfSpace { normal, offset } => [normal.x, normal.y, normal.z, *offset, 0., 0., 0.],
    }
}

/// Name of the column with the interval of force checks, only where it is not the default.
pub(crate) const FORCE_CHECK: &str = "solver/force_check_interval";
/// Name of an empty column, only in files of models that skip subdomains that have converged.
pub(crate) const SKIP: &str = "solver/skip_converged_subdomains";
/// Name of an empty column, only in files of models without acceleration.
pub(crate) const PLAIN: &str = "solver/plain";
/// Name of the column with stiffness, ratio and damping time of the contacts between grains, then of those with each
/// driven body; only in files of models whose contacts are not all rigid.
pub(crate) const STIFFNESS: &str = "model/contact_stiffness";
/// Name of the column with the energy of the contacts' springs at the start of the run and now, only where there is any.
pub(crate) const ELASTIC: &str = "state/elastic_energy";
/// Name of the column with the overlaps of the contacts' springs, m; only where there are any.
pub(crate) const OVERLAP: &str = "contacts/overlap";
/// Name of the column with factor and slop, only in files of models with penetration correction.
pub(crate) const RECOVERY: &str = "solver/recovery";

fn constants(model: &Model) -> Vec<Column<'_>> {
    let Solver {
        schedule,
        partition,
        max_iterations,
        subdomain_sweeps,
        interface_sweeps,
        tolerance,
        norm,
        convergence_check_interval,
        force_check_interval,
        relaxation,
        warm_start_factor,
        acceleration,
        skip_converged_subdomains,
        penetration_correction,
    } = model.solver;
    let (rule, numbers) = match partition {
        PartitionRule::Boxes(n) => ("boxes", n.to_vec()),
        PartitionRule::Balanced(n) => ("balanced", vec![n]),
        PartitionRule::ContactsPer(n) => ("contacts per", vec![n]),
    };
    let mut columns = vec![
        vectors("model/gravity", std::slice::from_ref(&model.gravity)),
        f64s("model/grain_friction", vec![model.grain_friction]),
        f64s("model/restitution", vec![model.restitution]),
        u64s("stepping/step_ns", vec![model.stepping.step_ns]),
        f64s("stepping/theta", vec![model.stepping.theta]),
        f64s("stepping/alert", vec![model.stepping.detection_distance]),
        text("solver/schedule", vec![schedule.name().into()]),
        text("solver/partition", vec![rule.into()]),
        u32s("solver/partition_numbers", numbers),
        u32s("solver/iterations", vec![max_iterations]),
        u32s("solver/subdomain_sweeps", vec![subdomain_sweeps]),
        u32s("solver/interface_sweeps", vec![interface_sweeps]),
        // Empty without a tolerance.
        f64s("solver/tolerance", tolerance.into_iter().collect::<Vec<_>>()),
        text("solver/norm", vec![norm.name().into()]),
        u32s("solver/check_every", vec![convergence_check_interval]),
        f64s("solver/relaxation", vec![relaxation]),
        f64s("solver/warm_start", vec![warm_start_factor]),
    ];
    if force_check_interval != Solver::default().force_check_interval {
        columns.push(u32s(FORCE_CHECK, vec![force_check_interval]));
    }
    if acceleration == Acceleration::None {
        columns.push(f64s(PLAIN, Vec::new()));
    }
    if skip_converged_subdomains {
        columns.push(f64s(SKIP, Vec::new()));
    }
    // Absent where all contacts are rigid.
    if !model.is_rigid() {
        let of_bodies = model.driven.iter().map(|d| &d.stiffness);
        let all = std::iter::once(&model.grain_stiffness).chain(of_bodies);
        columns.push(rows(STIFFNESS, all.map(|s| [s.normal, s.tangential_ratio, s.damping_time])));
    }
    // Absent without penetration correction.
    if let Some(PenetrationCorrection { factor, slop, iterations }) = penetration_correction {
        columns.push(f64s(RECOVERY, vec![factor, slop]));
        columns.push(u32s("solver/recovery_iterations", vec![iterations]));
    }
    columns
}

/// Returns the hashed columns of a state.
pub fn of_state(state: &State) -> Vec<Column<'_>> {
    let memory = &state.contacts;
    let energy = &state.energy;
    let mut columns = vec![
        u64s("state/step", vec![state.step]),
        u64s("state/time_ns", vec![state.time_ns]),
        vectors("state/position", &state.position),
        quaternions("state/orientation", &state.orientation),
        vectors("state/velocity", &state.velocity),
        vectors("state/angular_velocity", &state.angular_velocity),
        Column {
            name: "contacts/bodies",
            width: 2,
            data: Data::U32(memory.bodies.as_flattened().into()),
        },
        u64s("contacts/feature", &memory.feature),
        vectors("contacts/local_point", &memory.local_point),
        vectors("contacts/impulse", &memory.impulse),
        rows("state/mount", state.mount.iter().map(pose_row)),
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
    ];
    if memory.overlap.iter().any(|overlap| *overlap != 0.0) {
        columns.push(f64s(OVERLAP, memory.overlap.as_slice()));
    }
    let elastic = [energy.initial_elastic, energy.elastic];
    if elastic != [0.0; 2] {
        columns.push(f64s(ELASTIC, elastic.to_vec()));
    }
    columns
}

/// Returns 1 or 0 for a known or unknown twist, then velocity and angular velocity.
pub(crate) const TWIST: usize = 7;

/// Returns the columns of the window memory and of the driver state, which are written but not hashed.
pub fn of_memory(state: &State) -> Vec<Column<'_>> {
    let (window, driver) = (&state.window, &state.driver);
    let twist = |twist: &Option<Twist>| {
        let Twist { velocity: v, angular_velocity: w } = twist.unwrap_or_default();
        [f64::from(u8::from(twist.is_some())), v.x, v.y, v.z, w.x, w.y, w.z]
    };
    let reaction = |[impulse, angular]: &[Vec3; 2]| {
        [impulse.x, impulse.y, impulse.z, angular.x, angular.y, angular.z]
    };
    vec![
        rows("window/twists", window.twists.iter().map(twist)),
        rows("window/reactions", window.reactions.rows().map(reaction)),
        u32s("window/squeeze_version", vec![SQUEEZE_TRACK_VERSION]),
        f64s("window/squeezes", SqueezeTrack::encode(&window.squeezes)),
        text("driver/kind", vec![driver.kind.clone()]),
        u32s("driver/version", vec![driver.version]),
        f64s("driver/values", &driver.values),
    ]
}
