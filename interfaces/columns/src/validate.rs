//! Validation of a model and a state, before they are written and after they were read.
//!
//! Reads: model, state. Cost: linear in their size. Contract: a valid state can be stepped without an index
//! out of range, a division by zero or a number that is not finite.

use crate::fault::Fault;
use ballast::Error as CoreError;
use ballast::geometry::Polyhedron;
use ballast::math::Vec3;
use ballast::model::{Model, PartitionRule};
use ballast::state::State;

type CheckResult = Result<(), Fault>;

/// Maximum deviation of the length of a unit vector from 1; rounding stays within a few 1e-16.
const UNIT: f64 = 1e-9;

/// Checks a model and its state.
///
/// # Errors
/// The first invalid value.
pub fn check(model: &Model, state: &State) -> CheckResult {
    model.check().map_err(fault)?;
    state.check(model).map_err(fault)?;
    for (s, shape) in model.shapes.iter().enumerate() {
        polyhedron(shape)
            .map_err(|f| Fault { place: format!("shapes/{} of shape {s}", f.place), ..f })?;
    }
    rest(model)
}

/// Converts an error of the core, which has a place in the model or the state.
fn fault(error: CoreError) -> Fault {
    match error {
        CoreError::Model { place, expected, found } => {
            Fault { place: format!("model: {place}"), expected, found }
        }
        CoreError::State { place, expected, found } => {
            Fault { place: format!("state: {place}"), expected, found }
        }
        other => Fault::new("content", "a model and a state that can be stepped", other),
    }
}

fn all<T: std::fmt::Debug>(
    place: &str,
    values: &[T],
    expected: &str,
    good: impl Fn(&T) -> bool,
) -> CheckResult {
    match values.iter().position(|v| !good(v)) {
        None => Ok(()),
        Some(i) => Err(Fault::new(place, expected, format!("{:?} in row {i}", values[i]))),
    }
}

fn require(
    good: bool,
    place: &str,
    expected: impl Into<String>,
    found: impl ToString,
) -> CheckResult {
    if good { Ok(()) } else { Err(Fault::new(place, expected, found)) }
}

fn finite(v: &Vec3) -> bool {
    v.iter().all(|x| x.is_finite())
}

fn unit(v: &Vec3) -> bool {
    (v.norm_squared() - 1.0).abs() < UNIT
}

fn positive(x: &f64) -> bool {
    x.is_finite() && *x > 0.0
}

/// Checks properties that models from constructors of the core always have.
fn rest(model: &Model) -> CheckResult {
    let numbers = match model.solver.partition {
        PartitionRule::Boxes(n) => n,
        PartitionRule::Balanced(n) | PartitionRule::ContactsPer(n) => [n; 3],
    };
    all("solver/partition_numbers", &numbers, "above zero", |n| *n > 0)
}

fn polyhedron(shape: &Polyhedron) -> CheckResult {
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
