//! Plates from case file to run.

use crate::broken::errors;
use crate::{BASE, changed};
use ballast::component::{
    Component, Interpolation, Knot, Limits, MotionInput, Session, TampingDriver, Waveform,
    WindowInputsRef,
};
use ballast::math::Vec3;
use ballast::model::{DofMode, Role};
use ballast::track::plan::Plan;
use ballast::track::{Bed, TampingCycle, deposit::deposit, scene::scene};
use ballast_scenario::{content_key, read_case};
use std::ops::ControlFlow;
use std::sync::{Arc, LazyLock};

/// Some sixty stones in a box with a loaded lid on them.
const PRESS: &str = r#"name = "press"

[bed]
size_m = [0.16, 0.12, 0.25]
sleeper_underside_z_m = 0.08
grains = { classes = [{ size_m = 0.03, number_fraction = 1 }], shape_count = 6 }

[[plate]]
name = "lid"
x_m = 0.08
y_m = 0.06
boxes = [{ size_m = [0.16, 0.12, 0.02] }]
mount = { z = "free" }
load = [{ time_s = 0.05, force_N = [0, 0, -400] }]

[run]
duration_s = 0.4
step_s = 1e-3
"#;

fn plan(text: &str) -> Plan {
    read_case(text, "case.toml").unwrap_or_else(|e| panic!("{e}")).plan
}

/// Returns the case with another plate on the stones.
fn with_plate(keys: &str) -> String {
    let (before, rest) = PRESS.split_once("mount").unwrap();
    let (_, run) = rest.split_once("[run]").unwrap();
    format!("{before}{keys}\n[run]{run}")
}

static BED: LazyLock<Bed> =
    LazyLock::new(|| deposit(&plan(PRESS), &mut |_| ControlFlow::Continue(())).unwrap().unwrap());

type PlateSession = Session<TampingDriver>;

/// Returns the run of a case on the bed of [`PRESS`], which has the same stones.
fn session(text: &str) -> PlateSession {
    let plan = plan(text);
    assert_eq!(content_key(&plan), content_key(&self::plan(PRESS)), "another bed");
    let (model, state) = scene(&plan, BED.clone()).unwrap();
    let cycle = TampingCycle::new(&plan, &model).unwrap();
    let component = Component::new(Arc::new(model), state, Limits::default()).unwrap();
    Session::new(component, TampingDriver::new(cycle))
}

fn lid(session: &PlateSession) -> usize {
    session.component().model().driven_index("lid").unwrap()
}

fn position(session: &PlateSession) -> Vec3 {
    let component = session.component();
    component.state().position[component.model().grains.len() + lid(session)]
}

#[test]
fn a_load_arrives_at_the_stones_with_the_weight() {
    let mut session = session(PRESS);
    let d = lid(&session);
    let mut force = 0.0;
    for step in 1..=400 {
        let window = session.step(&mut ()).unwrap().unwrap();
        force += if step > 300 { window.result.bodies[d].mean_force.z / 100.0 } else { 0.0 };
    }
    let carried = 400.0 + 7850.0 * 0.16 * 0.12 * 0.02 * 9.81;
    assert!((force / carried - 1.0).abs() < 0.01, "{force} N of {carried} N");
}

#[test]
fn a_motion_is_followed_from_where_the_plate_was_lowered_to() {
    let motion = "motion = [{ time_s = 0.02, displacement_m = [0, 0, 0] }, { time_s = 0.04, \
                  displacement_m = [0, 0, 0.01] }, { time_s = 0.055, displacement_m = [0.002, 0, 0.004] }]";
    let mut session = session(&with_plate(motion));
    let start = position(&session);
    let mut moved = vec![Vec3::zeros()];
    for _ in 0..60 {
        session.step(&mut ()).unwrap().unwrap();
        moved.push(position(&session) - start);
    }
    let last = [0.002, 0.0, 0.004];
    for (step, expected) in
        [(20, [0.0; 3]), (30, [0.0, 0.0, 0.005]), (40, [0.0, 0.0, 0.01]), (55, last), (60, last)]
    {
        let error = (moved[step] - Vec3::from(expected)).norm();
        assert!(error < 1e-15, "step {step}: {:?}", moved[step]);
    }
}

#[test]
fn a_plate_restored_in_mid_motion_continues_as_if_never_interrupted() {
    let text = with_plate(
        "motion = [{ time_s = 0.03, displacement_m = [0, 0, -0.002] }]\n\
         vibration = { amplitude_m = [0.001, 0, 0], frequency_Hz = 50 }",
    );
    let run = |session: &mut PlateSession, steps: usize| {
        (0..steps).for_each(|_| drop(session.step(&mut ()).unwrap().unwrap()));
    };
    let mut undisturbed = session(&text);
    run(&mut undisturbed, 40);
    let mut first = session(&text);
    run(&mut first, 17);
    let saved = first.component().save();
    let mut second = session(&text);
    second.parts_mut().1.restore(saved).unwrap();
    run(&mut second, 23);
    assert!(second.component().state() == undisturbed.component().state());
}

