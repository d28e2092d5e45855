//! Motions and loads of a window, and checked conversion of Python numbers and arrays.

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

/// Any object that numpy can convert to an array.
type ArrayLike<'a, 'py> = &'a Bound<'py, PyAny>;
type FloatArray<'py> = PyArrayLikeDyn<'py, f64, AllowTypeChange>;

/// Angle below which two orientations are equal, rad: round-off.
const ORIENTATION_TOLERANCE: f64 = 1e-9;

#[doc = stub!("Motion")]
#[pyclass(frozen, module = "ballast", name = "Motion")]
pub struct PyMotion {
    pub waveform: Waveform,
    pub allow_jump: bool,
}

#[pymethods]
impl PyMotion {
    #[new]
    #[pyo3(signature = (times_ns, positions, orientations=None, *, velocities=None, angular_velocities=None,
                        interpolation=None, allow_jump=false))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments of Python")]
    fn new(
        py: Python<'_>,
        times_ns: Vec<Bound<'_, PyAny>>,
        positions: ArrayLike<'_, '_>,
        orientations: Option<ArrayLike<'_, '_>>,
        velocities: Option<ArrayLike<'_, '_>>,
        angular_velocities: Option<ArrayLike<'_, '_>>,
        interpolation: Option<&str>,
        allow_jump: bool,
    ) -> PyResult<Self> {
        let n = times_ns.len();
        let interpolation = match interpolation {
            None if velocities.is_some() => Interpolation::Hermite,
            None if angular_velocities.is_some() && n > 1 => {
                let expected = "one per knot with angular velocities";
                return Err(errors::invalid(py, "velocities", expected, "none"));
            }
            None => Interpolation::Linear,
            Some("hermite") if velocities.is_none() && n > 1 => {
                let expected = "one per knot with interpolation \"hermite\"";
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
        let differs = |q: &Quat| {
            q != &orientations[0] && q.angle_to(&orientations[0]) > ORIENTATION_TOLERANCE
        };
        let rotates = interpolation == Interpolation::Hermite && orientations.iter().any(differs);
        if rotates && angular_velocities.is_none() {
            let expected = "one per knot where orientations differ with interpolation \"hermite\"";
            return Err(errors::invalid(py, "angular_velocities", expected, "none"));
        }
        let rates = |name: &str, rows: Option<ArrayLike<'_, '_>>| match rows {
            None => Ok(vec![Vec3::zeros(); n]),
            Some(rows) => vectors(py, name, rows, n),
        };
        let velocities = rates("velocities", velocities)?;
        let angular_velocities = rates("angular_velocities", angular_velocities)?;
        let knot = |i: usize| Knot {
            time_ns: times[i],
            pose: Pose { position: positions[i], orientation: orientations[i] },
            velocity: velocities[i],
            angular_velocity: angular_velocities[i],
        };
        let waveform = Waveform { interpolation, knots: (0..n).map(knot).collect() };
        Ok(Self { waveform, allow_jump })
    }

    #[doc = stub!("Motion.__getnewargs_ex__")]
    fn __getnewargs_ex__<'py>(&self, py: Python<'py>) -> PyResult<ConstructorArgs<'py>> {
        let Waveform { interpolation, knots } = &self.waveform;
        let rows = |of: fn(&Knot) -> Vec3| vector_rows(py, knots.iter().map(of));
        let orientations = knots.iter().flat_map(|k| <[f64; 4]>::from(k.pose.orientation.coords));
        let named = PyDict::new(py);
        named.set_item("velocities", rows(|k| k.velocity))?;
        named.set_item("angular_velocities", rows(|k| k.angular_velocity))?;
        named.set_item("interpolation", interpolation_name(*interpolation))?;
        named.set_item("allow_jump", self.allow_jump)?;
        let times: Vec<u64> = knots.iter().map(|k| k.time_ns).collect();
        let orientations = arrays::table(py, &orientations.collect::<Vec<_>>(), 4);
        Ok(((times, rows(|k| k.pose.position), orientations).into_pyobject(py)?, named))
    }

    fn __repr__(&self) -> String {
        let Waveform { interpolation, knots } = &self.waveform;
        let kind = interpolation_name(*interpolation);
        let ends = match (knots.first(), knots.last()) {
            (Some(first), Some(last)) => format!("{} to {} ns", first.time_ns, last.time_ns),
            _ => "empty".into(),
        };
        format!("Motion({} knots, {ends}, {kind})", knots.len())
    }
}

#[doc = stub!("Load")]
#[pyclass(frozen, module = "ballast", name = "Load")]
pub struct PyLoad {
    pub waveform: LoadWaveform,
}

