use super::*;
use crate::drive::StepInputs;
use crate::model::{DofMode, Part};
use crate::step::step;
use crate::track::plan::{BlockPlan, SizeClass};
use crate::track::tamping_cycle::start_position;
use crate::track::test_plan::small_plan;
use crate::track::{scene, sleeper_mount};

/// A bed of some hundred grains: a few seconds of preparation.
fn tiny() -> Plan {
    let mut plan = small_plan();
    plan.bed.size = Vec3::new(0.26, 0.2, 0.3);
    plan.bed.grains.classes[0].size = 0.03;
    plan.bed.preparation.ballast_depth = 0.06;
    plan.bed.preparation.fill_level = 0.1;
    plan.bed.preparation.max_settling = 0.3;
    plan.bed.preparation.rest_speed = 0.02;
    plan.sleepers[0].centre = [0.13, 0.1];
    plan.sleepers[0].blocks[0].size = Vec3::new(0.08, 0.1, 0.04);
    for tine in &mut plan.tines {
        tine.position[1] = 0.1;
    }
    plan.run.solver.max_iterations = 100;
    plan
}

fn prepared(plan: &Plan) -> Bed {
    deposit(plan, &mut |_| ControlFlow::Continue(())).unwrap().unwrap()
}

#[test]
fn a_prepared_bed_is_the_same_for_the_same_plan_and_is_at_rest_at_its_levels() {
    let plan = tiny();
    let bed = prepared(&plan);
    let n = bed.model.grains.len();
    assert!(n > 80 && n < 200, "{n}");
    assert_eq!(bed, prepared(&plan), "the same plan gives the same bytes");
    let mut builder = BedBuilder {
        model: bed.model,
        state: bed.state,
        workspace: Workspace::default(),
        has_traffic: false,
    };
    assert!(builder.mean_speed() < 0.03, "{}", builder.mean_speed());
    assert_eq!((builder.state.step, builder.state.time_ns), (0, 0));
    assert_eq!(builder.model.grain_friction, 1.0);
    assert_eq!(builder.model.driven[5].friction, 1.0, "the sleeper's friction is the run's again");
    let sleeper = builder.state.position[n + 5];
    assert_eq!(sleeper, Vec3::new(0.13, 0.1, 0.06));
    assert!(builder.state.position[..n].iter().all(|p| p.z < 0.1 + 0.005), "trimmed");
    let shape = |g: usize| &builder.model.shapes[builder.model.grains.shape[g] as usize];
    let tops = (0..n).map(|g| top(shape(g), &builder.state.pose(g)));
    assert!(tops.fold(0.0, f64::max) < 0.1 + 0.5 * 0.03 + 0.005, "nothing sticks far out");
    // Contacts kept for the warm start are those of the bodies as numbered now.
    let contacts = &builder.state.contacts.bodies;
    assert!(contacts.iter().all(|p| (p[0] as usize) < n && (p[1] as usize) < n + 6));
    assert!(contacts.is_sorted() && !contacts.is_empty());
    builder.retain(&vec![true; n]);
    assert_eq!(builder.model.grains.len(), n);
}

