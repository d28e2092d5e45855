//! Read-only numpy arrays of the core's numbers; arrays of a state are views without a copy.
//!
//! The only module of this package with `unsafe`: a view keeps its state alive, and shared states are never written to.

use ballast::math::{Quat, Vec3};
use ballast::state;
use numpy::ndarray::{ArrayView1, ArrayView2};
use numpy::{Element, PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use std::sync::Arc;

/// One-dimensional array.
pub type Vector<'py, T = f64> = Bound<'py, PyArray1<T>>;
/// Two-dimensional array.
pub type Matrix<'py, T = f64> = Bound<'py, PyArray2<T>>;

/// Owner of the memory of views: keeps a state alive.
#[pyclass(frozen, module = "ballast", name = "_StateOwner")]
pub struct StateOwner(#[allow(dead_code, reason = "keeps the state alive")] Arc<state::State>);

/// A type that consists of `WIDTH` numbers without padding.
///
/// # Safety
/// `Self` is laid out as `[Number; WIDTH]`.
pub unsafe trait Packed: Copy {
    type Number: Element + Copy;
    const WIDTH: usize;
}

// SAFETY: a matrix of three numbers is stored as these, without anything else (`repr(C)`, `transparent`).
unsafe impl Packed for Vec3 {
    type Number = f64;
    const WIDTH: usize = 3;
}
// SAFETY: a unit quaternion is stored as its coordinates i, j, k, w (`transparent`).
unsafe impl Packed for Quat {
    type Number = f64;
    const WIDTH: usize = 4;
}
// SAFETY: an array is its items.
unsafe impl Packed for [u32; 2] {
    type Number = u32;
    const WIDTH: usize = 2;
}

const _: () = assert!(size_of::<Vec3>() == 24 && size_of::<Quat>() == 32);

/// Returns a view of a part of a state `[n, width]`.
pub fn rows<'py, T: Packed>(
    py: Python<'py>,
    state: &Arc<state::State>,
    pick: impl FnOnce(&state::State) -> &[T],
) -> PyResult<Matrix<'py, T::Number>> {
    let items = pick(state);
    let owner = Bound::new(py, StateOwner(Arc::clone(state)))?;
    // SAFETY: `Packed` guarantees the layout of an item; `owner` keeps the items alive and in place: a shared state is
    // never written to.
    let array = unsafe {
        let numbers =
            std::slice::from_raw_parts(items.as_ptr().cast::<T::Number>(), items.len() * T::WIDTH);
        let view = ArrayView2::from_shape((items.len(), T::WIDTH), numbers)
            .expect("n times width numbers");
        PyArray2::borrow_from_array(&view, owner.into_any())
    };
    array.readwrite().make_nonwriteable();
    Ok(array)
}

/// Returns a copy of numbers as an array `[n]`.
pub fn column<'py, T: Element + Copy>(py: Python<'py>, numbers: &[T]) -> Vector<'py, T> {
    let array = PyArray1::from_array(py, &ArrayView1::from(numbers));
    array.readwrite().make_nonwriteable();
    array
}

/// Returns a copy of numbers as an array `[n, width]`, row by row.
pub fn table<'py, T: Element + Copy>(
    py: Python<'py>,
    numbers: &[T],
    width: usize,
) -> Matrix<'py, T> {
    let rows = numbers.len() / width.max(1);
    let view = ArrayView2::from_shape((rows, width), &numbers[..rows * width])
        .expect("whole rows of numbers");
    let array = PyArray2::from_array(py, &view);
    array.readwrite().make_nonwriteable();
    array
}

/// Returns a vector as an array `[3]`.
pub fn vector<'py>(py: Python<'py>, v: &Vec3) -> Vector<'py> {
    column(py, v.as_slice())
}

/// Returns a quaternion as an array `[4]`: x, y, z, w.
pub fn quaternion<'py>(py: Python<'py>, q: &Quat) -> Vector<'py> {
    column(py, q.coords.as_slice())
}
