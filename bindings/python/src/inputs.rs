//! Motions and loads that a window is asked with.

use crate::arrays::{self, Matrix};
use crate::errors;
use ballast::component::{Interpolation, Knot, LoadKnot, LoadWaveform, Waveform};
use ballast::drive::Load as CoreLoad;
use ballast::math::{Pose, Quat, Vec3};
use ballast_protocol::messages::Quaternion;
use numpy::{
    AllowTypeChange, PyArrayDescrMethods, PyArrayDyn, PyArrayLikeDyn, PyArrayMethods,
    PyUntypedArray, PyUntypedArrayMethods, get_array_module,
};
use pyo3::PyTypeInfo;
use pyo3::exceptions::{PyIndexError, PyOverflowError, PyTypeError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyMapping, PyTuple};

/// Anything that numpy makes an array of.
type Rows<'a, 'py> = &'a Bound<'py, PyAny>;
type Array<'py> = PyArrayLikeDyn<'py, f64, AllowTypeChange>;

/// Orientations that differ by less are the same, rad: as round-off leaves them.
const SAME_TURN: f64 = 1e-9;

/// Motion of a driven body, or of the mount of one, through a window.
///
/// Knots of a motion; nothing is extrapolated beyond them.
///
/// Args:
///     times_ns: (n,) in order, from the window's start or before to its end or later.
///     positions: (n, 3) of the body's reference point, m.
///     orientations: (n, 4) unit quaternions x, y, z, w; upright unless given.
///     velocities: (n, 3) of the reference point, m/s.
///     spins: (n, 3) rad/s, world axes; needed with hermite where orientations differ, else 0 unless given.
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
        times_ns: Vec<Bound<'_, PyAny>>,
        positions: Rows<'_, '_>,
        orientations: Option<Rows<'_, '_>>,
        velocities: Option<Rows<'_, '_>>,
        spins: Option<Rows<'_, '_>>,
        interpolation: Option<&str>,
        rebase: bool,
    ) -> PyResult<Self> {
        let n = times_ns.len();
        let interpolation = match interpolation {
            // Without velocities there is no telling the slope at a knot.
            None if velocities.is_some() => Interpolation::Hermite,
            None if spins.is_some() && velocities.is_none() && n > 1 => {
                let expected = "one per knot beside the spins";
                return Err(errors::invalid(py, "velocities", expected, "none"));
            }
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
        let times = times(&times_ns)?;
        let positions = vectors(py, "positions", positions, n)?;
        let orientations = match orientations {
            None => vec![Quat::identity(); n],
            Some(rows) => quaternions(py, rows, n)?,
        };
        let turn = |q: &Quat| q != &orientations[0] && q.angle_to(&orientations[0]) > SAME_TURN;
        let needs_spins = interpolation == Interpolation::Hermite && orientations.iter().any(turn);
        if needs_spins && spins.is_none() {
            let expected = "one per knot where orientations differ, as hermite needs them";
            return Err(errors::invalid(py, "spins", expected, "none"));
        }
        let rates = |name: &str, rows: Option<Rows<'_, '_>>| match rows {
            None => Ok(vec![Vec3::zeros(); n]),
            Some(rows) => vectors(py, name, rows, n),
        };
        let (velocities, spins) = (rates("velocities", velocities)?, rates("spins", spins)?);
        let knot = |i: usize| Knot {
            time_ns: times[i],
            pose: Pose { position: positions[i], orientation: orientations[i] },
            velocity: velocities[i],
            angular_velocity: spins[i],
        };
        let waveform = Waveform { interpolation, knots: (0..n).map(knot).collect() };
        Ok(Self { waveform, rebase })
    }

    /// Pickled and copied as what it was made of.
    fn __getnewargs_ex__<'py>(&self, py: Python<'py>) -> PyResult<Again<'py>> {
        let Waveform { interpolation, knots } = &self.waveform;
        let rows = |of: fn(&Knot) -> Vec3| vectors_of(py, knots.iter().map(of));
        let turns = knots.iter().flat_map(|k| <[f64; 4]>::from(k.pose.orientation.coords));
        let named = PyDict::new(py);
        named.set_item("velocities", rows(|k| k.velocity))?;
        named.set_item("spins", rows(|k| k.angular_velocity))?;
        named.set_item("interpolation", word(*interpolation))?;
        named.set_item("rebase", self.rebase)?;
        let times: Vec<u64> = knots.iter().map(|k| k.time_ns).collect();
        let turns = arrays::table(py, &turns.collect::<Vec<_>>(), 4);
        Ok(((times, rows(|k| k.pose.position), turns).into_pyobject(py)?, named))
    }

    fn __repr__(&self) -> String {
        let Waveform { interpolation, knots } = &self.waveform;
        let kind = word(*interpolation);
        let ends = match (knots.first(), knots.last()) {
            (Some(first), Some(last)) => format!("{} to {} ns", first.time_ns, last.time_ns),
            _ => "empty".into(),
        };
        format!("Motion({} knots, {ends}, {kind})", knots.len())
    }
}

