//! One contact: rounded frame, arms and Delassus block.

use super::Line;
use crate::math::{Mat3, Vec3, frame};

/// What a contact needs of one of its mobile bodies.
pub struct Side {
    /// Contact point minus centre of mass, or what takes its place in a mounted body, m.
    pub lever: Vec3,
    /// 1/kg.
    pub inverse_mass: f64,
    /// `B = R D^(-1/2)`.
    pub whitening: Mat3,
    /// Velocity that the whitened coordinates stand for besides, in a mounted body.
    pub shift: Option<Mat3>,
}

/// A contact of the local problem (T-5 to T-9). Components are (n, t, s).
///
/// The tangents are turned so that the tangential Schur complement of the Delassus block,
/// `S = W_TT - W_Tn W_nT / W_nn`, is diagonal with its larger entry first: given that the contact
/// does not open, `u_T = S r_T + const`, component by component.
///
/// The Delassus block only steers a visit, a solved contact stays solved with any block: rounding
/// it to f32 does not move the solution.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LocalContact {
    /// Candidate and antagonist, numbered as in the model.
    pub bodies: [u32; 2],
    /// Normal, from antagonist to candidate.
    pub normal: [f32; 3],
    /// First tangent; the second is `normal × tangent` in f64.
    pub tangent: [f32; 3],
    /// Rows `(B_cᵀ (ℓ_c × axis))` for the axes n, t, s, kg^(-1/2).
    pub candidate_arms: [[f32; 3]; 3],
    /// The same for the antagonist; zero for a driven body.
    pub antagonist_arms: [[f32; 3]; 3],
    /// `1/W_nn`, kg.
    pub normal_mass: f32,
    /// `k = W_Tn / W_nn`.
    pub coupling: [f32; 2],
    /// `1/S_ss`, kg: the larger of the two tangential masses.
    pub tangent_mass: f32,
    /// `S_ss / S_tt`, in (0, 1].
    pub tangent_ratio: f32,
    /// Coulomb's coefficient μ.
    pub friction: f32,
    /// What is added to `Hᵀ V` of the grains: gap or restitution, minus the driven body's velocity, m/s.
    pub offset: Vec3,
    /// Impulse on the candidate, N s.
    pub impulse: Vec3,
    /// Whether it starts with an impulse, or what moves the grains before the solve all but closes it.
    pub likely: bool,
}

impl LocalContact {
    /// Contact between two grains.
    pub fn pair(normal: &Vec3, candidate: &Side, antagonist: &Side) -> Self {
        Self::build(normal, candidate, Some(antagonist))
    }

    /// Contact between a grain and a driven body.
    pub fn single(normal: &Vec3, grain: &Side) -> Self {
        Self::build(normal, grain, None)
    }

    fn build(normal: &Vec3, candidate: &Side, antagonist: Option<&Side>) -> Self {
        let normal = round(normal);
        let (t, s) = frame::tangents(&widen(&normal));
        // First with unrounded tangents, to find the turn; then with the turned, rounded ones.
        let w = delassus(&[widen(&normal), t, s], candidate, antagonist);
        let (cos, sin) = principal_turn(&tangential_schur(&w));
        let tangent = round(&(t * cos + s * sin));
        let axes = axes(&normal, &tangent);
        let candidate_arms = axes.map(|axis| round(&arm(candidate, &axis)));
        let antagonist_arms =
            antagonist.map_or([[0.0; 3]; 3], |side| axes.map(|axis| round(&arm(side, &axis))));
        let mut contact = Self {
            bodies: [0, u32::MAX],
            normal,
            tangent,
            candidate_arms,
            antagonist_arms,
            normal_mass: 0.0,
            coupling: [0.0; 2],
            tangent_mass: 0.0,
            tangent_ratio: 1.0,
            friction: 0.0,
            offset: Vec3::zeros(),
            impulse: Vec3::zeros(),
            likely: false,
        };
        let inverse_mass = candidate.inverse_mass + antagonist.map_or(0.0, |a| a.inverse_mass);
        let w = contact.delassus(inverse_mass);
        let schur = tangential_schur(&w);
        contact.normal_mass = (1.0 / w.m11) as f32;
        contact.coupling = [(w.m21 / w.m11) as f32, (w.m31 / w.m11) as f32];
        contact.tangent_mass = (1.0 / schur[2]) as f32;
        // Equal up to rounding when S is isotropic: keep the ratio in its interval.
        contact.tangent_ratio = (schur[2] / schur[0]).min(1.0) as f32;
        contact
    }