#[test]
fn the_watcher_can_stop_the_preparation() {
    let mut steps = 0;
    let stopped = deposit(&tiny(), &mut |_| {
        steps += 1;
        if steps == 3 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    assert_eq!((stopped.unwrap(), steps), (None, 3));
}

#[test]
fn a_scene_is_the_bed_with_the_tines_clear_above_it() {
    let plan = tiny();
    let bed = prepared(&plan);
    let n = bed.model.grains.len();
    let mut other = plan.clone();
    other.sleepers[0].centre[0] += 0.01;
    let message = scene(&other, bed.clone()).unwrap_err().to_string();
    assert!(message.contains("\"sleeper\""), "{message}");
    assert!(message.contains("it stands at [0.13, 0.1, 0.06] m"), "{message}");
    let mut heaped = bed.clone();
    let tine = &plan.tines[0];
    heaped.state.position[0] = Vec3::new(tine.position[0], tine.position[1], 0.13);
    let message = scene(&plan, heaped).unwrap_err().to_string();
    assert!(message.contains(&tine.name) && message.contains("clearance"), "{message}");
    let (model, state) = scene(&plan, bed.clone()).unwrap();
    assert_eq!(model.driven.len(), 8);
    assert_eq!(state.position.len(), n + 8);
    assert_eq!(state.position[n + 6].z, 0.1 + 0.03 + 0.07, "fill level, clearance, blade");
    assert_eq!(state.contacts, bed.state.contacts, "numbers of what was there stay");
    assert!(state.energy.initial_potential > 0.0);
}

#[test]
fn tines_without_a_cycle_begin_above_the_grains_that_stick_out() {
    let mut plan = tiny();
    plan.tamping = None;
    let bed = prepared(&plan);
    let n = bed.model.grains.len();
    let (_, state) = scene(&plan, bed).unwrap();
    let lower_edge = state.position[n + 6].z + plan.tines[0].bounds().low.z;
    assert!((lower_edge - (0.1 + 0.75 * 0.03)).abs() < 1e-12, "three quarters of a grain");
    plan.bed.grains.classes[0].size = 0.01;
    let lower_edge = start_position(&plan, &plan.tines[0]).z + plan.tines[0].bounds().low.z;
    assert!((lower_edge - (0.1 + 0.02)).abs() < 1e-12, "20 mm at least");
}

#[test]
fn a_sleeper_that_is_loaded_is_carried_by_the_bed() {
    let mut plan = tiny();
    plan.tamping = None;
    plan.tines.clear();
    let bed = prepared(&plan);
    let mut freedoms = [DofMode::Prescribed; 6];
    freedoms[2] = DofMode::Free;
    let sleeper = &mut plan.sleepers[0];
    sleeper.mount = Some(sleeper_mount(&sleeper.blocks, Some(40.0), freedoms));
    let (model, mut state) = scene(&plan, bed.clone()).unwrap();
    model.check().unwrap();
    state.check(&model).unwrap();
    assert_eq!(model.driven_index("sleeper"), Some(0), "before all that are not mounted");
    assert_eq!(model.driven.len(), bed.model.driven.len());
    assert_eq!(state.contacts.bodies.len(), bed.state.contacts.bodies.len());
    let start = state.pose(model.grains.len());
    assert_eq!(start.position, Vec3::new(0.13, 0.1, 0.06));
    let targets: Vec<Pose> = (0..model.driven.len()).map(|d| state.imposed(&model, d)).collect();
    let mut workspace = Workspace::default();
    let (steps, mut carried) = (1200, 0.0);
    for k in 0..steps {
        let inputs = StepInputs::from_targets(&targets);
        let report = step(&model, &mut state, &inputs, &mut workspace, &mut ()).unwrap();
        if k >= steps / 2 {
            carried += report.reactions[0].impulse.z;
        }
    }
    let end = state.pose(model.grains.len());
    let sunk = start.position.z - end.position.z;
    assert!((0.0..0.01).contains(&sunk), "sank by {sunk} m");
    assert_eq!((end.position.x, end.orientation), (start.position.x, start.orientation));
    let weight = 40.0 * 9.81 * 0.5 * f64::from(steps) * model.stepping.h();
    assert!((carried / weight - 1.0).abs() < 0.02, "{carried} of {weight} N s");
}

#[test]
fn removing_and_inserting_grains_renumbers_contacts() {
    let mut builder = empty_box(&tiny()).unwrap();
    builder.model.shapes.push(crate::geometry::cuboid(Vec3::repeat(0.01)));
    let at = |x: f64| (0, Pose::at(Vec3::new(x, 0.0, 0.0)));
    builder.insert(&[at(0.0), at(1.0), at(2.0)], 1000.0);
    let memory = &mut builder.state.contacts;
    memory.bodies = vec![[0, 1], [0, 3], [1, 2], [2, 4]];
    memory.feature = vec![10, 11, 12, 13];
    memory.local_point = vec![Vec3::zeros(); 4];
    memory.overlap = vec![0.0; 4];
    memory.impulse = (0..4).map(|i| Vec3::x() * f64::from(i)).collect();
    builder.retain(&[true, false, true]);
    assert_eq!(builder.state.contacts.bodies, [[0, 2], [1, 3]]);
    assert_eq!(builder.state.contacts.feature, [11, 13]);
    assert_eq!(builder.state.contacts.impulse, [Vec3::x(), Vec3::x() * 3.0]);
    assert_eq!(builder.state.position[1].x, 2.0);
    builder.insert(&[at(7.0)], 1000.0);
    assert_eq!(builder.state.contacts.bodies, [[0, 3], [1, 4]]);
    assert_eq!(builder.state.position[2].x, 7.0);
    assert_eq!(builder.state.position.len(), 3 + 5);
}

#[test]
fn blocks_flush_with_a_wall_are_inside_whatever_rounding_says() {
    let mut plan = tiny();
    plan.bed.size.y = 0.6;
    plan.sleepers[0].centre[1] = 0.3;
    let block = plan.sleepers[0].blocks[0];
    plan.sleepers[0].blocks = vec![
        BlockPlan { offset_y: -0.2, size: Vec3::new(0.08, 0.2, 0.04) },
        BlockPlan { offset_y: 0.2, ..block },
    ];
    let low = block_boxes(&plan).next().unwrap().low.y;
    assert!(
        low < 0.0 && low > -ROUNDING_TOLERANCE,
        "the sum of these decimal numbers is not 0: {low}"
    );
    check(&plan).unwrap();
}

#[test]
fn grains_that_pack_densely_fill_their_bed_all_the_same() {
    // Small ones between large ones, without friction while they settle.
    let mut plan = tiny();
    plan.bed.size = Vec3::new(0.12, 0.1, 0.3);
    plan.bed.preparation.friction = 0.0;
    let small = SizeClass::of_size(0.012, 0.97);
    plan.bed.grains.classes = vec![SizeClass::of_size(0.03, 0.03), small];
    (plan.sleepers, plan.tines) = (vec![], vec![]);
    let bed = prepared(&plan);
    let builder = BedBuilder {
        model: bed.model,
        state: bed.state,
        workspace: Workspace::default(),
        has_traffic: false,
    };
    let height_map = present_height_map(&plan, &builder).unwrap();
    let [lacking, area] = height_map.lacking(plan.bed.preparation.fill_level);
    assert!(lacking < 0.75 * plan.bed.grains.mean_size() * area, "{} m", lacking / area);
}

#[test]
fn cribs_narrower_than_grains_stay_as_they_are() {
    for covered in [Vec3::new(0.25, 0.19, 0.04), Vec3::new(0.26, 0.2, 0.04)] {
        let mut plan = tiny();
        plan.sleepers[0].blocks[0].size = covered;
        let bed = prepared(&plan);
        let n = bed.model.grains.len();
        assert!(n > 60, "{n}");
        let tallest = bed.state.position[..n].iter().map(|p| p.z).fold(0.0, f64::max);
        assert!(tallest < 0.06, "all are below the sleeper: {tallest}");
    }
}

#[test]
fn beds_that_cannot_be_are_refused() {
    let refused = |change: &dyn Fn(&mut Plan)| {
        let mut plan = tiny();
        change(&mut plan);
        deposit(&plan, &mut |_| ControlFlow::Break(())).unwrap_err().to_string()
    };
    assert!(refused(&|p| p.bed.size.x = f64::NAN).contains("bed.size"));
    assert!(refused(&|p| p.bed.size.x = 1e9).contains("bed"));
    assert!(refused(&|p| p.bed.preparation.step_ns = 0).contains("step"));
    assert!(refused(&|p| p.bed.preparation.ballast_depth = 0.2).contains("ballast_depth"));
    let message = refused(&|p| p.sleepers[0].centre[0] = 0.03);
    assert!(message.contains("inside the box"), "{message}");
    assert!(message.contains("from [-0.01") && !message.contains('\n'), "in one line: {message}");
}

#[test]
fn a_frictionless_wall_carries_no_tangential_impulse() {
    let mut plan = tiny();
    plan.bed.friction.boundary = [0.8, 0.6, 0.2, 0.0, 0.0];
    plan.bed.stiffness.boundary[0].normal = 1e7;
    let box_before = empty_bed(&plan).unwrap();
    let frictions = |model: &Model| model.driven.iter().map(|d| d.friction).collect::<Vec<_>>();
    assert_eq!(frictions(&box_before.model)[..5], [0.3, 0.3, 0.2, 0.0, 0.0], "while it settles");
    let (model, mut state) = scene(&plan, prepared(&plan)).unwrap();
    assert_eq!(frictions(&model)[..5], plan.bed.friction.boundary);
    let springs = model.driven.iter().filter(|d| !d.stiffness.is_rigid());
    assert_eq!(springs.map(|d| d.name.as_str()).collect::<Vec<_>>(), ["floor"]);
    let targets = state.imposed_poses(&model);
    let inputs = StepInputs::from_targets(&targets);
    let mut workspace = Workspace::default();
    for _ in 0..5 {
        step(&model, &mut state, &inputs, &mut workspace, &mut ()).unwrap();
    }
    let n = model.grains.len();
    let mut slips = [0.0_f64; 5];
    for (pair, impulse) in state.contacts.bodies.iter().zip(&state.contacts.impulse) {
        let Some(wall) = (pair[1] as usize).checked_sub(n).filter(|wall| *wall < 5) else {
            continue;
        };
        let Part::HalfSpace { normal, .. } = model.driven[wall].parts[0] else { panic!("a wall") };
        let along = impulse.dot(&normal);
        let tangential = (impulse - normal * along).norm();
        slips[wall] = slips[wall].max(tangential);
        let limit = model.driven[wall].friction * along;
        // Friction is stored in single precision.
        assert!(tangential <= limit * (1.0 + 1e-6) + 1e-15, "{wall}: {tangential} beyond {limit}");
    }
    assert!(slips[3] < 1e-15 && slips[4] < 1e-15, "{slips:?} N s");
    assert!(slips[0] > 1e-9 && slips[1] > 1e-9, "{slips:?} N s");
}
