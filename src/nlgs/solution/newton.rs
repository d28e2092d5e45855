//! Regularised semismooth Newton method for the function of Alart and Curnier (T-33).

use crate::math::{Mat3, Vec3};
use crate::nlgs::assembled_problem::AssembledProblem;
use nalgebra::{DMatrix, DVector};

/// Maximum number of unknowns of a dense system; larger ones take minutes.
const MAX_UNKNOWNS: usize = 4500;

/// Number of products in the solution of a dense system; infinite above the maximum size.
pub(super) fn cost(unknowns: usize) -> f64 {
    if unknowns > MAX_UNKNOWNS { f64::INFINITY } else { 2.0 / 3.0 * (unknowns as f64).powi(3) }
}

/// Contact status at the current impulses and velocities.
#[derive(Debug, Clone, Copy, PartialEq)]
enum ContactStatus {
    Open,
    Stick,
    /// Slip: direction of the tangential impulse, and `κ = μ r_n / ‖x_T‖`.
    Slip([f64; 2], f64),
}

/// Linear system of one Newton step for the closed contacts.
pub(super) struct NewtonSystem<'a> {
    problem: &'a AssembledProblem,
    impulse: &'a [Vec3],
    velocity: Vec<Vec3>,
    status: Vec<ContactStatus>,
    closed: Vec<usize>,
    /// Index of each contact among the closed ones.
    place: Vec<Option<usize>>,
}

impl<'a> NewtonSystem<'a> {
    pub fn new(problem: &'a AssembledProblem, impulse: &'a [Vec3]) -> Self {
        let nc = impulse.len();
        let velocity: Vec<Vec3> = (0..nc).map(|c| problem.relative_velocity(c, impulse)).collect();
        let status: Vec<ContactStatus> =
            (0..nc).map(|c| status(problem, c, &impulse[c], &velocity[c])).collect();
        let closed: Vec<usize> = (0..nc).filter(|&c| status[c] != ContactStatus::Open).collect();
        let mut place = vec![None; nc];
        for (k, &c) in closed.iter().enumerate() {
            place[c] = Some(k);
        }
        Self { problem, impulse, velocity, status, closed, place }
    }

    /// Number of unknowns.
    pub fn size(&self) -> usize {
        3 * self.closed.len()
    }

    /// Returns the change of the impulses `[nc]`; `None` if the system is singular or too large.
    pub fn step(&self, regularisation: f64) -> Option<Vec<Vec3>> {
        let n = self.size();
        if n > MAX_UNKNOWNS {
            return None;
        }
        let mut matrix = DMatrix::zeros(n, n);
        let mut right = DVector::zeros(n);
        for (k, &c) in self.closed.iter().enumerate() {
            self.rows(k, c, regularisation, &mut matrix, &mut right);
        }
        let x = matrix.lu().solve(&right).filter(|x| x.iter().all(|x| x.is_finite()))?;
        let change = |c: usize| match self.place[c] {
            None => -self.impulse[c],
            Some(k) => Vec3::new(x[3 * k], x[3 * k + 1], x[3 * k + 2]),
        };
        Some((0..self.impulse.len()).map(change).collect())
    }

    /// Writes the three equations of the closed contact `c`, which is number `k` of them.
    ///
    /// With `A` and `B` the derivatives by the impulse and by the velocity: `A Δr + B W Δr`, where the
    /// changes of open contacts are known.
    fn rows(
        &self,
        k: usize,
        c: usize,
        regularisation: f64,
        matrix: &mut DMatrix<f64>,
        right: &mut DVector<f64>,
    ) {
        let problem = self.problem;
        let (by_impulse, by_velocity, defect) = self.derivatives(c);
        let mut known = Vec3::zeros();
        for e in problem.row_starts[c]..problem.row_starts[c + 1] {
            let other = problem.columns[e] as usize;
            let Some(place) = self.place[other] else {
                known -= problem.blocks[e] * self.impulse[other];
                continue;
            };
            let mut block = by_velocity * problem.blocks[e];
            if other == c {
                let own = regularisation * problem.diagonal[c].trace() / 3.0;
                block += by_impulse + by_velocity * own;
            }
            matrix.view_mut((3 * k, 3 * place), (3, 3)).copy_from(&block);
        }
        right.rows_mut(3 * k, 3).copy_from(&(defect - by_velocity * known));
    }

    /// Returns the derivatives of the function by impulse and velocity, and its negative value, in m/s.
    fn derivatives(&self, c: usize) -> (Mat3, Mat3, Vec3) {
        let ContactStatus::Slip([t, s], kappa) = self.status[c] else {
            return (Mat3::zeros(), Mat3::identity(), -self.velocity[c]);
        };
        let (r, mu) = (self.impulse[c], self.problem.friction[c]);
        // Projector perpendicular to the direction of slip.
        let across = Mat3::new(0.0, 0.0, 0.0, 0.0, 1.0 - t * t, -t * s, 0.0, -t * s, 1.0 - s * s);
        let tangential = Mat3::new(0.0, 0.0, 0.0, -mu * t, 1.0, 0.0, -mu * s, 0.0, 1.0);
        let by_impulse = (tangential - across * kappa) * (self.problem.diagonal[c].trace() / 3.0);
        let by_velocity = across * kappa + Mat3::from_diagonal(&Vec3::x());
        let excess = Vec3::new(0.0, r.y - mu * r.x * t, r.z - mu * r.x * s);
        let defect = excess * (-self.problem.diagonal[c].trace() / 3.0)
            - Vec3::new(self.velocity[c].x, 0.0, 0.0);
        (by_impulse, by_velocity, defect)
    }
}

fn status(problem: &AssembledProblem, c: usize, r: &Vec3, u: &Vec3) -> ContactStatus {
    let x = r - u * (3.0 / problem.diagonal[c].trace());
    let (mu, length) = (problem.friction[c], x.yz().norm());
    if x.x <= 0.0 {
        ContactStatus::Open
    } else if length <= mu * x.x {
        ContactStatus::Stick
    } else {
        ContactStatus::Slip([x.y / length, x.z / length], mu * r.x.max(0.0) / length)
    }
}
