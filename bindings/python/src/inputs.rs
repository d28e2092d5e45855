//! Motions and loads that a window is asked with.

use crate::errors;
use ballast::component::{Interpolation, Knot, LoadKnot, LoadWaveform, Waveform};
use ballast::drive::Load as CoreLoad;
use ballast::math::{Pose, Quat, Vec3};
use ballast_protocol::messages::Quaternion;
use numpy::{AllowTypeChange, PyArrayLike2, PyUntypedArrayMethods};
use pyo3::prelude::*;

type Rows<'py> = PyArrayLike2<'py, f64, AllowTypeChange>;

/// Motion of a driven body, or of the mount of one, through a window.
///
/// Knots of a motion; nothing is extrapolated beyond them.
///
/// Args:
///     times_ns: (n,) in order, from the window's start or before to its end or later.
///     positions: (n, 3) of the body's reference point, m.
///     orientations: (n, 4) unit quaternions x, y, z, w; upright unless given.
///     velocities: (n, 3) of the reference point, m/s.
///     spins: (n, 3) rad/s, world axes.
///     interpolation: "hermite" (cubic through poses and velocities; the default where velocities are
///         given), "linear" (the default without them) or "hold".
///     rebase: the motion need not begin where the body is.
#[pyclass(frozen, module = "ballast")]
pub struct Motion {
    pub waveform: Waveform,
    pub rebase: bool,
}

#[pymethods]
impl Motion {
    #[new]
    #[pyo3(signature = (times_ns, positions, orientations=None, *, velocities=None, spins=None,
                        interpolation=None, rebase=false))]
    #[expect(clippy::too_many_arguments, reason = "they have names in Python")]
    fn new(
        py: Python<'_>,
        times_ns: Vec<i64>,
        positions: Rows<'_>,
        orientations: Option<Rows<'_>>,
        velocities: Option<Rows<'_>>,
        spins: Option<Rows<'_>>,
        interpolation: Option<&str>,
        rebase: bool,
    ) -> PyResult<Self> {
        let n = times_ns.len();
        let interpolation = match interpolation {
            // Without velocities there is no telling the slope at a knot.
            None if velocities.is_some() => Interpolation::Hermite,
            None => Interpolation::Linear,
            Some("hermite") if velocities.is_none() && n > 1 => {
                let expected = "one per knot, as hermite needs them";
                return Err(errors::invalid(py, "velocities", expected, "none"));
            }
            Some("hermite") => Interpolation::Hermite,
            Some("linear") => Interpolation::Linear,
            Some("hold") => Interpolation::Hold,
            Some(other) => {
                let expected = "\"hermite\", \"linear\" or \"hold\"";
                return Err(errors::invalid(py, "interpolation", expected, format!("{other:?}")));
            }
        };
        let times = times(py, &times_ns)?;
        let positions = vectors(py, "positions", &positions, n)?;
        let orientations = match &orientations {
            None => vec![Quat::identity(); n],
            Some(rows) => quaternions(py, rows, n)?,
        };
        let rates = |name: &str, rows: &Option<Rows<'_>>| match rows {
            None => Ok(vec![Vec3::zeros(); n]),
            Some(rows) => vectors(py, name, rows, n),
        };
        let (velocities, spins) = (rates("velocities", &velocities)?, rates("spins", &spins)?);
        let knot = |i: usize| Knot {
            time_ns: times[i],
            pose: Pose { position: positions[i], orientation: orientations[i] },
            velocity: velocities[i],
            spin: spins[i],
        };
        let waveform = Waveform { interpolation, knots: (0..n).map(knot).collect() };
        Ok(Self { waveform, rebase })
    }

    fn __repr__(&self) -> String {
        let Waveform { interpolation, knots } = &self.waveform;
        let kind = format!("{interpolation:?}").to_lowercase();
        let ends = match (knots.first(), knots.last()) {
            (Some(first), Some(last)) => format!("{} to {} ns", first.time_ns, last.time_ns),
            _ => "empty".into(),
        };
        format!("Motion({} knots, {ends}, {kind})", knots.len())
    }
}

/// Load on a mounted body through a window, besides its weight.
///
/// Knots of forces (n, 3) in N and torques (n, 3) about the reference point in N m, linear between them or held from each
/// one on; `times_ns` (n,) are in order.
#[pyclass(frozen, module = "ballast")]
pub struct Load {
    pub waveform: LoadWaveform,
}

#[pymethods]
impl Load {
    #[new]
    #[pyo3(signature = (times_ns, forces, torques=None, *, held=false))]
    fn new(
        py: Python<'_>,
        times_ns: Vec<i64>,
        forces: Rows<'_>,
        torques: Option<Rows<'_>>,
        held: bool,
    ) -> PyResult<Self> {
        let n = times_ns.len();
        let times = times(py, &times_ns)?;
        let forces = vectors(py, "forces", &forces, n)?;
        let torques = match &torques {
            None => vec![Vec3::zeros(); n],
            Some(rows) => vectors(py, "torques", rows, n)?,
        };
        let knot = |i: usize| LoadKnot {
            time_ns: times[i],
            load: CoreLoad { force: forces[i], torque: torques[i] },
        };
        Ok(Self { waveform: LoadWaveform { is_held: held, knots: (0..n).map(knot).collect() } })
    }

    fn __repr__(&self) -> String {
        format!("Load({} knots)", self.waveform.knots.len())
    }
}

fn times(py: Python<'_>, times_ns: &[i64]) -> PyResult<Vec<u64>> {
    let time = |(i, t): (usize, &i64)| {
        u64::try_from(*t).map_err(|_| {
            let text = format!(
                "times_ns: expected times after the start of the run, found {t} (knot {i})"
            );
            errors::refused(py, "input_invalid", text)
        })
    };
    times_ns.iter().enumerate().map(time).collect()
}

fn shaped(
    py: Python<'_>,
    name: &str,
    rows: &Rows<'_>,
    n: usize,
    width: usize,
) -> PyResult<Vec<f64>> {
    if rows.shape() != [n, width] {
        let expected = format!("an array of {n} rows of {width}, one per time");
        return Err(errors::invalid(py, name, expected, format!("the shape {:?}", rows.shape())));
    }
    let numbers: Vec<f64> = rows.as_array().iter().copied().collect();
    match numbers.iter().position(|x| !x.is_finite()) {
        None => Ok(numbers),
        Some(i) => {
            let found = format!("{} (row {})", numbers[i], i / width);
            Err(errors::invalid(py, name, "finite numbers", found))
        }
    }
}

fn vectors(py: Python<'_>, name: &str, rows: &Rows<'_>, n: usize) -> PyResult<Vec<Vec3>> {
    let numbers = shaped(py, name, rows, n, 3)?;
    Ok(numbers.as_chunks().0.iter().map(|[x, y, z]| Vec3::new(*x, *y, *z)).collect())
}

fn quaternions(py: Python<'_>, rows: &Rows<'_>, n: usize) -> PyResult<Vec<Quat>> {
    let numbers = shaped(py, "orientations", rows, n, 4)?;
    let quaternion = |&[x, y, z, w]: &[f64; 4]| {
        Quat::try_from(Quaternion { x, y, z, w })
            .map_err(|e| errors::refused(py, "input_invalid", e))
    };
    numbers.as_chunks().0.iter().map(quaternion).collect()
}
