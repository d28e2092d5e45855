//! From the JSON of a sample to model and state.

use super::file::{FORMAT, Fixed, Grain, SampleFile, Solver};
use super::{Sample, SampleError};
use ballast::geometry::{Polyhedron, convex_hull};
use ballast::math::{Pose, Quat, Vec3};
use ballast::model::{self, DrivenBody, Grains, Model, Part, Role, Schedule, Stepping};
use ballast::state::State;
use std::collections::BTreeSet;

/// Longest text of a sample that is read, bytes: about 250 000 grains.
pub const LONGEST: u64 = 256 << 20;
/// Corners of a body that are read; the hull of more costs minutes.
const MAX_VERTICES: usize = 1000;
/// Largest length, speed or acceleration that is no slip of the pen, SI units.
const MAX_NUMBER: f64 = 1e6;

/// Reads the sample `text`; `name` stands for it in messages.
///
/// Never panics, whatever the text is.
pub fn read(text: &str, name: &str) -> Result<Sample, SampleError> {
    let place = Place { file: name, within: String::new() };
    if text.len() as u64 > LONGEST {
        let found = format!("{} bytes", text.len());
        return Err(place.error("", format!("a sample of at most {LONGEST} bytes"), found));
    }
    let file = parse(text, &place)?;
    let (stepping, solver) = check_constants(&file, &place)?;
    let mut model = Model {
        shapes: Vec::new(),
        grains: Grains::default(),
        driven: Vec::new(),
        gravity: place.vector(file.gravity, "gravity")?,
        grain_friction: file.friction.grain_grain,
        restitution: file.restitution,
        stepping,
        solver,
    };
    let mut state = State::default();
    for (i, grain) in file.grains.iter().enumerate() {
        add_grain(grain, &place.at(&format!("grains[{i}]")), &mut model, &mut state)?;
    }
    let mut names = BTreeSet::new();
    for (i, fixed) in file.fixed.iter().enumerate() {
        let friction = file.friction.grain_wall;
        let within = place.at(&format!("fixed[{i}]"));
        let body = fixed_body(fixed, i, friction, &within, &mut model.shapes, &mut state)?;
        if !names.insert(body.name.clone()) {
            return Err(within.error("name", "a name of its own", format!("{:?}", body.name)));
        }
        model.driven.push(body);
    }
    Ok(Sample { model, state, steps: file.steps, meta: file.meta })
}

fn parse(text: &str, place: &Place) -> Result<SampleFile, SampleError> {
    let json = &mut serde_json::Deserializer::from_str(text);
    let file: SampleFile = serde_path_to_error::deserialize(&mut *json).map_err(|e| {
        let path = e.path().to_string();
        place.syntax(if path == "." { "" } else { &path }, e.inner())
    })?;
    json.end().map_err(|e| place.syntax("", &e))?;
    if file.format != FORMAT {
        return Err(place.error("format", format!("{FORMAT:?}"), format!("{:?}", file.format)));
    }
    Ok(file)
}

/// Checks what is one for all, and makes stepping and solver of it.
fn check_constants(
    file: &SampleFile,
    place: &Place,
) -> Result<(Stepping, model::Solver), SampleError> {
    let step_ns = (file.dt * 1e9).round();
    let whole = (file.dt * 1e9 - step_ns).abs() <= 1e-3 && (1.0..=1e12).contains(&step_ns);
    place.require(whole, "dt", "a whole number of nanoseconds, up to 1000 s", file.dt)?;
    place.require((0.5..=1.0).contains(&file.theta), "theta", "0.5 to 1", file.theta)?;
    place.require(file.steps <= 1 << 40, "steps", "at most 2^40", file.steps)?;
    let alert = file.alert > 0.0 && file.alert <= MAX_NUMBER;
    place.require(alert, "alert", "a distance above 0, m", file.alert)?;
    for (path, mu) in [
        ("friction.grain_grain", file.friction.grain_grain),
        ("friction.grain_wall", file.friction.grain_wall),
    ] {
        place.require((0.0..=MAX_NUMBER).contains(&mu), path, "a coefficient, 0 or more", mu)?;
    }
    let e = file.restitution;
    place.require((0.0..=1.0).contains(&e), "restitution", "0 to 1", e)?;
    let stepping =
        Stepping { step_ns: step_ns as u64, theta: file.theta, detection_distance: file.alert };
    Ok((stepping, solver(&file.solver, &place.at("solver"))?))
}

fn solver(solver: &Solver, place: &Place) -> Result<model::Solver, SampleError> {
    let (iterations, tolerance) = match (solver.iterations, solver.tolerance) {
        (Some(sweeps), _) => (sweeps, None),
        (None, Some(tolerance)) => (solver.max_iterations, Some(tolerance)),
        (None, None) => {
            let expected = "`iterations`, or `tolerance` where it is null";
            return Err(place.error("iterations", expected, "neither"));
        }
    };
    let path = if tolerance.is_some() { "max_iterations" } else { "iterations" };
    place.require(iterations > 0, path, "1 or more", iterations)?;
    if let Some(t) = tolerance {
        place.require(t > 0.0 && t.is_finite(), "tolerance", "a number above 0", t)?;
    }
    place.require(solver.check_every > 0, "check_every", "1 or more", solver.check_every)?;
    let relax = solver.relax > 0.0 && solver.relax <= 1.0;
    place.require(relax, "relax", "above 0 and up to 1", solver.relax)?;
    Ok(model::Solver {
        // Sweeps over all contacts, as the format's other programs do them.
        schedule: Schedule::Sequential,
        max_iterations: iterations,
        tolerance,
        norm: solver.norm,
        convergence_check_interval: solver.check_every,
        relaxation: solver.relax,
        ..model::Solver::default()
    })
}

