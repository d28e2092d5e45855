//! Published friction-contact problems: what is written is read, what is read is solved.

use crate::left_out;
use ballast::math::Vec3;
use ballast::nlgs::assembled_problem::AssembledProblem;
use ballast::nlgs::solution::{Method, Solution, SolutionSettings, solve};
use ballast_hdf5::fclib::{Storage, read, write_local, write_solution};
use hdf5::File;
use std::path::{Path, PathBuf};

const STORAGES: [Storage; 3] = [Storage::Rows, Storage::Columns, Storage::Triplets];

/// Two contacts, `W` not symmetric and without the block (1, 0).
pub fn small() -> AssembledProblem {
    let mut entries: Vec<_> = (0..6).map(|i| (i, i, 2.0 + i as f64)).collect();
    entries.extend([(0, 3, 0.5), (0, 4, -0.25), (2, 5, 0.125), (1, 0, 0.1)]);
    let q = vec![Vec3::new(-1.0, 0.4, 0.0), Vec3::new(-0.5, 0.0, 2.0)];
    AssembledProblem::from_entries(entries, q, vec![0.3, 0.5]).unwrap()
}

pub fn grain_pile() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/GrainPile500-nc818.hdf5")
}

fn solved(problem: &AssembledProblem, method: Method, tolerance: f64) -> Solution {
    let solution =
        solve(problem, None, &SolutionSettings { method, tolerance, max_sweeps: 50_000 });
    assert!(solution.converged, "{method:?} {tolerance:e}: {:?}", solution.errors);
    assert!(solution.errors.abh <= tolerance);
    solution
}

pub fn put<T: hdf5::H5Type>(file: &File, name: &str, values: &[T]) {
    if file.link_exists(name) {
        file.unlink(name).unwrap();
    }
    let builder = file.new_dataset::<T>().with_lcpl(|p| p.create_intermediate_group(true));
    builder.shape(values.len()).create(name).unwrap().write_raw(values).unwrap();
}

pub fn edit(path: &Path) -> File {
    File::open_rw(path).unwrap()
}

#[test]
fn each_storage_of_a_matrix_gives_the_same_problem() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("problem.hdf5");
    for storage in STORAGES {
        write_local(&path, &small(), storage).unwrap();
        let problem = read(&path).unwrap();
        assert_eq!(problem.local, small(), "{storage:?}");
        assert!(problem.global.is_none() && problem.solution.is_none() && problem.guess.is_none());
    }
    // All blocks and no symmetry: rows taken for columns would show.
    let pile = read(grain_pile()).unwrap().local;
    for storage in STORAGES {
        write_local(&path, &pile, storage).unwrap();
        assert_eq!(read(&path).unwrap().local, pile, "{storage:?}");
    }
}

#[test]
fn triplets_hold_the_column_in_p_and_the_row_in_i() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("problem.hdf5");
    write_local(&path, &small(), Storage::Triplets).unwrap();
    let numbers = |name: &str| -> Vec<i32> {
        edit(&path).dataset(&format!("fclib_local/W/{name}")).unwrap().read_raw().unwrap()
    };
    let (p, i, nz) = (numbers("p"), numbers("i"), numbers("nz"));
    assert_eq!((p.len(), i.len(), nz[0]), (10, 10, 10));
    assert!((0..10).any(|k| (i[k], p[k]) == (0, 4)));
    assert!(!(0..10).any(|k| (i[k], p[k]) == (4, 0)));
}

#[test]
fn room_that_is_not_used_is_no_part_of_the_matrix() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("problem.hdf5");
    for storage in STORAGES {
        write_local(&path, &small(), storage).unwrap();
        let file = edit(&path);
        // More claimed than there is, as published files do,
        put(&file, "fclib_local/W/nzmax", &[5000_i32]);
        // and more there than is used.
        let mut x: Vec<f64> = file.dataset("fclib_local/W/x").unwrap().read_raw().unwrap();
        let mut i: Vec<i32> = file.dataset("fclib_local/W/i").unwrap().read_raw().unwrap();
        x.extend([7.0; 3]);
        i.extend([-1; 3]);
        put(&file, "fclib_local/W/x", &x);
        put(&file, "fclib_local/W/i", &i);
        file.close().unwrap();
        assert_eq!(read(&path).unwrap().local, small(), "{storage:?}");
    }
}

