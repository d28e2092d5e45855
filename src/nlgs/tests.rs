//! Tests of the kernel against the reference, and of properties of a sweep.

use super::assembled_problem::AssembledProblem;
use super::lattice_scene::LatticeScene;
use super::reference::MatrixFreeSolver;
use super::{BlockSubset, ComplementarityGap, ContactSet};
use crate::lanes::InstructionSet;
use crate::local_problem::LocalProblem;
use crate::math::Vec3;
use crate::model::ContactStiffness;

fn whole(problem: &LocalProblem) -> ContactSet {
    let contacts: Vec<u32> = (0..problem.contacts.len() as u32).collect();
    let lines: Vec<u32> = (0..problem.body_count() as u32).collect();
    let mut set = ContactSet::default();
    set.pack(problem, &contacts, lines.len(), |grain| lines[grain as usize]);
    set.lines[..lines.len()].copy_from_slice(&problem.lines);
    set.apply_impulses();
    set
}

fn largest(x: impl IntoIterator<Item = Vec3>) -> f64 {
    x.into_iter().fold(0.0, |max, v| v.amax().max(max))
}

#[test]
fn kernel_plain_and_assembled_sweeps_agree_to_rounding() {
    for (seed, restitution, relaxation, stiffness) in
        [(1, 0.0, 1.0, f64::INFINITY), (2, 0.3, 0.7, f64::INFINITY), (3, 0.0, 1.0, 1e6)]
    {
        let mut scene = LatticeScene::grid([5, 4, 3], 2, restitution, seed);
        if stiffness.is_finite() {
            let stiffness =
                ContactStiffness { normal: stiffness, tangential_ratio: 0.5, damping_time: 1e-4 };
            scene.model.grain_stiffness = stiffness;
            scene.model.driven[0].stiffness = stiffness;
            scene.build();
            assert!(scene.problem.contacts.iter().all(|c| c.compliance[1] > c.compliance[0]));
        }
        let mut set = whole(&scene.problem);
        let mut plain = MatrixFreeSolver::new(&scene.problem);
        let assembled = AssembledProblem::from_problem(&scene.problem);
        let mut r = plain.impulse.clone();
        let order: Vec<u32> = set.order().collect();
        for _ in 0..20 {
            set.sweep(relaxation);
            plain.sweep(order.iter().copied(), relaxation);
            assembled.sweep(&mut r, order.iter().copied(), relaxation);
            let scale = largest(plain.impulse.iter().copied());
            let apart = largest(set.impulses().map(|(i, r)| r - plain.impulse[i as usize]));
            assert!(apart < 1e-12 * scale, "kernel: {apart:e} of {scale:e}");
            let apart = largest(r.iter().zip(&plain.impulse).map(|(a, b)| a - b));
            assert!(apart < 1e-12 * scale, "assembled: {apart:e} of {scale:e}");
            for (a, b) in set.lines.iter().zip(&plain.lines) {
                let apart = (0..6).map(|j| (a.0[j] - b.0[j]).abs()).fold(0.0, f64::max);
                assert!(apart < 1e-12, "velocity: {apart:e}");
            }
        }
        let spare = set.lines.last().unwrap();
        assert!(spare.0.iter().all(|&x| x == 0.0));
    }
}

#[test]
fn a_relaxed_sweep_leaves_no_impulse_on_open_contacts() {
    let scene = LatticeScene::grid([5, 4, 3], 2, 0.0, 2);
    let mut set = whole(&scene.problem);
    (0..200).for_each(|_| set.sweep(0.5));
    let impulses: Vec<Vec3> = set.impulses().map(|(_, r)| r).collect();
    let scale = largest(impulses.iter().copied());
    let open = impulses.iter().filter(|r| **r == Vec3::zeros()).count();
    let faint = impulses.iter().filter(|r| **r != Vec3::zeros() && r.amax() < 1e-12 * scale);
    assert!(open > 0 && open < impulses.len(), "{open} of {}", impulses.len());
    assert_eq!(faint.count(), 0);
}

