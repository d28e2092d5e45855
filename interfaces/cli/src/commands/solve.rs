//! `ballast solve FILE`: solution of friction-contact problems with their errors.
//!
//! The measured time is that of the solution, without reading the file and assembling `W`.

use super::solve_table::{
    SolveRow, csv, performance_profile, profile_csv, profile_page, report, table,
};
use crate::args::SolveArgs;
use crate::console::Console;
use crate::files::{check_replaceable, expect_different, replace_text};
use crate::profile::cpu_time;
use ballast::nlgs::solution::{self, SolutionSettings};
use ballast_hdf5::fclib;
use ballast_session::{Failure, Reporter, Result};
use serde_json::json;
use std::path::{Path, PathBuf};

/// Default tolerances for a folder of problems.
const FOLDER_TOLERANCES: [f64; 3] = [1e-4, 1e-6, 1e-8];

pub fn solve(args: SolveArgs, console: Console) -> Result {
    if let Some(tolerance) = args.tolerance.filter(|t| !(*t > 0.0 && t.is_finite())) {
        return Err(Failure::Usage(format!("--tolerance {tolerance}: expected a number above 0")));
    }
    let folder = args.file.is_dir();
    if args.write_solution.is_some() && (folder || args.method.len() > 1) {
        return Err(Failure::Usage(
            "--write-solution: expected one problem and one method, found several".into(),
        ));
    }
    let tables = [("--csv", args.csv.as_deref()), ("--profile", args.profile.as_deref())];
    // The solution may be written into the problem itself.
    for other in
        [("the problem", Some(&*args.file)), ("--write-solution", args.write_solution.as_deref())]
    {
        expect_different(&[[other].as_slice(), &tables].concat())?;
    }
    if let Some(path) = &args.write_solution {
        check_replaceable(path, "a problem", || fclib::read(path).is_ok())
            .map_err(|e| Failure::at(path, e))?;
    }
    let single = [args.tolerance.unwrap_or(1e-6)];
    let tolerances =
        if folder && args.tolerance.is_none() { &FOLDER_TOLERANCES[..] } else { &single };
    let files = if folder { problems_in(&args.file)? } else { vec![args.file.clone()] };
    let mut rows = Vec::new();
    let mut unreadable = 0;
    for file in &files {
        let problem = problem_name(file, &files);
        match solve_file(file, &problem, tolerances, &args, console) {
            Ok(of_file) => rows.extend(of_file),
            Err(failure) if folder => {
                unreadable += 1;
                console.warning(&failure.to_string());
            }
            Err(failure) => return Err(failure),
        }
    }
    finish(&args, &rows, console)?;
    if unreadable > 0 {
        let message = format!("{unreadable} of {} files could not be read", files.len());
        return Err(Failure::at(&args.file, message));
    }
    match rows.iter().find(|row| !folder && !row.solution.converged) {
        None => Ok(()),
        Some(row) => Err(Failure::at(
            &args.file,
            format!(
                "not solved: expected an error of {:e}, found {:.2e} after {} sweeps",
                row.tolerance, row.solution.errors.abh, row.solution.sweeps
            ),
        )),
    }
}

/// Returns true if the path of a profile is that of a page.
fn is_page(path: &Path) -> bool {
    path.extension().is_some_and(|e| e == "html")
}

/// Returns the HDF5 files of a folder, sorted by name.
fn problems_in(folder: &Path) -> Result<Vec<PathBuf>> {
    let entries = std::fs::read_dir(folder).map_err(|e| Failure::at(folder, e))?;
    let mut files = Vec::new();
    for entry in entries {
        let path = entry.map_err(|e| Failure::at(folder, e))?.path();
        if path.extension().is_some_and(|e| e == "hdf5" || e == "h5") {
            files.push(path);
        }
    }
    files.sort();
    if files.is_empty() {
        return Err(Failure::at(folder, "expected problems (.hdf5 or .h5), found none"));
    }
    Ok(files)
}

/// Returns the name of a problem in tables: its file without the extension, unless that is ambiguous.
fn problem_name(file: &Path, files: &[PathBuf]) -> String {
    let is_alone = files.iter().filter(|other| other.file_stem() == file.file_stem()).count() == 1;
    let name = if is_alone { file.file_stem() } else { file.file_name() };
    name.unwrap_or_default().to_string_lossy().into_owned()
}

/// Solves one problem to each tolerance with each method.
fn solve_file(
    file: &Path,
    name: &str,
    tolerances: &[f64],
    args: &SolveArgs,
    console: Console,
) -> Result<Vec<SolveRow>> {
    let problem = fclib::read(file)?;
    let mut rows = Vec::new();
    for &tolerance in tolerances {
        for &method in &args.method {
            let settings =
                SolutionSettings { method: method.into(), tolerance, max_sweeps: args.max_sweeps };
            let start = cpu_time();
            let solution = solution::solve(&problem.local, None, &settings);
            let seconds = cpu_time().saturating_sub(start).as_secs_f64();
            if let Some(out) = &args.write_solution {
                fclib::write_solution(file, out, &problem, &solution.impulse)?;
            }
            let row = SolveRow {
                problem: name.to_string(),
                contacts: problem.local.contact_count(),
                method: method.name(),
                tolerance,
                solution,
                seconds,
            };
            console.event("solution", row.json());
            rows.push(row);
        }
    }
    Ok(rows)
}

/// Prints the solutions and writes the requested tables.
fn finish(args: &SolveArgs, rows: &[SolveRow], console: Console) -> Result {
    match rows {
        [row] if !args.file.is_dir() => console.result(&report(row)),
        _ => console.result(&table(rows)),
    }
    if let Some(path) = &args.csv {
        replace_text(path, &csv(rows))?;
    }
    if let Some(path) = &args.profile {
        let profiles = performance_profile(rows);
        let text =
            if is_page(path) { profile_page(&profiles, rows) } else { profile_csv(&profiles) };
        replace_text(path, &text)?;
    }
    let solved = rows.iter().filter(|row| row.solution.converged).count();
    console.event("done", json!({ "solutions": rows.len(), "converged": solved }));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn problems_with_equal_stems_have_their_extension() {
        let files = ["d/a.h5", "d/a.hdf5", "d/b.h5"].map(PathBuf::from);
        assert_eq!(files.each_ref().map(|f| problem_name(f, &files)), ["a.h5", "a.hdf5", "b"]);
    }
}
