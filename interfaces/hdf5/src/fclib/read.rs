//! Reader of friction-contact problems.

use super::matrix;
use crate::error::{Fault, FaultInFile, Result, hdf5 as hdf5_error, io};
use crate::image::{self, ColumnSource};
use crate::seal;
use ballast::Error as CoreError;
use ballast::math::Vec3;
use ballast::nlgs::assembled_problem::AssembledProblem;
use ballast::nlgs::global_problem::{FactorisedGlobalProblem, GlobalProblem};
use ballast_columns::ColumnReader;
use std::path::Path;

/// Friction-contact problem of a file, with its solution and first guess, if given.
#[derive(Debug, Clone)]
pub struct FclibProblem {
    /// Problem in impulses alone.
    pub local: AssembledProblem,
    /// Problem with the velocities of the bodies, if the file has it.
    pub global: Option<FactorisedGlobalProblem>,
    /// Impulses `[nc]` of the solution in the file; they may be all zero.
    pub solution: Option<Vec<Vec3>>,
    /// Impulses `[nc]` of the first guess in the file.
    pub guess: Option<Vec<Vec3>>,
}

/// Reads the problem in `path`, in its local or global form.
///
/// # Errors
/// [`crate::Error::Damaged`], with dataset, expected and found, for a file that is no such
/// problem, and for problems in two dimensions or with joints, which are not supported.
pub fn read(path: impl AsRef<Path>) -> Result<FclibProblem> {
    let path = path.as_ref();
    let size = std::fs::metadata(path).map_err(io(path, "read"))?.len();
    if !seal::is_hdf5(path)? {
        return Err(Fault::new("header", "an HDF5 file", "another").in_file(path));
    }
    let file = image::open(path).map_err(hdf5_error(path, "content"))?;
    let source = ColumnSource { path, file: &file, size, packed: true };
    let form = ["fclib_local", "fclib_global"].into_iter().find(|form| file.link_exists(form));
    let Some(form) = form else {
        let fault = Fault::new("/", "a group fclib_local or fclib_global", "neither");
        return Err(fault.in_file(path));
    };
    let dimension = matrix::integer(&source, &format!("{form}/spacedim"))?;
    if dimension != 3 {
        return Err(Fault::new(format!("{form}/spacedim"), "3", dimension).in_file(path));
    }
    let (local, global) = match form {
        "fclib_local" => (local(&source)?, None),
        _ => global(&source).map(|(local, global)| (local, Some(global)))?,
    };
    let impulses = |name: &str| {
        let held = source.has(name);
        held.then(|| vectors(&source, name, Some(local.contact_count()))).transpose()
    };
    Ok(FclibProblem {
        solution: impulses("solution/r")?,
        guess: impulses("guesses/1/r")?,
        local,
        global,
    })
}

fn local(source: &ColumnSource) -> Result<AssembledProblem> {
    refuse_joints(source, &["fclib_local/V", "fclib_local/R", "fclib_local/vectors/s"])?;
    let q = vectors(source, "fclib_local/vectors/q", None)?;
    let friction = source.reals("fclib_local/vectors/mu", Some(q.len()), 1)?;
    let entries = matrix::read(source, "fclib_local/W", 3 * q.len(), 3 * q.len())?;
    AssembledProblem::from_entries(entries, q, friction)
        .map_err(|e| refused(source, "fclib_local", e))
}

fn global(source: &ColumnSource) -> Result<(AssembledProblem, FactorisedGlobalProblem)> {
    refuse_joints(source, &["fclib_global/G", "fclib_global/vectors/b"])?;
    let f = source.reals("fclib_global/vectors/f", None, 1)?;
    let w = vectors(source, "fclib_global/vectors/w", None)?;
    let given = GlobalProblem {
        mass: matrix::read(source, "fclib_global/M", f.len(), f.len())?,
        h: matrix::read(source, "fclib_global/H", f.len(), 3 * w.len())?,
        friction: source.reals("fclib_global/vectors/mu", Some(w.len()), 1)?,
        f,
        w,
    };
    let form =
        FactorisedGlobalProblem::new(given).map_err(|e| refused(source, "fclib_global", e))?;
    let local = form.assembled().map_err(|e| refused(source, "fclib_global", e))?;
    Ok((local, form))
}

/// Refuses equality constraints, without which the problem would be another one.
fn refuse_joints(source: &ColumnSource, names: &[&'static str]) -> Result<()> {
    match names.iter().find(|name| source.has(name)) {
        None => Ok(()),
        Some(name) => {
            let expected = "contacts alone: problems with joints are not solved here";
            Err(Fault::new(*name, expected, "joints").in_file(source.path))
        }
    }
}

/// Reads vectors (n, t, s) `[contacts]`, which are stored flat.
fn vectors(source: &ColumnSource, name: &str, contacts: Option<usize>) -> Result<Vec<Vec3>> {
    let flat = source.reals(name, contacts.map(|n| 3 * n), 1)?;
    let (vectors, rest) = flat.as_chunks::<3>();
    if !rest.is_empty() {
        let fault = Fault::new(name, "three values for each contact", flat.len());
        return Err(fault.in_file(source.path));
    }
    Ok(vectors.iter().map(|v| Vec3::from(*v)).collect())
}

fn refused(source: &ColumnSource, form: &str, error: CoreError) -> crate::Error {
    match error {
        CoreError::Model { place, expected, found } => {
            Fault { place: format!("{form}: {place}"), expected, found }.in_file(source.path)
        }
        other => Fault::new(form, "a friction problem", other).in_file(source.path),
    }
}