#[test]
fn sweeps_converge_to_a_solution_by_every_measure() {
    let scene = LatticeScene::grid([4, 4, 3], 1, 0.0, 5);
    let mut set = whole(&scene.problem);
    let before = set.law_sums().natural_map();
    let mut norms = set.measured_sweep(1.0);
    for _ in 0..3000 {
        norms = set.measured_sweep(1.0);
    }
    let after = set.law_sums().natural_map();
    assert!(before > 1e-2 && after < 1e-8, "{before:e} {after:e}");
    assert!(norms.residuals().qm16() < 1e-8, "{norms:?}");
    let assembled = AssembledProblem::from_problem(&scene.problem);
    let mut r = vec![Vec3::zeros(); assembled.contact_count()];
    for (i, impulse) in set.impulses() {
        r[i as usize] = impulse;
    }
    let errors = assembled.natural_map(&r);
    assert!((errors.unit_free / after - 1.0).abs() < 1e-4, "{errors:?} {after:e}");
}

#[test]
fn measured_sweeps_have_the_same_bits() {
    let scene = LatticeScene::grid([6, 5, 4], 2, 0.0, 7);
    let (mut a, mut b) = (whole(&scene.problem), whole(&scene.problem));
    for _ in 0..5 {
        a.sweep(1.0);
        b.measured_sweep(1.0);
    }
    assert_eq!(a.lines, b.lines);
    assert!(a.impulses().eq(b.impulses()));
}

#[test]
fn contacts_between_grains_keep_momentum() {
    let mut scene = LatticeScene::grid([6, 6, 4], 2, 0.0, 9);
    scene.model.driven.clear();
    let ng = scene.model.grains.len() as u32;
    let pairs: Vec<u32> = (0..scene.contacts.len() as u32)
        .filter(|&i| scene.contacts.bodies[i as usize][1] < ng)
        .collect();
    let lines: Vec<u32> = (0..ng).collect();
    let mut set = ContactSet::default();
    set.pack(&scene.problem, &pairs, lines.len(), |grain| lines[grain as usize]);
    set.lines[..lines.len()].copy_from_slice(&scene.problem.lines);
    let momentum = |set: &ContactSet| {
        (0..ng as usize).fold((Vec3::zeros(), Vec3::zeros()), |(p, l), g| {
            let (v, w) = scene.problem.velocity(g, &set.lines[g]);
            let rotation = scene.motion.orientation[g].to_rotation_matrix();
            let angular_velocity = rotation.inverse() * w;
            let own = rotation * angular_velocity.component_mul(&scene.model.grains.inertia[g]);
            let mv = v * scene.model.grains.mass[g];
            (p + mv, l + own + scene.motion.position[g].cross(&mv))
        })
    };
    let before = momentum(&set);
    set.apply_impulses();
    for _ in 0..10 {
        set.sweep(1.0);
    }
    let after = momentum(&set);
    let scale: f64 = scene.model.grains.mass.iter().sum::<f64>() * 0.05;
    assert!((after.0 - before.0).norm() < 1e-14 * scale, "{:?}", after.0 - before.0);
    // Arms are rounded to f32.
    assert!((after.1 - before.1).norm() < 1e-7 * scale * 0.1, "{:?}", after.1 - before.1);
}

/// Returns the blocks with an impulse.
fn active(set: &mut ContactSet) -> BlockSubset {
    let mut chosen = BlockSubset::default();
    set.update_active();
    set.copy_active_blocks(&mut chosen);
    chosen
}

#[test]
fn every_arithmetic_gives_the_same_bits() {
    let scene = LatticeScene::grid([6, 5, 4], 3, 0.2, 11);
    let run = |arithmetic| {
        let mut set = whole(&scene.problem);
        set.set_arithmetic(arithmetic);
        for _ in 0..10 {
            set.sweep(0.9);
        }
        let norms = set.measured_sweep(1.0);
        let chosen = active(&mut set);
        set.sweep_active(0.9);
        // Some of these are outside of their cones.
        let moved: Vec<f64> = set.subset_impulses(&chosen).map(|r| 1.5 * r - 1e-4).collect();
        set.replace_impulses(&chosen, &moved);
        let bits = |x: &f64| x.to_bits();
        let lines: Vec<u64> = set.lines.iter().flat_map(|l| l.0.iter().map(bits)).collect();
        let impulses: Vec<u64> =
            set.impulses().flat_map(|(_, r)| r.iter().map(bits).collect::<Vec<_>>()).collect();
        (lines, impulses, norms, set.law_sums())
    };
    let portable = run(InstructionSet::PORTABLE);
    for arithmetic in InstructionSet::available() {
        assert!(run(arithmetic) == portable, "{arithmetic:?}");
    }
}

