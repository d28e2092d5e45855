//! Guarantees of detection for a whole configuration: canonical order, independence of the past, equal
//! results for any number of threads.

use crate::oracle::{self, Body};
use crate::scene;
use ballast::detection::{Contacts, DetectionRange, Detector};
use ballast::geometry::{Polyhedron, cuboid};
use ballast::math::{Pose, Quat, Vec3};
use ballast::model::{ContactStiffness, DrivenBody, Model, Part, Role};
use ballast::motion::Motion;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// A dense heap of random grains between a floor of half-space, a wall and a turning bar.
fn heap(seed: u64, count: usize) -> (Model, Motion) {
    let mut rng = Pcg64::seed_from_u64(seed);
    let mut shapes: Vec<_> = (0..count).map(|_| scene::random_hull(&mut rng, 0.02)).collect();
    let side = (count as f64).cbrt().ceil();
    let mut poses: Vec<Pose> = (0..count)
        .map(|k| {
            let k = k as f64;
            let cell = Vec3::new(k % side, (k / side).floor() % side, (k / side / side).floor());
            let jitter = scene::random_unit(&mut rng) * 0.004;
            let position = cell * 0.027 + jitter;
            Pose { position, orientation: scene::random_turn(&mut rng) }
        })
        .collect();
    shapes.push(cuboid(Vec3::new(0.1, 0.02, 0.02)));
    shapes.push(cuboid(Vec3::new(0.01, 0.5, 0.5)));
    let bar = count as u32;
    let body = |name: &str, parts| DrivenBody {
        name: name.into(),
        role: Role::Boundary,
        friction: 0.5,
        stiffness: ContactStiffness::RIGID,
        parts,
        mount: None,
    };
    let plane = |normal, offset| Part::HalfSpace { normal, offset };
    let convex = |shape, x, y, z| Part::Convex { shape, pose: Pose::at(Vec3::new(x, y, z)) };
    let driven = vec![
        body("bar", vec![convex(bar, 0.0, 0.0, 0.0), convex(bar, 0.0, 0.0, 0.05)]),
        body(
            "box",
            vec![
                plane(Vec3::z(), -0.015),
                convex(bar + 1, -0.025, 0.0, 0.0),
                plane(Vec3::y(), -0.01),
            ],
        ),
    ];
    poses.push(Pose::at(Vec3::new(0.05, 0.05, 0.05)));
    poses.push(Pose::identity());
    let mut model = scene::model(shapes, driven, 1e-3);
    model.grains.shape.truncate(count);
    model.grains.mass.truncate(count);
    model.grains.inertia.truncate(count);
    (model, scene::at_rest(&poses))
}

/// Moves all bodies a little, some of them a lot.
fn stir(motion: &mut Motion, rng: &mut Pcg64, step: usize) {
    for b in 0..motion.position.len() {
        let stride = if b % 17 == step % 17 { 2e-3 } else { 2e-5 };
        motion.position[b] += scene::random_unit(rng) * stride;
        let turn = Quat::from_scaled_axis(scene::random_unit(rng) * (20.0 * stride));
        motion.orientation[b] = turn * motion.orientation[b];
    }
}

/// Gives some bodies speeds that enlarge the detection range, and stops others.
fn hurry(motion: &mut Motion, rng: &mut Pcg64) {
    for velocity in &mut motion.velocity {
        let speed = [0.0, 0.0, 0.0, 1.0, 5.0, 20.0][rng.random_range(0..6)];
        *velocity = scene::random_unit(rng) * speed;
    }
}

fn assert_same(a: &Contacts, b: &Contacts, what: &str) {
    for k in 0..a.len().min(b.len()) {
        let of = |c: &Contacts| (c.bodies[k], c.feature[k], c.point[k], c.normal[k], c.gap[k]);
        assert_eq!(of(a), of(b), "{what}, contact {k}");
    }
    assert_eq!(a.len(), b.len(), "{what}");
}

#[test]
fn contacts_do_not_depend_on_the_past() {
    let (model, mut motion) = heap(1, 300);
    let mut rng = Pcg64::seed_from_u64(2);
    let mut detector = Detector::default();
    for step in 0..60 {
        let contacts = scene::detect(&mut detector, &model, &motion);
        assert!(contacts.len() > 500, "{}", contacts.len());
        assert_same(&contacts, &scene::fresh(&model, &motion), &format!("step {step}"));
        stir(&mut motion, &mut rng, step);
        hurry(&mut motion, &mut rng);
    }
    // Another model in the same detector.
    let (model, motion) = heap(3, 200);
    let contacts = scene::detect(&mut detector, &model, &motion);
    assert_same(&contacts, &scene::fresh(&model, &motion), "other model");
}

