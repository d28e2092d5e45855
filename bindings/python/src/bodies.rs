//! Driven bodies: what they are, what holds them, what they are made of, and how tines move in a tamping cycle.

use crate::arrays::{self, Matrix, Vector};
use ballast::geometry::Polyhedron;
use ballast::math::Pose;
use ballast::model::{DrivenBody, Model, Part};
use ballast::track::TinePath;
use ballast_protocol::description;
use pyo3::prelude::*;

/// What is known of a driven body, wherever it is.
pub struct About {
    pub role: String,
    /// Of one that loads can move.
    pub mount: Option<Mount>,
}

impl From<&DrivenBody> for About {
    fn from(body: &DrivenBody) -> Self {
        let mount = body.mount.map(|mount| Mount {
            mass: mount.mass,
            freedoms: mount.dof_modes.map(|freedom| freedom.name().into()),
            stiffness: mount.dof_modes.map(|freedom| freedom.spring()[0]),
            damping: mount.dof_modes.map(|freedom| freedom.spring()[1]),
        });
        Self { role: body.role.name().into(), mount }
    }
}

impl From<description::Body> for About {
    fn from(body: description::Body) -> Self {
        let description::Body { role, freedoms, stiffness, damping, .. } = body;
        let mount = body.mass_kg.map(|mass| Mount { mass, freedoms, stiffness, damping });
        Self { role, mount }
    }
}

/// What holds a body that loads can move: by direction, the motion that is asked of the body, springs that follow it, or
/// nothing.
#[pyclass(frozen, module = "ballast")]
#[derive(Clone)]
pub struct Mount {
    mass: f64,
    freedoms: [String; 6],
    stiffness: [f64; 6],
    damping: [f64; 6],
}

#[pymethods]
impl Mount {
    /// That moves with the body, kg.
    #[getter]
    fn mass(&self) -> f64 {
        self.mass
    }

    /// Of x, y, z, and of the rotations about them: "prescribed", "spring" or "free".
    #[getter]
    fn freedoms(&self) -> (&str, &str, &str, &str, &str, &str) {
        let [x, y, z, a, b, c] = self.freedoms.each_ref().map(|freedom| &freedom[..]);
        (x, y, z, a, b, c)
    }

    /// (6,) where it is sprung, in the same order: N/m, of rotations N m/rad; elsewhere 0.
    #[getter]
    fn stiffness<'py>(&self, py: Python<'py>) -> Vector<'py> {
        arrays::column(py, &self.stiffness)
    }

    /// (6,) where it is sprung, in the same order: N s/m, of rotations N m s/rad; elsewhere 0.
    #[getter]
    fn damping<'py>(&self, py: Python<'py>) -> Vector<'py> {
        arrays::column(py, &self.damping)
    }

    fn __repr__(&self) -> String {
        format!("Mount({} kg, {})", self.mass, self.freedoms.join(", "))
    }
}

/// Corners and faces.
pub type Solid<'py> = (Matrix<'py>, Vec<Vec<u16>>);

pub fn solid<'py>(py: Python<'py>, shape: &Polyhedron, pose: &Pose) -> Solid<'py> {
    let corners = shape.vertices.iter().map(|corner| pose.point(corner));
    let corners: Vec<f64> = corners.flat_map(<[f64; 3]>::from).collect();
    let ends = shape.face_starts.windows(2);
    let faces = ends.map(|e| shape.face_vertices[e[0] as usize..e[1] as usize].to_vec()).collect();
    (arrays::table(py, &corners, 3), faces)
}

/// The solids of a driven body.
pub fn parts<'py>(py: Python<'py>, model: &Model, body: &DrivenBody) -> Vec<Solid<'py>> {
    let solids = body.parts.iter().filter_map(|part| match part {
        Part::Convex { shape, pose } => Some(solid(py, &model.shapes[*shape as usize], pose)),
        Part::HalfSpace { .. } => None,
    });
    solids.collect()
}

/// The way of a tine through the tamping cycle of its case.
#[pyclass(frozen, module = "ballast")]
pub struct Tine {
    pub name: String,
    pub pair: u32,
    pub path: TinePath,
}

#[pymethods]
impl Tine {
    /// Its body's.
    #[getter]
    fn name(&self) -> &str {
        &self.name
    }

    /// Number of its pair in the case: its squeezes are those of "pair_NUMBER".
    #[getter]
    fn pair(&self) -> u32 {
        self.pair
    }

    /// Of its squeeze along x: 1 or -1.
    #[getter]
    fn direction(&self) -> f64 {
        self.path.direction
    }

    /// (3,) where its reference point is before the cycle, m.
    #[getter]
    fn start<'py>(&self, py: Python<'py>) -> Vector<'py> {
        arrays::vector(py, &self.path.start)
    }

    /// Height of its reference point at full depth, m.
    #[getter]
    fn deep(&self) -> f64 {
        self.path.deep
    }

    /// How far it closes, m.
    #[getter]
    fn stroke(&self) -> f64 {
        self.path.stroke
    }

    fn __repr__(&self) -> String {
        format!("Tine({:?}, pair {})", self.name, self.pair)
    }
}