#[test]
fn nncg_extrapolates_as_defined() {
    let scene = LatticeScene::grid([6, 5, 4], 3, 0.2, 11);
    let begin = |arithmetic| {
        let mut set = whole(&scene.problem);
        set.set_arithmetic(arithmetic);
        set.measured_sweep(1.0);
        let chosen = active(&mut set);
        (set, chosen)
    };
    for arithmetic in InstructionSet::available() {
        let (mut set, chosen) = begin(arithmetic);
        let weights: Vec<_> = set.weights().collect();
        let mut memories = Vec::new();
        set.begin_nncg(&chosen, &weights, &mut memories);
        // Scalar version: impulses before and after the iterations, and the search direction.
        let (mut plain, _) = begin(InstructionSet::PORTABLE);
        let weights: Vec<f64> = plain.subset_weights(&chosen).collect();
        let mut before: Vec<f64> = plain.subset_impulses(&chosen).collect();
        let mut direction = vec![0.0; before.len()];
        for share in [1.0, 0.6, 0.9] {
            set.sweep_active(0.9);
            plain.sweep_active(0.9);
            let image: Vec<f64> = plain.subset_impulses(&chosen).collect();
            let change: Vec<f64> = image.iter().zip(&before).map(|(r, b)| r - b).collect();
            let squares = change.iter().zip(&weights).map(|(c, w)| (c * w).powi(2));
            assert_eq!(set.change_squared(&chosen, &memories), squares.sum::<f64>());
            direction.iter_mut().for_each(|p| *p *= share);
            let on: Vec<f64> = image.iter().zip(&direction).map(|(r, p)| r + p).collect();
            direction.iter_mut().zip(&change).for_each(|(p, c)| *p += c);
            set.extrapolate(&chosen, &mut memories, share);
            plain.replace_impulses(&chosen, &on);
            before = plain.subset_impulses(&chosen).collect();
            assert!(
                set.lines == plain.lines && set.impulses().eq(plain.impulses()),
                "{arithmetic:?}"
            );
        }
    }
}

#[test]
fn inactive_contacts_are_swept_after_their_impulses_are_replaced() {
    let scene = LatticeScene::grid([6, 5, 4], 3, 0.2, 11);
    let mut set = whole(&scene.problem);
    set.sweep(1.0);
    let chosen = active(&mut set);
    let impulses: Vec<f64> = set.subset_impulses(&chosen).collect();
    let visits = |set: &mut ContactSet| {
        let before = set.visits();
        set.sweep_active(1.0);
        set.visits() - before
    };
    set.replace_impulses(&chosen, &vec![0.0; impulses.len()]);
    set.update_active();
    assert_eq!(visits(&mut set), 0);
    set.replace_impulses(&chosen, &impulses);
    assert!(visits(&mut set) > 0);
}

/// One grain whose contact point is straight below its centre, on a fixed floor: closed forms.
///
/// Free velocity (along x, upwards) and the result, m/s; mass 0.02 kg, friction 0.4.
fn single_grain(free: [f64; 2], gap: f64, restitution: f64) -> (Vec3, Vec3, Vec3) {
    let scene = single_grain_scene(free, gap, restitution);
    let mut set = whole(&scene.problem);
    set.sweep(1.0);
    let mut impulse = vec![Vec3::zeros()];
    set.unpack(&mut impulse);
    let (v, w) = scene.problem.velocity(0, &set.lines[0]);
    (v, w, scene.problem.contacts[0].world(&impulse[0]))
}

/// Scene of [`single_grain`], without initial impulses.
fn single_grain_scene(free: [f64; 2], gap: f64, restitution: f64) -> LatticeScene {
    let mut scene = LatticeScene::grid([1, 1, 1], 1, restitution, 3);
    scene.model.grains.mass[0] = 0.02;
    scene.model.grains.inertia[0] = Vec3::repeat(8e-7);
    scene.state.velocity[0] = Vec3::new(free[0], 0.0, free[1]);
    scene.state.angular_velocity[0] = Vec3::zeros();
    scene.motion.velocity[0] = scene.state.velocity[0];
    scene.motion.angular_velocity[0] = Vec3::zeros();
    scene.motion.velocity[1] = Vec3::zeros();
    scene.motion.angular_velocity[1] = Vec3::zeros();
    scene.contacts.normal[0] = Vec3::z();
    scene.contacts.point[0] = scene.motion.position[0] - Vec3::z() * 0.01;
    scene.contacts.gap[0] = gap;
    scene.warm = vec![Vec3::zeros()];
    scene.build();
    scene
}

