//! Bodies that stand flush are one surface: what slides over them goes where one body would take it (T-39).

use crate::common::scene::{Scene, slope};
use ballast::geometry::{GrainShape, Polyhedron, convex_hull, random_grain};
use ballast::math::{Pose, Vec3};
use ballast::model::{ContactStiffness, Part};
use rand::SeedableRng;
use rand_pcg::Pcg64;

const PLATES: usize = 40;

fn cuboid(size: Vec3) -> (Polyhedron, Pose) {
    let corners: Vec<Vec3> = (0..8)
        .map(|i| {
            let side = |axis: usize| if i >> axis & 1 == 0 { -0.5 } else { 0.5 };
            Vec3::new(side(0) * size.x, side(1) * size.y, side(2) * size.z)
        })
        .collect();
    convex_hull(&corners).expect("a cuboid")
}

fn ball_of_200_corners() -> (Polyhedron, Pose) {
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let corners: Vec<Vec3> = (0..200)
        .map(|i| {
            let z = 1.0 - (2.0 * i as f64 + 1.0) / 200.0;
            let (r, angle) = ((1.0 - z * z).sqrt(), golden * i as f64);
            Vec3::new(r * angle.cos(), r * angle.sin(), z) * 0.03
        })
        .collect();
    convex_hull(&corners).expect("a ball")
}

fn bodies() -> [(&'static str, (Polyhedron, Pose)); 4] {
    let stone = random_grain(&mut Pcg64::seed_from_u64(5), &GrainShape::default(), 0.04);
    [
        ("box", cuboid(Vec3::repeat(0.1))),
        ("brick", cuboid(Vec3::new(0.25, 0.12, 0.065))),
        ("ball", ball_of_200_corners()),
        ("stone", (stone.expect("a stone"), Pose::identity())),
    ]
}

/// Position and velocity, after `seconds`, of a body that starts at `speed` along x on a floor of `plates` flush plates.
fn slide(
    (shape, pose): &(Polyhedron, Pose),
    plates: usize,
    speed: f64,
    friction: f64,
    step_ns: u64,
    seconds: f64,
) -> (Vec3, Vec3) {
    let mut scene = Scene::new(step_ns, friction);
    scene.model.stepping.detection_distance = 5e-4;
    scene.model.solver.tolerance = Some(1e-10);
    let lowest =
        shape.vertices.iter().map(|v| (pose.orientation * v).z).fold(f64::INFINITY, f64::min);
    let index = scene.shape(shape.clone());
    let position = Vec3::new(-0.17, 0.013, -lowest);
    scene.grain(index, Pose { position, orientation: pose.orientation });
    let length = 2.0 / plates as f64;
    let (plate, _) = cuboid(Vec3::new(length, 1.0, 0.2));
    let plate = scene.shape(plate);
    for i in 0..plates {
        let x = -0.5 + length * (i as f64 + 0.5);
        let pose = Pose { position: Vec3::new(x, 0.0, -0.1), ..Pose::identity() };
        scene.driven(
            &format!("plate {i}"),
            Part::Convex { shape: plate, pose: Pose::identity() },
            pose,
            friction,
        );
    }
    scene.state.velocity[0].x = speed;
    scene.run(seconds);
    (scene.state.position[0], scene.state.velocity[0])
}

#[test]
fn flush_plates_are_one_floor() {
    for (name, body) in bodies() {
        for (speed, friction, step_ns) in [
            (2.0, 0.0, 1_000_000),
            (2.0, 0.3, 1_000_000),
            (0.5, 0.0, 200_000),
            (0.1, 0.3, 50_000),
            (1.0, 0.3, 400_000),
        ] {
            let seconds = f64::min(0.3 / speed, 0.06);
            let run = |plates| slide(&body, plates, speed, friction, step_ns, seconds);
            let ((one, v_one), (many, v_many)) = (run(1), run(PLATES));
            let start = Vec3::new(-0.17, 0.013, one.z);
            let travelled = (one - start).norm().max(1e-3);
            // The stone rolls across a joint on an edge that lies on both plates to 1e-9 m. The second plate alone is separated
            // by the axis of its rim and this edge, 1e-8 rad off its face: gaps differ by 1e-10 m, which a step of 0.05 ms turns
            // into 2e-6 m/s.
            let tolerance = if name == "stone" { 3e-6 } else { 1e-6 };
            assert!(
                (one - many).norm() <= tolerance * travelled
                    && (v_one - v_many).norm() <= 10.0 * tolerance * speed,
                "{name} {speed} m/s, friction {friction}, {step_ns} ns: {one:?} {v_one:?}, {many:?} {v_many:?}"
            );
            if name == "box" && friction == 0.0 {
                assert!((one.x + 0.17 - speed * seconds).abs() < 1e-9, "{one:?}");
            }
        }
    }
}

/// Prism with a sharp edge along y at its lowest point, below its vertical face; `rise` is the height of the other face.
fn wedge(rise: f64) -> (Polyhedron, Pose) {
    let section = [[0.0, 0.0], [0.0, 0.06], [0.03, 0.06], [0.03, rise]];
    let corners: Vec<Vec3> =
        section.iter().flat_map(|[x, z]| [-0.02, 0.02].map(|y| Vec3::new(*x, y, *z))).collect();
    convex_hull(&corners).expect("a wedge")
}

/// A wedge falls with its sharp edge on the rim of a block that is flush with a wall. Where its springs let it penetrate, the
/// normal of least penetration is that of its lower face, and there it touches the covered rim.
#[test]
fn wedge_beside_a_covered_rim_stays_on_the_block() {
    for wall in ["half-space", "box"] {
        for (rise, step_ns) in [(0.02, 200_000), (0.05, 200_000), (0.05, 1_000_000)] {
            let mut scene = Scene::new(step_ns, 0.3);
            scene.model.stepping.detection_distance = 2e-3;
            let (shape, pose) = wedge(rise);
            let index = scene.shape(shape.clone());
            let start = pose.position + Vec3::new(1e-5, 0.0, 1e-3);
            scene.grain(index, Pose { position: start, ..pose });
            scene.state.velocity[0].z = -0.5;
            let springs = ContactStiffness { normal: 1e6, ..ContactStiffness::default() };
            scene.model.grain_stiffness = springs;
            let (block, _) = cuboid(Vec3::new(0.2, 0.2, 0.2));
            let block = scene.shape(block);
            let part = Part::Convex { shape: block, pose: Pose::identity() };
            let below = Pose { position: Vec3::new(0.1, 0.0, -0.1), ..Pose::identity() };
            scene.driven("block", part, below, 0.3);
            if wall == "box" {
                let (high, _) = cuboid(Vec3::new(0.2, 0.2, 0.6));
                let part = Part::Convex { shape: scene.shape(high), pose: Pose::identity() };
                let beside = Pose { position: Vec3::new(-0.1, 0.0, 0.0), ..Pose::identity() };
                scene.driven("wall", part, beside, 0.3);
            } else {
                scene.plane("wall", slope(std::f64::consts::FRAC_PI_2), 0.3);
            }
            scene.model.driven.iter_mut().for_each(|d| d.stiffness = springs);
            let mut lowest = f64::INFINITY;
            for _ in 0..(100_000_000 / step_ns) {
                scene.step();
                let pose = Pose {
                    position: scene.state.position[0],
                    orientation: scene.state.orientation[0],
                };
                lowest = shape.vertices.iter().map(|v| pose.point(v).z).fold(lowest, f64::min);
            }
            assert!(lowest > -2e-3, "{wall}, {rise} m, {step_ns} ns: {lowest} m");
        }
    }
}
