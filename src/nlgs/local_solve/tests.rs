use super::*;
use crate::lanes::Portable;
use crate::math::{Mat3, Vec3};
use crate::nlgs::contact_law;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Eight problems as rows of the kernel, with velocities and impulses at the visit.
struct Problems {
    rows: LawRows,
    u: [[f64; 8]; 3],
    r: [[f64; 8]; 3],
}

impl Problems {
    fn random(rng: &mut Pcg64) -> Self {
        let mut problems = Self { rows: LawRows::EMPTY, u: [[0.0; 8]; 3], r: [[0.0; 8]; 3] };
        let power = |rng: &mut Pcg64, low: f64, high: f64| 10_f64.powf(rng.random_range(low..high));
        for i in 0..8 {
            let mass = power(rng, -4.0, 2.0);
            let rows = &mut problems.rows;
            rows.normal_mass[i] = mass as f32;
            let strong = power(rng, -3.0, 1.0);
            rows.coupling[0][i] = (strong * rng.random_range(-1.0..1.0)) as f32;
            rows.coupling[1][i] = (strong * rng.random_range(-1.0..1.0)) as f32;
            rows.tangent_mass[i] = (mass * power(rng, -2.0, 2.0)) as f32;
            rows.tangent_ratio[i] = power(rng, -4.0, 0.0) as f32;
            rows.friction[i] =
                if rng.random_range(0..20) == 0 { 0.0 } else { power(rng, -3.0, 1.0) as f32 };
            rows.slip[i] = if rng.random() { 1.0 } else { power(rng, -8.0, 0.0) as f32 };
            let (speed, load) = (power(rng, -8.0, 1.0), power(rng, -8.0, 1.0) * mass);
            for k in 0..3 {
                problems.u[k][i] = speed * rng.random_range(-1.0..1.0);
                problems.r[k][i] = load * rng.random_range(-1.0..1.0);
            }
        }
        problems
    }

    fn visit(&self) -> LocalSolve<Portable> {
        let law = LawLanes::load(&self.rows);
        let [u, r] = [self.u, self.r].map(|rows| rows.map(|x| Portable::load(&x)));
        LocalSolve::start(&law, approach(&law, &u, &r), &u, &r, &self.rows.slip)
    }

    fn end(&mut self, visit: LocalSolve<Portable>) -> [Vec3; 8] {
        let law = LawLanes::load(&self.rows);
        let rows = visit.finish(&law, &mut self.rows.slip).map(|lanes| {
            let mut row = [0.0; 8];
            lanes.store(&mut row);
            row
        });
        std::array::from_fn(|i| Vec3::new(rows[0][i], rows[1][i], rows[2][i]))
    }

    fn solve(&mut self) -> [Vec3; 8] {
        let mut visits = [self.visit()];
        solve_slip(&mut visits);
        let [visit] = visits;
        self.end(visit)
    }

    /// Returns `W_αα`, `u`, `r` and μ of a lane.
    fn lane(&self, i: usize) -> (Mat3, Vec3, Vec3, f64) {
        let rows = &self.rows;
        let f = |row: &[f32; 8]| row[i] as f64;
        let k = Vec3::new(1.0, f(&rows.coupling[0]), f(&rows.coupling[1]));
        let s = 1.0 / f(&rows.tangent_mass);
        let schur = Vec3::new(0.0, s / f(&rows.tangent_ratio), s);
        let w = k * k.transpose() / f(&rows.normal_mass) + Mat3::from_diagonal(&schur);
        let vector = |rows: &[[f64; 8]; 3]| Vec3::new(rows[0][i], rows[1][i], rows[2][i]);
        (w, vector(&self.u), vector(&self.r), f(&rows.friction))
    }
}

/// Returns the violation of Signorini-Coulomb by `r`, relative to the terms of its sums, and the status of the contact.
fn violation(w: &Mat3, u: &Vec3, before: &Vec3, mu: f64, r: &Vec3) -> (f64, &'static str) {
    let delta = r - before;
    let after = u + w * delta;
    // Scale of rounding: impulses and velocities in the sums.
    let size = u.abs() + w.abs() * (before.abs() + r.abs());
    let speed = size.amax();
    if *r == Vec3::zeros() {
        return ((-after.x).max(0.0) / speed, "open");
    }
    let (tangential, bound) = (r.y.hypot(r.z), mu * r.x);
    let mut worst = after.x.abs() / speed;
    worst = worst.max((-r.x).max(0.0) / r.norm());
    if tangential < bound * (1.0 - 1e-12) {
        return (worst.max(after.y.hypot(after.z) / speed), "stick");
    }
    worst = worst.max((tangential - bound) / r.norm());
    // u_T = -λ r_T with λ >= 0.
    let sliding = after.y.hypot(after.z);
    let opposed = (after.y * r.y + after.z * r.z) + sliding * tangential;
    let parallel = after.y * r.z - after.z * r.y;
    if tangential > 0.0 {
        worst = worst.max(parallel.abs() / tangential / speed);
        worst = worst.max(opposed / tangential / speed);
    }
    (worst, "slip")
}

