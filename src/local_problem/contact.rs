//! Contact of the local problem: rounded frame, arms and Delassus block.

use crate::lanes::BodyVelocity;
use crate::math::{Mat3, Vec3, widen};

/// Data of one mobile body of a contact.
pub struct ContactSide {
    /// Contact point minus centre of mass, or minus the response centre of a mounted body, m.
    pub lever: Vec3,
    /// Inverse mass, 1/kg.
    pub inverse_mass: f64,
    /// Whitening matrix `B = R D^(-1/2)`.
    pub whitening: Mat3,
    /// Linear velocity per whitened coordinate of a mounted body.
    pub shift: Option<Mat3>,
}

/// Contact of the local problem (T-5 to T-9). Components are (n, t, s).
///
/// The Delassus block includes the compliance of the contact's springs (T-42): `W_αα = H_αᵀ M⁻¹ H_α + C`.
///
/// The tangents are turned so that the tangential Schur complement of the Delassus block,
/// `S = W_TT - W_Tn W_nT / W_nn`, is diagonal with its larger entry first: given that the contact
/// does not open, `u_T = S r_T + const`, component by component.
///
/// The Delassus block only steers a visit, a solved contact stays solved with any block: rounding
/// it to f32 does not move the solution.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct LocalContact {
    /// Candidate and antagonist, numbered as in the model.
    pub bodies: [u32; 2],
    /// Normal, from antagonist to candidate.
    pub normal: [f32; 3],
    /// First tangent; the second is `normal × tangent` in f64.
    pub tangent: [f32; 3],
    /// Rows `(B_cᵀ (ℓ_c × axis))` for the axes n, t, s, kg^(-1/2).
    pub candidate_arms: [[f32; 3]; 3],
    /// Rows `(B_aᵀ (ℓ_a × axis))` of the antagonist, kg^(-1/2); zero for a driven body.
    pub antagonist_arms: [[f32; 3]; 3],
    /// Normal mass `1/W_nn`, kg.
    pub normal_mass: f32,
    /// Coupling `k = W_Tn / W_nn`.
    pub coupling: [f32; 2],
    /// Tangential mass `1/S_ss`, kg: the larger of the two tangential masses.
    pub tangent_mass: f32,
    /// Ratio of the tangential masses `S_ss / S_tt`, in (0, 1].
    pub tangent_ratio: f32,
    /// Coulomb's coefficient μ.
    pub friction: f32,
    /// Compliance of the contact's springs (normal, tangential), 1/kg; zero for a rigid contact (T-42).
    pub compliance: [f32; 2],
    /// Offset added to `Hᵀ V + C r`: gap or restitution and the force of the tangential spring, minus the velocity of a
    /// driven body, m/s.
    pub offset: Vec3,
    /// Impulse on the candidate, N s.
    pub impulse: Vec3,
    /// True if the contact starts with an impulse, or nearly closes at the free velocities.
    pub is_likely_active: bool,
}

impl LocalContact {
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
    pub fn normal_velocity(&self, lines: &[BodyVelocity]) -> f64 {
        let normal = widen(&self.normal);
        let along = |body: u32, arms: &[[f32; 3]; 3]| {
            lines.get(body as usize).map_or(0.0, |line| {
                normal.dot(&line.velocity())
                    + widen(&arms[0]).dot(&line.whitened_angular_velocity())
            })
        };
        along(self.bodies[0], &self.candidate_arms) - along(self.bodies[1], &self.antagonist_arms)
    }

    /// Velocity by which the springs give way under an impulse, m/s: `C r`.
    pub fn yielding(&self, impulse: &Vec3) -> Vec3 {
        let [normal, tangential] = self.compliance.map(f64::from);
        impulse.component_mul(&Vec3::new(normal, tangential, tangential))
    }

