//! Two grains whose cached list of features once gave a corner that does not exist.
//!
//! A corner of the first is beside a nearly vertical face of the second when the list is made; as the axis
//! rotates, the line along it comes to leave the second by this face, far below. Only the faces below, which the
//! list had left out, show that the line is never inside.

use crate::{json, scene};
use ballast::detection::Detector;
use ballast::math::{Pose, Quat};
use serde_json::Value;

#[test]
fn contacts_beside_a_face_that_turns_steep_are_those_from_scratch() {
    let case: Value = serde_json::from_str(include_str!("steep_face.json")).expect("JSON");
    let (shapes, frames): (Vec<_>, Vec<_>) =
        json::list(&case["corners"]).iter().map(json::grain).unzip();
    let model = scene::model(shapes, vec![], case["alert"].as_f64().expect("a number"));
    let mut detector = Detector::default();
    for (k, step) in json::list(&case["steps"]).iter().enumerate() {
        let pose = |(given, frame): (&Value, &Pose)| {
            let q = json::numbers(&given["orientation"]);
            let orientation =
                Quat::from_quaternion(nalgebra::Quaternion::new(q[3], q[0], q[1], q[2]));
            Pose { position: json::vector(&given["position"]), orientation }.then(frame)
        };
        let poses: Vec<Pose> = json::list(step).iter().zip(&frames).map(pose).collect();
        let motion = scene::at_rest(&poses);
        let kept = scene::detect(&mut detector, &model, &motion);
        assert_eq!(kept, scene::fresh(&model, &motion), "step {k}");
        assert_eq!(kept.len(), 4, "step {k}");
        assert!(kept.point.iter().all(|x| x.iter().all(|x| x.is_finite())), "step {k}: {kept:?}");
    }
}
