//! Checks with exact answers: incline, column of boxes, arch.

use super::check::{CheckFinding, ValidationCheck, exponent};
use super::listed;
use super::suite_size::SuiteSize;
use super::world::{GRAVITY, World};
use ballast::geometry::{convex_hull, cuboid};
use ballast::math::{Pose, Quat, Vec3};
use ballast::state::State;
use ballast_report::plot::{Chart, SeriesStyle};
use ballast_session::{Reporter, Result};
use std::f64::consts::PI;

/// Checks a slab on a slope, which sticks below the angle of friction and slides with `g (sin α - μ cos α)` above.
pub fn incline(_: &SuiteSize, _: &dyn Reporter) -> Result<ValidationCheck> {
    let mut check = ValidationCheck::new(
        "incline",
        "A slab of 0.2 × 0.2 × 0.02 m on a slope for 0.5 s, steps of 1 ms, 1e-4 rad below the angle of friction and \
         0.05 rad above it.",
        "Coulomb's law: sticks iff tan α <= μ, else slides with a = g (sin α − μ cos α)",
    );
    for friction in [1.0_f64, 0.8, 0.3] {
        for above in [-1e-4, 0.05] {
            let angle = friction.atan() + above;
            let turn = Quat::from_axis_angle(&Vec3::y_axis(), angle);
            let mut world = World::new(1_000_000, friction, 2e-3);
            let slab = world.shape(cuboid(Vec3::new(0.1, 0.1, 0.01)));
            world.grain(slab, Pose { position: turn * Vec3::z() * 0.01, orientation: turn });
            world.wall("slope", Vec3::zeros(), turn * Vec3::z(), friction);
            let start = world.state.position[0];
            world.run(0.5)?;
            let distance = (world.state.position[0] - start).dot(&(turn * Vec3::x()));
            if above < 0.0 {
                let name = format!("distance, μ = {friction}, below its angle (m)");
                check.findings.push(CheckFinding::near(name, distance, 0.0, 1e-7));
            } else {
                let expected = GRAVITY * (angle.sin() - friction * angle.cos());
                // From rest, s = a t²/2; the scheme is exact for constant acceleration, friction is kept in f32.
                let name = format!("acceleration over a, μ = {friction}, above");
                check.findings.push(CheckFinding::near(
                    name,
                    distance / (0.125 * expected),
                    1.0,
                    2e-6,
                ));
            }
        }
    }
    Ok(check)
}

/// Counts the sweeps until the floor carries the weight of stacked boxes.
pub fn column(size: &SuiteSize, _: &dyn Reporter) -> Result<ValidationCheck> {
    let counts: &[usize] = if size.quick { &[4, 8, 16, 32] } else { &[4, 8, 16, 32, 64, 128] };
    let mut check = ValidationCheck::new(
        "column of boxes",
        format!(
            "Columns of {} boxes without friction, one step without warm start, sequential sweeps without relaxation, until \
             the floor carries 99 % of the weight.",
            listed(counts)
        ),
        "The weight diffuses through the sweeps: their number grows with the square of the height",
    );
    let mut points = Vec::new();
    for &count in counts {
        points.push([count as f64, f64::from(sweeps_needed(count)?)]);
    }
    let [a, b] = [points[1], points[points.len() - 1]];
    check.findings.push(CheckFinding::near(
        "exponent of sweeps over boxes",
        exponent(a, b),
        2.0,
        0.1,
    ));
    let law = points.iter().map(|p| [p[0], a[1] * (p[0] / a[0]).powi(2)]).collect();
    let chart = Chart::new("Sweeps for a column", "boxes", "sweeps").log_x().log_y();
    let chart = chart.with("measured", points, SeriesStyle::Points).with(
        "square",
        law,
        SeriesStyle::Expected,
    );
    check.charts.push(chart.svg());
    Ok(check)
}

/// Maximum number of sweeps per solve in [`sweeps_needed`], below the number after which relaxation starts (T-12).
const MAX_SWEEPS_PER_SOLVE: u32 = 100;

