//! Fabric: the distribution of contact directions (T-24).

use super::zone::Zone;
use crate::math::{Mat3, Vec3};
use crate::workspace::Workspace;

/// Fabric tensor of the contacts that carry an impulse.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fabric {
    /// `F`, of trace 1; zero without contacts.
    pub tensor: Mat3,
    /// Contacts counted.
    pub contacts: usize,
}

impl Fabric {
    /// Norm of the deviator of `F`, scaled to 1 for parallel normals and 0 without preference.
    pub fn anisotropy(&self) -> f64 {
        if self.contacts == 0 {
            return 0.0;
        }
        (self.tensor - Mat3::identity() / 3.0).norm() * 1.5f64.sqrt()
    }
}

/// Fabric of the contacts with their point in `zone`, or of all (T-24).
pub fn fabric(workspace: &Workspace, zone: Option<&Zone>) -> Fabric {
    let contacts = &workspace.contacts;
    let mut found = Fabric { tensor: Mat3::zeros(), contacts: 0 };
    for (k, impulse) in workspace.impulse.iter().enumerate() {
        let inside = zone.is_none_or(|z| z.region.contains(&contacts.point[k]));
        if inside && *impulse != Vec3::zeros() {
            found.tensor += contacts.normal[k] * contacts.normal[k].transpose();
            found.contacts += 1;
        }
    }
    if found.contacts > 0 {
        found.tensor /= found.contacts as f64;
    }
    found
}

#[cfg(test)]
mod tests {
    use super::super::scene;
    use super::*;

    #[test]
    fn axes_in_equal_shares_are_isotropic_and_one_axis_is_not() {
        let mut w = Workspace::default();
        let push = [1.0, 1.0, 1.0];
        for n in [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]] {
            scene::touch(&mut w, [0, 1], [0.0, 0.0, n[2]], n, 0.0, push);
        }
        scene::touch(&mut w, [0, 1], [0.0; 3], [1.0, 0.0, 0.0], 0.1, [0.0; 3]);
        let all = fabric(&w, None);
        assert_eq!(all.contacts, 3);
        assert!((all.tensor - Mat3::identity() / 3.0).amax() < 1e-15);
        assert!(all.anisotropy() < 1e-15);
        let top = Zone::new("top", Vec3::new(-1.0, -1.0, 0.5), Vec3::repeat(2.0)).unwrap();
        let vertical = fabric(&w, Some(&top));
        assert_eq!(vertical.contacts, 1);
        assert_eq!(vertical.tensor, Mat3::from_diagonal(&Vec3::z()));
        assert!((vertical.anisotropy() - 1.0).abs() < 1e-15);
    }
}
