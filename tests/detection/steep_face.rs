//! Two stones whose kept list of features once led to a corner that is nowhere.
//!
//! A corner of the first is beside a nearly vertical face of the second when the list is made; as the axis
//! turns, the line along it comes to leave the second by this face, far below. What the list had left out, the
//! faces below, then alone tells that the line never is inside.

use crate::scene;
use ballast::detection::Detector;
use ballast::geometry::hull;
use ballast::math::{Pose, Quat, Vec3};
use serde_json::Value;

fn numbers<const N: usize>(value: &Value) -> [f64; N] {
    let list = value.as_array().expect("a list");
    std::array::from_fn(|k| list[k].as_f64().expect("a number"))
}

fn list(value: &Value) -> &Vec<Value> {
    value.as_array().expect("a list")
}

#[test]
fn contacts_beside_a_face_that_turns_steep_are_those_from_scratch() {
    let case: Value = serde_json::from_str(include_str!("steep_face.json")).expect("JSON");
    let (mut shapes, mut own) = (vec![], vec![]);
    for corners in list(&case["corners"]) {
        let points: Vec<Vec3> = list(corners).iter().map(|x| Vec3::from(numbers(x))).collect();
        let (shape, local) = hull::convex_hull(&points).expect("a hull");
        shapes.push(shape);
        own.push(local);
    }
    let model = scene::model(shapes, vec![], case["alert"].as_f64().expect("a number"));
    let mut detector = Detector::default();
    for (k, step) in list(&case["steps"]).iter().enumerate() {
        let pose = |(given, local): (&Value, &Pose)| {
            let [i, j, k, w] = numbers(&given["orientation"]);
            let orientation = Quat::from_quaternion(nalgebra::Quaternion::new(w, i, j, k));
            let pose = Pose { position: Vec3::from(numbers(&given["position"])), orientation };
            Pose {
                position: pose.point(&local.position),
                orientation: pose.orientation * local.orientation,
            }
        };
        let poses: Vec<Pose> = list(step).iter().zip(&own).map(pose).collect();
        let motion = scene::at_rest(&poses);
        let (kept, fresh) =
            (scene::detect(&mut detector, &model, &motion), scene::fresh(&model, &motion));
        assert_eq!(kept, fresh, "step {k}");
        assert_eq!(kept.len(), 4, "step {k}");
        assert!(kept.point.iter().all(|x| x.iter().all(|x| x.is_finite())), "step {k}: {kept:?}");
    }
}
