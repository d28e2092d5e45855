//! Friction problem in the form `W`, `q` and `μ`, with the Delassus operator in block rows.
//!
//! [`super::solution`] solves it, and FCLIB files store it.
//!
//! Reads: entries of the operator, or a [`LocalProblem`]. Cost: a sweep and a natural map read every block once.
//! Contract: unusable entries are refused, with their place.

use super::contact_law;
use super::reference::MatrixFreeSolver;
use crate::error::{Error, Result};
use crate::local_problem::LocalProblem;
use crate::math::{Mat3, Vec3, cone, widen};
use std::ops::RangeInclusive;

/// Friction problem `u = W r + q`, with `W` in rows of 3 x 3 blocks (FCLIB's local problem).
#[derive(Debug, Clone, Default, PartialEq)]
pub struct AssembledProblem {
    /// Start of each block row `[nc + 1]`.
    pub row_starts: Vec<usize>,
    /// Block columns, increasing in each row.
    pub columns: Vec<u32>,
    /// Blocks with rows and columns (n, t, s), 1/kg.
    pub blocks: Vec<Mat3>,
    /// Diagonal block of each contact `[nc]`, with which its contact law is solved.
    pub diagonal: Vec<Mat3>,
    /// Relative velocities at zero impulses `[nc]`, m/s.
    pub q: Vec<Vec3>,
    /// Coulomb's μ `[nc]`.
    pub friction: Vec<f64>,
}

/// Maximum friction coefficient; above it, rounding dominates the errors.
pub const MAX_FRICTION: f64 = 1000.0;

/// Range of the largest component of `q`, m/s, unless it is zero; outside, squares in the errors underflow or overflow.
const VELOCITY_RANGE: RangeInclusive<f64> = 1e-100..=1e100;

/// Errors of impulses in the scalings of the literature.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NaturalMapErrors {
    /// Error of Acary, Brémond and Huber: `‖F‖/‖q‖` with ρ = 1 in the problem's units.
    pub abh: f64,
    /// Error of Siconos: `‖F‖/max(‖q‖, ‖r‖, ‖u‖)`, ρ = 1.
    pub siconos: f64,
    /// Error of FCLIB: `‖F‖/(1 + sqrt ‖q‖)`, ρ = 1.
    pub fclib: f64,
    /// Unit-free error `‖F‖/‖r‖` with `ρ_c = 3/tr W_cc`.
    pub unit_free: f64,
}

impl AssembledProblem {
    /// Creates a problem from scalar entries (row, column, value); components are `3 contact + (n, t, s)`.
    ///
    /// Entries of the same place are added up.
    ///
    /// # Errors
    /// [`Error::Model`] for indices out of range, values that are not finite, friction that is negative or above
    /// [`MAX_FRICTION`], contacts with `W_nn` not above zero, and `q` whose squares underflow or overflow.
    pub fn from_entries(
        entries: impl IntoIterator<Item = (usize, usize, f64)>,
        q: Vec<Vec3>,
        friction: Vec<f64>,
    ) -> Result<Self> {
        let nc = q.len();
        if friction.len() != nc {
            return Err(invalid("mu", format!("{nc} values"), friction.len().to_string()));
        }
        let usable = |c: usize| {
            q[c].iter().all(|x| x.is_finite()) && (0.0..=MAX_FRICTION).contains(&friction[c])
        };
        if let Some(c) = (0..nc).find(|&c| !usable(c)) {
            let found = format!("{:?} and {} at contact {c}", q[c], friction[c]);
            let expected = format!("finite q, mu from 0 to {MAX_FRICTION}");
            return Err(invalid("q and mu", expected, found));
        }
        let largest = (0..nc).max_by(|&a, &b| q[a].amax().total_cmp(&q[b].amax()));
        if let Some(c) =
            largest.filter(|&c| q[c].amax() > 0.0 && !VELOCITY_RANGE.contains(&q[c].amax()))
        {
            let [least, most] = [VELOCITY_RANGE.start(), VELOCITY_RANGE.end()];
            let expected = format!("zero, or a largest component from {least:e} to {most:e} m/s");
            return Err(invalid("q", expected, format!("{:e} at contact {c}", q[c].amax())));
        }
        let mut scalars = Vec::new();
        for (row, column, value) in entries {
            if row >= 3 * nc || column >= 3 * nc || !value.is_finite() {
                let found = format!("{value} at ({row}, {column})");
                return Err(invalid("W", format!("finite, {0} x {0}", 3 * nc), found));
            }
            scalars.push((row / 3, column / 3, 3 * (row % 3) + column % 3, value));
        }
        scalars.sort_by_key(|&(row, column, place, _)| (row, column, place));
        let mut assembled = Self { q, friction, ..Self::default() };
        assembled.diagonal = vec![Mat3::zeros(); nc];
        let mut scalars = scalars.into_iter().peekable();
        for row in 0..nc {
            assembled.row_starts.push(assembled.columns.len());
            while let Some(&(_, column, _, _)) = scalars.peek().filter(|s| s.0 == row) {
                let mut block = Mat3::zeros();
                while let Some((.., place, value)) =
                    scalars.next_if(|s| (s.0, s.1) == (row, column))
                {
                    block[(place / 3, place % 3)] += value;
                }
                if column == row {
                    assembled.diagonal[row] = block;
                }
                assembled.columns.push(column as u32);
                assembled.blocks.push(block);
            }
        }
        assembled.row_starts.push(assembled.columns.len());
        if let Some(c) = assembled.diagonal.iter().position(|w| w.m11.is_nan() || w.m11 <= 0.0) {
            let found = format!("{} at contact {c}", assembled.diagonal[c].m11);
            return Err(invalid("W", "W_nn above zero", found));
        }
        Ok(assembled)
    }