/// Load on a mounted body through a window, beside its weight along directions that are loaded; along sprung ones the
/// spring carries that already.
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
        times_ns: Vec<Bound<'_, PyAny>>,
        forces: Rows<'_, '_>,
        torques: Option<Rows<'_, '_>>,
        held: bool,
    ) -> PyResult<Self> {
        let n = times_ns.len();
        let times = times(&times_ns)?;
        let forces = vectors(py, "forces", forces, n)?;
        let torques = match torques {
            None => vec![Vec3::zeros(); n],
            Some(rows) => vectors(py, "torques", rows, n)?,
        };
        let knot = |i: usize| LoadKnot {
            time_ns: times[i],
            load: CoreLoad { force: forces[i], torque: torques[i] },
        };
        Ok(Self { waveform: LoadWaveform { is_held: held, knots: (0..n).map(knot).collect() } })
    }

    /// Pickled and copied as what it was made of.
    fn __getnewargs_ex__<'py>(&self, py: Python<'py>) -> PyResult<Again<'py>> {
        let LoadWaveform { is_held, knots } = &self.waveform;
        let rows = |of: fn(&LoadKnot) -> Vec3| vectors_of(py, knots.iter().map(of));
        let named = PyDict::new(py);
        named.set_item("held", is_held)?;
        let times: Vec<u64> = knots.iter().map(|k| k.time_ns).collect();
        let forces = rows(|k| k.load.force);
        Ok(((times, forces, rows(|k| k.load.torque)).into_pyobject(py)?, named))
    }

    fn __repr__(&self) -> String {
        format!("Load({} knots)", self.waveform.knots.len())
    }
}

/// Arguments of a class, by place and by name.
type Again<'py> = (Bound<'py, PyTuple>, Bound<'py, PyDict>);

fn word(interpolation: Interpolation) -> &'static str {
    match interpolation {
        Interpolation::Hermite => "hermite",
        Interpolation::Linear => "linear",
        Interpolation::Hold => "hold",
    }
}

fn vectors_of<'py>(py: Python<'py>, rows: impl Iterator<Item = Vec3>) -> Matrix<'py> {
    arrays::table(py, &rows.flat_map(<[f64; 3]>::from).collect::<Vec<_>>(), 3)
}

/// A time, ns since the start of the run.
pub fn time(number: &Bound<'_, PyAny>, place: impl FnOnce() -> String) -> PyResult<u64> {
    let expected = "ns since the start of the run, from 0 to 2^64 - 1";
    whole(number, "a whole number of ns", &place(), expected, refused)
}

/// A request that makes no sense, as an error of [`whole`].
pub fn refused(py: Python<'_>, place: &str, expected: &str, found: &Bound<'_, PyAny>) -> PyErr {
    errors::invalid(py, place, expected, found)
}

/// A whole number from 0 to 2^64 - 1, `kind` in words; `beyond` is the error for one that is not: interpreter, place, what is
/// `expected`, found.
pub fn whole(
    number: &Bound<'_, PyAny>,
    kind: &str,
    place: &str,
    expected: &str,
    beyond: impl FnOnce(Python<'_>, &str, &str, &Bound<'_, PyAny>) -> PyErr,
) -> PyResult<u64> {
    number.extract().map_err(|e: PyErr| {
        if e.is_instance_of::<PyOverflowError>(number.py()) {
            return beyond(number.py(), place, expected, number);
        }
        PyTypeError::new_err(format!("{place}: expected {kind}, found {number:?}"))
    })
}

/// The place of one of `n` items; negative ones count from the end, as they do in Python.
pub fn index(number: &Bound<'_, PyAny>, place: &str, n: usize) -> PyResult<usize> {
    let asked = match number.extract::<isize>() {
        Err(e) if e.is_instance_of::<PyOverflowError>(number.py()) => isize::MAX,
        asked => asked?,
    };
    let at = if asked < 0 { asked.checked_add_unsigned(n) } else { Some(asked) };
    at.and_then(|i| usize::try_from(i).ok()).filter(|i| *i < n).ok_or_else(|| {
        let expected = match n {
            0 => "none, as there are none".into(),
            n => format!("-{n} to {}", n - 1),
        };
        PyIndexError::new_err(format!("{place}: expected {expected}, found {number}"))
    })
}

