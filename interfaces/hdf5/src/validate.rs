//! Whether a model and a state make sense: before they are written, and after they were read.
//!
//! Reads: model, state. Cost: O(everything). Contract: what passes can be stepped without an index
//! out of range, a division by zero or a number that is not finite.

use crate::error::Fault;
use ballast::geometry::Polyhedron;
use ballast::math::{Quat, Vec3};
use ballast::model::{Model, Part, PartitionRule};
use ballast::state::State;

type Check = Result<(), Fault>;

/// Rounding leaves unit vectors within a few 1e-16 of length 1; a damaged one is far off.
const UNIT: f64 = 1e-9;

pub(crate) fn check(model: &Model, state: &State) -> Check {
    for (s, shape) in model.shapes.iter().enumerate() {
        polyhedron(shape)
            .map_err(|f| Fault { place: format!("shapes/{} of shape {s}", f.place), ..f })?;
    }
    grains(model)?;
    driven(model)?;
    constants(model)?;
    lengths(model, state)?;
    motion(state)?;
    contacts(model, state)?;
    all("state/drive", &state.drive, "finite", |v| v.is_finite())?;
    let e = &state.energy;
    let energy =
        [e.initial_kinetic, e.initial_potential, e.kinetic, e.potential, e.work_in, e.dissipated];
    all("state/energy", &energy, "finite", |v| v.is_finite())
}

fn all<T: std::fmt::Debug>(
    place: &str,
    values: &[T],
    expected: &str,
    good: impl Fn(&T) -> bool,
) -> Check {
    match values.iter().position(|v| !good(v)) {
        None => Ok(()),
        Some(i) => Err(Fault::new(place, expected, format!("{:?} in row {i}", values[i]))),
    }
}

fn require(good: bool, place: &str, expected: impl Into<String>, found: impl ToString) -> Check {
    if good { Ok(()) } else { Err(Fault::new(place, expected, found)) }
}

fn finite(v: &Vec3) -> bool {
    v.iter().all(|x| x.is_finite())
}

fn unit(v: &Vec3) -> bool {
    (v.norm_squared() - 1.0).abs() < UNIT
}

fn rotation(q: &Quat) -> bool {
    (q.coords.norm_squared() - 1.0).abs() < UNIT
}

fn positive(x: &f64) -> bool {
    x.is_finite() && *x > 0.0
}

fn not_negative(x: &f64) -> bool {
    x.is_finite() && *x >= 0.0
}

fn polyhedron(shape: &Polyhedron) -> Check {
    let (nv, nf) = (shape.vertices.len(), shape.face_normals.len());
    require(nv >= 4, "vertices", "4 or more", nv)?;
    require(nf >= 4, "face_normals", "4 or more", nf)?;
    all("vertices", &shape.vertices, "finite", finite)?;
    all("face_normals", &shape.face_normals, "unit vectors", unit)?;
    require(
        shape.face_offsets.len() == nf,
        "face_offsets",
        format!("{nf} rows"),
        shape.face_offsets.len(),
    )?;
    all("face_offsets", &shape.face_offsets, "above zero", positive)?;
    require(
        shape.face_starts.len() == nf + 1,
        "face_starts",
        format!("{} rows", nf + 1),
        shape.face_starts.len(),
    )?;
    let ends = (shape.face_starts[0], shape.face_starts[nf] as usize);
    let expected = (0, shape.face_vertices.len());
    require(
        ends == expected,
        "face_starts",
        format!("from, to {expected:?}"),
        format!("{ends:?}"),
    )?;
    let corners: Vec<_> = shape.face_starts.windows(2).map(|w| (w[0], w[1])).collect();
    all("face_starts", &corners, "3 or more corners to a face", |(a, b)| {
        *b >= a.saturating_add(3)
    })?;
    all("face_vertices", &shape.face_vertices, &format!("below {nv}"), |v| (*v as usize) < nv)?;
    require(!shape.edges.is_empty(), "edges", "some", "none")?;
    let expected = format!("two rising vertices below {nv}, two faces below {nf}");
    all("edges", &shape.edges, &expected, |e| {
        e.vertices[0] < e.vertices[1]
            && (e.vertices[1] as usize) < nv
            && e.faces[0] != e.faces[1]
            && e.faces.iter().all(|f| (*f as usize) < nf)
    })?;
    all("volume", &[shape.volume], "above zero", positive)?;
    all("unit_inertia", shape.unit_inertia.as_slice(), "above zero", positive)?;
    let farthest = shape.vertices.iter().map(|v| v.norm()).fold(0.0, f64::max);
    all("radius", &[shape.radius], &format!("{farthest}, where the farthest vertex is"), |r| {
        (r - farthest).abs() <= 1e-9 * farthest
    })
}

