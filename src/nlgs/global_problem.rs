//! Friction-contact problems with the bodies' velocities kept: `M v = H r + f`, `u = Hᵀ v + w`.
//!
//! Reads: entries of `M` and `H`. Writes: the problem in impulses alone, [`AssembledProblem`]. Cost: one dense
//! inverse per set of coupled degrees of freedom (a rigid body: six), one product per pair of contacts
//! on the same body. Contract: refuses, before it allocates, what claims more than `MAX_ENTRIES`.

use super::assembled_problem::{AssembledProblem, invalid};
use crate::error::Result;
use crate::math::Vec3;
use nalgebra::{DMatrix, DVector};

/// Degrees of freedom that `M` may couple with each other; a dense inverse is made of them.
const MAX_BODY_DOFS: usize = 600;
/// Scalar entries of `W` before those of the same place are added up; also of all inverses together.
const MAX_ENTRIES: usize = 1 << 25;

/// Global problem `M v = H r + f`, `u = Hᵀ v + w`; `H` is `[ndof, 3 nc]`.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct GlobalProblem {
    /// Entries (row, column, value) of `M` `[ndof, ndof]`; those of the same place add up.
    pub mass: Vec<(usize, usize, f64)>,
    /// Entries of `H`; column `3 contact + (n, t, s)`.
    pub h: Vec<(usize, usize, f64)>,
    /// Impulses on the bodies `[ndof]`.
    pub f: Vec<f64>,
    /// Relative velocities of resting bodies `[nc]`.
    pub w: Vec<Vec3>,
    /// Coulomb's μ `[nc]`.
    pub friction: Vec<f64>,
}

/// Global problem with its mass matrix inverted.
#[derive(Debug, Clone)]
pub struct FactorisedGlobalProblem {
    bodies: Vec<DofBlock>,
    given: GlobalProblem,
}

/// Degrees of freedom that the mass matrix couples, with the inverse of their block.
#[derive(Debug, Clone)]
struct DofBlock {
    dofs: Vec<usize>,
    inverse: DMatrix<f64>,
    /// Columns of `H` on these degrees of freedom, with their parts `[dofs]`.
    columns: Vec<(usize, DVector<f64>)>,
}

impl FactorisedGlobalProblem {
    /// Inverts the mass matrix, block by block.
    ///
    /// Refuses indices out of range, values that are not finite, and a mass matrix that is singular or
    /// couples more than 600 degrees of freedom.
    pub fn new(given: GlobalProblem) -> Result<Self> {
        let (ndof, columns) = (given.f.len(), 3 * given.w.len());
        check_entries("M", &given.mass, ndof, ndof)?;
        check_entries("H", &given.h, ndof, columns)?;
        if let Some(i) = given.f.iter().position(|x| !x.is_finite()) {
            return Err(invalid("f", "finite values", format!("{} at {i}", given.f[i])));
        }
        let (mut bodies, place) = split_blocks(&given)?;
        let mut touching: Vec<_> = given.h.iter().filter(|e| e.2 != 0.0).collect();
        touching.sort_by_key(|e| (place[e.0].0, e.1));
        check_column_entries(&touching, &bodies, &place)?;
        for &&(row, column, value) in &touching {
            let (body, k) = place[row];
            let body = &mut bodies[body];
            if body.columns.last().is_none_or(|c| c.0 != column) {
                body.columns.push((column, DVector::zeros(body.dofs.len())));
            }
            if let Some((_, part)) = body.columns.last_mut() {
                part[k] += value;
            }
        }
        Ok(Self { bodies, given })
    }

    /// Assembles `W = Hᵀ M⁻¹ H` and `q = Hᵀ M⁻¹ f + w` (T-30).
    pub fn assembled(&self) -> Result<AssembledProblem> {
        let count: usize = self.bodies.iter().map(|b| b.columns.len().pow(2)).sum();
        if count > MAX_ENTRIES {
            let expected = format!("at most {MAX_ENTRIES} entries");
            return Err(invalid("W = Hᵀ M⁻¹ H", expected, count.to_string()));
        }
        let mut entries = Vec::with_capacity(count);
        let mut q: Vec<f64> = self.given.w.iter().flat_map(|w| [w.x, w.y, w.z]).collect();
        for body in &self.bodies {
            let free = &body.inverse * body.restrict(&self.given.f);
            for (column, part) in &body.columns {
                q[*column] += part.dot(&free);
                let answer = &body.inverse * part;
                entries.extend(body.columns.iter().map(|(row, p)| (*row, *column, p.dot(&answer))));
            }
        }
        let q = q.as_chunks::<3>().0.iter().map(|c| Vec3::from(*c)).collect();
        AssembledProblem::from_entries(entries, q, self.given.friction.clone())
    }

