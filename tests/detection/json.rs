//! Grains from JSON.

use ballast::geometry::{Polyhedron, convex_hull};
use ballast::math::{Pose, Vec3};
use serde_json::Value;

pub fn list(value: &Value) -> &[Value] {
    value.as_array().expect("a list")
}

pub fn numbers(value: &Value) -> Vec<f64> {
    list(value).iter().map(|x| x.as_f64().expect("a number")).collect()
}

pub fn vector(value: &Value) -> Vec3 {
    Vec3::from_iterator(numbers(value))
}

/// Hull of a list of points, and its frame in theirs.
pub fn grain(points: &Value) -> (Polyhedron, Pose) {
    let points: Vec<Vec3> = list(points).iter().map(vector).collect();
    convex_hull(&points).expect("a grain")
}