/// Bodies that drift and roll slowly, for longer than any cache of earlier steps is valid.
#[test]
fn slow_drift_invalidates_caches_without_changing_contacts() {
    for (seed, stride) in [(11, 3e-6), (12, 2e-5), (13, 1e-4)] {
        let (model, mut motion) = heap(seed, 250);
        let mut rng = Pcg64::seed_from_u64(seed);
        let count = motion.position.len();
        let drift: Vec<_> = (0..count).map(|_| scene::random_unit(&mut rng) * stride).collect();
        let roll: Vec<_> =
            (0..count).map(|_| scene::random_unit(&mut rng) * (50.0 * stride)).collect();
        let mut detector = Detector::default();
        for step in 0..80 {
            let contacts = scene::detect(&mut detector, &model, &motion);
            let fresh = scene::fresh(&model, &motion);
            assert!(fresh.len() > 400, "{}", fresh.len());
            assert_same(&contacts, &fresh, &format!("stride {stride}, step {step}"));
            for b in 0..count {
                motion.position[b] += drift[b];
                let turn = Quat::from_scaled_axis(roll[b]);
                motion.orientation[b] = turn * motion.orientation[b];
            }
            if step % 4 == 0 {
                hurry(&mut motion, &mut rng);
            }
        }
    }
}

/// Turns a shape into its mirror image, by inversion in its centre.
fn mirror(shape: &mut Polyhedron) {
    shape.vertices.iter_mut().chain(&mut shape.face_normals).for_each(|v| *v = -*v);
    for face in 0..shape.face_count() {
        let corners = shape.face_starts[face] as usize..shape.face_starts[face + 1] as usize;
        shape.face_vertices[corners].reverse();
    }
    shape.edges.iter_mut().for_each(|edge| edge.faces.swap(0, 1));
}

/// Turns a shape by half a turn about x.
fn turn_over(shape: &mut Polyhedron) {
    let half = |v: &mut Vec3| (v.y, v.z) = (-v.y, -v.z);
    shape.vertices.iter_mut().chain(&mut shape.face_normals).for_each(half);
}

/// Other shapes for the same bodies, in the same places.
#[test]
fn exchanged_shapes_invalidate_caches() {
    let (mut model, motion) = heap(14, 200);
    let mut detector = Detector::default();
    scene::detect(&mut detector, &model, &motion);
    let (other, _) = heap(15, 200);
    model.shapes = other.shapes;
    let contacts = scene::detect(&mut detector, &model, &motion);
    assert_same(&contacts, &scene::fresh(&model, &motion), "other shapes");
    // Of a mirror image counts, sizes, volume and inertia are the same to the last bit.
    model.shapes.iter_mut().for_each(mirror);
    let contacts = scene::detect(&mut detector, &model, &motion);
    assert_same(&contacts, &scene::fresh(&model, &motion), "mirror images");
    // Nor does half a turn change any of them, nor the product of a corner's coordinates.
    model.shapes.iter_mut().for_each(turn_over);
    let contacts = scene::detect(&mut detector, &model, &motion);
    assert_same(&contacts, &scene::fresh(&model, &motion), "turned shapes");
    model.driven[1].parts.swap(0, 2);
    let contacts = scene::detect(&mut detector, &model, &motion);
    assert_same(&contacts, &scene::fresh(&model, &motion), "other parts");
}

#[test]
fn threads_do_not_change_a_byte() {
    let (model, mut motion) = heap(4, 400);
    let run = |threads: usize, motion: &mut Motion| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| {
            let mut rng = Pcg64::seed_from_u64(5);
            let mut detector = Detector::default();
            (0..5)
                .map(|step| {
                    stir(motion, &mut rng, step);
                    scene::detect(&mut detector, &model, motion)
                })
                .collect::<Vec<_>>()
        })
    };
    let start = motion.clone();
    let one = run(1, &mut motion);
    for threads in [2, 3, 8] {
        let many = run(threads, &mut start.clone());
        for (step, (a, b)) in one.iter().zip(&many).enumerate() {
            assert_same(a, b, &format!("{threads} threads, step {step}"));
        }
    }
}

#[test]
fn order_is_by_bodies_then_feature() {
    let (model, motion) = heap(6, 400);
    let contacts = scene::fresh(&model, &motion);
    let keys: Vec<_> = contacts.bodies.iter().zip(&contacts.feature).collect();
    assert!(keys.windows(2).all(|w| w[0] < w[1]), "each key once, ascending");
    let ng = model.grains.len() as u32;
    assert!(contacts.bodies.iter().all(|[c, a]| *c < ng && a > c));
    for driven in 0..2 {
        assert!(contacts.bodies.iter().any(|b| b[1] == ng + driven), "none on driven {driven}");
    }
}