    /// Computes the velocities of the bodies `v = M⁻¹ (H r + f)` `[ndof]`.
    pub fn velocity(&self, impulse: &[Vec3]) -> Vec<f64> {
        let mut v = vec![0.0; self.given.f.len()];
        for body in &self.bodies {
            let load = (body.columns.iter())
                .fold(body.restrict(&self.given.f), |load, (c, part)| {
                    load + part * impulse[c / 3][c % 3]
                });
            for (dof, value) in body.dofs.iter().zip((&body.inverse * load).iter()) {
                v[*dof] = *value;
            }
        }
        v
    }
}

impl DofBlock {
    fn restrict(&self, whole: &[f64]) -> DVector<f64> {
        DVector::from_iterator(self.dofs.len(), self.dofs.iter().map(|&d| whole[d]))
    }
}

fn check_entries(
    name: &str,
    entries: &[(usize, usize, f64)],
    rows: usize,
    columns: usize,
) -> Result<()> {
    let good = |&(i, j, x): &(usize, usize, f64)| i < rows && j < columns && x.is_finite();
    match entries.iter().find(|e| !good(e)) {
        None => Ok(()),
        Some((i, j, x)) => {
            let found = format!("{x} at ({i}, {j})");
            Err(invalid(name, format!("finite, {rows} x {columns}"), found))
        }
    }
}

/// Block of a degree of freedom, and its index there.
type DofIndex = (usize, usize);

/// Refuses columns of `H` that would be too large when stored with all degrees of freedom of each block they touch.
///
/// `touching` is in the order of blocks and columns.
fn check_column_entries(
    touching: &[&(usize, usize, f64)],
    bodies: &[DofBlock],
    place: &[DofIndex],
) -> Result<()> {
    let columns = touching.chunk_by(|a, b| (place[a.0].0, a.1) == (place[b.0].0, b.1));
    let dofs = |column: &[&(usize, usize, f64)]| bodies[place[column[0].0].0].dofs.len();
    let count: usize = columns.map(dofs).sum();
    if count > MAX_ENTRIES {
        let expected = format!("at most {MAX_ENTRIES} entries, body by body");
        return Err(invalid("H", expected, count.to_string()));
    }
    Ok(())
}

/// Splits the degrees of freedom by the coupling of `M`; also returns the block and index of each.
fn split_blocks(given: &GlobalProblem) -> Result<(Vec<DofBlock>, Vec<DofIndex>)> {
    let ndof = given.f.len();
    let mut parent: Vec<usize> = (0..ndof).collect();
    for &(i, j, _) in given.mass.iter().filter(|e| e.2 != 0.0) {
        let (a, b) = (find_root(&mut parent, i), find_root(&mut parent, j));
        parent[a.max(b)] = a.min(b);
    }
    let mut members: Vec<Vec<usize>> = vec![Vec::new(); ndof];
    for i in 0..ndof {
        members[find_root(&mut parent, i)].push(i);
    }
    members.retain(|m| !m.is_empty());
    let mut place = vec![(0, 0); ndof];
    for (b, dofs) in members.iter().enumerate() {
        if dofs.len() > MAX_BODY_DOFS {
            let expected = format!("at most {MAX_BODY_DOFS} coupled degrees of freedom");
            return Err(invalid("M", expected, dofs.len().to_string()));
        }
        for (k, &dof) in dofs.iter().enumerate() {
            place[dof] = (b, k);
        }
    }
    let inverses: usize = members.iter().map(|m| m.len().pow(2)).sum();
    if inverses > MAX_ENTRIES {
        let expected = format!("inverses of at most {MAX_ENTRIES} entries");
        return Err(invalid("M", expected, inverses.to_string()));
    }
    let zero = |m: &Vec<usize>| DMatrix::zeros(m.len(), m.len());
    let mut masses: Vec<DMatrix<f64>> = members.iter().map(zero).collect();
    for &(i, j, value) in given.mass.iter().filter(|e| e.2 != 0.0) {
        masses[place[i].0][(place[i].1, place[j].1)] += value;
    }
    let body = |(dofs, mass): (Vec<usize>, DMatrix<f64>)| {
        let first = dofs[0];
        let inverse = mass.try_inverse().filter(|m| m.iter().all(|x| x.is_finite()));
        let singular = || invalid("M", "a regular matrix", format!("a singular one at {first}"));
        Ok(DofBlock { dofs, inverse: inverse.ok_or_else(singular)?, columns: Vec::new() })
    };
    let bodies: Result<Vec<_>> = members.into_iter().zip(masses).map(body).collect();
    Ok((bodies?, place))
}

