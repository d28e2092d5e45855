//! Driven bodies: roles, mounts, convex parts, and the paths of tines in a tamping cycle.

use crate::arrays::{self, Matrix, Vector};
use ballast::geometry::Polyhedron;
use ballast::math::Pose;
use ballast::model::{DrivenBody, Model, Part};
use ballast_protocol::description::{self, TineDescription};
use pyo3::prelude::*;

/// Role and mount of a driven body of any backend.
pub struct BodyInfo {
    pub role: String,
    /// Mount of a body that loads can move.
    pub mount: Option<PyMount>,
}

impl From<&DrivenBody> for BodyInfo {
    fn from(body: &DrivenBody) -> Self {
        let mount = body.mount.map(|mount| PyMount {
            mass: mount.mass,
            dof_modes: mount.dof_modes.map(|mode| mode.name().into()),
            stiffness: mount.dof_modes.map(|mode| mode.spring()[0]),
            damping: mount.dof_modes.map(|mode| mode.spring()[1]),
        });
        Self { role: body.role.name().into(), mount }
    }
}

impl From<description::BodyDescription> for BodyInfo {
    fn from(body: description::BodyDescription) -> Self {
        let description::BodyDescription { role, dof_modes, stiffness, damping, .. } = body;
        let mount = body.mass_kg.map(|mass| PyMount { mass, dof_modes, stiffness, damping });
        Self { role, mount }
    }
}

#[doc = stub!("Mount")]
#[pyclass(frozen, module = "ballast", name = "Mount")]
#[derive(Clone)]
pub struct PyMount {
    mass: f64,
    dof_modes: [String; 6],
    stiffness: [f64; 6],
    damping: [f64; 6],
}

#[pymethods]
impl PyMount {
    #[doc = stub!("Mount.mass")]
    #[getter]
    fn mass(&self) -> f64 {
        self.mass
    }

    #[doc = stub!("Mount.dof_modes")]
    #[getter]
    fn dof_modes(&self) -> (&str, &str, &str, &str, &str, &str) {
        let [x, y, z, rx, ry, rz] = self.dof_modes.each_ref().map(|mode| &mode[..]);
        (x, y, z, rx, ry, rz)
    }

    #[doc = stub!("Mount.stiffness")]
    #[getter]
    fn stiffness<'py>(&self, py: Python<'py>) -> Vector<'py> {
        arrays::column(py, &self.stiffness)
    }

    #[doc = stub!("Mount.damping")]
    #[getter]
    fn damping<'py>(&self, py: Python<'py>) -> Vector<'py> {
        arrays::column(py, &self.damping)
    }

    fn __repr__(&self) -> String {
        format!("Mount({} kg, {})", self.mass, self.dof_modes.join(", "))
    }
}

/// Corners `[n, 3]`, m, and faces as lists of corner indices.
pub type SolidArrays<'py> = (Matrix<'py>, Vec<Vec<u16>>);

/// Returns a shape, moved by `pose`, as arrays.
pub fn solid<'py>(py: Python<'py>, shape: &Polyhedron, pose: &Pose) -> SolidArrays<'py> {
    let corners = shape.vertices.iter().map(|corner| pose.point(corner));
    let corners: Vec<f64> = corners.flat_map(<[f64; 3]>::from).collect();
    let ends = shape.face_starts.windows(2);
    let faces = ends.map(|e| shape.face_vertices[e[0] as usize..e[1] as usize].to_vec()).collect();
    (arrays::table(py, &corners, 3), faces)
}

/// Returns the convex parts of a driven body, in its frame.
pub fn parts<'py>(py: Python<'py>, model: &Model, body: &DrivenBody) -> Vec<SolidArrays<'py>> {
    let solids = body.parts.iter().filter_map(|part| match part {
        Part::Convex { shape, pose } => Some(solid(py, &model.shapes[*shape as usize], pose)),
        Part::HalfSpace { .. } => None,
    });
    solids.collect()
}

#[doc = stub!("Tine")]
#[pyclass(frozen, module = "ballast", name = "Tine")]
pub struct PyTine(pub TineDescription);

#[pymethods]
impl PyTine {
    #[doc = stub!("Tine.name")]
    #[getter]
    fn name(&self) -> &str {
        &self.0.body
    }

    #[doc = stub!("Tine.pair")]
    #[getter]
    fn pair(&self) -> u32 {
        self.0.pair
    }

    #[doc = stub!("Tine.direction")]
    #[getter]
    fn direction(&self) -> f64 {
        self.0.direction
    }

    #[doc = stub!("Tine.start")]
    #[getter]
    fn start<'py>(&self, py: Python<'py>) -> Vector<'py> {
        arrays::vector(py, &self.0.start.into())
    }

    #[doc = stub!("Tine.full_depth_z")]
    #[getter]
    fn full_depth_z(&self) -> f64 {
        self.0.full_depth_z
    }

    #[doc = stub!("Tine.stroke")]
    #[getter]
    fn stroke(&self) -> f64 {
        self.0.stroke
    }

    fn __repr__(&self) -> String {
        format!("Tine({:?}, pair {})", self.0.body, self.0.pair)
    }
}