fn close(a: Vec3, b: Vec3) -> bool {
    // Arms are rounded to f32.
    (a - b).amax() <= 1e-7 * b.amax()
}

#[test]
fn a_single_grain_on_a_floor_follows_the_closed_form() {
    let (m, lever, inertia, mu) = (0.02, 0.01, 8e-7, 0.4);
    // Separation: the step does not close the gap of 1e-4 m, 0.2 m/s at h = 5e-4 s.
    let (v, w, r) = single_grain([0.3, -0.1], 1e-4, 0.0);
    assert_eq!((v, w, r), (Vec3::new(0.3, 0.0, -0.1), Vec3::zeros(), Vec3::zeros()));
    // Closing of the same gap: 0.2 m/s remain. Slip: sliding loses μ per unit of normal impulse.
    let (v, w, r) = single_grain([3.0, -0.5], 1e-4, 0.0);
    let normal = m * 0.3;
    assert!(close(r, Vec3::new(-mu * normal, 0.0, normal)), "{r:?}");
    assert!(close(v, Vec3::new(3.0 - mu * 0.3, 0.0, -0.2)), "{v:?}");
    assert!(close(w, Vec3::new(0.0, lever * mu * normal / inertia, 0.0)), "{w:?}");
    // Stick: the contact point stops, u_x (1/m + ℓ²/J) = -r_x.
    let (v, w, r) = single_grain([0.01, -0.5], -1e-5, 0.0);
    let stop = 0.01 / (1.0 / m + lever * lever / inertia);
    assert!(close(r, Vec3::new(-stop, 0.0, m * 0.5)), "{r:?}");
    let point = v + w.cross(&Vec3::new(0.0, 0.0, -lever));
    assert!(point.amax() < 1e-7 * 0.5, "{point:?}");
    // Restitution returns half of the approach of a closed contact.
    let (v, _, _) = single_grain([0.0, -0.5], -1e-5, 0.5);
    assert!(close(v, Vec3::new(0.0, 0.0, 0.25)), "{v:?}");
}

/// Returns the complementarity gap of (T-44) from the scalar reference.
fn reference_gap(problem: &LocalProblem, reference: &MatrixFreeSolver) -> ComplementarityGap {
    let mut sum = ComplementarityGap::default();
    for (i, contact) in problem.contacts.iter().enumerate() {
        let (r, u) = (reference.impulse[i], reference.relative_velocity(i));
        let normal = r.x * u.x;
        let friction = f64::from(contact.friction) * r.x * u.yz().norm() + r.yz().dot(&u.yz());
        sum.gap += normal.max(0.0) + friction.max(0.0);
        sum.infeasible += (-normal).max(0.0) + (-friction).max(0.0);
        sum.infeasible += 0.5 * u.x.min(0.0).powi(2) * f64::from(contact.normal_mass);
    }
    sum
}

#[test]
fn the_complementarity_gap_is_that_of_its_definition() {
    for (restitution, stiffness) in [(0.0, f64::INFINITY), (0.3, f64::INFINITY), (0.0, 1e6)] {
        let mut scene = LatticeScene::grid([4, 4, 3], 1, restitution, 5);
        if stiffness.is_finite() {
            let springs =
                ContactStiffness { normal: stiffness, tangential_ratio: 0.5, damping_time: 1e-4 };
            scene.model.grain_stiffness = springs;
            scene.model.driven[0].stiffness = springs;
            scene.build();
        }
        let mut set = whole(&scene.problem);
        let mut plain = MatrixFreeSolver::new(&scene.problem);
        let order: Vec<u32> = set.order().collect();
        // Initial impulses are partly outside of their cones.
        for sweep in 0..4 {
            let found = set.law_sums().complementarity;
            let expected = reference_gap(&scene.problem, &plain);
            for (found, expected) in
                [(found.gap, expected.gap), (found.infeasible, expected.infeasible)]
            {
                assert!(expected > 0.0, "sweep {sweep}");
                assert!((found / expected - 1.0).abs() < 1e-9, "{sweep}: {found} {expected}");
            }
            set.sweep(1.0);
            plain.sweep(order.iter().copied(), 1.0);
        }
        (0..20_000).for_each(|_| set.sweep(1.0));
        let end = set.law_sums().complementarity;
        let start = reference_gap(&scene.problem, &MatrixFreeSolver::new(&scene.problem));
        let left = (end.gap + end.infeasible) / (start.gap + start.infeasible);
        assert!((0.0..1e-9).contains(&left), "{restitution}, {stiffness}: {left:e}");
    }
}