#[test]
fn whole_numbers_of_64_bits_and_compressed_data_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("problem.hdf5");
    write_local(&path, &small(), Storage::Rows).unwrap();
    let file = edit(&path);
    for part in ["m", "n", "nz", "p", "i"] {
        let name = format!("fclib_local/W/{part}");
        let values: Vec<i32> = file.dataset(&name).unwrap().read_raw().unwrap();
        put(&file, &name, &values.into_iter().map(i64::from).collect::<Vec<_>>());
    }
    file.close().unwrap();
    assert_eq!(read(&path).unwrap().local, small());
    // Without a lock, as other tests have it open: the library allows no mixture in one process.
    let options = File::with_options().with_fapl(|p| p.file_locking(false)).clone();
    let pile = options.open(grain_pile()).unwrap();
    assert!(pile.dataset("fclib_local/W/x").unwrap().is_chunked(), "this file is compressed");
}

#[test]
fn the_global_form_gives_the_local_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("global.hdf5");
    global_file(&path);
    let problem = read(&path).unwrap();
    // One contact of a grain of mass 2 on one of mass 4: W = 1/2 + 1/4.
    let w = problem.local.diagonal[0];
    assert!(
        (0..9).all(|k| (w[(k / 3, k % 3)] - if k % 4 == 0 { 0.75 } else { 0.0 }).abs() < 1e-15)
    );
    // Impulses f of weight on the upper grain, and w.
    assert!((problem.local.q[0] - Vec3::new(-0.5, 0.25, 0.1)).norm() < 1e-15);
    let solution = solved(&problem.local, Method::Auto, 1e-10);
    let out = folder.path().join("solved.hdf5");
    write_solution(&path, &out, &problem, &solution.impulse).unwrap();
    let v: Vec<f64> = edit(&out).dataset("solution/v").unwrap().read_raw().unwrap();
    let r = solution.impulse[0];
    assert!((v[0] - (-1.0 + r.x) / 2.0).abs() < 1e-14 && (v[3] + r.x / 4.0).abs() < 1e-14);
}

/// Two grains of three degrees of freedom each, one contact, all matrices as triplets.
pub fn global_file(path: &Path) {
    let file = File::create(path).unwrap();
    let group = |name: &str, part: &str| format!("fclib_global/{name}/{part}");
    let matrix = |name: &str, size: [i32; 2], entries: &[(i32, i32, f64)]| {
        put(&file, &group(name, "m"), &size[..1]);
        put(&file, &group(name, "n"), &size[1..]);
        put(&file, &group(name, "nz"), &[entries.len() as i32]);
        put(&file, &group(name, "nzmax"), &[99_i32]);
        put(&file, &group(name, "i"), &entries.iter().map(|e| e.0).collect::<Vec<_>>());
        put(&file, &group(name, "p"), &entries.iter().map(|e| e.1).collect::<Vec<_>>());
        put(&file, &group(name, "x"), &entries.iter().map(|e| e.2).collect::<Vec<_>>());
    };
    let mass: Vec<_> = (0..6).map(|k| (k, k, if k < 3 { 2.0 } else { 4.0 })).collect();
    let h: Vec<_> = (0..6).map(|k| (k, k % 3, if k < 3 { 1.0 } else { -1.0 })).collect();
    matrix("M", [6, 6], &mass);
    matrix("H", [6, 3], &h);
    put(&file, "fclib_global/spacedim", &[3_i32]);
    put(&file, "fclib_global/vectors/f", &[-1.0, 0.5, 0.0, 0.0, 0.0, 0.0]);
    put(&file, "fclib_global/vectors/w", &[0.0, 0.0, 0.1]);
    put(&file, "fclib_global/vectors/mu", &[0.5]);
    file.close().unwrap();
}