    /// Axes n, t, s as the kernels use them.
    pub fn axes(&self) -> [Vec3; 3] {
        axes(&self.normal, &self.tangent)
    }

    /// Components (n, t, s) of a world vector.
    pub fn components(&self, world: &Vec3) -> Vec3 {
        let [n, t, s] = self.axes();
        Vec3::new(n.dot(world), t.dot(world), s.dot(world))
    }

    /// World vector of the components (n, t, s).
    pub fn world(&self, components: &Vec3) -> Vec3 {
        let [n, t, s] = self.axes();
        n * components.x + t * components.y + s * components.z
    }

    /// Normal velocity of the bodies that have a line, m/s: without the offset.
    pub fn normal_velocity(&self, lines: &[Line]) -> f64 {
        let normal = widen(&self.normal);
        let along = |body: u32, arms: &[[f32; 3]; 3]| {
            lines.get(body as usize).map_or(0.0, |line| {
                normal.dot(&line.velocity()) + widen(&arms[0]).dot(&line.whitened_spin())
            })
        };
        along(self.bodies[0], &self.candidate_arms) - along(self.bodies[1], &self.antagonist_arms)
    }

    /// Delassus block as the kernels know it: rounded, [`LocalContact::delassus`] to about 1e-7.
    pub fn law_block(&self) -> Mat3 {
        let w_nn = 1.0 / self.normal_mass as f64;
        let k = Vec3::new(1.0, self.coupling[0].into(), self.coupling[1].into());
        let s_ss = 1.0 / self.tangent_mass as f64;
        let s_tt = s_ss / self.tangent_ratio as f64;
        k * k.transpose() * w_nn + Mat3::from_diagonal(&Vec3::new(0.0, s_tt, s_ss))
    }

    /// Delassus block `W_αα` of the rounded geometry, 1/kg; `inverse_mass` is the grains' sum.
    pub fn delassus(&self, inverse_mass: f64) -> Mat3 {
        let axes = self.axes();
        Mat3::from_fn(|i, j| {
            inverse_mass * axes[i].dot(&axes[j])
                + widen(&self.candidate_arms[i]).dot(&widen(&self.candidate_arms[j]))
                + widen(&self.antagonist_arms[i]).dot(&widen(&self.antagonist_arms[j]))
        })
    }
}

/// To f64.
pub fn widen(x: &[f32; 3]) -> Vec3 {
    Vec3::new(x[0].into(), x[1].into(), x[2].into())
}

fn round(x: &Vec3) -> [f32; 3] {
    [x.x as f32, x.y as f32, x.z as f32]
}

/// Products of two f32 are exact in f64, so each component is rounded once: the kernels' fused
/// operations give the same bits.
fn axes(normal: &[f32; 3], tangent: &[f32; 3]) -> [Vec3; 3] {
    let (n, t) = (widen(normal), widen(tangent));
    [n, t, n.cross(&t)]
}

fn arm(side: &Side, axis: &Vec3) -> Vec3 {
    let turning = side.whitening.tr_mul(&side.lever.cross(axis));
    side.shift.map_or(turning, |shift| turning + shift.tr_mul(axis))
}

fn delassus(axes: &[Vec3; 3], candidate: &Side, antagonist: Option<&Side>) -> Mat3 {
    let mut w = Mat3::zeros();
    for side in [Some(candidate), antagonist].into_iter().flatten() {
        let arms = axes.map(|axis| arm(side, &axis));
        w +=
            Mat3::from_fn(|i, j| side.inverse_mass * axes[i].dot(&axes[j]) + arms[i].dot(&arms[j]));
    }
    w
}

