//! Contacts on bodies of flush parts (T-39).

use crate::oracle::{self, Body};
use crate::scene;
use ballast::geometry::cuboid;
use ballast::math::{Pose, Vec3};
use ballast::model::{ContactStiffness, DrivenBody, Part, Role};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// A tine: a shaft on a wider blade of the same thickness.
fn tine() -> [(Vec3, Pose); 2] {
    [
        (Vec3::new(0.011, 0.06, 0.035), Pose::at(Vec3::new(0.0, 0.0, -0.035))),
        (Vec3::new(0.011, 0.0325, 0.1), Pose::at(Vec3::new(0.0, 0.0, 0.1))),
    ]
}

#[test]
fn no_contact_is_deeper_than_the_bodies_overlap() {
    let mut rng = Pcg64::seed_from_u64(24);
    let parts = tine();
    let mut counted = 0;
    for k in 0..3000 {
        let mut shapes = vec![scene::random_hull(&mut rng, 0.025)];
        shapes.extend(parts.map(|(half, _)| cuboid(half)));
        let mut pose = Pose {
            position: Vec3::new(
                rng.random_range(0.01..0.05),
                rng.random_range(-0.05..0.05),
                rng.random_range(-0.03..0.01),
            ),
            orientation: scene::random_turn(&mut rng),
        };
        let target = rng.random_range(-1e-3..3e-3);
        let solids = [1, 2].map(|s| Body::new(&shapes[s], &parts[s - 1].1));
        let nearest = |pose: &Pose| {
            let stone = Body::new(&shapes[0], pose);
            let found = solids.iter().map(|solid| oracle::separation(solid, &stone));
            found.min_by(|a, b| a.0.total_cmp(&b.0)).expect("two parts")
        };
        for _ in 0..4 {
            let (gap, outward) = nearest(&pose);
            pose.position += outward * (target - gap);
        }
        let (gap, _) = nearest(&pose);
        if (gap - target).abs() > 1e-9 {
            continue;
        }
        counted += 1;
        let driven = DrivenBody {
            name: "tine".into(),
            role: Role::Tine,
            friction: 0.3,
            stiffness: ContactStiffness::RIGID,
            parts: (1..)
                .zip(&parts)
                .map(|(shape, (_, pose))| Part::Convex { shape, pose: *pose })
                .collect(),
            mount: None,
        };
        let mut model = scene::model(shapes[..1].to_vec(), vec![driven], 4e-3);
        model.shapes = shapes;
        // A plane that separates bodies which pass each other (T-40) touches none of their faces.
        let mut motion = scene::at_rest(&[pose, Pose::identity()]);
        motion.velocity[0] = scene::random_unit(&mut rng) * 10f64.powf(rng.random_range(-2.0..0.5));
        let contacts = scene::fresh(&model, &motion);
        for (n, found) in contacts.normal.iter().zip(&contacts.gap) {
            assert!(
                *found > gap.min(0.0) - 1e-8,
                "stone {k}: gap {found} along {n:?}, overlap {gap}"
            );
        }
    }
    assert!(counted > 2000, "{counted}");
}
