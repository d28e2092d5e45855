//! Matching of impulses with the contacts of the next step.

use crate::scene;
use ballast::detection::{ContactHistory, Contacts, match_contacts, store_contacts};
use ballast::geometry::cuboid;
use ballast::math::{Pose, Quat, Vec3};
use ballast::model::Model;
use ballast::motion::Motion;
use ballast::state::ContactMemory;

fn pile(count: usize) -> (Model, Motion) {
    let shapes = vec![cuboid(Vec3::new(0.02, 0.03, 0.01)); count];
    let at = |k: usize| {
        let turn = Quat::from_euler_angles(0.0, 0.0, 0.1 * k as f64);
        Pose { position: Vec3::new(0.0, 0.0, 0.02 * k as f64), orientation: turn }
    };
    let poses: Vec<Pose> = (0..count).map(at).collect();
    (scene::model(shapes, vec![], 1e-3), scene::at_rest(&poses))
}

/// A different impulse for each contact.
fn impulses(contacts: &Contacts) -> Vec<Vec3> {
    (0..contacts.len()).map(|k| Vec3::new(1.0 + k as f64, 0.5, -0.25 * k as f64)).collect()
}

/// Impulses of the same contacts in `memory`.
fn matched(
    model: &Model,
    motion: &Motion,
    memory: &ContactMemory,
    contacts: &Contacts,
) -> Vec<Vec3> {
    let mut history = ContactHistory::default();
    match_contacts(model, motion, memory, contacts, &mut history);
    // Springs of a pair have no more energy than they had, and a contact that is the same keeps its own.
    let energy = |overlaps: &[f64]| overlaps.iter().map(|overlap| overlap * overlap).sum::<f64>();
    assert!(energy(&history.overlap) <= energy(&memory.overlap) * (1.0 + 1e-12));
    for (k, impulse) in history.impulse.iter().enumerate().filter(|(_, r)| **r != Vec3::zeros()) {
        assert_eq!(history.overlap[k], impulse.x, "{k}");
    }
    history.impulse
}

fn remembered(motion: &Motion, contacts: &Contacts) -> ContactMemory {
    let mut memory = ContactMemory::default();
    let impulses = impulses(contacts);
    let overlaps: Vec<f64> = impulses.iter().map(|r| r.x).collect();
    store_contacts(motion, contacts, &impulses, &overlaps, &mut memory);
    memory
}

#[test]
fn equal_features_match_and_new_pairs_start_from_zero() {
    let (model, motion) = pile(700);
    let contacts = scene::fresh(&model, &motion);
    assert_eq!(contacts.len(), 4 * 699);
    let mut memory = remembered(&motion, &contacts);
    let start = matched(&model, &motion, &memory, &contacts);
    assert_eq!(start, impulses(&contacts));

    // Forget the pair of grains 100 and 101.
    let gone = |k: usize| contacts.bodies[k] == [100, 101];
    let keep: Vec<usize> = (0..contacts.len()).filter(|k| !gone(*k)).collect();
    memory.bodies = keep.iter().map(|k| memory.bodies[*k]).collect();
    memory.feature = keep.iter().map(|k| memory.feature[*k]).collect();
    memory.local_point = keep.iter().map(|k| memory.local_point[*k]).collect();
    memory.impulse = keep.iter().map(|k| memory.impulse[*k]).collect();
    memory.overlap = keep.iter().map(|k| memory.overlap[*k]).collect();
    let start = matched(&model, &motion, &memory, &contacts);
    for (k, (found, wanted)) in start.iter().zip(impulses(&contacts)).enumerate() {
        assert_eq!(*found, if gone(k) { Vec3::zeros() } else { wanted }, "{k}");
    }
}

#[test]
fn points_match_by_position_when_features_have_changed() {
    let (model, motion) = pile(2);
    let contacts = scene::fresh(&model, &motion);
    let mut memory = remembered(&motion, &contacts);
    // Other features, in the reverse order of the points.
    memory.local_point.reverse();
    memory.impulse.reverse();
    memory.overlap.reverse();
    memory.feature.iter_mut().for_each(|f| *f ^= 1 << 40);
    let start = matched(&model, &motion, &memory, &contacts);
    assert_eq!(start, impulses(&contacts));

    // Points that are far away are other points.
    memory.local_point.iter_mut().for_each(|p| p.x += 0.5);
    let start = matched(&model, &motion, &memory, &contacts);
    assert!(start.iter().all(|r| *r == Vec3::zeros()));
}

#[test]
fn an_old_point_is_used_once() {
    let (model, motion) = pile(2);
    let contacts = scene::fresh(&model, &motion);
    let mut memory = remembered(&motion, &contacts);
    for list in [&mut memory.local_point, &mut memory.impulse] {
        list.truncate(1);
    }
    memory.bodies.truncate(1);
    memory.feature.truncate(1);
    memory.overlap.truncate(1);
    memory.feature[0] ^= 1 << 40;
    let start = matched(&model, &motion, &memory, &contacts);
    assert_eq!(start.iter().filter(|r| **r != Vec3::zeros()).count(), 1);
    assert_eq!(start[0], impulses(&contacts)[0]);
}

/// The candidate's frame carries the points: a pile that moves as one keeps its impulses.
#[test]
fn points_are_remembered_in_the_body() {
    let (model, motion) = pile(3);
    let contacts = scene::fresh(&model, &motion);
    let mut memory = remembered(&motion, &contacts);
    memory.feature.iter_mut().for_each(|f| *f ^= 1 << 40);
    let turn = Pose {
        position: Vec3::new(3.0, -1.0, 2.0),
        orientation: Quat::from_euler_angles(1.0, 0.4, -2.0),
    };
    let poses: Vec<Pose> = (0..3)
        .map(|b| {
            turn.then(&Pose { position: motion.position[b], orientation: motion.orientation[b] })
        })
        .collect();
    let motion = scene::at_rest(&poses);
    let contacts = scene::fresh(&model, &motion);
    let start = matched(&model, &motion, &memory, &contacts);
    for (k, point) in contacts.point.iter().enumerate() {
        let local = motion.orientation[contacts.bodies[k][0] as usize].inverse()
            * (point - motion.position[contacts.bodies[k][0] as usize]);
        let old = memory.local_point.iter().zip(&memory.bodies);
        let same = old.enumerate().filter(|(_, (_, b))| **b == contacts.bodies[k]);
        let nearest = same
            .min_by(|(_, (p, _)), (_, (q, _))| (*p - local).norm().total_cmp(&(*q - local).norm()))
            .map(|(o, _)| memory.impulse[o]);
        assert_eq!(Some(start[k]), nearest, "{k}");
    }
}