#[pymethods]
impl PyLoad {
    #[new]
    #[pyo3(signature = (times_ns, forces, torques=None, *, interpolation="linear"))]
    fn new(
        py: Python<'_>,
        times_ns: Vec<Bound<'_, PyAny>>,
        forces: ArrayLike<'_, '_>,
        torques: Option<ArrayLike<'_, '_>>,
        interpolation: &str,
    ) -> PyResult<Self> {
        let n = times_ns.len();
        let is_held = match interpolation {
            "linear" => false,
            "hold" => true,
            other => {
                let expected = "\"linear\" or \"hold\"";
                return Err(errors::invalid(py, "interpolation", expected, format!("{other:?}")));
            }
        };
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
        Ok(Self { waveform: LoadWaveform { is_held, knots: (0..n).map(knot).collect() } })
    }

    #[doc = stub!("Load.__getnewargs_ex__")]
    fn __getnewargs_ex__<'py>(&self, py: Python<'py>) -> PyResult<ConstructorArgs<'py>> {
        let LoadWaveform { is_held, knots } = &self.waveform;
        let rows = |of: fn(&LoadKnot) -> Vec3| vector_rows(py, knots.iter().map(of));
        let named = PyDict::new(py);
        named.set_item("interpolation", if *is_held { "hold" } else { "linear" })?;
        let times: Vec<u64> = knots.iter().map(|k| k.time_ns).collect();
        let forces = rows(|k| k.load.force);
        Ok(((times, forces, rows(|k| k.load.torque)).into_pyobject(py)?, named))
    }

    fn __repr__(&self) -> String {
        format!("Load({} knots)", self.waveform.knots.len())
    }
}

/// Positional and keyword arguments of a constructor.
type ConstructorArgs<'py> = (Bound<'py, PyTuple>, Bound<'py, PyDict>);

fn interpolation_name(interpolation: Interpolation) -> &'static str {
    match interpolation {
        Interpolation::Hermite => "hermite",
        Interpolation::Linear => "linear",
        Interpolation::Hold => "hold",
    }
}

fn vector_rows<'py>(py: Python<'py>, rows: impl Iterator<Item = Vec3>) -> Matrix<'py> {
    arrays::table(py, &rows.flat_map(<[f64; 3]>::from).collect::<Vec<_>>(), 3)
}

/// Converts a time, ns since the start of the run; `place` names it in errors.
pub fn time(number: &Bound<'_, PyAny>, place: impl FnOnce() -> String) -> PyResult<u64> {
    let expected = "ns since the start of the run, from 0 to 2^64 - 1";
    whole(number, "a whole number of ns", &place(), expected, out_of_range)
}

/// Returns the `RequestError` for a number out of range, for [`whole`].
pub fn out_of_range(
    py: Python<'_>,
    place: &str,
    expected: &str,
    found: &Bound<'_, PyAny>,
) -> PyErr {
    errors::invalid(py, place, expected, found)
}

/// Converts a whole number from 0 to 2^64 - 1.
///
/// # Errors
/// `TypeError` with `kind` if it is no whole number, and what `out_of_range(py, place, expected, found)` returns.
pub fn whole(
    number: &Bound<'_, PyAny>,
    kind: &str,
    place: &str,
    expected: &str,
    out_of_range: impl FnOnce(Python<'_>, &str, &str, &Bound<'_, PyAny>) -> PyErr,
) -> PyResult<u64> {
    number.extract().map_err(|e: PyErr| {
        if e.is_instance_of::<PyOverflowError>(number.py()) {
            return out_of_range(number.py(), place, expected, number);
        }
        PyTypeError::new_err(format!("{place}: expected {kind}, found {number:?}"))
    })
}

/// Converts an index of `n` items; negative indices count from the end, as in Python.
///
/// # Errors
/// `IndexError`.
pub fn index(number: &Bound<'_, PyAny>, place: &str, n: usize) -> PyResult<usize> {
    let signed = match number.extract::<isize>() {
        Err(e) if e.is_instance_of::<PyOverflowError>(number.py()) => isize::MAX,
        result => result?,
    };
    let at = if signed < 0 { signed.checked_add_unsigned(n) } else { Some(signed) };
    at.and_then(|i| usize::try_from(i).ok()).filter(|i| *i < n).ok_or_else(|| {
        let expected = match n {
            0 => "no index (there are no items)".into(),
            n => format!("-{n} to {}", n - 1),
        };
        PyIndexError::new_err(format!("{place}: expected {expected}, found {number}"))
    })
}

