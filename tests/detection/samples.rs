//! Settled sample of another program, with overlaps that this program did not detect.

use crate::oracle::{self, Body};
use crate::{json, scene};
use ballast::math::{Pose, Quat};

/// Settled by LMGC90 (`tests/data/README.md`).
const SETTLED: &str = include_str!("../data/settled2000.json");

#[test]
fn settled_sample_with_its_overlap_of_5_mm() {
    let sample: serde_json::Value = serde_json::from_str(SETTLED).expect("the sample is JSON");
    let (mut shapes, mut poses) = (vec![], vec![]);
    for grain in json::list(&sample["grains"]) {
        let (shape, frame) = json::grain(&grain["vertices"]);
        let q = json::numbers(&grain["quaternion"]);
        let orientation = Quat::new_normalize(nalgebra::Quaternion::new(q[0], q[1], q[2], q[3]));
        let position = json::vector(&grain["position"]);
        poses.push(Pose { position, orientation }.then(&frame));
        shapes.push(shape);
    }
    let model = scene::model(shapes, vec![], 1e-3);
    let contacts = scene::fresh(&model, &scene::at_rest(&poses));
    let first = contacts.bodies.partition_point(|b| *b < [671, 771]);
    assert_eq!(contacts.bodies.get(first), Some(&[671, 771]), "the overlap is missed");
    let depth = -contacts.gap.iter().copied().fold(f64::INFINITY, f64::min);
    assert!((depth - 4.98e-3).abs() < 0.01e-3, "{depth}");

    // Every touching pair's gap against the oracle.
    let body = |b: u32| Body::new(&model.shapes[b as usize], &poses[b as usize]);
    let mut k = 0;
    let mut overlaps = 0;
    while k < contacts.len() {
        let [i, j] = contacts.bodies[k];
        let run = contacts.bodies[k..].iter().take_while(|b| **b == [i, j]).count();
        let gap = contacts.gap[k..k + run].iter().copied().fold(f64::INFINITY, f64::min);
        let (a, b) = (body(i), body(j));
        let (s, _) = oracle::separation(&a, &b);
        let expected = if s > 0.0 { oracle::distance(&a, &b) } else { s };
        assert!((gap - expected).abs() < 1e-9 * 0.04, "{i} {j}: {gap:e}, {expected:e}");
        overlaps += usize::from(gap < 0.0);
        k += run;
    }
    assert!(overlaps > 1000, "{overlaps}");
}
