//! A plan for tests.

use crate::geometry::GrainShape;
use crate::math::Vec3;
use crate::model::{Solver, Stepping};
use crate::track::plan::*;

/// Two facing tines at one short block, in a box for some 3 500 grains.
pub fn small_plan() -> Plan {
    let tine = |name: &str, x: f64, direction: f64| TinePlan {
        name: name.into(),
        position: [x, 0.35],
        direction,
        pair: 7,
        shape: TineShape::Boxes {
            blade: Vec3::new(0.022, 0.12, 0.07),
            shaft: Vec3::new(0.03, 0.06, 0.45),
        },
        mount: None,
    };
    Plan {
        name: "cycle".into(),
        bed: BedPlan {
            size: Vec3::new(0.6, 0.7, 0.45),
            seed: 1,
            density: 2700.0,
            grains: GrainPlan {
                classes: vec![SizeClass::of_size(0.0375, 1.0)],
                shape: GrainShape {
                    elongation: [0.7, 0.1],
                    flatness: [0.7, 0.1],
                    vertices: [8, 40],
                    angularity: 0.5,
                },
                templates: 4,
                stones: vec![],
            },
            friction: FrictionPlan { grain: 1.0, sleeper: 1.0, tine: 1.0, boundary: [0.8; 5] },
            stiffness: StiffnessPlan::default(),
            gravity: 9.81,
            preparation: PreparationPlan {
                ballast_depth: 0.28,
                fill_level: 0.43,
                friction: 0.3,
                step_ns: 1_000_000,
                iterations: 30,
                rest_speed: 5e-3,
                max_settling: 0.5,
            },
            subgrade: None,
            traffic: None,
        },
        sleepers: vec![SleeperPlan {
            name: "sleeper".into(),
            centre: [0.3, 0.35],
            blocks: vec![BlockPlan { offset_y: 0.0, size: Vec3::new(0.29, 0.40, 0.15) }],
            tamped: true,
            mount: None,
        }],
        tines: vec![tine("left", 0.05, 1.0), tine("right", 0.55, -1.0)],
        plates: vec![],
        tamping: Some(TampingPlan {
            start: 0.05,
            lift: LiftPlan { height: 0.02, duration: 0.2 },
            insertion: InsertionPlan {
                duration: 0.45,
                depth: 0.02,
                clearance: 0.03,
                force_limit: 8000.0,
            },
            squeeze: SqueezePlan { duration: 0.8, stroke: 0.06, force_limit: 7800.0 },
            hold: 0.1,
            withdrawal: 0.4,
            vibration: VibrationPlan { frequency: 35.0, amplitude: 0.005 },
            release: None,
            traffic: None,
        }),
        run: RunPlan {
            stepping: Stepping { step_ns: 200_000, theta: 0.5, detection_distance: 2e-3 },
            solver: Solver::default(),
            restitution: 0.0,
            duration_ns: 2_100_000_000,
            output_ns: 0,
            checkpoint_ns: 0,
        },
    }
}