/// Returns the number of sweeps after which the floor carries 99 % of the weight.
fn sweeps_needed(count: usize) -> Result<u32> {
    let mut world = World::new(1_000_000, 0.0, 2e-3);
    let cube = world.shape(cuboid(Vec3::repeat(0.05)));
    for k in 0..count {
        world.grain(cube, Pose::at(Vec3::z() * (0.1 * (k as f64 + 0.5))));
    }
    world.wall("floor", Vec3::zeros(), Vec3::z(), 0.0);
    // A resolution of 1/64 of the squared height does not affect the exponent.
    let sweeps_per_solve = ((count as u32).pow(2) / 64).clamp(1, MAX_SWEEPS_PER_SOLVE);
    let solver = &mut world.model.solver;
    solver.tolerance = None;
    solver.max_iterations = sweeps_per_solve;
    solver.convergence_check_interval = 1;
    let start = world.state.clone();
    let mut sweeps = 0;
    loop {
        let carried = -world.step()?.reactions[0].impulse.z / world.model.stepping.h();
        sweeps += sweeps_per_solve;
        if 1.0 - carried / world.weight() < 0.01 || sweeps >= 1 << 20 {
            return Ok(sweeps);
        }
        // Repeats the step, starting from the impulses that its sweeps have reached.
        let contacts = std::mem::take(&mut world.state.contacts);
        world.state = State { contacts, ..start.clone() };
    }
}

/// Checks a semicircular arch of voussoirs, which stands if and only if it is thick enough.
pub fn arch(size: &SuiteSize, _: &dyn Reporter) -> Result<ValidationCheck> {
    const VOUSSOIRS: usize = 16;
    let mut check = ValidationCheck::new(
        "arch",
        format!(
            "A semicircle of {VOUSSOIRS} voussoirs on a floor, μ = 1, for 1 s; mean radius 1 m."
        ),
        "Milankovitch 1907: stands iff thickness over mean radius is above 0.1075",
    );
    let sinking = |thickness: f64| -> Result<f64> {
        let mut world = World::new(2_000_000, 1.0, 2e-3);
        world.model.solver.tolerance = Some(1e-6);
        world.model.solver.max_iterations = 500;
        for k in 0..VOUSSOIRS {
            let mut points = vec![];
            for joint in [k, k + 1] {
                let angle = PI * joint as f64 / VOUSSOIRS as f64;
                for radius in [1.0 - 0.5 * thickness, 1.0 + 0.5 * thickness] {
                    for y in [-0.15, 0.15] {
                        points.push(Vec3::new(radius * angle.cos(), y, radius * angle.sin()));
                    }
                }
            }
            let (stone, pose) = convex_hull(&points)?;
            let shape = world.shape(stone);
            world.grain(shape, pose);
        }
        world.wall("floor", Vec3::zeros(), Vec3::z(), 1.0);
        let start = world.state.position[VOUSSOIRS / 2].z;
        world.run(1.0)?;
        Ok(start - world.state.position[VOUSSOIRS / 2].z)
    };
    let (thick, thin) = (sinking(0.12)?, sinking(0.095)?);
    check.findings.push(CheckFinding::near("crown sinks, thickness 0.12 (m)", thick, 0.0, 1e-4));
    let texts = ["falls".into(), "more than 0.1 m".into()];
    let sinks = "crown sinks, thickness 0.095 (m)";
    check.findings.push(CheckFinding::at_distance(sinks, thin, texts, 0.1 - thin));
    if !size.quick {
        let [mut falls, mut stands] = [0.095, 0.12];
        while stands - falls > 1e-3 {
            let middle = 0.5 * (falls + stands);
            if sinking(middle)?.abs() < 0.01 { stands = middle } else { falls = middle }
        }
        let middle = 0.5 * (falls + stands);
        check.findings.push(CheckFinding::near(
            "thickness between falling and standing",
            middle,
            0.1075,
            0.005,
        ));
    }
    Ok(check)
}
