//! Coulomb's cone `K = {‖r_T‖ <= μ r_n}`, components (n, t, s) (T-9).

use super::Vec3;

/// Returns the orthogonal projection of `x` on the cone of slope `mu`.
pub fn project(x: &Vec3, mu: f64) -> Vec3 {
    let tangential = x.yz().norm();
    // Tested first: without friction, a purely normal pull would pass as a point of the cone.
    if mu * tangential <= -x.x {
        return Vec3::zeros();
    }
    if tangential <= mu * x.x {
        return *x;
    }
    let normal = (x.x + mu * tangential) / (1.0 + mu * mu);
    // Outside the polar cone, so `tangential` is above zero.
    let scale = mu * normal / tangential;
    Vec3::new(normal, x.y * scale, x.z * scale)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn projection_is_idempotent_and_the_rest_is_polar() {
        for mu in [0.0, 0.3, 1.0] {
            for k in 0..64 {
                let a = k as f64;
                let x = Vec3::new((a * 1.3).sin(), (a * 2.1).cos() * 2.0, (a * 0.7).sin());
                for x in [x, Vec3::new(x.x, 0.0, 0.0), Vec3::new(0.0, x.y, x.z)] {
                    let p = project(&x, mu);
                    assert!(p.x >= 0.0 && p.yz().norm() <= mu * p.x * (1.0 + 1e-14), "{p}");
                    assert!((project(&p, mu) - p).norm() < 1e-14);
                    assert!(p.dot(&(x - p)).abs() < 1e-14);
                }
            }
        }
    }
}
