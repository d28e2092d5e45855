use super::*;
use crate::track::test_plan::small_plan;
use crate::track::{Bed, deposit, scene};
use std::ops::ControlFlow;
use std::sync::LazyLock;

const LID_SIZE: [f64; 3] = [0.16, 0.12, 0.02];

fn steel(name: &str, boxes: Vec<PlateBox>) -> PlatePlan {
    PlatePlan {
        name: name.into(),
        position: [0.08, 0.06],
        z: None,
        boxes,
        friction: 0.3,
        stiffness: crate::model::ContactStiffness::RIGID,
        mount: None,
        in_preparation: false,
        motion: Vec::new(),
        vibration: None,
        load: Vec::new(),
    }
}

fn of_size(size: [f64; 3]) -> Vec<PlateBox> {
    vec![PlateBox { offset: Vec3::zeros(), size: Vec3::from(size) }]
}

/// A box of some sixty grains without sleepers and tines.
fn bare() -> Plan {
    let mut plan = small_plan();
    plan.bed.size = Vec3::new(0.16, 0.12, 0.3);
    plan.bed.grains.classes[0].size = 0.03;
    plan.bed.preparation.ballast_depth = 0.08;
    plan.bed.preparation.fill_level = 0.08;
    plan.bed.preparation.rest_speed = 0.01;
    (plan.sleepers, plan.tines, plan.tamping) = (Vec::new(), Vec::new(), None);
    plan.run.stepping.step_ns = 1_000_000;
    plan.run.solver.max_iterations = 200;
    plan
}

fn prepared(plan: &Plan) -> Bed {
    deposit(plan, &mut |_| ControlFlow::Continue(())).unwrap().unwrap()
}

static BED: LazyLock<Bed> = LazyLock::new(|| prepared(&bare()));

fn with_plate(plate: PlatePlan) -> Plan {
    Plan { plates: vec![plate], ..bare() }
}

fn message(plan: &Plan) -> String {
    scene(plan, BED.clone()).unwrap_err().to_string()
}

#[test]
fn a_plate_without_a_height_touches_the_highest_grain_below_it() {
    let plan = with_plate(steel("lid", of_size(LID_SIZE)));
    let (model, state) = scene(&plan, BED.clone()).unwrap();
    let d = model.driven_index("lid").unwrap();
    let underside = state.position[model.grains.len() + d].z - 0.5 * LID_SIZE[2];
    let top = |g: usize| {
        let shape = &model.shapes[model.grains.shape[g] as usize];
        crate::track::deposit::top(shape, &state.pose(g))
    };
    let highest = (0..model.grains.len()).map(top).fold(0.0, f64::max);
    assert!((underside - highest).abs() < 1e-15, "{underside} {highest}");
}

#[test]
fn plates_in_grains_or_bodies_are_refused() {
    let deep = PlatePlan { z: Some(0.05), ..steel("lid", of_size(LID_SIZE)) };
    let text = message(&with_plate(deep.clone()));
    assert!(text.contains("\"lid\"") && text.contains("clear of the grains"), "{text}");
    let high = |name: &str| PlatePlan { z: Some(0.3), name: name.into(), ..deep.clone() };
    let text = message(&Plan { plates: vec![high("lid"), high("other")], ..bare() });
    assert!(text.contains("\"other\"") && text.contains("clear of all other bodies"), "{text}");
    let beside = PlatePlan { position: [0.5, 0.06], ..steel("lid", of_size(LID_SIZE)) };
    let text = message(&with_plate(beside));
    assert!(text.contains("grains below it"), "{text}");
    let standing = PlatePlan { in_preparation: true, ..high("wall") };
    let text = message(&with_plate(standing));
    assert!(text.contains("a bed that was prepared for it"), "{text}");
}

#[test]
fn a_case_has_a_start_before_its_bed_is_prepared() {
    let plan = with_plate(steel("lid", of_size(LID_SIZE)));
    let (model, _) = scene(&plan, crate::track::empty_bed(&plan).unwrap()).unwrap();
    assert!(model.driven_index("lid").is_some());
}

#[test]
fn grains_are_poured_beside_a_plate_of_the_preparation() {
    let wall = [0.02, 0.14, 0.2];
    let boxes = vec![
        PlateBox { offset: Vec3::new(-0.06, 0.0, 0.0), size: Vec3::from(wall) },
        PlateBox { offset: Vec3::new(0.07, 0.0, 0.0), size: Vec3::from(wall) },
    ];
    let plan = with_plate(PlatePlan { z: Some(0.1), in_preparation: true, ..steel("box", boxes) });
    let bed = prepared(&plan);
    let grains = bed.model.grains.len();
    // The strip behind the left wall is too narrow for a grain; 110 of 160 mm are left between the walls.
    assert!((0.5..0.8).contains(&(grains as f64 / BED.model.grains.len() as f64)), "{grains}");
    assert!((0..grains).all(|g| (0.03..0.14).contains(&bed.state.position[g].x)));
    let (model, state) = scene(&plan, bed).unwrap();
    let d = model.driven_index("box").unwrap();
    assert_eq!(state.position[grains + d], Vec3::new(0.08, 0.06, 0.1));
    assert_eq!(model.driven[d].friction, 0.3);
}