fn times(times_ns: &[Bound<'_, PyAny>]) -> PyResult<Vec<u64>> {
    times_ns.iter().enumerate().map(|(i, t)| time(t, || format!("times_ns[{i}]"))).collect()
}

/// Converts a mapping from body names to objects of class `C`.
///
/// # Errors
/// `TypeError`.
pub fn by_body<C: PyTypeInfo, T>(
    place: &str,
    inputs: Option<&Bound<'_, PyAny>>,
    input: impl Fn(String, &Bound<'_, C>) -> T,
) -> PyResult<Vec<T>> {
    let Some(inputs) = inputs else { return Ok(Vec::new()) };
    let py = inputs.py();
    let wrong_type = |place: &str, expected: &str, found: &Bound<'_, PyAny>| {
        let text = format!("{place}: expected {expected}, found {}", found.get_type());
        PyTypeError::new_err(text)
    };
    let dict = match inputs.cast::<PyDict>() {
        Ok(dict) => dict.clone(),
        Err(_) => match inputs.cast::<PyMapping>() {
            Ok(mapping) => PyDict::from_sequence(mapping.items()?.as_any())?,
            Err(_) => return Err(wrong_type(place, "a mapping from names of bodies", inputs)),
        },
    };
    let convert = |(name, value): (Bound<'_, PyAny>, Bound<'_, PyAny>)| {
        let Ok(body) = name.extract() else {
            return Err(wrong_type(&format!("{place}: key {name:?}"), "the name of a body", &name));
        };
        let Ok(value) = value.cast::<C>() else {
            let expected = C::type_object(py).to_string();
            return Err(wrong_type(&format!("{place}[{name:?}]"), &expected, &value));
        };
        Ok(input(body, value))
    };
    dict.iter().map(convert).collect()
}

/// Converts rows to an array of real numbers, or returns a description of what they are.
///
/// numpy alone would accept dates as numbers, drop imaginary parts and show masked values.
fn array<'py>(rows: ArrayLike<'_, 'py>) -> Result<FloatArray<'py>, String> {
    let not_numbers = |_| match rows.get_type().name() {
        Ok(kind) => format!("no array of numbers ({kind})"),
        Err(_) => "no array of numbers".into(),
    };
    // Fast path.
    let is_plain = rows.is_exact_instance_of::<PyUntypedArray>();
    if is_plain && let Ok(doubles) = rows.cast::<PyArrayDyn<f64>>() {
        return aligned(doubles).map_err(not_numbers);
    }
    let array = get_array_module(rows.py()).and_then(|np| np.call_method1("asanyarray", (rows,)));
    let array = array.map_err(not_numbers)?;
    let array = array.cast_into::<PyUntypedArray>().map_err(|e| not_numbers(e.into()))?;
    let dtype = array.dtype();
    if !b"biufO".contains(&dtype.kind()) {
        return Err(format!("no real numbers ({dtype})"));
    }
    let mask = array.getattr_opt("mask").map_err(not_numbers)?;
    let is_masked = mask.map_or(Ok(false), |m| m.call_method0("any")?.is_truthy());
    if is_masked.map_err(not_numbers)? {
        return Err("masked numbers".into());
    }
    match array.cast::<PyArrayDyn<f64>>() {
        Ok(doubles) => aligned(doubles).map_err(not_numbers),
        Err(_) => array.extract().map_err(not_numbers),
    }
}

/// Returns the array, copied if it is unaligned: strides that are no multiples of the item size, as of a field of packed
/// records, would be rounded down.
fn aligned<'py>(doubles: &Bound<'py, PyArrayDyn<f64>>) -> PyResult<FloatArray<'py>> {
    let size = size_of::<f64>() as isize;
    if doubles.data().is_aligned() && doubles.strides().iter().all(|stride| stride % size == 0) {
        return doubles.extract();
    }
    doubles.call_method0("copy")?.extract()
}

/// Converts rows to `n` times `width` finite numbers.
fn shaped(
    py: Python<'_>,
    name: &str,
    rows: ArrayLike<'_, '_>,
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

fn vectors(py: Python<'_>, name: &str, rows: ArrayLike<'_, '_>, n: usize) -> PyResult<Vec<Vec3>> {
    let numbers = shaped(py, name, rows, n, 3)?;
    Ok(numbers.as_chunks().0.iter().map(|[x, y, z]| Vec3::new(*x, *y, *z)).collect())
}

fn quaternions(py: Python<'_>, rows: ArrayLike<'_, '_>, n: usize) -> PyResult<Vec<Quat>> {
    let numbers = shaped(py, "orientations", rows, n, 4)?;
    let quaternion = |(i, &[x, y, z, w]): (usize, &[f64; 4])| {
        Quat::try_from(Quaternion { x, y, z, w }).map_err(|e| {
            let found = format!("({x}, {y}, {z}, {w}) (row {i})");
            errors::invalid(py, "orientations", e.expected, found)
        })
    };
    numbers.as_chunks().0.iter().enumerate().map(quaternion).collect()
}
