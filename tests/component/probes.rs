//! Probes of a sleeper in closed form: springs in series, friction under a weight.

use crate::MS;
use crate::common::scene::{GRAVITY, Scene};
use ballast::component::{PushProbe, Refusal, StiffnessProbe, StopReason, sleepers};
use ballast::geometry::cuboid;
use ballast::math::{Pose, Vec3};
use ballast::model::{ContactStiffness, Part, Role};
use ballast::step::StepObserver;

/// Density of the sleeper, kg/m³.
const CONCRETE: f64 = 2400.0;
const STIFFNESS: f64 = 1e6;
const FRICTION: f64 = 0.4;
/// Half sizes of the sleeper, m.
const HALF: [f64; 3] = [0.08, 0.08, 0.05];

/// A sleeper on a slab on the floor, with four springs above and four below the slab; `gap` is above the slab.
fn sleeper_on_slab(gap: f64) -> (Scene, usize) {
    let mut scene = Scene::new(MS, 0.8);
    let slab = scene.shape(cuboid(Vec3::new(0.1, 0.1, 0.02)));
    scene.grain(slab, Pose::at(Vec3::new(0.0, 0.0, 0.02)));
    scene.plane("floor", Pose::identity(), 0.8);
    let block = scene.shape(cuboid(Vec3::from(HALF)));
    let part = Part::Convex { shape: block, pose: Pose::at(Vec3::new(0.0, 0.0, HALF[2])) };
    let at = Pose::at(Vec3::new(0.0, 0.0, 0.04 + gap));
    let sleeper = scene.driven("sleeper", part, at, FRICTION);
    scene.model.driven[sleeper].role = Role::Sleeper;
    let springs = ContactStiffness { normal: STIFFNESS, tangential_ratio: 1.0, damping_time: 5e-4 };
    scene.model.driven.iter_mut().for_each(|body| body.stiffness = springs);
    (scene, sleeper)
}

#[test]
fn support_stiffness_is_that_of_springs_in_series() {
    let (scene, sleeper) = sleeper_on_slab(0.0);
    let probe = StiffnessProbe { max_load: 2000.0, min_load: 200.0, cycles: 2, ramp: 0.4 };
    let curve = probe.run(&scene.model, &scene.state, sleeper, &mut ()).expect("a curve");
    let expected = 2.0 * STIFFNESS;
    assert_eq!(curve.cycles.len(), 2);
    for (k, cycle) in curve.cycles.iter().enumerate() {
        for found in [cycle.loading, cycle.unloading] {
            assert!((found / expected - 1.0).abs() < 1e-2, "cycle {k}: {found} N/m");
        }
        assert!(
            (cycle.settlement - 2000.0 / expected).abs() < 1e-2 * cycle.settlement,
            "{cycle:?}"
        );
        assert!((cycle.rest - 200.0 / expected).abs() < 1e-2 * cycle.settlement, "{cycle:?}");
    }
    let largest = curve.points.iter().map(|p| p.force).fold(0.0, f64::max);
    assert!((largest - 2000.0).abs() < 1e-9);
    assert!(curve.points.windows(2).all(|p| p[0].time < p[1].time));
}

#[test]
fn a_push_is_resisted_by_friction_under_the_weight() {
    // Lifted by 0.2 mm: the weight seats it first.
    let (scene, sleeper) = sleeper_on_slab(2e-4);
    let probe = PushProbe { displacement: 3e-3, speed: 0.02, seating: 0.3 };
    let curve = probe.run(&scene.model, &scene.state, sleeper, &mut ()).expect("a curve");
    let weight = CONCRETE * HALF.iter().map(|x| 2.0 * x).product::<f64>() * GRAVITY;
    assert!((curve.weight / weight - 1.0).abs() < 1e-9, "{} N", curve.weight);
    let force = curve.force_at(2e-3).expect("a curve beyond 2 mm");
    assert!((force / (FRICTION * weight) - 1.0).abs() < 1e-2, "{force} N, weight {weight} N");
    assert_eq!(curve.force_at(4e-3), None);
}

#[test]
fn probes_leave_the_state_and_repeat() {
    let (scene, sleeper) = sleeper_on_slab(0.0);
    let before = scene.state.clone();
    let run = || {
        let probe = StiffnessProbe { cycles: 1, ..StiffnessProbe::default() };
        probe.run(&scene.model, &scene.state, sleeper, &mut ()).expect("a curve")
    };
    assert_eq!(run(), run());
    assert_eq!(scene.state, before);
}

/// Observer that cancels at once.
struct Cancel;

impl StepObserver for Cancel {
    fn cancelled(&mut self) -> Option<StopReason> {
        Some(StopReason::Cancel)
    }
}

#[test]
fn impossible_probes_are_refused_and_probes_can_be_cancelled() {
    let (scene, sleeper) = sleeper_on_slab(0.0);
    let (model, state) = (&scene.model, &scene.state);
    assert_eq!(sleepers(model).collect::<Vec<_>>(), [sleeper]);
    let refused = |probe: StiffnessProbe, body: usize| {
        probe.run(model, state, body, &mut ()).expect_err("a refusal").to_string()
    };
    let default = StiffnessProbe::default();
    let text = refused(StiffnessProbe { max_load: f64::NAN, ..default }, sleeper);
    assert!(text.contains("probe: largest load") && text.contains("NaN"), "{text}");
    let text = refused(StiffnessProbe { min_load: 1e9, ..default }, sleeper);
    assert!(text.contains("below the largest load"), "{text}");
    let text = refused(default, 0);
    assert!(text.contains("a sleeper, one of [\"sleeper\"]"), "{text}");
    let cancelled = default.run(model, state, sleeper, &mut Cancel);
    assert!(matches!(cancelled, Err(Refusal::Cancelled)), "{cancelled:?}");
}