#[test]
fn a_partner_moves_a_plate_by_its_name() {
    let mut session = session(&with_plate(""));
    let (d, start) = (lid(&session), position(&session));
    let (_, component) = session.parts_mut();
    let pose = component.state().imposed(component.model(), d);
    let knot = |time_ns, z| {
        let mut pose = pose;
        pose.position.z += z;
        let (velocity, angular_velocity) = (Vec3::zeros(), Vec3::zeros());
        Knot { time_ns, pose, velocity, angular_velocity }
    };
    let knots = vec![knot(0, 0.0), knot(5_000_000, 0.003)];
    let waveform = Waveform { interpolation: Interpolation::Hermite, knots };
    let motions = [MotionInput { body: "lid".into(), waveform, allow_jump: false }];
    let inputs = WindowInputsRef { motions: &motions, loads: &[] };
    component.advance_to(5_000_000, inputs).unwrap();
    assert!((position(&session) - start - Vec3::new(0.0, 0.0, 0.003)).norm() < 1e-15);
}

#[test]
fn plates_of_the_preparation_are_part_of_the_bed_and_others_are_not() {
    let base = content_key(&plan(BASE));
    let plate = "[[plate]]\nname = \"wall\"\nx_m = 0.02\ny_m = 0.1\nz_m = 0.1\n\
                 boxes = [{ size_m = [0.02, 0.1, 0.2] }]\n";
    let with = |keys: &str| plan(&changed("[run]", &format!("{plate}{keys}\n[run]")));
    assert_eq!(content_key(&with("")), base);
    let standing = content_key(&with("in_preparation = true"));
    assert_ne!(standing, base);
    let motion =
        "in_preparation = true\nvibration = { amplitude_m = [0, 0, 0.001], frequency_Hz = 40 }";
    assert_eq!(content_key(&with(motion)), standing);
    assert_ne!(content_key(&with("in_preparation = true\nfriction = 0.1")), standing);
}

#[test]
fn absent_keys_are_those_of_boundaries_and_steel() {
    let text = PRESS.replace("[[plate]]", "[bed.stiffness]\ngrain_N_per_m = 3e6\n[[plate]]");
    let plan = plan(&text);
    let lid = &plan.plates[0];
    assert_eq!((lid.friction, lid.stiffness), (0.8, plan.bed.stiffness.boundary[0]));
    let mount = lid.mount.unwrap();
    assert!((mount.mass - 7850.0 * 0.16 * 0.12 * 0.02).abs() < 1e-12, "{}", mount.mass);
    assert_eq!(mount.dof_modes[2], DofMode::Free);
    assert!(mount.dof_modes[..2].iter().all(|mode| mode.is_prescribed()));
}

#[test]
fn the_shear_box_of_the_examples_shears_its_stones() {
    let text = include_str!("../../../../examples/shear_box.toml");
    let mut case = read_case(text, "shear_box").unwrap_or_else(|e| panic!("{e}"));
    assert!(case.warnings.is_empty(), "{:?}", case.warnings);
    case.plan.run.solver.max_iterations = 200;
    let bed = deposit(&case.plan, &mut |_| ControlFlow::Continue(())).unwrap().unwrap();
    let (model, state) = scene(&case.plan, bed).unwrap();
    let plates: Vec<&str> =
        model.driven.iter().filter(|d| d.role == Role::Plate).map(|d| &d.name[..]).collect();
    assert_eq!(plates, ["lid", "lower", "upper"]);
    let [lid, lower, upper] =
        ["lid", "lower", "upper"].map(|name| model.driven_index(name).unwrap());
    let cycle = TampingCycle::new(&case.plan, &model).unwrap();
    let component = Component::new(Arc::new(model), state, Limits::default()).unwrap();
    let mut session = Session::new(component, TampingDriver::new(cycle));
    // Up to a tenth of the displacement of the example.
    let mut forces = [Vec3::zeros(); 3];
    for step in 1..=480 {
        let window = session.step(&mut ()).unwrap().unwrap();
        if step > 440 {
            let bodies = &window.result.bodies;
            let of = [lid, lower, upper].map(|d| bodies[d].mean_force / 40.0);
            forces.iter_mut().zip(of).for_each(|(sum, force)| *sum += force);
        }
    }
    let component = session.component();
    let moved = component.state().position[component.model().grains.len() + upper].x - 0.14;
    assert!((moved - 0.002).abs() < 1e-12, "{moved}");
    let [lid, lower, upper] = forces;
    let carried = 1000.0 + 7850.0 * 0.16 * 0.16 * 0.02 * 9.81;
    assert!((lid.z / carried - 1.0).abs() < 0.03, "{} N of {carried} N", lid.z);
    assert!(lower.x > 50.0 && upper.x < -50.0, "no shear force: {lower} {upper}");
}