/// `S = W_TT - W_Tn W_nT / W_nn` as (tt, ts, ss).
fn tangential_schur(w: &Mat3) -> [f64; 3] {
    [w.m22 - w.m21 * w.m21 / w.m11, w.m23 - w.m21 * w.m31 / w.m11, w.m33 - w.m31 * w.m31 / w.m11]
}

/// Cosine and sine of the turn that makes `[tt, ts, ss]` diagonal, larger entry first.
///
/// By half-angle formulas: square roots and divisions give the same bits on every machine, library
/// trigonometry does not.
fn principal_turn(&[tt, ts, ss]: &[f64; 3]) -> (f64, f64) {
    let (x, y) = (0.5 * (tt - ss), ts);
    let length = (x * x + y * y).sqrt();
    if length == 0.0 {
        return (1.0, 0.0);
    }
    if x >= 0.0 {
        let cos = (0.5 * (1.0 + x / length)).sqrt();
        (cos, 0.5 * y / (length * cos))
    } else {
        let sin = (0.5 * (1.0 - x / length)).sqrt();
        (0.5 * y / (length * sin), sin)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Quat;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    fn vector(rng: &mut Pcg64) -> Vec3 {
        Vec3::from_fn(|_, _| rng.random_range(-1.0..1.0))
    }

    /// A side, and what it is made of: inertia and orientation.
    fn side(rng: &mut Pcg64) -> (Side, Vec3, Mat3) {
        let inertia = Vec3::from_fn(|_, _| 10_f64.powf(rng.random_range(-8.0..-5.0)));
        let rotation = *Quat::from_scaled_axis(vector(rng) * 3.0).to_rotation_matrix().matrix();
        let side = Side {
            lever: vector(rng) * 0.03,
            inverse_mass: 10_f64.powf(rng.random_range(-1.0..3.0)),
            whitening: rotation * Mat3::from_diagonal(&inertia.map(|x| 1.0 / x.sqrt())),
            shift: None,
        };
        (side, inertia, rotation)
    }

    #[test]
    fn arms_are_those_of_rigid_kinematics() {
        let mut rng = Pcg64::seed_from_u64(31);
        for _ in 0..100 {
            let (side, inertia, rotation) = side(&mut rng);
            let contact = LocalContact::single(&vector(&mut rng).normalize(), &side);
            let spin = vector(&mut rng);
            let whitened = (rotation.transpose() * spin).component_mul(&inertia.map(f64::sqrt));
            let u = contact.components(&spin.cross(&side.lever));
            for k in 0..3 {
                let by_arm = widen(&contact.candidate_arms[k]).dot(&whitened);
                assert!((by_arm - u[k]).abs() < 1e-7 * spin.norm() * 0.06, "{by_arm} {}", u[k]);
            }
        }
    }

    #[test]
    fn law_data_are_those_of_the_delassus_block() {
        let mut rng = Pcg64::seed_from_u64(37);
        for i in 0..200 {
            let (a, b) = (side(&mut rng).0, side(&mut rng).0);
            let normal = vector(&mut rng).normalize();
            let (contact, inverse_mass) = if i % 2 == 0 {
                (LocalContact::pair(&normal, &a, &b), a.inverse_mass + b.inverse_mass)
            } else {
                (LocalContact::single(&normal, &a), a.inverse_mass)
            };
            let w = contact.delassus(inverse_mass);
            // Diagonal S: rebuilding W without its off-diagonal loses nothing but rounding.
            let apart = (contact.law_block() - w).amax() / w.amax();
            assert!(apart < 1e-6, "{apart:e}: {w}");
            assert!(contact.tangent_ratio > 0.0 && contact.tangent_ratio <= 1.0);
            let [n, t, s] = contact.axes();
            assert!(n.dot(&t).abs() < 1e-6 && (s.norm() - 1.0).abs() < 1e-6);
        }
    }
}