    /// Assembles `W = Hᵀ M⁻¹ H` and `q = Hᵀ V_free + c` of a local problem.
    pub fn from_problem(problem: &LocalProblem) -> Self {
        let nc = problem.contacts.len();
        let mut free = MatrixFreeSolver::new(problem);
        free.lines.clone_from(&problem.lines);
        free.impulse.fill(Vec3::zeros());
        let mut touching: Vec<Vec<u32>> = vec![Vec::new(); problem.body_count()];
        for i in 0..nc {
            for (grain, ..) in free.sides(i) {
                touching[grain].push(i as u32);
            }
        }
        let mut assembled = Self::default();
        for i in 0..nc {
            assembled.row_starts.push(assembled.columns.len());
            let contact = &problem.contacts[i];
            let mut row: Vec<(u32, Mat3)> = Vec::new();
            for (grain, arms, sign) in free.sides(i) {
                let inverse_mass = problem.lines[grain].inverse_mass();
                for &j in &touching[grain] {
                    let other = &problem.contacts[j as usize];
                    for (_, other_arms, other_sign) in
                        free.sides(j as usize).filter(|side| side.0 == grain)
                    {
                        let (axes, other_axes) = (contact.axes(), other.axes());
                        let block = Mat3::from_fn(|k, l| {
                            inverse_mass * axes[k].dot(&other_axes[l])
                                + widen(&arms[k]).dot(&widen(&other_arms[l]))
                        }) * (sign * other_sign);
                        row.push((j, block));
                    }
                }
            }
            let [normal, tangential] = contact.compliance.map(f64::from);
            let springs = Vec3::new(normal, tangential, tangential);
            row.push((i as u32, Mat3::from_diagonal(&springs)));
            row.sort_by_key(|&(j, _)| j);
            for (j, block) in row {
                let start = assembled.row_starts[i];
                match (assembled.columns[start..].last(), assembled.blocks.last_mut()) {
                    (Some(&last), Some(sum)) if last == j => *sum += block,
                    _ => {
                        assembled.columns.push(j);
                        assembled.blocks.push(block);
                    }
                }
            }
            assembled.diagonal.push(contact.law_block());
            assembled.q.push(free.relative_velocity(i));
            assembled.friction.push(contact.friction as f64);
        }
        assembled.row_starts.push(assembled.columns.len());
        assembled
    }

    /// Number of contacts.
    pub fn contact_count(&self) -> usize {
        self.q.len()
    }

    /// Relative velocity `u = W r + q` at contact `i`, m/s.
    pub fn relative_velocity(&self, i: usize, impulse: &[Vec3]) -> Vec3 {
        let row = self.row_starts[i]..self.row_starts[i + 1];
        (self.columns[row.clone()].iter().zip(&self.blocks[row]))
            .fold(self.q[i], |u, (&j, block)| u + block * impulse[j as usize])
    }

    /// Visits the contacts in the given order.
    pub fn sweep(
        &self,
        impulse: &mut [Vec3],
        order: impl IntoIterator<Item = u32>,
        relaxation: f64,
    ) {
        for i in order {
            let i = i as usize;
            let w = &self.diagonal[i];
            let b = self.relative_velocity(i, impulse) - w * impulse[i];
            let solved = contact_law::solve(w, &b, self.friction[i]);
            impulse[i] += contact_law::relaxed_change(&impulse[i], &solved, relaxation);
        }
    }

