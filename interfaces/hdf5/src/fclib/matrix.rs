//! Sparse matrices of FCLIB: a group with `nzmax, m, n, nz, p, i, x`.
//!
//! Contract: every index is compared with the matrix before it is used; allocations are bounded by
//! the sizes of the datasets, not by the claims of the file.

use crate::error::{Fault, FaultInFile, Result};
use crate::image::ColumnSource;
use ballast_columns::ColumnReader;

/// Entries of a matrix: row, column, value.
pub(crate) type Entries = Vec<(usize, usize, f64)>;

/// Value of `nz` for a matrix in compressed rows.
pub(crate) const ROWS: i64 = -2;
/// Value of `nz` for a matrix in compressed columns.
pub(crate) const COLUMNS: i64 = -1;

/// Reads the whole number in `name`, an array of length 1.
pub(crate) fn integer(source: &ColumnSource, name: &str) -> Result<i64> {
    match integers(source, name)?[..] {
        [value] => Ok(value),
        ref other => {
            let found = format!("{} numbers", other.len());
            Err(Fault::new(name, "one whole number", found).in_file(source.path))
        }
    }
}

/// Reads whole numbers of 32 bits, as the library of the format writes them, or of 64.
fn integers(source: &ColumnSource, name: &str) -> Result<Vec<i64>> {
    match source.array::<i32>(name, None, 1) {
        Ok(values) => Ok(values.into_iter().map(i64::from).collect()),
        Err(error) => source.array::<i64>(name, None, 1).map_err(|_| error),
    }
}

/// Reads the matrix in the group `name`, which must be `rows` by `columns`.
pub(crate) fn read(
    source: &ColumnSource,
    name: &str,
    rows: usize,
    columns: usize,
) -> Result<Entries> {
    let fault = |part: &str, expected: String, found: String| {
        Fault::new(format!("{name}/{part}"), expected, found).in_file(source.path)
    };
    for (part, size) in [("m", rows), ("n", columns)] {
        let found = integer(source, &format!("{name}/{part}"))?;
        if found != size as i64 {
            return Err(fault(part, size.to_string(), found.to_string()));
        }
    }
    let x = source.reals(&format!("{name}/x"), None, 1)?;
    let i = integers(source, &format!("{name}/i"))?;
    let p = integers(source, &format!("{name}/p"))?;
    let nz = integer(source, &format!("{name}/nz"))?;
    // `nzmax` is the capacity of the writer and means nothing here.
    let inside = |part: &str, at: usize, index: i64, size: usize| {
        usize::try_from(index).ok().filter(|&k| k < size).ok_or_else(|| {
            fault(part, format!("indices from 0 to below {size}"), format!("{index} at {at}"))
        })
    };
    if nz >= 0 {
        let count = nz as usize;
        if nz as u64 > x.len() as u64 || count > i.len() || count > p.len() {
            let found = format!("{}, {} and {} of them", x.len(), i.len(), p.len());
            return Err(fault("x, i, p", format!("{count} values, as nz says"), found));
        }
        // The header of the format states the opposite; its files have the column in p.
        let entry =
            |k: usize| Ok((inside("i", k, i[k], rows)?, inside("p", k, p[k], columns)?, x[k]));
        return (0..count).map(entry).collect();
    }
    let (lines, along) = match nz {
        ROWS => (rows, columns),
        COLUMNS => (columns, rows),
        _ => return Err(fault("nz", "-2, -1 or a number of entries".into(), nz.to_string())),
    };
    let most = x.len().min(i.len());
    if p.len() != lines + 1 || p[0] != 0 || !p.is_sorted() || p[lines] > most as i64 {
        let expected = format!("{} starts from 0, rising, up to {most} at most", lines + 1);
        let found = match (p.first(), p.last()) {
            (Some(first), Some(last)) => format!("{} from {first} to {last}", p.len()),
            _ => "none".into(),
        };
        return Err(fault("p", expected, found));
    }
    let mut entries = Vec::with_capacity(p[lines] as usize);
    for line in 0..lines {
        for k in p[line] as usize..p[line + 1] as usize {
            let other = inside("i", k, i[k], along)?;
            let (row, column) = if nz == ROWS { (line, other) } else { (other, line) };
            entries.push((row, column, x[k]));
        }
    }
    Ok(entries)
}
