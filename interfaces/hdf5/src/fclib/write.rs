//! Writer of friction-contact problems and their solutions.

use super::matrix::{self, Entries};
use super::read::FclibProblem;
use crate::error::{Result, hdf5 as hdf5_error, io};
use crate::{image, replace};
use ballast::math::Vec3;
use ballast::nlgs::assembled_problem::AssembledProblem;
use hdf5::{File, H5Type};
use std::path::Path;

/// Storage of the entries of a matrix.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Storage {
    /// Compressed rows.
    Rows,
    /// Compressed columns.
    Columns,
    /// Row, column and value of each entry; the column in `p`.
    Triplets,
}

/// Writes a problem to `path` in the local form, atomically.
///
/// # Errors
/// [`crate::Error::Io`] and [`crate::Error::Hdf5`].
pub fn write_local(
    path: impl AsRef<Path>,
    problem: &AssembledProblem,
    storage: Storage,
) -> Result<()> {
    let path = path.as_ref();
    let file = image::new_image(path)?;
    let put = || -> hdf5::Result<()> {
        put_matrix(&file, "fclib_local/W", 3 * problem.contact_count(), entries(problem), storage)?;
        put(&file, "fclib_local/spacedim", &[3_i32])?;
        put(&file, "fclib_local/vectors/q", &flat(&problem.q))?;
        put(&file, "fclib_local/vectors/mu", &problem.friction)
    };
    put().map_err(hdf5_error(path, "fclib_local"))?;
    replace::replace(path, &[&image::bytes_of(&file, path)?])
}

/// Copies the file `from` that `problem` was read from to `to`, with these impulses `[nc]` as its solution.
///
/// The solution holds the impulses `r`, the relative velocities `u = W r + q`, and, in the global form,
/// the bodies' velocities `v`. A file at `to`, which may be `from`, is replaced when the copy is complete.
///
/// # Errors
/// [`crate::Error::Io`] and [`crate::Error::Hdf5`].
pub fn write_solution(
    from: impl AsRef<Path>,
    to: impl AsRef<Path>,
    problem: &FclibProblem,
    impulse: &[Vec3],
) -> Result<()> {
    let (from, to) = (from.as_ref(), to.as_ref());
    let copy = replace::beside(to)?;
    let mut original = std::fs::File::open(from).map_err(io(from, "open"))?;
    std::io::copy(&mut original, &mut copy.as_file()).map_err(io(to, "write"))?;
    let local = &problem.local;
    let u: Vec<Vec3> = (0..impulse.len()).map(|i| local.relative_velocity(i, impulse)).collect();
    let put = || -> hdf5::Result<()> {
        let options = File::with_options().with_fapl(|p| p.file_locking(false)).clone();
        let file = options.open_as(copy.path(), hdf5::OpenMode::ReadWrite)?;
        if file.link_exists("solution") {
            file.unlink("solution")?;
        }
        put(&file, "solution/r", &flat(impulse))?;
        put(&file, "solution/u", &flat(&u))?;
        if let Some(global) = &problem.global {
            put(&file, "solution/v", &global.velocity(impulse))?;
        }
        file.flush()?;
        file.close()
    };
    put().map_err(hdf5_error(to, "solution"))?;
    replace::settle(copy, to)
}

fn put<T: H5Type>(file: &File, name: &str, values: &[T]) -> hdf5::Result<()> {
    image::put_array(file, name, 1, values)
}

fn flat(vectors: &[Vec3]) -> Vec<f64> {
    vectors.iter().flat_map(|v| [v.x, v.y, v.z]).collect()
}

/// Returns the scalar entries that are not zero, row by row.
fn entries(problem: &AssembledProblem) -> Entries {
    let mut entries = Vec::new();
    for contact in 0..problem.contact_count() {
        let blocks = problem.row_starts[contact]..problem.row_starts[contact + 1];
        for k in 0..3 {
            for block in blocks.clone() {
                let column = 3 * problem.columns[block] as usize;
                let value = |l: usize| problem.blocks[block][(k, l)];
                entries.extend((0..3).map(|l| (3 * contact + k, column + l, value(l))));
            }
        }
    }
    entries.retain(|e| e.2 != 0.0);
    entries
}

fn put_matrix(
    file: &File,
    name: &str,
    size: usize,
    mut entries: Entries,
    storage: Storage,
) -> hdf5::Result<()> {
    let nonzeros = entries.len();
    let starts = |line: fn(&(usize, usize, f64)) -> usize, entries: &Entries| -> Vec<i32> {
        (0..=size).map(|l| entries.partition_point(|e| line(e) < l) as i32).collect()
    };
    let (nz, p) = match storage {
        Storage::Rows => (matrix::ROWS as i32, starts(|e| e.0, &entries)),
        Storage::Columns => {
            entries.sort_by_key(|e| (e.1, e.0));
            (matrix::COLUMNS as i32, starts(|e| e.1, &entries))
        }
        Storage::Triplets => (nonzeros as i32, entries.iter().map(|e| e.1 as i32).collect()),
    };
    let i = entries.iter().map(|e| if storage == Storage::Rows { e.1 } else { e.0 } as i32);
    put(file, &format!("{name}/i"), &i.collect::<Vec<_>>())?;
    put(file, &format!("{name}/p"), &p)?;
    put(file, &format!("{name}/x"), &entries.iter().map(|e| e.2).collect::<Vec<_>>())?;
    for (part, value) in [("m", size), ("n", size), ("nzmax", nonzeros)] {
        put(file, &format!("{name}/{part}"), &[value as i32])?;
    }
    put(file, &format!("{name}/nz"), &[nz])
}
