//! Conversion of the JSON of a sample to model and state.

use super::content::{Sample, SampleError};
use super::file::{FORMAT, SampleFile, SampleFixedBody, SampleGrain, SampleSolver};
use ballast::geometry::{Polyhedron, convex_hull};
use ballast::math::{Pose, Quat, Vec3};
use ballast::model::{
    self, ContactStiffness, DrivenBody, Grains, Model, Part, Role, Schedule, Stepping,
};
use ballast::state::State;
use std::collections::BTreeSet;

/// Maximum size of a sample, bytes: about 250 000 grains.
pub const MAX_SAMPLE_BYTES: u64 = 256 << 20;
/// Maximum number of vertices of a body; the hull of more takes minutes.
const MAX_VERTICES: usize = 1000;
/// Maximum length, speed or acceleration, SI units.
const MAX_QUANTITY: f64 = 1e6;

/// Reads the sample `text`; `name` stands for it in messages. Never panics, whatever the text is.
///
/// # Errors
/// The first error in the text.
pub fn read(text: &str, name: &str) -> Result<Sample, SampleError> {
    let root = ErrorContext { file: name, parent: String::new() };
    if text.len() as u64 > MAX_SAMPLE_BYTES {
        let found = format!("{} bytes", text.len());
        return Err(root.error("", format!("a sample of at most {MAX_SAMPLE_BYTES} bytes"), found));
    }
    let file = parse(text, &root)?;
    let (stepping, solver) = global_settings(&file, &root)?;
    let mut model = Model {
        shapes: Vec::new(),
        grains: Grains::default(),
        driven: Vec::new(),
        gravity: root.vector(file.gravity, "gravity")?,
        grain_friction: file.friction.grain_grain,
        grain_stiffness: ContactStiffness::RIGID,
        restitution: file.restitution,
        stepping,
        solver,
    };
    let mut state = State::default();
    for (i, grain) in file.grains.iter().enumerate() {
        add_grain(grain, &root.at(&format!("grains[{i}]")), &mut model, &mut state)?;
    }
    let mut names = BTreeSet::new();
    for (i, fixed) in file.fixed.iter().enumerate() {
        let friction = file.friction.grain_wall;
        let context = root.at(&format!("fixed[{i}]"));
        let body = fixed_body(fixed, i, friction, &context, &mut model.shapes, &mut state)?;
        if !names.insert(body.name.clone()) {
            return Err(context.error("name", "a unique name", format!("{:?}", body.name)));
        }
        model.driven.push(body);
    }
    Ok(Sample { model, state, steps: file.steps, meta: file.meta })
}

fn parse(text: &str, context: &ErrorContext) -> Result<SampleFile, SampleError> {
    let json = &mut serde_json::Deserializer::from_str(text);
    let file: SampleFile = serde_path_to_error::deserialize(&mut *json).map_err(|e| {
        let path = e.path().to_string();
        context.syntax_error(if path == "." { "" } else { &path }, e.inner())
    })?;
    json.end().map_err(|e| context.syntax_error("", &e))?;
    if file.format != FORMAT {
        return Err(context.error("format", format!("{FORMAT:?}"), format!("{:?}", file.format)));
    }
    Ok(file)
}

/// Checks the values that hold for the whole sample, and returns its stepping and solver.
fn global_settings(
    file: &SampleFile,
    context: &ErrorContext,
) -> Result<(Stepping, model::Solver), SampleError> {
    let step_ns = (file.dt * 1e9).round();
    let is_whole = (file.dt * 1e9 - step_ns).abs() <= 1e-3 && (1.0..=1e12).contains(&step_ns);
    context.require(is_whole, "dt", "a whole number of nanoseconds, up to 1000 s", file.dt)?;
    context.require((0.5..=1.0).contains(&file.theta), "theta", "0.5 to 1", file.theta)?;
    context.require(file.steps <= 1 << 40, "steps", "at most 2^40", file.steps)?;
    let is_distance = file.alert > 0.0 && file.alert <= MAX_QUANTITY;
    context.require(is_distance, "alert", "a distance above 0, m", file.alert)?;
    for (path, mu) in [
        ("friction.grain_grain", file.friction.grain_grain),
        ("friction.grain_wall", file.friction.grain_wall),
    ] {
        context.require(
            (0.0..=MAX_QUANTITY).contains(&mu),
            path,
            "a coefficient, 0 or more",
            mu,
        )?;
    }
    let e = file.restitution;
    context.require((0.0..=1.0).contains(&e), "restitution", "0 to 1", e)?;
    let stepping =
        Stepping { step_ns: step_ns as u64, theta: file.theta, detection_distance: file.alert };
    Ok((stepping, solver(&file.solver, &context.at("solver"))?))
}

