//! Named regions of the bed over which something is measured.

use crate::error::{Error, Result};
use crate::geometry::AxisBox;
use crate::math::Vec3;

/// Named box along the world axes.
#[derive(Debug, Clone, PartialEq)]
pub struct Zone {
    /// Name in reports and files.
    pub name: String,
    /// Region of the zone.
    pub region: AxisBox,
}

impl Zone {
    /// Creates the zone between two corners, m.
    ///
    /// # Errors
    /// [`Error::Model`] unless `low < high` in each coordinate, all finite.
    pub fn new(name: impl Into<String>, low: Vec3, high: Vec3) -> Result<Self> {
        let name = name.into();
        let fine = |k: usize| low[k].is_finite() && high[k].is_finite() && low[k] < high[k];
        match (0..3).find(|&k| !fine(k)) {
            None => Ok(Self { name, region: AxisBox { low, high } }),
            Some(k) => Err(Error::Model {
                place: format!("zone {name:?}, {}", ["x", "y", "z"][k]),
                expected: "finite lower bound below finite upper bound".into(),
                found: format!("{} to {} m", low[k], high[k]),
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn empty_and_infinite_zones_are_refused_by_name_and_axis() {
        let error = Zone::new("crib", Vec3::zeros(), Vec3::new(1.0, 0.0, 1.0)).unwrap_err();
        assert!(error.to_string().contains("\"crib\", y"), "{error}");
        let high = Vec3::new(1.0, 1.0, f64::INFINITY);
        assert!(Zone::new("crib", Vec3::zeros(), high).is_err());
        assert!(Zone::new("crib", Vec3::zeros(), Vec3::repeat(1.0)).is_ok());
    }
}