#[test]
fn contradictions_of_plates_are_refused_with_their_place() {
    let wall = "[[plate]]\nname = \"wall\"\nx_m = 0.08\ny_m = 0.06\nz_m = 0.2\n\
                boxes = [{ size_m = [0.1, 0.02, 0.1] }]\n";
    for (keys, line, texts) in [
        ("thickness_m = 1", 13, &["unknown key `thickness_m`"][..]),
        ("motion = []", 13, &["wrong number of entries"]),
        ("load = []", 13, &["wrong number of entries"]),
        ("load = [{ force_N = [0, 0, nan] }]", 13, &["out of range", "`nan`"]),
        ("z_m = inf", 13, &["not finite"]),
        (
            "load = [{ force_N = [0, 0, -9] }]",
            13,
            &["no load moves `lid` along z", "without a mount"],
        ),
        (
            "mount = { z = \"free\" }\nload = [{ force_N = [5, 0, 0] }]",
            14,
            &["no load moves `lid` along x", "`x = \"prescribed\"` in its mount"],
        ),
        (
            "mount = { z = \"free\" }\nmotion = [{ time_s = 0.1, displacement_m = [0, 0, -0.01] }]",
            14,
            &["`motion` cannot move `lid` along z"],
        ),
        (
            "mount = { z = \"free\" }\nvibration = { amplitude_m = [0, 0, 1e-3], frequency_Hz = 40 }",
            14,
            &["`vibration` cannot move `lid` along z"],
        ),
        (
            "motion = [{ time_s = 0.1, displacement_m = [0, 0, 0] },\n{ time_s = 0.1, displacement_m = [0, 0, 0] }]",
            14,
            &["not in order of time", "more than 0.1 s"],
        ),
        (
            "motion = [{ time_s = 0, displacement_m = [0, 0, 0.1] }]",
            13,
            &["begins with a jump", "at 0 s"],
        ),
        (
            "motion = [{ time_s = 1e-3, displacement_m = [0, 0, 0.1] }]",
            13,
            &["too large for this motion", "half the smallest grain"],
        ),
        (
            "vibration = { amplitude_m = [0, 0, 1e-3], frequency_Hz = 200 }",
            13,
            &["too large for the vibration", "5.0 steps per period"],
        ),
        (
            "vibration = { amplitude_m = [0, 0, 1e-3], frequency_Hz = 20, start_s = 0.38 }",
            13,
            &["shorter than its period"],
        ),
        ("in_preparation = true", 13, &["missing key `z_m`"]),
        ("mount = { z = \"spring\" }", 13, &["missing key `stiffness_N_per_m`"]),
        (
            "[[plate]]\nname = \"floor\"\nx_m = 0\ny_m = 0\nboxes = [{ size_m = [0.1, 0.1, 0.1] }]",
            14,
            &["this name is taken"],
        ),
        (
            "[[plate]]\nname = \"far\"\nx_m = 0\ny_m = 1\nboxes = [{ size_m = [0.1, 0.1, 0.1] }]",
            16,
            &["`far` stands outside the box", "y = 1 m"],
        ),
    ] {
        let found = errors(&with_plate(keys));
        let fits = |e: &ballast_scenario::CaseDiagnostic| {
            let text = e.to_string();
            e.line == line && texts.iter().all(|part| text.contains(part))
        };
        assert!(found.errors.iter().any(fits), "{keys}, line {line}: {found}");
    }
    // Meetings, the error being at the later plate.
    for (keys, motion, texts) in [
        ("z_m = 0.2", "", &["`wall` overlaps `lid` at the start"][..]),
        (
            "z_m = 0.4",
            "motion = [{ time_s = 0.3, displacement_m = [0, 0, 0.5] }]\n",
            &["`wall` and `lid` move into each other", "before 0.3 s"],
        ),
    ] {
        let found = errors(&with_plate(&format!("{keys}\n{wall}{motion}"))).to_string();
        assert!(texts.iter().all(|text| found.contains(text)), "{found}");
    }
    let plate = "[[plate]]\nname = \"wall\"\nx_m = 0.3\ny_m = 0.35\nz_m = 0.3\n\
                 boxes = [{ size_m = [0.4, 0.02, 0.05] }]\n[run]";
    let found = errors(&changed("[run]", plate)).to_string();
    assert!(found.contains("`wall` overlaps `sleeper_1` at the start"), "{found}");
    let tine = plate.replace("y_m = 0.35", "y_m = 0.25").replace("x_m = 0.3", "x_m = 0.04");
    let found = errors(&changed("[run]", &tine)).to_string();
    assert!(found.contains("`wall` overlaps `tine_1_plus` at the start"), "{found}");
}
