//! Saved states: rollback, serialisation, several instances.

use crate::driver::{Importer, TINE, VERSIONS, set_motion, unpacked};
use std::ptr::null_mut;

const STEP: f64 = 0.004;

/// Advances by the steps of a range with the motion of the tine.
fn advance(importer: &Importer, steps: std::ops::Range<u32>) {
    for k in steps {
        let time = f64::from(k) * STEP;
        set_motion(importer, time + STEP);
        importer.step(time, STEP);
    }
}

#[test]
fn a_restored_instance_continues_as_if_never_interrupted() {
    for version in VERSIONS {
        let whole = Importer::ready(version, unpacked(), |_| ());
        advance(&whole, 0..8);

        let first = Importer::ready(version, unpacked(), |_| ());
        advance(&first, 0..3);
        let mut state = null_mut();
        first.save(&mut state);
        let force = first.get(&format!("{TINE}.force"));
        let bytes = first.serialize(state);
        first.drop_state(state);
        drop(first);

        // Never initialised: the state brings the phase.
        let second = Importer::new(version, unpacked());
        let mut state = null_mut();
        assert_eq!(second.deserialize(&bytes, &mut state), 0);
        assert_eq!(second.restore_status(state), 0);
        assert_eq!(second.get(&format!("{TINE}.force")), force);
        assert_eq!(second.serialize(state), bytes);
        second.drop_state(state);
        advance(&second, 3..8);
        assert_eq!(second.hash(), whole.hash());
        assert_eq!(second.get(&format!("{TINE}.force")), whole.get(&format!("{TINE}.force")));
    }
}

#[test]
fn a_step_is_repeated_to_the_bit() {
    for version in VERSIONS {
        let importer = Importer::ready(version, unpacked(), |_| ());
        advance(&importer, 0..2);
        let mut state = null_mut();
        importer.save(&mut state);
        let ends: Vec<String> = (0..3)
            .map(|_| {
                assert_eq!(importer.restore_status(state), 0);
                // Other inputs in between leave no trace.
                set_motion(&importer, 0.0);
                importer.step(2.0 * STEP, STEP);
                assert_eq!(importer.restore_status(state), 0);
                advance(&importer, 2..4);
                importer.hash()
            })
            .collect();
        importer.drop_state(state);
        assert!(ends.iter().all(|end| *end == ends[0]), "{ends:?}");
    }
}

#[test]
fn instances_do_not_see_each_other() {
    let importers = VERSIONS.map(|version| Importer::ready(version, unpacked(), |_| ()));
    let start = importers[1].hash();
    advance(&importers[0], 0..3);
    assert_eq!(importers[1].hash(), start);
    // A state of one instance fits another of the same unit.
    let mut state = null_mut();
    importers[0].save(&mut state);
    assert_eq!(importers[1].restore_status(state), 0);
    importers[0].drop_state(state);
    for importer in &importers {
        advance(importer, 3..5);
    }
    assert_eq!(importers[0].hash(), importers[1].hash());
}

#[test]
fn damaged_states_are_refused() {
    for version in VERSIONS {
        let importer = Importer::ready(version, unpacked(), |_| ());
        let mut state = null_mut();
        importer.save(&mut state);
        let bytes = importer.serialize(state);
        importer.drop_state(state);
        let mut other = null_mut();
        for at in [0, 20, 60, bytes.len() / 2, bytes.len() - 1] {
            let mut damaged = bytes.clone();
            damaged[at] ^= 4;
            assert_eq!(importer.deserialize(&damaged, &mut other), 3);
        }
        assert_eq!(importer.deserialize(&bytes[..bytes.len() - 1], &mut other), 3);
        assert_eq!(importer.deserialize(&[], &mut other), 3);
        assert_eq!(importer.deserialize(&unpacked().bed.to_bytes(), &mut other), 3);
        assert!(other.is_null());
    }
}
