//! Shape of a tine: boxes of blade and shaft, or convex parts.

use crate::case_file::TinePartSection;
use crate::diagnostic::DiagnosticText;
use crate::report::DiagnosticReport;
use ballast::error::Error;
use ballast::geometry::stone_with_corners;
use ballast::math::Vec3;
use ballast::track::plan::TineShape;

/// Returns the shape of a tine, whose section is at `key`: the boxes if there are no valid parts.
pub fn tine_shape(
    [blade, shaft]: [[f64; 3]; 2],
    parts: &[TinePartSection],
    key: &str,
    report: &mut DiagnosticReport,
) -> TineShape {
    let boxes = TineShape::Boxes { blade: Vec3::from(blade), shaft: Vec3::from(shaft) };
    let key_parts = format!("{key}.parts");
    if parts.is_empty() || !report.is_clean(&[&key_parts]) {
        return boxes;
    }
    for name in ["blade_size_m", "shaft_size_m"] {
        let other = format!("{key}.{name}");
        if report.document.has(&other) {
            let text = DiagnosticText {
                problem: "the shape of the tine is given twice".into(),
                found: format!("`parts` and `{name}`"),
                expected: "one of them".into(),
                hint: Some(format!("remove `{name}`: parts have their own size")),
            };
            report.error(&other, text);
        }
    }
    let parts: Vec<Vec<Vec3>> =
        parts.iter().map(|p| p.corners.iter().map(|c| Vec3::from(*c)).collect()).collect();
    for (k, corners) in parts.iter().enumerate() {
        if let Err(Error::Geometry { expected, found }) = stone_with_corners(corners) {
            let text = DiagnosticText {
                problem: "these corners make no convex part".into(),
                found,
                expected: expected.into(),
                hint: Some("`ballast tool` chooses corners from a surface mesh".into()),
            };
            report.error(&format!("{key_parts}[{k}].corners"), text);
        }
    }
    let shape = TineShape::Parts(parts);
    if shape.blade_bounds().low.z < 0.0 {
        return shape;
    }
    let text = DiagnosticText {
        problem: "the tine has no blade".into(),
        found: format!("its lowest corner at z = {} m", shape.bounds().low.z),
        expected: "a part below z = 0, the level of the blade's upper edge".into(),
        hint: Some("`ballast tool --origin` places a mesh".into()),
    };
    report.error(&key_parts, text);
    boxes
}