    /// Delassus block `W_αα`, compliance included, as the kernels know it, 1/kg: that of the rounded geometry to about 1e-7.
    pub fn law_block(&self) -> Mat3 {
        let w_nn = 1.0 / self.normal_mass as f64;
        let k = Vec3::new(1.0, self.coupling[0].into(), self.coupling[1].into());
        let s_ss = 1.0 / self.tangent_mass as f64;
        let s_tt = s_ss / self.tangent_ratio as f64;
        k * k.transpose() * w_nn + Mat3::from_diagonal(&Vec3::new(0.0, s_tt, s_ss))
    }
}

/// Returns the axes n, t, s.
///
/// Products of two f32 are exact in f64, so each component is rounded once: the kernels' fused
/// operations give the same bits.
fn axes(normal: &[f32; 3], tangent: &[f32; 3]) -> [Vec3; 3] {
    let (n, t) = (widen(normal), widen(tangent));
    [n, t, n.cross(&t)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::local_problem::lane_builder;
    use crate::math::Quat;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    fn vector(rng: &mut Pcg64) -> Vec3 {
        Vec3::from_fn(|_, _| rng.random_range(-1.0..1.0))
    }

    /// Returns a random side with its inertia and orientation.
    fn side(rng: &mut Pcg64) -> (ContactSide, Vec3, Mat3) {
        let inertia = Vec3::from_fn(|_, _| 10_f64.powf(rng.random_range(-8.0..-5.0)));
        let rotation = *Quat::from_scaled_axis(vector(rng) * 3.0).to_rotation_matrix().matrix();
        let side = ContactSide {
            lever: vector(rng) * 0.03,
            inverse_mass: 10_f64.powf(rng.random_range(-1.0..3.0)),
            whitening: rotation * Mat3::from_diagonal(&inertia.map(|x| 1.0 / x.sqrt())),
            shift: None,
        };
        (side, inertia, rotation)
    }

    /// Delassus block of the rounded geometry; `inverse_mass` is the grains' sum.
    fn delassus(contact: &LocalContact, inverse_mass: f64) -> Mat3 {
        let axes = contact.axes();
        let along =
            |arms: &[[f32; 3]; 3], i: usize, j: usize| widen(&arms[i]).dot(&widen(&arms[j]));
        Mat3::from_fn(|i, j| {
            inverse_mass * axes[i].dot(&axes[j])
                + along(&contact.candidate_arms, i, j)
                + along(&contact.antagonist_arms, i, j)
        })
    }

    #[test]
    fn arms_are_those_of_rigid_kinematics() {
        let mut rng = Pcg64::seed_from_u64(31);
        for _ in 0..100 {
            let (side, inertia, rotation) = side(&mut rng);
            let contact = lane_builder::build_one(&vector(&mut rng).normalize(), &side, None);
            let angular_velocity = vector(&mut rng);
            let whitened =
                (rotation.transpose() * angular_velocity).component_mul(&inertia.map(f64::sqrt));
            let u = contact.components(&angular_velocity.cross(&side.lever));
            for k in 0..3 {
                let by_arm = widen(&contact.candidate_arms[k]).dot(&whitened);
                assert!(
                    (by_arm - u[k]).abs() < 1e-7 * angular_velocity.norm() * 0.06,
                    "{by_arm} {}",
                    u[k]
                );
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
                (lane_builder::build_one(&normal, &a, Some(&b)), a.inverse_mass + b.inverse_mass)
            } else {
                (lane_builder::build_one(&normal, &a, None), a.inverse_mass)
            };
            let w = delassus(&contact, inverse_mass);
            // S is diagonal: rebuilding W without its off-diagonal loses only rounding.
            let apart = (contact.law_block() - w).amax() / w.amax();
            assert!(apart < 1e-6, "{apart:e}: {w}");
            assert!(contact.tangent_ratio > 0.0 && contact.tangent_ratio <= 1.0);
            let [n, t, s] = contact.axes();
            assert!(n.dot(&t).abs() < 1e-6 && (s.norm() - 1.0).abs() < 1e-6);
        }
    }
}