    /// Computes the natural map `F_c = r_c - P_K(r_c - ρ (u_c + μ ‖u_T‖ n))` (T-10), in all scalings (T-31).
    pub fn natural_map(&self, impulse: &[Vec3]) -> NaturalMapErrors {
        let mut sums = [0.0_f64; 5];
        for i in 0..self.contact_count() {
            let (r, u, mu) = (impulse[i], self.relative_velocity(i, impulse), self.friction[i]);
            let shifted = u + Vec3::x() * (mu * u.yz().norm());
            let map = |rho: f64| (r - cone::project(&(r - shifted * rho), mu)).norm_squared();
            let terms = [
                map(1.0),
                map(3.0 / self.diagonal[i].trace()),
                self.q[i].norm_squared(),
                r.norm_squared(),
                u.norm_squared(),
            ];
            for (sum, term) in sums.iter_mut().zip(terms) {
                *sum += term;
            }
        }
        let [f, f_unit_free, q, r, u] = sums.map(f64::sqrt);
        // Zero also where the reference is zero.
        let ratio = |f: f64, whole: f64| if f == 0.0 { 0.0 } else { f / whole };
        NaturalMapErrors {
            abh: ratio(f, q),
            siconos: ratio(f, q.max(r).max(u)),
            fclib: f / (1.0 + q.sqrt()),
            unit_free: ratio(f_unit_free, r),
        }
    }
}

/// Error for an unusable entry of a problem.
pub(super) fn invalid(place: &str, expected: impl Into<String>, found: String) -> Error {
    Error::Model { place: format!("friction problem, {place}"), expected: expected.into(), found }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Entries of two coupled contacts, with columns in the order of triplets.
    fn entries() -> Vec<(usize, usize, f64)> {
        let mut entries: Vec<_> = (0..6).rev().map(|i| (i, i, 2.0 + i as f64)).collect();
        // Not symmetric, and one value in two parts.
        entries.extend([(0, 3, 0.5), (3, 0, 0.25), (3, 0, 0.125), (1, 0, 0.1)]);
        entries
    }

    #[test]
    fn a_problem_given_by_entries_is_solved() {
        let q = vec![Vec3::new(-1.0, 0.4, 0.0), Vec3::new(-0.5, 0.0, 2.0)];
        let problem = AssembledProblem::from_entries(entries(), q.clone(), vec![0.3, 0.5]).unwrap();
        assert_eq!((problem.blocks.len(), problem.columns.as_slice()), (4, &[0, 1, 0, 1][..]));
        assert_eq!(problem.blocks[2][(0, 0)], 0.375);
        assert_eq!(problem.diagonal[0][(1, 0)], 0.1);
        let mut r = vec![Vec3::zeros(); 2];
        let start = problem.natural_map(&r);
        assert!(start.abh > 0.1 && start.unit_free.is_infinite());
        for _ in 0..60 {
            problem.sweep(&mut r, 0..2, 1.0);
        }
        let end = problem.natural_map(&r);
        assert!(end.abh < 1e-14 && end.siconos < 1e-14 && end.unit_free < 1e-14, "{end:?}");
        assert!(r[0].x > 0.0 && r[1].x > 0.0);
    }

    #[test]
    fn unusable_problems_are_refused_with_their_place() {
        let q = vec![Vec3::zeros(); 2];
        let refused = |entries: Vec<(usize, usize, f64)>, mu: Vec<f64>| {
            AssembledProblem::from_entries(entries, q.clone(), mu).unwrap_err().to_string()
        };
        let with = |entry| [entries(), vec![entry]].concat();
        let mu = vec![0.3; 2];
        assert!(refused(with((6, 0, 1.0)), mu.clone()).contains("(6, 0)"));
        assert!(refused(with((0, 0, f64::NAN)), mu.clone()).contains("NaN at (0, 0)"));
        assert!(refused(vec![(0, 0, 1.0)], mu.clone()).contains("0 at contact 1"));
        assert!(refused(entries(), vec![0.3]).contains("expected 2 values, found 1"));
        assert!(refused(entries(), vec![0.3, -1.0]).contains("-1 at contact 1"));
        let huge = refused(entries(), vec![1e3, 1e10]);
        assert!(huge.contains("mu from 0 to 1000") && huge.contains("at contact 1"), "{huge}");
    }

    #[test]
    fn velocities_whose_squares_underflow_or_overflow_are_refused() {
        let of = |size: f64| {
            let q = vec![Vec3::zeros(), Vec3::new(-size, 1e-3 * size, 0.0)];
            AssembledProblem::from_entries(entries(), q, vec![0.3; 2])
        };
        for size in [1e-200, 1e-101, 1e101, 1e200] {
            let message = of(size).unwrap_err().to_string();
            let expected = "q: expected zero, or a largest component from 1e-100 to 1e100 m/s";
            assert!(message.contains(expected), "{message}");
            assert!(message.ends_with(&format!("found {size:e} at contact 1")), "{message}");
        }
        for size in [0.0, 1e-100, 1.0, 1e100] {
            let errors = of(size).unwrap().natural_map(&[Vec3::zeros(); 2]);
            assert!(errors.abh.is_finite() && (errors.abh > 0.0) == (size > 0.0), "{errors:?}");
        }
    }
}