#[test]
fn wrong_impulses_of_a_single_grain_have_the_gap_of_the_closed_form() {
    // Closed contact below the centre: 3 m/s along x, 0.5 m/s downwards, mass 0.02 kg, μ = 0.4.
    let (m, lever, inertia, mu) = (0.02, 0.01, 8e-7, 0.4);
    let gap = |normal: f64, tangential: f64| {
        let mut scene = single_grain_scene([3.0, -0.5], 0.0, 0.0);
        scene.warm = vec![Vec3::new(tangential, 0.0, normal)];
        scene.build();
        whole(&scene.problem).law_sums().complementarity
    };
    let close = |found: f64, expected: f64| {
        assert!((found - expected).abs() <= 1e-6 * expected, "{found} J instead of {expected} J");
    };
    let exact = m * 0.5;
    let slide = |tangential: f64| 3.0 + tangential * (1.0 / m + lever * lever / inertia);
    let solved = gap(exact, -mu * exact);
    assert!(solved.gap + solved.infeasible < 1e-9, "{solved:?}");
    // Twice the impulse: the grain leaves at 0.5 m/s.
    let found = gap(2.0 * exact, -2.0 * mu * exact);
    close(found.gap, 2.0 * exact * 0.5);
    assert!(found.infeasible < 1e-9, "{found:?}");
    // Half of it: the grain still closes at 0.25 m/s.
    let found = gap(0.5 * exact, -0.5 * mu * exact);
    assert!(found.gap < 1e-9, "{found:?}");
    close(found.infeasible, 0.5 * exact * 0.25 + 0.5 * m * 0.25 * 0.25);
    // None: it closes with all of its normal energy.
    let found = gap(0.0, 0.0);
    assert_eq!(found.gap, 0.0);
    close(found.infeasible, 0.5 * m * 0.5 * 0.5);
    // Half of the friction: the other half of its work is missing. Twice the friction: outside of the cone.
    let share = -0.5 * mu * exact;
    close(gap(exact, share).gap, 0.5 * mu * exact * slide(share));
    let excess = -2.0 * mu * exact;
    assert!(slide(excess) > 0.0);
    close(gap(exact, excess).infeasible, mu * exact * slide(excess));
}

#[test]
fn any_split_of_the_contacts_reaches_the_same_velocities() {
    let scene = LatticeScene::grid([3, 3, 3], 1, 0.0, 21);
    let mut set = whole(&scene.problem);
    let reversed: Vec<u32> = (0..scene.problem.contacts.len() as u32).rev().collect();
    // Lines in another order, too.
    let ng = scene.problem.body_count();
    let lines: Vec<u32> = (0..ng as u32).map(|g| (g * 7 + 3) % ng as u32).collect();
    let mut other = ContactSet::default();
    other.pack(&scene.problem, &reversed, ng, |grain| lines[grain as usize]);
    for g in 0..ng {
        other.lines[lines[g] as usize] = scene.problem.lines[g];
    }
    other.apply_impulses();
    let mut order: Vec<u32> = other.order().collect();
    order.sort_unstable();
    assert!(order.into_iter().eq(0..reversed.len() as u32));
    for _ in 0..5000 {
        set.sweep(1.0);
        other.sweep(1.0);
    }
    for g in 0..ng {
        let apart = set.lines[g].velocity() - other.lines[lines[g] as usize].velocity();
        assert!(apart.amax() < 1e-9, "{apart:?}");
    }
}