/// Every pair of the heap, whether the broad phase lists it or not.
#[test]
fn no_pair_is_missed() {
    let (mut model, mut motion) = heap(7, 150);
    // One boulder among them: a body much larger than a cell of the grid.
    let boulder = cuboid(Vec3::new(0.09, 0.004, 0.07));
    model.shapes[70] = boulder;
    let mut rng = Pcg64::seed_from_u64(8);
    let mut detector = Detector::default();
    for step in 0..4 {
        let contacts = scene::detect(&mut detector, &model, &motion);
        let body = |i: usize| {
            let pose = Pose { position: motion.position[i], orientation: motion.orientation[i] };
            Body::new(&model.shapes[i], &pose)
        };
        let bodies: Vec<Body> = (0..150).map(body).collect();
        for i in 0..150 {
            for j in i + 1..150 {
                let reach = model.shapes[i].radius + model.shapes[j].radius + 1e-3;
                if (motion.position[i] - motion.position[j]).norm() > reach {
                    assert!(contacts.bodies.binary_search(&[i as u32, j as u32]).is_err());
                    continue;
                }
                let (s, _) = oracle::separation(&bodies[i], &bodies[j]);
                if (s - 1e-3).abs() < 1e-9 {
                    continue;
                }
                let gap =
                    if s > 0.0 && s < 1e-3 { oracle::distance(&bodies[i], &bodies[j]) } else { s };
                let found = contacts.bodies.binary_search(&[i as u32, j as u32]).is_ok();
                assert_eq!(found, gap <= 1e-3, "step {step}, pair {i} {j}, gap {gap:e}");
            }
        }
        stir(&mut motion, &mut rng, step);
    }
}

/// Pairs of moving bodies are detected up to the distance that both may close in a step, with a margin.
#[test]
fn no_pair_that_speed_can_close_is_missed() {
    let (model, mut motion) = heap(17, 120);
    let mut rng = Pcg64::seed_from_u64(18);
    let mut detector = Detector::default();
    let mut wide = 0;
    for step in 0..4 {
        hurry(&mut motion, &mut rng);
        let contacts = scene::detect(&mut detector, &model, &motion);
        let reach = DetectionRange::new(&model, &motion);
        let body = |i: usize| {
            let pose = Pose { position: motion.position[i], orientation: motion.orientation[i] };
            Body::new(&model.shapes[i], &pose)
        };
        let bodies: Vec<Body> = (0..120).map(body).collect();
        for i in 0..120 {
            for j in i + 1..120 {
                let way = (motion.velocity[i] - motion.velocity[j]).norm() * 2e-4;
                let looked = reach.distance(&motion, model.grain_radius(i), [i, j]);
                assert!(looked >= (way + 0.5e-3).max(1e-3), "{looked} for {way}");
                let (s, _) = oracle::separation(&bodies[i], &bodies[j]);
                let gap = if s > 0.0 { oracle::distance(&bodies[i], &bodies[j]) } else { s };
                if (gap - looked).abs() < 1e-9 {
                    continue;
                }
                let found = contacts.bodies.binary_search(&[i as u32, j as u32]).is_ok();
                assert_eq!(found, gap <= looked, "step {step}, pair {i} {j}, gap {gap:e}");
                wide += usize::from(found && gap > 1e-3);
            }
        }
        stir(&mut motion, &mut rng, step);
    }
    assert!(wide > 50, "{wide} pairs beyond the alert distance");
}

/// A distant body, and one at an invalid position: neither memory nor the other bodies are affected.
#[test]
fn far_bodies_are_harmless() {
    let (model, motion) = heap(9, 100);
    let near = scene::fresh(&model, &motion);
    for far in [1e6, 1e15, 1e300, f64::NAN] {
        let mut motion = motion.clone();
        motion.position[99] = Vec3::repeat(far);
        let contacts = scene::fresh(&model, &motion);
        let others = near.bodies.iter().filter(|b| b[0] != 99 && b[1] != 99).count();
        let kept = contacts.bodies.iter().filter(|b| b[0] != 99 && b[1] != 99).count();
        assert_eq!(others, kept, "{far}");
    }
}

#[test]
fn an_empty_model_has_no_contacts() {
    let model = scene::model(vec![], vec![], 1e-3);
    assert!(scene::fresh(&model, &Motion::default()).is_empty());
    let (mut model, motion) = heap(10, 1);
    model.driven.clear();
    assert!(scene::fresh(&model, &scene::at_rest(&[Pose::at(motion.position[0])])).is_empty());
}