fn grains(model: &Model) -> Check {
    let (ns, ng) = (model.shapes.len(), model.grains.len());
    all("grains/shape", &model.grains.shape, &format!("below {ns}"), |s| (*s as usize) < ns)?;
    let (masses, inertias) = (model.grains.mass.len(), model.grains.inertia.len());
    require(masses == ng, "grains/mass", format!("{ng} rows"), masses)?;
    require(inertias == ng, "grains/inertia", format!("{ng} rows"), inertias)?;
    all("grains/mass", &model.grains.mass, "above zero", positive)?;
    all("grains/inertia", &model.grains.inertia, "above zero", |i| i.iter().all(positive))
}

fn driven(model: &Model) -> Check {
    let ns = model.shapes.len();
    for (d, body) in model.driven.iter().enumerate() {
        let place = format!("driven body {d} ({:?})", body.name);
        let twin = model.driven[..d].iter().any(|other| other.name == body.name);
        require(!twin, &place, "a name of its own", "a second one")?;
        all(&place, &[body.friction], "friction, 0 or above", not_negative)?;
        all(&place, &body.parts, "parts of known shape and finite, unit placement", |part| {
            match part {
                Part::Convex { shape, pose } => {
                    (*shape as usize) < ns && pose.is_finite() && rotation(&pose.orientation)
                }
                Part::HalfSpace { normal, offset } => unit(normal) && offset.is_finite(),
            }
        })?;
    }
    Ok(())
}

fn constants(model: &Model) -> Check {
    let (stepping, solver) = (&model.stepping, &model.solver);
    let within = |from: f64, to: f64| move |x: &f64| (from..=to).contains(x);
    all("model/gravity", &[model.gravity], "finite", finite)?;
    all("model/grain_friction", &[model.grain_friction], "0 or above", not_negative)?;
    all("model/restitution", &[model.restitution], "0 to 1", within(0.0, 1.0))?;
    require(stepping.step_ns > 0, "stepping/step_ns", "above zero", stepping.step_ns)?;
    all("stepping/theta", &[stepping.theta], "1/2 to 1", within(0.5, 1.0))?;
    all("stepping/alert", &[stepping.alert], "0 or above", not_negative)?;
    all("solver/relaxation", &[solver.relaxation], "above 0, up to 1", |r| {
        positive(r) && *r <= 1.0
    })?;
    all("solver/tolerance", solver.tolerance.as_slice(), "0 or above", not_negative)?;
    require(solver.check_every > 0, "solver/check_every", "above zero", solver.check_every)?;
    let numbers = match solver.partition {
        PartitionRule::Boxes(n) => n,
        PartitionRule::Balanced(n) | PartitionRule::ContactsPer(n) => [n; 3],
    };
    all("solver/partition_numbers", &numbers, "above zero", |n| *n > 0)
}

fn lengths(model: &Model, state: &State) -> Check {
    let nb = model.body_count();
    for (place, found) in [
        ("state/position", state.position.len()),
        ("state/orientation", state.orientation.len()),
        ("state/velocity", state.velocity.len()),
        ("state/spin", state.spin.len()),
    ] {
        require(found == nb, place, format!("{nb} rows, one per body"), found)?;
    }
    let memory = &state.contacts;
    let nc = memory.bodies.len();
    for (place, found) in [
        ("contacts/feature", memory.feature.len()),
        ("contacts/local_point", memory.local_point.len()),
        ("contacts/impulse", memory.impulse.len()),
    ] {
        require(found == nc, place, format!("{nc} rows, one per contact"), found)?;
    }
    Ok(())
}

fn motion(state: &State) -> Check {
    all("state/position", &state.position, "finite", finite)?;
    all("state/orientation", &state.orientation, "unit quaternions", rotation)?;
    all("state/velocity", &state.velocity, "finite", finite)?;
    all("state/spin", &state.spin, "finite", finite)
}

fn contacts(model: &Model, state: &State) -> Check {
    let (ng, nb) = (model.grains.len(), model.body_count());
    let memory = &state.contacts;
    let expected = format!("a grain below {ng}, then a higher body below {nb}");
    all("contacts/bodies", &memory.bodies, &expected, |[c, a]| {
        (*c as usize) < ng && c < a && (*a as usize) < nb
    })?;
    require(memory.bodies.is_sorted(), "contacts/bodies", "sorted pairs", "another order")?;
    all("contacts/local_point", &memory.local_point, "finite", finite)?;
    all("contacts/impulse", &memory.impulse, "finite", finite)
}