fn times(times_ns: &[Bound<'_, PyAny>]) -> PyResult<Vec<u64>> {
    times_ns.iter().enumerate().map(|(i, t)| time(t, || format!("times_ns[{i}]"))).collect()
}

/// What is asked of bodies by name.
pub fn named<C: PyTypeInfo, T>(
    place: &str,
    inputs: Option<&Bound<'_, PyAny>>,
    input: impl Fn(String, &Bound<'_, C>) -> T,
) -> PyResult<Vec<T>> {
    let Some(inputs) = inputs else { return Ok(Vec::new()) };
    let py = inputs.py();
    let wrong = |place: &str, expected: &str, found: &Bound<'_, PyAny>| {
        let text = format!("{place}: expected {expected}, found {}", found.get_type());
        PyTypeError::new_err(text)
    };
    let dict = match inputs.cast::<PyDict>() {
        Ok(dict) => dict.clone(),
        Err(_) => match inputs.cast::<PyMapping>() {
            Ok(mapping) => PyDict::from_sequence(mapping.items()?.as_any())?,
            Err(_) => return Err(wrong(place, "a mapping from names of bodies", inputs)),
        },
    };
    let of = |(name, value): (Bound<'_, PyAny>, Bound<'_, PyAny>)| {
        let Ok(body) = name.extract() else {
            return Err(wrong(&format!("{place}: key {name:?}"), "the name of a body", &name));
        };
        let Ok(value) = value.cast::<C>() else {
            let expected = C::type_object(py).to_string();
            return Err(wrong(&format!("{place}[{name:?}]"), &expected, &value));
        };
        Ok(input(body, value))
    };
    dict.iter().map(of).collect()
}

/// Rows as an array of real numbers, or what they are instead: numpy would take dates for numbers, leave out imaginary
/// parts, and show what a mask hides.
fn array<'py>(rows: Rows<'_, 'py>) -> Result<Array<'py>, String> {
    let none = |_| match rows.get_type().name() {
        Ok(kind) => format!("no array of numbers ({kind})"),
        Err(_) => "no array of numbers".into(),
    };
    // The usual ones are looked at no further.
    let is_plain = rows.is_exact_instance_of::<PyUntypedArray>();
    if is_plain && let Ok(doubles) = rows.cast::<PyArrayDyn<f64>>() {
        return even(doubles).map_err(none);
    }
    let array = get_array_module(rows.py()).and_then(|np| np.call_method1("asanyarray", (rows,)));
    let array = array.map_err(none)?.cast_into::<PyUntypedArray>().map_err(|e| none(e.into()))?;
    let dtype = array.dtype();
    if !b"biufO".contains(&dtype.kind()) {
        return Err(format!("no real numbers ({dtype})"));
    }
    let mask = array.getattr_opt("mask").map_err(none)?;
    if mask.map_or(Ok(false), |m| m.call_method0("any")?.is_truthy()).map_err(none)? {
        return Err("masked numbers".into());
    }
    match array.cast::<PyArrayDyn<f64>>() {
        Ok(doubles) => even(doubles).map_err(none),
        Err(_) => array.extract().map_err(none),
    }
}

/// These numbers, copied if they do not lie as doubles do: strides that are no multiples of their size, as of a field of
/// packed records, would be rounded down.
fn even<'py>(doubles: &Bound<'py, PyArrayDyn<f64>>) -> PyResult<Array<'py>> {
    let size = size_of::<f64>() as isize;
    if doubles.data().is_aligned() && doubles.strides().iter().all(|stride| stride % size == 0) {
        return doubles.extract();
    }
    doubles.call_method0("copy")?.extract()
}

fn shaped(
    py: Python<'_>,
    name: &str,
    rows: Rows<'_, '_>,
    n: usize,
    width: usize,
) -> PyResult<Vec<f64>> {
    let rows = match array(rows) {
        Ok(array) if array.shape() == [n, width] => array,
        other => {
            let found = match other {
                Ok(array) => format!("the shape {:?}", array.shape()),
                Err(found) => found,
            };
            let expected = format!("an array of {n} rows of {width}, one per time");
            return Err(errors::invalid(py, name, expected, found));
        }
    };
    let numbers: Vec<f64> = rows.as_array().iter().copied().collect();
    match numbers.iter().position(|x| !x.is_finite()) {
        None => Ok(numbers),
        Some(i) => {
            let found = format!("{} (row {})", numbers[i], i / width);
            Err(errors::invalid(py, name, "finite numbers", found))
        }
    }
}

fn vectors(py: Python<'_>, name: &str, rows: Rows<'_, '_>, n: usize) -> PyResult<Vec<Vec3>> {
    let numbers = shaped(py, name, rows, n, 3)?;
    Ok(numbers.as_chunks().0.iter().map(|[x, y, z]| Vec3::new(*x, *y, *z)).collect())
}

fn quaternions(py: Python<'_>, rows: Rows<'_, '_>, n: usize) -> PyResult<Vec<Quat>> {
    let numbers = shaped(py, "orientations", rows, n, 4)?;
    let quaternion = |(i, &[x, y, z, w]): (usize, &[f64; 4])| {
        Quat::try_from(Quaternion { x, y, z, w }).map_err(|e| {
            let found = format!("({x}, {y}, {z}, {w}) (row {i})");
            errors::invalid(py, "orientations", e.expected, found)
        })
    };
    numbers.as_chunks().0.iter().enumerate().map(quaternion).collect()
}