fn solver(solver: &SampleSolver, context: &ErrorContext) -> Result<model::Solver, SampleError> {
    let (iterations, tolerance) = match (solver.iterations, solver.tolerance) {
        (Some(sweeps), _) => (sweeps, None),
        (None, Some(tolerance)) => (solver.max_iterations, Some(tolerance)),
        (None, None) => {
            let expected = "`iterations`, or `tolerance` where it is null";
            return Err(context.error("iterations", expected, "neither"));
        }
    };
    let path = if tolerance.is_some() { "max_iterations" } else { "iterations" };
    context.require(iterations > 0, path, "1 or more", iterations)?;
    if let Some(t) = tolerance {
        context.require(t > 0.0 && t.is_finite(), "tolerance", "a number above 0", t)?;
    }
    context.require(solver.check_every > 0, "check_every", "1 or more", solver.check_every)?;
    let is_factor = solver.relax > 0.0 && solver.relax <= 1.0;
    context.require(is_factor, "relax", "above 0 and up to 1", solver.relax)?;
    Ok(model::Solver {
        // Sweeps over all contacts, as in the other programs of the format.
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
    grain: &SampleGrain,
    context: &ErrorContext,
    model: &mut Model,
    state: &mut State,
) -> Result<(), SampleError> {
    let is_density = grain.density > 0.0 && grain.density <= MAX_QUANTITY;
    context.require(is_density, "density", "kg/m³, above 0 and up to 1e6", grain.density)?;
    let (polyhedron, local) = hull(&grain.vertices, context)?;
    let frame = context.pose(grain.position, grain.quaternion)?;
    let velocity = context.vector(grain.velocity, "velocity")?;
    let angular_velocity = context.vector(grain.omega, "omega")?;
    let pose = frame.then(&local);
    state.push(pose);
    // The origin of the file's body frame may differ from the centre of mass by the rounding of the vertices.
    let lever = pose.position - frame.position;
    let last = state.velocity.len() - 1;
    state.velocity[last] = velocity + angular_velocity.cross(&lever);
    state.angular_velocity[last] = angular_velocity;
    model.grains.push(model.shapes.len() as u32, &polyhedron, grain.density);
    model.shapes.push(polyhedron);
    Ok(())
}

fn fixed_body(
    fixed: &SampleFixedBody,
    i: usize,
    friction: f64,
    context: &ErrorContext,
    shapes: &mut Vec<Polyhedron>,
    state: &mut State,
) -> Result<DrivenBody, SampleError> {
    let (polyhedron, local) = hull(&fixed.vertices, context)?;
    state.push(context.pose(fixed.position, fixed.quaternion)?);
    let part = Part::Convex { shape: shapes.len() as u32, pose: local };
    shapes.push(polyhedron);
    let name = fixed.name.clone().unwrap_or_else(|| format!("fixed_{}", i + 1));
    Ok(DrivenBody {
        name,
        role: Role::Boundary,
        friction,
        stiffness: ContactStiffness::RIGID,
        parts: vec![part],
        mount: None,
    })
}

fn hull(vertices: &[[f64; 3]], context: &ErrorContext) -> Result<(Polyhedron, Pose), SampleError> {
    let count = vertices.len();
    let expected = format!("4 to {MAX_VERTICES} vertices");
    context.require((4..=MAX_VERTICES).contains(&count), "vertices", &expected, count)?;
    let points: Vec<Vec3> = vertices
        .iter()
        .enumerate()
        .map(|(j, v)| context.vector(*v, &format!("vertices[{j}]")))
        .collect::<Result<_, _>>()?;
    convex_hull(&points).map_err(|e| match e {
        ballast::Error::Geometry { expected, found } => context.error("vertices", expected, found),
        other => context.error("vertices", "a convex polyhedron", other.to_string()),
    })
}

/// File and path that an error is about.
struct ErrorContext<'a> {
    file: &'a str,
    parent: String,
}

impl<'a> ErrorContext<'a> {
    fn at(&self, parent: &str) -> ErrorContext<'a> {
        ErrorContext { file: self.file, parent: parent.into() }
    }

    fn error(
        &self,
        path: &str,
        expected: impl Into<String>,
        found: impl Into<String>,
    ) -> SampleError {
        let path = match (self.parent.as_str(), path) {
            ("", "") => "sample".to_string(),
            ("", path) => path.to_string(),
            (parent, "") => parent.to_string(),
            (parent, path) => format!("{parent}.{path}"),
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

    /// Converts an error of the JSON parser, with its position in the text.
    fn syntax_error(&self, path: &str, error: &serde_json::Error) -> SampleError {
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
        is_valid: bool,
        path: &str,
        expected: &str,
        found: impl ToString,
    ) -> Result<(), SampleError> {
        if is_valid { Ok(()) } else { Err(self.error(path, expected, found.to_string())) }
    }

    fn vector(&self, v: [f64; 3], path: &str) -> Result<Vec3, SampleError> {
        let is_valid = v.iter().all(|x| x.abs() <= MAX_QUANTITY);
        self.require(is_valid, path, "three numbers of at most 1e6", format!("{v:?}"))?;
        Ok(Vec3::from(v))
    }

    fn pose(&self, position: [f64; 3], [w, x, y, z]: [f64; 4]) -> Result<Pose, SampleError> {
        let position = self.vector(position, "position")?;
        let quaternion = nalgebra::Quaternion::new(w, x, y, z);
        let is_valid = (quaternion.norm() - 1.0).abs() <= 1e-3;
        let found = format!("{:?}", [w, x, y, z]);
        self.require(is_valid, "quaternion", "w, x, y, z of norm 1", found)?;
        Ok(Pose { position, orientation: Quat::from_quaternion(quaternion) })
    }
}