fn add_grain(
    grain: &Grain,
    place: &Place,
    model: &mut Model,
    state: &mut State,
) -> Result<(), SampleError> {
    let dense = grain.density > 0.0 && grain.density <= MAX_NUMBER;
    place.require(dense, "density", "kg/m³, above 0 and up to 1e6", grain.density)?;
    let (polyhedron, local) = hull(&grain.vertices, place)?;
    let frame = place.pose(grain.position, grain.quaternion)?;
    let velocity = place.vector(grain.velocity, "velocity")?;
    let angular_velocity = place.vector(grain.omega, "omega")?;
    let pose = frame.then(&local);
    state.push(pose);
    // The file's origin is the centre of mass only up to the rounding of its corners.
    let lever = pose.position - frame.position;
    let last = state.velocity.len() - 1;
    state.velocity[last] = velocity + angular_velocity.cross(&lever);
    state.angular_velocity[last] = angular_velocity;
    model.grains.push(model.shapes.len() as u32, &polyhedron, grain.density);
    model.shapes.push(polyhedron);
    Ok(())
}

fn fixed_body(
    fixed: &Fixed,
    i: usize,
    friction: f64,
    place: &Place,
    shapes: &mut Vec<Polyhedron>,
    state: &mut State,
) -> Result<DrivenBody, SampleError> {
    let (polyhedron, local) = hull(&fixed.vertices, place)?;
    state.push(place.pose(fixed.position, fixed.quaternion)?);
    let part = Part::Convex { shape: shapes.len() as u32, pose: local };
    shapes.push(polyhedron);
    let name = fixed.name.clone().unwrap_or_else(|| format!("fixed_{}", i + 1));
    Ok(DrivenBody { name, role: Role::Boundary, friction, parts: vec![part], mount: None })
}

fn hull(vertices: &[[f64; 3]], place: &Place) -> Result<(Polyhedron, Pose), SampleError> {
    let count = vertices.len();
    let expected = format!("4 to {MAX_VERTICES} corners");
    place.require((4..=MAX_VERTICES).contains(&count), "vertices", &expected, count)?;
    let points: Vec<Vec3> = vertices
        .iter()
        .enumerate()
        .map(|(j, v)| place.vector(*v, &format!("vertices[{j}]")))
        .collect::<Result<_, _>>()?;
    convex_hull(&points).map_err(|e| match e {
        ballast::Error::Geometry { expected, found } => place.error("vertices", expected, found),
        other => place.error("vertices", "a convex polyhedron", other.to_string()),
    })
}

/// Where in which file a value stands.
struct Place<'a> {
    file: &'a str,
    within: String,
}

impl<'a> Place<'a> {
    fn at(&self, within: &str) -> Place<'a> {
        Place { file: self.file, within: within.into() }
    }

    fn error(
        &self,
        path: &str,
        expected: impl Into<String>,
        found: impl Into<String>,
    ) -> SampleError {
        let path = match (self.within.as_str(), path) {
            ("", "") => "sample".to_string(),
            ("", path) => path.to_string(),
            (within, "") => within.to_string(),
            (within, path) => format!("{within}.{path}"),
        };
        SampleError {
            file: self.file.into(),
            line: 0,
            column: 0,
            path,
            expected: expected.into(),
            found: found.into(),
        }
    }

    /// What the JSON reader says, with its place in the text.
    fn syntax(&self, path: &str, error: &serde_json::Error) -> SampleError {
        let message = error.to_string();
        let message = message.split(" at line ").next().unwrap_or_default();
        let (found, expected) = match message.split_once(", expected ") {
            Some((found, expected)) => (found, expected),
            None if message.starts_with("expected ") => ("another text", "a sample in JSON"),
            None => (message, "a sample in JSON"),
        };
        let line = error.line();
        SampleError { line, column: error.column(), ..self.error(path, expected, found) }
    }

    fn require(
        &self,
        good: bool,
        path: &str,
        expected: &str,
        found: impl ToString,
    ) -> Result<(), SampleError> {
        if good { Ok(()) } else { Err(self.error(path, expected, found.to_string())) }
    }

    fn vector(&self, v: [f64; 3], path: &str) -> Result<Vec3, SampleError> {
        let good = v.iter().all(|x| x.abs() <= MAX_NUMBER);
        self.require(good, path, "three numbers of at most 1e6", format!("{v:?}"))?;
        Ok(Vec3::from(v))
    }

    fn pose(&self, position: [f64; 3], [w, x, y, z]: [f64; 4]) -> Result<Pose, SampleError> {
        let position = self.vector(position, "position")?;
        let quaternion = nalgebra::Quaternion::new(w, x, y, z);
        let good = (quaternion.norm() - 1.0).abs() <= 1e-3;
        let found = format!("{:?}", [w, x, y, z]);
        self.require(good, "quaternion", "w, x, y, z of norm 1", found)?;
        Ok(Pose { position, orientation: Quat::from_quaternion(quaternion) })
    }
}
