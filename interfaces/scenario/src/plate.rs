//! Plates of a case: from section to plan.

use crate::case_file::{
    CaseFile, PlateBoxSection, PlateLoadSection, PlateMotionSection, PlateSection,
};
use crate::mount;
use crate::placed_body::PlacedBody;
use crate::report::DiagnosticReport;
use crate::stiffness::contact_stiffness;
use ballast::math::Vec3;
use ballast::track::plan::{PlateBox, PlatePlan, PlateVibration, VectorKnot};

/// Returns plate number `i` of a case; reports a mount with errors.
pub fn placed(
    i: usize,
    plate: &PlateSection,
    case: &CaseFile,
    report: &mut DiagnosticReport,
) -> PlacedBody<PlatePlan> {
    let key = format!("plate[{i}]");
    let of_box = |b: &PlateBoxSection| PlateBox {
        offset: Vec3::from(b.offset_m),
        size: Vec3::from(b.size_m),
    };
    let boxes: Vec<PlateBox> = plate.boxes.iter().map(of_box).collect();
    let mount =
        plate.mount.and_then(|m| mount::plate_mount(&m, &boxes, &format!("{key}.mount"), report));
    let motion = plate.motion.iter().flatten();
    let load = plate.load.iter().flatten();
    let stiffness = &case.bed.stiffness;
    PlacedBody {
        plan: PlatePlan {
            name: plate.name.clone(),
            position: [plate.x_m, plate.y_m],
            z: plate.z_m,
            boxes,
            friction: plate.friction.unwrap_or(case.bed.friction.boundary),
            stiffness: contact_stiffness(stiffness, plate.stiffness.or(stiffness.boundary)),
            mount,
            in_preparation: plate.in_preparation,
            motion: motion
                .map(|PlateMotionSection { time_s, displacement_m }| knot(*time_s, displacement_m))
                .collect(),
            vibration: plate.vibration.map(|v| PlateVibration {
                amplitude: Vec3::from(v.amplitude_m),
                frequency: v.frequency,
                start: v.start_s,
                end: v.end_s.unwrap_or(case.run.duration_s),
            }),
            load: load.map(|PlateLoadSection { time_s, force }| knot(*time_s, force)).collect(),
        },
        key_x: format!("{key}.x_m"),
        key_y: format!("{key}.y_m"),
        key,
    }
}

/// Returns a knot at the nearest nanosecond.
fn knot(time_s: f64, value: &[f64; 3]) -> VectorKnot {
    VectorKnot { time_ns: (1e9 * time_s).round() as u64, value: Vec3::from(*value) }
}