#[test]
fn a_solution_is_stored_in_a_copy_and_read_again() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("solved.hdf5");
    let before = std::fs::read(grain_pile()).unwrap();
    let problem = read(grain_pile()).unwrap();
    let solution = solved(&problem.local, Method::Auto, 1e-4);
    write_solution(grain_pile(), &out, &problem, &solution.impulse).unwrap();
    assert_eq!(std::fs::read(grain_pile()).unwrap(), before);
    let again = read(&out).unwrap();
    assert_eq!(again.local, problem.local);
    assert_eq!(again.solution.as_ref().unwrap(), &solution.impulse);
    // Once more, over itself: the solution is replaced.
    let nothing = vec![Vec3::zeros(); problem.local.contact_count()];
    write_solution(&out, &out, &again, &nothing).unwrap();
    let again = read(&out).unwrap();
    assert_eq!(again.solution.unwrap(), nothing);
    let u: Vec<f64> = edit(&out).dataset("solution/u").unwrap().read_raw().unwrap();
    assert_eq!(u[..3], [problem.local.q[0].x, problem.local.q[0].y, problem.local.q[0].z]);
}

#[test]
fn the_grain_pile_is_solved_as_the_law_of_contact_says() {
    let problem = read(grain_pile()).unwrap().local;
    let asymmetry = (0..problem.contact_count())
        .flat_map(|i| (problem.row_starts[i]..problem.row_starts[i + 1]).map(move |e| (i, e)))
        .filter(|&(i, e)| {
            let j = problem.columns[e] as usize;
            let row = problem.row_starts[j]..problem.row_starts[j + 1];
            let back = row.clone().find(|&k| problem.columns[k] as usize == i);
            back.is_none_or(|k| {
                (problem.blocks[k].transpose() - problem.blocks[e]).norm()
                    > 1e-4 * problem.blocks[e].norm()
            })
        })
        .count();
    assert!(asymmetry > 0, "the file has a W that is not symmetric");
    let size = problem.q.iter().map(|q| q.norm_squared()).sum::<f64>().sqrt();
    for (method, tolerance) in
        [(Method::Nlgs, 1e-4), (Method::Auto, 1e-4), (Method::Auto, 1e-6), (Method::Anderson, 1e-6)]
    {
        let solution = solved(&problem, method, tolerance);
        // The law of each contact, without the map that the error is made of.
        for (i, r) in solution.impulse.iter().enumerate() {
            let (u, mu) = (problem.relative_velocity(i, &solution.impulse), problem.friction[i]);
            let (pull, room) = (r.y.hypot(r.z), 2.0 * tolerance * size);
            assert!(pull <= mu * r.x * (1.0 + 1e-9), "contact {i} is outside its cone: {r}");
            assert!(u.x >= -room && r.x.min(u.x) <= room, "contact {i}: {u} with {r}");
            let slides = u.y.hypot(u.z) > room;
            assert!(!slides || pull >= mu * r.x - room, "contact {i} slides too early: {u}, {r}");
        }
    }
}

/// The collections' own problems, where they are: they do not belong to this project.
#[test]
fn problems_of_the_collections_are_solved() {
    let cases = std::env::var("BALLAST_CASES").map_or_else(
        |_| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/cases"),
        PathBuf::from,
    );
    let folder = cases.join("fclib");
    if !folder.is_dir() {
        left_out(&format!("no problems in {} (BALLAST_CASES names the folder)", folder.display()));
        return;
    }
    for (name, contacts) in [
        ("Box_Stacks-i0122-82-5", 82),
        ("BoxesStack_fclib_local_problem_test", 48),
        ("Capsules-i125-1213", 286),
        ("Confeti-ex13-Fc3D-SBM", 107),
        ("KaplasTower-i1061-4", 570),
        ("LMGC_100_PR_PerioBox-i00361-60-03000", 60),
        ("OneObject-i100000-499", 24),
        ("Spheres-i099-356-679", 356),
    ] {
        let problem = read(folder.join(name).with_extension("hdf5")).unwrap().local;
        assert_eq!(problem.contact_count(), contacts, "{name}");
        for tolerance in [1e-4, 1e-6] {
            let settings = SolutionSettings { method: Method::Auto, tolerance, max_sweeps: 20_000 };
            let solution = solve(&problem, None, &settings);
            assert!(solution.converged, "{name} to {tolerance:e}: {:?}", solution.errors);
        }
    }
}
