//! Heaps of ballast grains: angle of repose, silo.

use super::check::{CheckFinding, ValidationCheck, mean_and_error};
use super::samples_progress::{map_in_order, map_parallel};
use super::suite_size::SuiteSize;
use super::world::{D, SETTLING_SPEED, World, in_box, random, stack_loosely};
use ballast::geometry::{GrainShape, random_grain};
use ballast::math::{Pose, Vec3};
use ballast_report::plot::{Chart, SeriesStyle};
use ballast_session::{Reporter, Result};
use rand_pcg::Pcg64;

/// Seed of the grains and their places in the first heap.
pub const FIRST_SEED: u64 = 11;

/// Number of heaps per kind of grains; heaps of 120 grains differ by 9°.
const HEAPS: u64 = 3;

/// Shape of the ballast grains.
pub fn stones() -> GrainShape {
    GrainShape { vertices: [8, 20], ..GrainShape::default() }
}

fn round() -> GrainShape {
    GrainShape { vertices: [20, 40], angularity: 0.0, ..GrainShape::default() }
}

fn sharp() -> GrainShape {
    GrainShape { vertices: [5, 9], angularity: 1.0, ..GrainShape::default() }
}

/// Creates a scene with a loose column of grains of one kind; see [`stack_loosely`].
pub fn grains(
    kind: &GrainShape,
    count: usize,
    friction: f64,
    seed: u64,
    places: usize,
    place: impl Fn(&mut Pcg64, f64) -> [f64; 2],
) -> Result<World> {
    let mut world = World::new(2_000_000, friction, 0.05 * D).pouring(80);
    let mut rng = random(seed);
    let mut shapes = vec![];
    for _ in 0..12 {
        shapes.push(world.shape(random_grain(&mut rng, kind, D)?));
    }
    stack_loosely(&mut world, &mut rng, &shapes, count, places, place);
    Ok(world)
}

/// Speed of the receding wall, m/s. At five times this speed a heap of 700 grains slides and ends 3° flatter.
const WALL_SPEED: f64 = 0.05;

/// Measures the angle of repose of a heap behind a receding wall.
pub fn repose(size: &SuiteSize, console: &dyn Reporter) -> Result<ValidationCheck> {
    let count = size.grains(120, 700);
    let frictions: &[f64] = if size.quick { &[0.2, 0.8] } else { &[0.2, 0.4, 0.6, 0.8, 1.0] };
    let mut check = ValidationCheck::new(
        "angle of repose",
        format!(
            "{count} ballast grains, d = {D} m, behind a wall that recedes at {WALL_SPEED} m/s until no grain touches \
             it; floor as rough as the grains, sides without friction; line through the slope between a fifth and four \
             fifths of its height; mean of {HEAPS} heaps."
        ),
        "Ballast: 37° to 45°, rising with friction and angularity",
    );
    let mut kinds: Vec<(GrainShape, f64)> = frictions.iter().map(|mu| (stones(), *mu)).collect();
    if !size.quick {
        kinds.extend([round(), sharp()].map(|stones| (stones, 0.8)));
    }
    let slopes = slopes(size, &kinds, count, console)?;
    let mut points = Vec::new();
    for (&friction, [angle, error]) in frictions.iter().zip(&slopes) {
        points.push([friction, *angle]);
        let name = format!("angle at μ = {friction} (°)");
        check.findings.push(if friction == 0.8 {
            let largest = if size.quick { 10.0 } else { 8.5 };
            CheckFinding::between(name, *angle, [37.0, 45.0]).with_known_deviation(
                largest,
                "A withdrawn wall leaves the slope after its slide, and the frictionless sides lower it by some 3°; convex \
                 stones of this regularity interlock less than crushed rock.",
            )
        } else {
            CheckFinding::informational(name, *angle, "rises with μ")
        });
        let name = format!("its standard error, μ = {friction} (°)");
        check.findings.push(CheckFinding::informational(name, *error, "scatter"));
    }
    let rises = points[points.len() - 1][1] > points[0][1];
    check
        .findings
        .push(CheckFinding::trend("rises from the lowest to the highest friction", rises));
    if let [[round, _], [sharp, _]] = slopes[frictions.len()..] {
        for (name, angle) in [("round stones, 20 to 40", round), ("sharp stones, 5 to 9", sharp)] {
            let name = format!("angle at μ = 0.8 of {name} corners (°)");
            check.findings.push(CheckFinding::informational(name, angle, "rises with angularity"));
        }
        check.findings.push(CheckFinding::trend("rises from round to sharp stones", sharp > round));
    }
    let chart =
        Chart::new("Angle of repose", "friction between grains", "angle (°)").starting_at_zero();
    check.charts.push(chart.with("measured", points, SeriesStyle::Points).svg());
    check.remark = "Slopes of few grains: the line through their surface scatters from heap to heap, and a sliding slope \
                    ends below the angle at which it started."
        .into();
    Ok(check)
}

/// Returns mean and standard error of the slope for each kind of grains and friction, °.
fn slopes(
    size: &SuiteSize,
    kinds: &[(GrainShape, f64)],
    count: usize,
    console: &dyn Reporter,
) -> Result<Vec<[f64; 2]>> {
    let seeds = || FIRST_SEED..FIRST_SEED + HEAPS;
    let heaps: Vec<_> = kinds.iter().flat_map(|kind| seeds().map(move |s| (kind, s))).collect();
    let angles = map_parallel("heaps", &heaps, console, |((stones, friction), seed)| {
        slope(size, stones, count, *friction, *seed)
    })?;
    Ok(angles.chunks(HEAPS as usize).map(mean_and_error).collect())
}

