//! Subgrade: springs and dampers under the floor of a bed.
//!
//! Reads: the plan's bed. Contract: the floor moves vertically, without tilting.

use crate::error::Result;
use crate::math::Vec3;
use crate::model::check::expect;
use crate::model::{DofMode, Mount};
use crate::track::plan::{BedPlan, SubgradePlan};

/// Refuses numbers out of range.
pub(super) fn check(soil: &SubgradePlan) -> Result<()> {
    let SubgradePlan { modulus, damping_ratio, mass_per_area } = *soil;
    for (name, value) in [("modulus", modulus), ("mass_per_area", mass_per_area)] {
        let is_positive = value > 0.0 && value.is_finite();
        expect(is_positive, &format!("bed.subgrade.{name}"), "a number above 0", value)?;
    }
    let is_valid = damping_ratio >= 0.0 && damping_ratio.is_finite();
    expect(is_valid, "bed.subgrade.damping_ratio", "0 or more", damping_ratio)
}

/// Returns the mount of the floor; `None` for a rigid floor.
pub(super) fn floor_mount(bed: &BedPlan) -> Option<Mount> {
    let SubgradePlan { modulus, damping_ratio, mass_per_area } = bed.subgrade?;
    let area = bed.size.x * bed.size.y;
    let (stiffness, mass) = (modulus * area, mass_per_area * area);
    let damping = 2.0 * damping_ratio * (stiffness * mass).sqrt();
    let mut dof_modes = [DofMode::Prescribed; 6];
    dof_modes[2] = DofMode::Spring { stiffness, damping };
    Some(Mount { mass, inertia: Vec3::zeros(), centre: Vec3::zeros(), dof_modes })
}
