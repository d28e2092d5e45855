//! Orthonormal contact frames (n, t, s), normal first (T-5).

use super::Vec3;

/// Returns two tangents that complete the unit vector `n` to a right-handed frame `(n, t, s)`.
///
/// Branch-free up to the sign of `n.z`, so neighbouring normals get neighbouring tangents. Source: Duff et al.,
/// *Building an orthonormal basis, revisited*, JCGT 6(1), 2017.
pub fn tangents(n: &Vec3) -> (Vec3, Vec3) {
    let sign = 1.0_f64.copysign(n.z);
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    let t = Vec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x);
    let s = Vec3::new(b, sign + n.y * n.y * a, -n.y);
    (t, s)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_right_handed_and_orthonormal() {
        for n in [
            Vec3::z(),
            -Vec3::z(),
            Vec3::x(),
            -Vec3::y(),
            Vec3::new(0.6, 0.0, -0.8),
            Vec3::new(1.0, 2.0, 3.0).normalize(),
            Vec3::new(1e-9, -1e-9, -1.0).normalize(),
        ] {
            let (t, s) = tangents(&n);
            assert!((n.cross(&t) - s).norm() < 1e-14, "{n:?}");
            assert!((t.norm() - 1.0).abs() < 1e-14 && t.dot(&n).abs() < 1e-14);
        }
    }
}
