//! A small scene that uses every field of model and state.

use ballast::geometry::cuboid;
use ballast::math::{Pose, Quat, Vec3};
use ballast::model::*;
use ballast::state::*;
use ballast::window_memory::*;
use ballast_hdf5::checkpoint::{Checkpoint, Kind};
use std::sync::Arc;

fn turn(x: f64, y: f64, z: f64) -> Quat {
    Quat::from_scaled_axis(Vec3::new(x, y, z))
}

pub fn model() -> Model {
    let shapes = vec![
        cuboid(Vec3::new(0.02, 0.015, 0.01)),
        cuboid(Vec3::new(0.012, 0.014, 0.016)),
        cuboid(Vec3::new(0.12, 0.08, 0.05)),
        cuboid(Vec3::new(0.01, 0.03, 0.06)),
    ];
    let mut grains = Grains::default();
    for g in 0..27 {
        grains.push(g % 2, &shapes[g as usize % 2], 2700.0);
    }
    let part =
        |shape, position, orientation| Part::Convex { shape, pose: Pose { position, orientation } };
    let driven = |name: &str, role, friction, parts| DrivenBody {
        name: name.into(),
        role,
        friction,
        stiffness: ContactStiffness::RIGID,
        parts,
        mount: None,
    };
    let mut driven = vec![
        driven(
            "floor",
            Role::Boundary,
            1.0,
            vec![Part::HalfSpace { normal: Vec3::z(), offset: -0.02 }],
        ),
        driven(
            "wall",
            Role::Boundary,
            0.0,
            vec![Part::HalfSpace { normal: Vec3::x(), offset: -0.05 }],
        ),
        driven(
            "sleeper 1",
            Role::Sleeper,
            0.7,
            vec![
                part(2, Vec3::new(0.0, -0.2, 0.0), Quat::identity()),
                part(2, Vec3::new(0.0, 0.2, 0.0), turn(0.0, 0.0, 0.3)),
            ],
        ),
        driven("tine Ä/1", Role::Tine, 0.2, vec![part(3, Vec3::zeros(), turn(0.1, 0.2, 0.3))]),
    ];
    let mut mount = Mount::spring(1.0 / 3.0, 1e6, 0.1 + 0.2);
    mount.inertia = Vec3::new(0.1, 0.2, 0.3);
    mount.centre = Vec3::new(0.0, -0.0, 0.7);
    mount.dof_modes[4] = DofMode::Free;
    driven[0].mount = Some(mount);
    Model {
        shapes,
        grains,
        driven,
        gravity: Vec3::new(0.0, -0.0, -9.81),
        grain_friction: 0.8,
        grain_stiffness: ContactStiffness::RIGID,
        restitution: 0.1,
        stepping: Stepping { step_ns: 100_000, theta: 0.5, detection_distance: 1e-3 },
        solver: Solver {
            partition: PartitionRule::Boxes([3, 2, 1]),
            penetration_correction: Some(PenetrationCorrection::default()),
            ..Solver::default()
        },
    }
}

/// Values that a careless text or f32 round trip would change.
pub fn state(model: &Model) -> State {
    let mut state = State { step: 12_345, time_ns: u64::MAX / 3, ..State::default() };
    for g in 0..model.grains.len() {
        let k = g as f64;
        let at = |n: usize| 0.05 * n as f64;
        let position = Vec3::new(at(g % 3), at(g / 3 % 3) + 0.1 * 0.2, at(g / 9) + k * 1e-17);
        state.push(Pose { position, orientation: turn(0.3 * k, 0.1 - k, 0.7) });
        state.velocity[g] = Vec3::new(0.1 + 0.2, -0.0, 5e-324 * k);
        state.angular_velocity[g] = Vec3::new(1.0 / 3.0, f64::MIN_POSITIVE / 7.0, 1e300);
    }
    for position in
        [Vec3::zeros(), Vec3::zeros(), Vec3::new(0.05, 0.05, 0.3), Vec3::new(0.2, 0.05, 0.2)]
    {
        state.push(Pose::at(position));
    }
    state.mount.push(Pose::at(Vec3::new(0.1 + 0.2, -0.0, 1e-300)));
    for (c, a) in [(0, 1), (0, 1), (0, 27), (3, 29), (25, 26)] {
        let memory = &mut state.contacts;
        memory.feature.push(u64::MAX - memory.bodies.len() as u64);
        memory.bodies.push([c, a]);
        memory.local_point.push(Vec3::new(0.01, -0.02, 1.0 / 3.0));
        memory.impulse.push(Vec3::new(-0.0, 1e-9, 2.0 / 7.0));
        memory.overlap.push(1e-6 / 3.0);
    }
    let twist = Twist { velocity: Vec3::new(0.5, -0.0, 0.1), angular_velocity: Vec3::zeros() };
    let bodies = model.driven.len();
    let reactions = vec![[Vec3::new(1.0, -0.0, 2.0), Vec3::new(0.0, 3.0, 1e-310)]; 2 * bodies];
    state.window = Arc::new(WindowMemory {
        twists: (0..bodies).map(|d| (d > 0).then_some(twist)).collect(),
        reactions: ReactionHistory::from_rows(bodies, reactions).unwrap(),
        squeezes: vec![SqueezeTrack::default(); 2],
    });
    let values = vec![0.25, -0.0, 1e-310];
    state.driver = Arc::new(DriverState { kind: "test".into(), version: 7, values });
    state.energy.work_in = 0.1 + 0.7;
    state.energy.dissipated = 3.3;
    (state.energy.initial_elastic, state.energy.elastic) = (0.1 + 0.2, 1e-310);
    state
}

pub fn checkpoint() -> Checkpoint {
    let model = model();
    Checkpoint {
        state: state(&model),
        model,
        kind: Kind::Run,
        case_name: "Stück".into(),
        case_text: "name = \"Stück\"\n".into(),
        key: "abc".into(),
        extra: [("git".to_string(), "1".to_string()), ("empty".into(), String::new())].into(),
    }
}
