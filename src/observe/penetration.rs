//! Penetration, a measure of the quality of a run (T-26).

use super::grain_size::mean_diameter;
use crate::model::Model;
use crate::workspace::Workspace;

/// Penetration depths of the contact points.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Penetration {
    /// Number of contact points with a negative gap.
    pub points: usize,
    /// Mean depth of the penetrating points over the mean grain size.
    pub mean: f64,
    /// Largest depth over the mean grain size.
    pub max: f64,
    /// Mean grain size, m.
    pub diameter: f64,
}

/// Measures penetration at the step's configuration m (T-26); zeros without grains.
pub fn penetration(model: &Model, workspace: &Workspace) -> Penetration {
    let diameter = mean_diameter(model);
    if diameter == 0.0 {
        return Penetration::default();
    }
    let depths = workspace.contacts.gap.iter().filter(|&&g| g < 0.0).map(|g| -g / diameter);
    let points = depths.clone().count();
    let sum: f64 = depths.clone().sum();
    let mean = if points == 0 { 0.0 } else { sum / points as f64 };
    Penetration { points, mean, max: depths.fold(0.0, f64::max), diameter }
}

#[cfg(test)]
mod tests {
    use super::super::scene;
    use super::*;

    #[test]
    fn open_contacts_do_not_dilute_the_mean() {
        let model = scene::cubes(2);
        let mut w = Workspace::default();
        for gap in [-0.03, 0.002, -0.01, 0.0] {
            scene::touch(&mut w, [0, 1], [0.0; 3], [0.0, 0.0, 1.0], gap, [0.0; 3]);
        }
        let found = penetration(&model, &w);
        let d = (6.0 / std::f64::consts::PI).cbrt();
        assert_eq!(found.points, 2);
        assert!((found.diameter - d).abs() < 1e-15);
        assert!((found.mean - 0.02 / d).abs() < 1e-15 && (found.max - 0.03 / d).abs() < 1e-15);
        assert_eq!(penetration(&scene::cubes(0), &w), Penetration::default());
    }
}
