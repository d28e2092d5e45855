use crate::drive::StepInputs;
use crate::geometry::AxisBox;
use crate::math::Vec3;
use crate::model::{ContactStiffness, Role};
use crate::observe::{self, Zone};
use crate::step::step;
use crate::track::plan::{LoadCycles, Plan, SleeperPlan, StiffnessPlan, SubgradePlan, TrafficPlan};
use crate::track::test_plan::small_plan;
use crate::track::{Bed, DepositStage, deposit, scene};
use crate::workspace::Workspace;
use std::ops::ControlFlow;

const LOAD: LoadCycles =
    LoadCycles { cycles: 4, max_load: 900.0, min_load: 100.0, frequency: 20.0 };

/// Some hundred compliant grains under a short block that carries traffic.
fn trafficked() -> Plan {
    let mut plan = small_plan();
    let springs =
        ContactStiffness { normal: 1e6, tangential_ratio: 1.0, ..ContactStiffness::default() };
    plan.bed.stiffness =
        StiffnessPlan { grain: springs, sleeper: springs, tine: springs, boundary: [springs; 5] };
    plan.bed.size = Vec3::new(0.26, 0.2, 0.3);
    plan.bed.grains.classes[0].size = 0.03;
    plan.bed.friction.grain = 0.6;
    plan.bed.preparation.ballast_depth = 0.08;
    plan.bed.preparation.fill_level = 0.12;
    plan.bed.preparation.max_settling = 0.3;
    plan.bed.preparation.rest_speed = 0.02;
    plan.bed.traffic = Some(TrafficPlan { load: LOAD, settlement_limit: 0.0 });
    plan.sleepers[0].centre = [0.13, 0.1];
    plan.sleepers[0].blocks[0].size = Vec3::new(0.08, 0.1, 0.04);
    plan.run.stepping.step_ns = 500_000;
    for tine in &mut plan.tines {
        tine.position[1] = 0.1;
    }
    plan
}

fn prepared(plan: &Plan) -> Bed {
    deposit(plan, &mut |_| ControlFlow::Continue(())).unwrap().unwrap()
}

#[test]
fn the_load_rises_from_zero_and_swings_between_its_limits_until_it_is_taken_off() {
    let load = |cycles: f64| LOAD.load(cycles / LOAD.frequency);
    assert!((LOAD.duration() - 0.2).abs() < 1e-15);
    for (cycles, expected) in [
        (-0.1, 0.0),
        (0.0, 0.0),
        (0.25, 450.0),
        (0.5, 900.0),
        (1.0, 100.0),
        (1.25, 500.0),
        (3.0, 100.0),
        (3.5, 900.0),
        (3.75, 500.0),
        (4.1, 0.0),
    ] {
        assert!((load(cycles) - expected).abs() < 1e-9, "{} at {cycles}", load(cycles));
    }
    let single = LoadCycles { cycles: 1, ..LOAD };
    assert!((single.load(0.5 / LOAD.frequency) - 900.0).abs() < 1e-9);
    assert!((0..100).all(|i| single.load(f64::from(i) * 5e-4) <= 900.0));
}

#[test]
fn traffic_settles_the_sleeper_and_compacts_the_bed_under_it() {
    let plan = trafficked();
    let bed = prepared(&plan);
    assert_eq!(bed, prepared(&plan), "the same plan gives the same bytes");
    assert_eq!(bed.settlements.len(), 4);
    assert!(bed.settlements[0] > 1e-4, "{:?}", bed.settlements);
    let total = bed.settlements[3];
    assert!(total > bed.settlements[0] && total < 0.04, "{:?}", bed.settlements);
    // The sleeper stands at its level again, the floor is higher by the settlement.
    let (n, state) = (bed.model.grains.len(), &bed.state);
    let body = |name: &str| n + bed.model.driven_index(name).unwrap();
    assert_eq!(state.position[body("sleeper")], Vec3::new(0.13, 0.1, 0.08));
    assert!((state.position[body("floor")].z - total).abs() < 1e-12, "{total}");
    assert!(state.mount.is_empty(), "it stands");
    assert_eq!(state.velocity[body("sleeper")], Vec3::zeros());
    let roles: Vec<Role> = bed.model.driven.iter().map(|d| d.role).collect();
    assert_eq!(roles[..5], [Role::Boundary; 5]);
    assert_eq!(roles[5..], [Role::Sleeper]);
    assert!(state.position[..n].iter().all(|p| p.z > total && p.z < 0.13));
    let mut loose = plan.clone();
    loose.bed.traffic = None;
    let loose = prepared(&loose);
    assert!(loose.settlements.is_empty());
    let under = |bed: &Bed, floor: f64| {
        let region =
            AxisBox { low: Vec3::new(0.09, 0.05, floor), high: Vec3::new(0.17, 0.15, 0.08) };
        let zone = Zone { name: "under".into(), region };
        observe::compactness(&bed.model, &bed.state, &zone).unwrap().compactness
    };
    let compactness = [under(&loose, 0.0), under(&bed, total)];
    assert!(compactness[1] > 1.02 * compactness[0], "{compactness:?}");
    scene(&plan, bed).expect("the bed of the plan");
}