#[test]
fn the_contact_law_holds_on_a_hundred_thousand_random_problems() {
    let mut rng = Pcg64::seed_from_u64(17);
    let mut counts = std::collections::BTreeMap::new();
    let mut worst = 0.0_f64;
    for _ in 0..12_500 {
        let mut problems = Problems::random(&mut rng);
        let solved = problems.solve();
        for (i, r) in solved.iter().enumerate() {
            let (w, u, before, mu) = problems.lane(i);
            assert!(r.iter().all(|x| x.is_finite()), "{w} {u} {before} {mu}: {r}");
            assert!(problems.rows.slip[i] >= 0.0 && problems.rows.slip[i] <= 1.0);
            let (violation, kind) = violation(&w, &u, &before, mu, r);
            *counts.entry(kind).or_insert(0) += 1;
            assert!(violation < 1e-12, "{kind} {violation:e}: {w} {u} {before} {mu}: {r}");
            worst = worst.max(violation);
        }
    }
    println!("{counts:?}, worst {worst:e}");
    assert!(counts.len() == 3 && counts.values().all(|&n| n > 5_000), "{counts:?}");
}

#[test]
fn two_visits_at_once_end_as_each_alone() {
    let mut rng = Pcg64::seed_from_u64(31);
    for _ in 0..2_000 {
        let mut two = [Problems::random(&mut rng), Problems::random(&mut rng)];
        let mut visits = two.each_ref().map(Problems::visit);
        solve_slip(&mut visits);
        for (problems, visit) in two.iter_mut().zip(visits) {
            let slip = problems.rows.slip;
            let (at_once, ended) = (problems.end(visit), problems.rows.slip);
            problems.rows.slip = slip;
            assert_eq!((problems.solve(), problems.rows.slip), (at_once, ended));
        }
    }
}

#[test]
fn the_scalar_law_finds_the_same_impulse_where_it_is_unique() {
    let mut rng = Pcg64::seed_from_u64(19);
    for _ in 0..5_000 {
        let mut problems = Problems::random(&mut rng);
        let rows = &mut problems.rows;
        for i in 0..8 {
            // Uniqueness: μ ‖k‖ below one, weakly stretched S.
            let limit = 0.5 / rows.friction[i].max(0.01);
            rows.coupling[0][i] = rows.coupling[0][i].clamp(-limit, limit);
            rows.coupling[1][i] = rows.coupling[1][i].clamp(-limit, limit);
            rows.tangent_ratio[i] = rows.tangent_ratio[i].max(0.2);
        }
        let solved = problems.solve();
        for (i, r) in solved.iter().enumerate() {
            let (w, u, before, mu) = problems.lane(i);
            let scalar = contact_law::solve(&w, &(u - w * before), mu);
            let inverse = w.try_inverse().unwrap();
            let size = before.norm() + scalar.norm() + (inverse * u).norm();
            let apart = (scalar - r).norm() / size;
            assert!(apart < 1e-10, "{apart:e}: {w} {u} {before} {mu}: {r} {scalar}");
        }
    }
}

#[test]
fn eight_projections_are_those_of_one() {
    let mut rng = Pcg64::seed_from_u64(29);
    for _ in 0..2_000 {
        let values = [-2.0, -0.5, 0.0, 0.5, 2.0];
        let mut row = || [0; 8].map(|_| values[rng.random_range(0..5)]);
        let (mu, rows) = ([0.0, 0.0, 0.3, 0.3, 1.0, 1.0, 2.0, 1e3], [row(), row(), row()]);
        let lanes = project(Portable::load(&mu), &rows.map(|row| Portable::load(&row)));
        let lanes = lanes.map(|lane| {
            let mut row = [0.0; 8];
            lane.store(&mut row);
            row
        });
        for i in 0..8 {
            let [x, found] = [rows, lanes].map(|r| Vec3::new(r[0][i], r[1][i], r[2][i]));
            let apart = (found - crate::math::cone::project(&x, mu[i])).norm();
            assert!(apart < 1e-15 * (1.0 + x.norm()), "{} {x}: {found}", mu[i]);
        }
    }
}

#[test]
fn extreme_values_give_finite_impulses() {
    let extremes = [0.0, 1e-300, 1e-40, 1e-12, 1.0, 1e12, -1e-300, -1e-12, -1.0, -1e12];
    let mut rng = Pcg64::seed_from_u64(23);
    for _ in 0..20_000 {
        let mut problems = Problems::random(&mut rng);
        for i in 0..8 {
            for k in 0..3 {
                problems.u[k][i] = extremes[rng.random_range(0..extremes.len())];
                problems.r[k][i] = extremes[rng.random_range(0..extremes.len())];
            }
            problems.rows.friction[i] = [0.0, 1e-6, 0.5, 1e2][rng.random_range(0..4)];
            problems.rows.slip[i] = [0.0, 1e-30, 0.5, 1.0][rng.random_range(0..4)];
        }
        for (i, r) in problems.solve().iter().enumerate() {
            let (w, u, before, _) = problems.lane(i);
            assert!(r.iter().all(|x| x.is_finite()), "{u:?} {before:?} {r:?}");
            let size = before.norm() + (w.try_inverse().unwrap() * u).norm();
            assert!(r.x >= -1e-12 * size, "{u:?} {before:?} {r:?}");
        }
    }
}
