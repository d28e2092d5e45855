//! Numbers of the core as numpy arrays: read-only, and without a copy where they belong to a state.
//!
//! The one place of this package with `unsafe`: an array that looks at memory of a state keeps that state,
//! which nobody writes to any more, alive.

use ballast::math::{Quat, Vec3};
use ballast::state;
use numpy::ndarray::{ArrayView1, ArrayView2};
use numpy::{Element, PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use std::sync::Arc;

pub type Vector<'py, T = f64> = Bound<'py, PyArray1<T>>;
pub type Matrix<'py, T = f64> = Bound<'py, PyArray2<T>>;

/// What the arrays that look at a state hold on to.
#[pyclass(frozen, module = "ballast")]
pub struct Held(#[allow(dead_code, reason = "it is there to stay alive")] Arc<state::State>);

/// Plain numbers side by side, `W` to an item.
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

/// Rows of a state, without a copy `[n, width]`; `pick` names the part of the state.
pub fn rows<'py, T: Packed>(
    py: Python<'py>,
    state: &Arc<state::State>,
    pick: impl FnOnce(&state::State) -> &[T],
) -> PyResult<Matrix<'py, T::Number>> {
    let items = pick(state);
    let held = Bound::new(py, Held(Arc::clone(state)))?;
    // SAFETY: `Packed` says how an item is laid out; `held` keeps the items alive and in place: a state that
    // is shared is never written to.
    let array = unsafe {
        let numbers =
            std::slice::from_raw_parts(items.as_ptr().cast::<T::Number>(), items.len() * T::WIDTH);
        let view = ArrayView2::from_shape((items.len(), T::WIDTH), numbers)
            .expect("as many numbers as rows say");
        PyArray2::borrow_from_array(&view, held.into_any())
    };
    array.readwrite().make_nonwriteable();
    Ok(array)
}

/// A column of numbers of its own `[n]`.
pub fn column<'py, T: Element + Copy>(py: Python<'py>, numbers: &[T]) -> Vector<'py, T> {
    let array = PyArray1::from_array(py, &ArrayView1::from(numbers));
    array.readwrite().make_nonwriteable();
    array
}

/// A table of its own `[n, width]`; `numbers` row by row.
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

pub fn vector<'py>(py: Python<'py>, v: &Vec3) -> Vector<'py> {
    column(py, v.as_slice())
}

/// x, y, z, w.
pub fn quaternion<'py>(py: Python<'py>, q: &Quat) -> Vector<'py> {
    column(py, q.coords.as_slice())
}