/// Returns the slope of one heap, °.
fn slope(
    size: &SuiteSize,
    kind: &GrainShape,
    count: usize,
    friction: f64,
    seed: u64,
) -> Result<f64> {
    let [length, width] = if size.quick { [5.0 * D, 4.0 * D] } else { [11.0 * D, 6.0 * D] };
    let mut world = grains(kind, count, friction, seed, 1, in_box([length, width]))?;
    world.wall("floor", Vec3::zeros(), Vec3::z(), friction);
    world.wall("back", Vec3::zeros(), Vec3::x(), friction);
    world.wall("south", Vec3::zeros(), Vec3::y(), 0.0);
    world.wall("north", Vec3::y() * width, -Vec3::y(), 0.0);
    let front = world.wall("front", Vec3::x() * length, -Vec3::x(), 0.0);
    world.settle(SETTLING_SPEED, 2e-3)?;
    let h = world.model.stepping.h();
    let steps = (2.0 * length / WALL_SPEED / h) as usize;
    // A slope may slide and touch the wall again.
    let mut steps_without_contact = 0;
    for k in 0..steps {
        world.targets[front] = Pose::at(Vec3::x() * (length + WALL_SPEED * h * (k + 1) as f64));
        let pressed = world.step()?.reactions[front].impulse != Vec3::zeros();
        steps_without_contact = if pressed { 0 } else { steps_without_contact + 1 };
        if steps_without_contact > 200 && world.mean_speed() < 2e-3 {
            break;
        }
    }
    Ok(surface_angle(&world, width))
}

/// Returns the angle of the line through the uppermost corners of slices of width d, without top and toe, °.
fn surface_angle(world: &World, width: f64) -> f64 {
    let mut tops: Vec<f64> = Vec::new();
    for grain in 0..world.model.grains.len() {
        let position = world.state.position[grain];
        // Middle third of the width: at the frictionless sides grains roll.
        if (position.y - 0.5 * width).abs() > width / 3.0 {
            continue;
        }
        let slice = (position.x / D).max(0.0) as usize;
        if tops.len() <= slice {
            tops.resize(slice + 1, 0.0);
        }
        let top = world.corners(grain).map(|p| p.z).fold(0.0, f64::max);
        tops[slice] = tops[slice].max(top);
    }
    let height = tops.iter().copied().fold(0.0, f64::max);
    let slope = |z: f64| (0.2..0.8).contains(&(z / height));
    let points: Vec<[f64; 2]> = (tops.iter().enumerate().filter(|(_, z)| slope(**z)))
        .map(|(k, z)| [(k as f64 + 0.5) * D, *z])
        .collect();
    let n = points.len() as f64;
    let [mx, mz] = [0, 1].map(|c| points.iter().map(|p| p[c]).sum::<f64>() / n);
    let covariance: f64 = points.iter().map(|p| (p[0] - mx) * (p[1] - mz)).sum();
    let variance: f64 = points.iter().map(|p| (p[0] - mx).powi(2)).sum();
    (-covariance / variance).atan().to_degrees()
}

/// Measures the load on the floor of a narrow silo, whose walls carry most of a high fill.
pub fn silo(size: &SuiteSize, console: &dyn Reporter) -> Result<ValidationCheck> {
    let across = if size.quick { 3.0 * D } else { 5.0 * D };
    let counts: &[usize] =
        // At least four layers: the load of fewer scatters.
        if size.quick { &[40, 80, 160] } else { &[100, 200, 400, 800, 1200] };
    let (friction, walls) = (0.5, 0.8);
    let mut check = ValidationCheck::new(
        "silo",
        format!(
            "Up to {} ballast grains, μ = {friction}, in a square silo {} d wide, walls μ = {walls}: load of the floor, \
             mean of 50 steps at rest.",
            counts[counts.len() - 1],
            across / D
        ),
        "Janssen 1895: the floor's load saturates with the height of the fill",
    );
    let points = map_in_order("silos", counts, console, |&count| {
        let mut world = grains(&stones(), count, friction, FIRST_SEED, 1, in_box([across; 2]))?;
        world.container([across; 2], friction, walls);
        world.settle(SETTLING_SPEED, 1e-3)?;
        let mut load = 0.0;
        for _ in 0..50 {
            load -= world.step()?.reactions[0].impulse.z / world.model.stepping.h() / 50.0;
        }
        Ok([world.weight(), load])
    })?;
    let share = |p: &[f64; 2]| p[1] / p[0];
    let [before, last] = [points[points.len() - 2], points[points.len() - 1]];
    for p in &points {
        check.findings.push(CheckFinding::informational(
            format!("fraction of {:.0} N on the floor", p[0]),
            share(p),
            "falls",
        ));
    }
    let falls = points.windows(2).all(|p| share(&p[1]) < share(&p[0]));
    check.findings.push(CheckFinding::trend("the fraction falls with the fill", falls));
    let added = (last[1] - before[1]) / (last[0] - before[0]);
    let name = "fraction of the last addition that reaches the floor";
    check.findings.push(CheckFinding::between(name, added, [-0.2, 0.2]));
    let weight = points.iter().map(|p| [p[0], p[0]]).collect();
    let chart = Chart::new("Load on the floor of a silo", "weight of the fill (N)", "load (N)")
        .starting_at_zero()
        .with("measured", points, SeriesStyle::Points)
        .with("without walls", weight, SeriesStyle::Expected);
    check.charts.push(chart.svg());
    Ok(check)
}