#[test]
fn traffic_ends_where_a_cycle_settles_less_than_the_limit() {
    let mut plan = trafficked();
    plan.bed.traffic = Some(TrafficPlan { load: LOAD, settlement_limit: 1.0 });
    let mut stages = Vec::new();
    let bed = deposit(&plan, &mut |progress| {
        assert!(progress.has_traffic && progress.step <= progress.most_steps);
        if stages.last() != Some(&progress.stage) {
            stages.push(progress.stage);
        }
        ControlFlow::Continue(())
    });
    assert_eq!(bed.unwrap().unwrap().settlements.len(), 1);
    assert!(stages.is_sorted() && stages.contains(&DepositStage::Traffic), "{stages:?}");
    plan.sleepers.clear();
    let message = deposit(&plan, &mut |_| ControlFlow::Continue(())).unwrap_err().to_string();
    assert!(message.contains("bed.traffic"), "{message}");
}

#[test]
fn a_floor_on_a_subgrade_carries_the_bed_and_follows_its_level() {
    let mut plan = trafficked();
    let soil = SubgradePlan { modulus: 2e6, damping_ratio: 0.4, mass_per_area: 500.0 };
    plan.bed.subgrade = Some(soil);
    let bed = prepared(&plan);
    let names: Vec<&str> = bed.model.driven.iter().map(|d| d.name.as_str()).collect();
    assert_eq!(names, ["floor", "wall_x_min", "wall_x_max", "wall_y_min", "wall_y_max", "sleeper"]);
    let total = bed.settlements[3];
    assert_eq!((bed.state.mount.len(), bed.state.mount[0].position.z > 0.9 * total), (1, true));
    scene(&plan, bed).expect("the bed of the plan");
    // Between smooth walls and without a sleeper, the floor alone carries the weight.
    plan.bed.traffic = None;
    plan.bed.friction.boundary = [0.6, 0.0, 0.0, 0.0, 0.0];
    plan.bed.preparation.rest_speed = 1e-3;
    plan.bed.preparation.max_settling = 2.0;
    plan.sleepers.clear();
    plan.tines.clear();
    plan.tamping = None;
    let Bed { model, mut state, .. } = prepared(&plan);
    let targets = state.imposed_poses(&model);
    let mut workspace = Workspace::default();
    for _ in 0..1000 {
        let inputs = StepInputs::from_targets(&targets);
        step(&model, &mut state, &inputs, &mut workspace, &mut ()).unwrap();
    }
    let n = model.grains.len();
    let inside = (0..n).filter(|g| state.position[*g].z > -0.01);
    let weight = 9.81 * inside.map(|g| model.grains.mass[g]).sum::<f64>();
    let sinks = weight / (soil.modulus * plan.bed.size.x * plan.bed.size.y);
    let found = -state.position[n].z;
    assert!((found / sinks - 1.0).abs() < 0.01, "{found} m instead of {sinks} m");
    plan.bed.subgrade = Some(SubgradePlan { modulus: 0.0, ..soil });
    let message = deposit(&plan, &mut |_| ControlFlow::Continue(())).unwrap_err().to_string();
    assert!(message.contains("bed.subgrade.modulus"), "{message}");
}

#[test]
fn sleepers_that_settle_differently_are_brought_to_one_level() {
    let mut plan = trafficked();
    plan.bed.size.x = 0.4;
    let at = |name: &str, x: f64| SleeperPlan {
        name: name.into(),
        centre: [x, 0.1],
        ..plan.sleepers[0].clone()
    };
    plan.sleepers = vec![at("one", 0.1), at("other", 0.3)];
    plan.tines.clear();
    plan.tamping = None;
    let bed = prepared(&plan);
    let n = bed.model.grains.len();
    for name in ["one", "other"] {
        let place = bed.model.driven_index(name).unwrap();
        assert_eq!(bed.state.position[n + place].z, 0.08, "{name}");
    }
    assert_eq!(bed.model.driven[5].name, "one", "their order is that of the plan");
    scene(&plan, bed).expect("the bed of the plan");
}
