//! Steps of a unit are those of the Rust component.

use crate::driver::{
    Importer, TINE, VERSIONS, Version, instantiate, motion, set_motion, unpacked,
    unpacked_with_free_sleeper,
};
use ballast::component::{
    Component, Interpolation, Knot, MotionInput, Twist, Waveform, WindowInputs,
};
use ballast::math::{Pose, Vec3};

const STEP: f64 = 0.005;

/// Returns the input of a window from the present pose to `pose` with a cubic motion.
fn cubic(component: &Component, end_ns: u64, position: Vec3, velocity: Vec3) -> WindowInputs {
    let d = component.model().driven_index(TINE).unwrap();
    let from = component.state().imposed(component.model(), d);
    let Twist { velocity: v, angular_velocity: w } = component.twist(d).unwrap();
    let knots = vec![
        Knot { time_ns: component.now_ns(), pose: from, velocity: v, angular_velocity: w },
        Knot {
            time_ns: end_ns,
            pose: Pose { position, ..from },
            velocity,
            angular_velocity: Vec3::zeros(),
        },
    ];
    let waveform = Waveform { interpolation: Interpolation::Hermite, knots };
    let body = component.model().driven[d].name.clone();
    WindowInputs { motions: vec![MotionInput { body, waveform, allow_jump: false }], loads: vec![] }
}

#[test]
fn steps_give_the_states_of_the_component() {
    let unit = unpacked();
    for at_start in [false, true] {
        let mut component = unit.bed.component().unwrap();
        let importers = VERSIONS.map(|version| {
            Importer::ready(version, unit, |i| {
                i.set_whole("inputs_at", if at_start { 2 } else { 1 });
                i.set_whole("threads", if version == Version::Two { 1 } else { 2 });
            })
        });
        for k in 0..6 {
            let time = f64::from(k) * STEP;
            let given = if at_start { time } else { time + STEP };
            let end_ns = 5_000_000 * (u64::from(k as u32) + 1);
            let (position, velocity) = motion(given);
            let [mut position, velocity] = [position, velocity].map(Vec3::from);
            if at_start {
                position += velocity * 0.005;
            }
            let inputs = cubic(&component, end_ns, position, velocity);
            let result = component.advance_to(end_ns, &inputs).unwrap();
            let (model, state) = (component.model(), component.state());
            let expected = format!("{:032x}", ballast_columns::state_hash(model, state));
            let d = model.driven_index(TINE).unwrap();
            for importer in &importers {
                set_motion(importer, given);
                importer.step(time, STEP);
                assert_eq!(importer.hash(), expected, "{:?}", importer.version);
                let force = importer.get(&format!("{TINE}.force"));
                assert_eq!(force, result.bodies[d].mean_force.as_slice());
                let at = importer.get(&format!("{TINE}.body_position"));
                assert_eq!(at, result.bodies[d].pose.position.as_slice());
            }
        }
    }
}

#[test]
fn positions_alone_move_linearly() {
    let importer = Importer::ready(Version::Three, unpacked(), |_| ());
    let position = format!("{TINE}.position");
    let [x, y, z]: [f64; 3] = importer.get(&position).try_into().unwrap();
    for k in 0..4 {
        importer.set(&position, &[x, y, z - 0.001 * f64::from(k + 1)]);
        importer.step(f64::from(k) * STEP, STEP);
        // A cubic motion whose velocities are zero would stop after each window.
        let speed = importer.get(&format!("{TINE}.body_velocity"))[2];
        assert!(speed < -0.1, "{speed} m/s");
    }
}

#[test]
fn a_load_presses_a_free_sleeper_down() {
    let unit = unpacked_with_free_sleeper();
    let sleeper = unit.bed.model.driven.iter().find(|d| d.mount.is_some()).unwrap().name.clone();
    for version in VERSIONS {
        let importer = Importer::ready(version, unit, |_| ());
        let height = |i: &Importer| i.get(&format!("{sleeper}.body_position"))[2];
        let start = height(&importer);
        importer.set(&format!("{sleeper}.load_force"), &[0.0, 0.0, -500.0]);
        for k in 0..4 {
            importer.step(f64::from(k) * STEP, STEP);
        }
        let speed = importer.get(&format!("{sleeper}.body_velocity"))[2];
        assert!(height(&importer) < start - 1e-3, "{} m after {start} m", height(&importer));
        assert!(speed < 0.0, "{speed} m/s");
    }
}

#[test]
fn what_cannot_be_done_changes_nothing() {
    for version in VERSIONS {
        let importer = Importer::ready(version, unpacked(), |_| ());
        set_motion(&importer, STEP);
        importer.step(0.0, STEP);
        let before = importer.hash();
        let position = format!("{TINE}.position");
        let values = importer.get(&position);
        for (time, length, expected) in [
            (0.0, STEP, 3),
            (STEP, 0.0, 3),
            (STEP, -1.0, 3),
            (STEP, f64::NAN, 3),
            (STEP, 0.0015, 2),
            (STEP, 1e300, 2),
        ] {
            let (status, early, last) = importer.step_status(time, length);
            assert_eq!((status, early, last), (expected, false, STEP), "{time} s, {length} s");
        }
        assert_eq!(importer.set_status(&position, &[f64::NAN, 0.0, 0.0]), 2);
        assert_eq!(importer.set_status(&format!("{TINE}.force"), &[0.0; 3]), 3);
        assert_eq!(importer.set_status("solver.tolerance", &[-1.0]), 2);
        assert_eq!((importer.get(&position), importer.hash()), (values, before));
        importer.step(STEP, STEP);
    }
}

#[test]
fn a_step_that_fails_ends_early_or_is_discarded() {
    let unit = unpacked();
    for (version, early) in [(Version::Two, false), (Version::Three, false), (Version::Three, true)]
    {
        let importer = Importer::with_early_return(version, unit, early);
        importer.initialize();
        let before = importer.hash();
        // The tine moves far beyond the speed limit in the last steps.
        let [x, y, z]: [f64; 3] = importer.get(&format!("{TINE}.position")).try_into().unwrap();
        importer.set(&format!("{TINE}.position"), &[x, y, z]);
        importer.set(&format!("{TINE}.velocity"), &[0.0, 0.0, -80.0]);
        let (status, is_early, last) = importer.step_status(0.0, 0.02);
        match (version, early) {
            (Version::Three, true) => {
                assert_eq!((status, is_early), (0, true));
                assert!(last > 0.0 && last < 0.02 && importer.hash() != before);
            }
            (Version::Two, _) => {
                assert_eq!(status, 2);
                assert!(last > 0.0 && last < 0.02 && importer.hash() != before);
            }
            (Version::Three, false) => {
                assert_eq!((status, is_early, last), (2, false, 0.0));
                assert_eq!(importer.hash(), before);
            }
        }
    }
}

#[test]
fn a_unit_refuses_other_tokens_and_resources() {
    let unit = unpacked();
    for version in VERSIONS {
        let empty = tempfile::tempdir().unwrap();
        let refused = |resources, token| instantiate(version, resources, token, false).is_null();
        assert!(refused(unit.resources.path(), c"{another}"));
        assert!(refused(empty.path(), &unit.token));
        let mut bytes = unit.bed.to_bytes();
        *bytes.last_mut().unwrap() ^= 1;
        std::fs::write(empty.path().join(ballast_fmu::bed::BED_FILE), bytes).unwrap();
        assert!(refused(empty.path(), &unit.token));
    }
}
