//! Stiffness of contacts of a case.

use crate::case_file;
use ballast::model::ContactStiffness;

/// Returns the stiffness of contacts with this normal stiffness, N/m; that between grains if it is absent.
pub fn contact_stiffness(
    stiffness: &case_file::StiffnessSection,
    normal: Option<f64>,
) -> ContactStiffness {
    match normal.or(stiffness.grain) {
        None | Some(f64::INFINITY) => ContactStiffness::RIGID,
        Some(normal) => ContactStiffness {
            normal,
            tangential_ratio: stiffness.tangential_ratio,
            damping_time: stiffness.damping_s,
        },
    }
}