fn find_root(parent: &mut [usize], mut i: usize) -> usize {
    while parent[i] != i {
        parent[i] = parent[parent[i]];
        i = parent[i];
    }
    i
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Problem of two coupled masses of one degree of freedom each and a third one, with one contact.
    fn given() -> GlobalProblem {
        GlobalProblem {
            mass: vec![(0, 0, 2.0), (1, 1, 1.0), (0, 1, 0.5), (1, 0, 0.5), (2, 2, 4.0)],
            h: vec![(0, 0, 1.0), (2, 0, -1.0), (1, 1, 1.0), (2, 2, 1.0), (2, 2, 1.0)],
            f: vec![-1.0, 0.0, 2.0],
            w: vec![Vec3::new(0.25, 0.0, 0.0)],
            friction: vec![0.5],
        }
    }

    #[test]
    fn the_local_problem_is_the_schur_complement() {
        let form = FactorisedGlobalProblem::new(given()).unwrap();
        let local = form.assembled().unwrap();
        // Inverse of [[2, 0.5], [0.5, 1]] is [[1, -0.5], [-0.5, 2]] / 1.75.
        let w = local.blocks[0];
        assert!((w.m11 - (1.0 / 1.75 + 0.25)).abs() < 1e-15);
        assert!((w.m12 + 0.5 / 1.75).abs() < 1e-15 && (w.m33 - 1.0).abs() < 1e-15);
        assert!((local.q[0] - Vec3::new(-1.0 / 1.75 - 0.5 + 0.25, 0.5 / 1.75, 1.0)).norm() < 1e-15);
        // u = Hᵀ v + w, with v from the same impulses.
        let r = [Vec3::new(0.3, -0.1, 0.2)];
        let v = form.velocity(&r);
        let u = Vec3::new(v[0] - v[2] + 0.25, v[1], 2.0 * v[2]);
        assert!((u - local.relative_velocity(0, &r)).norm() < 1e-15);
    }

    #[test]
    fn unusable_bodies_are_refused_with_their_place() {
        let message = |change: fn(&mut GlobalProblem)| {
            let mut bad = given();
            change(&mut bad);
            FactorisedGlobalProblem::new(bad).unwrap_err().to_string()
        };
        assert!(message(|g| g.mass.truncate(4)).contains("singular one at 2"));
        assert!(message(|g| g.h.push((3, 0, 1.0))).contains("1 at (3, 0)"));
        assert!(message(|g| g.mass.push((0, 0, f64::NAN))).contains("NaN at (0, 0)"));
        assert!(message(|g| g.f[1] = f64::INFINITY).contains("inf at 1"));
        let chain = message(|g| {
            g.f = vec![0.0; 700];
            g.mass = (0..700).flat_map(|i| [(i, i, 1.0), (i, i / 2, 0.1)]).collect();
        });
        assert!(chain.contains("700"), "{chain}");
        // Many large bodies: each is allowed, their inverses together are not.
        let many = message(|g| {
            g.f = vec![0.0; 60_000];
            g.mass = (0..60_000).flat_map(|i| [(i, i, 1.0), (i, i - i % 600, 0.1)]).collect();
        });
        assert!(many.contains("36000000"), "{many}");
        // A body of many degrees of freedom, each column of which is stored with all of them.
        let wide = message(|g| {
            g.f = vec![0.0; 600];
            g.mass = (0..600).flat_map(|i| [(i, i, 1.0), (i, 0, 0.1)]).collect();
            g.h = (0..60_000).map(|column| (0, column, 1.0)).collect();
            (g.w, g.friction) = (vec![Vec3::zeros(); 20_000], vec![0.5; 20_000]);
        });
        assert!(wide.contains("H: ") && wide.contains("36000000"), "{wide}");
    }
}
