//! Direct shear of ballast in a box.

use super::check::{CheckFinding, ValidationCheck};
use super::samples_progress::map_parallel;
use super::specimen::{
    PLATE_WEIGHT, SOLID_FRACTION, STEEL_FRICTION, STONE_FRICTION, column, compact, plate, release,
    rest,
};
use super::suite_size::SuiteSize;
use super::world::World;
use ballast::geometry::cuboid;
use ballast::math::{Pose, Vec3};
use ballast::model::Part;
use ballast_report::plot::{Chart, SeriesStyle};
use ballast_session::{Reporter, Result};

/// Speed of the lower half, m/s.
const SPEED: f64 = 0.03;
/// Displacement of the lower half at the end, m.
const DISPLACEMENT: f64 = 0.037;
/// Reason of the known deviations.
const DENSITY: &str = "At the solid fraction of the experiments, convex stones are nearly as dense as they can be, and they neither \
                       break nor wear: they dilate more, and their strength falls less with the stress.";
/// Displacement over which forces are averaged, m.
const AVERAGE: f64 = 1e-3;
/// Thickness of the walls, m: more than the displacement, so that they close both halves.
const THICKNESS: f64 = 0.06;
/// Height of the walls, which hold the stones before they are compacted, m.
const WALL_HEIGHT: f64 = 4.0;

/// Published ranges of the peak ratio of shear to normal stress, by normal stress (Pa): apparent friction angles of 64° at 15 kPa,
/// within a tenth of the ratio, and of 46° to 52° at 75 kPa.
const PEAKS: [(f64, [f64; 2]); 2] = [(15e3, [1.85, 2.25]), (75e3, [1.04, 1.28])];

/// Shear box with its specimen.
struct ShearBox {
    world: World,
    lid: usize,
    lower: usize,
    /// Cross-section, m².
    area: f64,
}

/// Curve of a test: displacement (m), shear over normal stress, rise of the lid (m).
type ShearCurve = Vec<[f64; 3]>;

/// Creates the walls of one half of the box, from one height to another.
fn walls(world: &mut World, length: f64, [low, high]: [f64; 2]) -> Vec<Part> {
    let half = |x: f64, y: f64| Vec3::new(0.5 * x, 0.5 * y, 0.5 * (high - low));
    let long = length + 2.0 * THICKNESS;
    let across = world.shape(cuboid(half(THICKNESS, long)));
    let along = world.shape(cuboid(half(long, THICKNESS)));
    let [middle, z, out] = [0.5 * length, 0.5 * (low + high), 0.5 * (length + THICKNESS)];
    let at =
        |shape, x, y| Part::Convex { shape, pose: Pose::at(Vec3::new(middle + x, middle + y, z)) };
    vec![at(across, -out, 0.0), at(across, out, 0.0), at(along, 0.0, -out), at(along, 0.0, out)]
}

impl ShearBox {
    /// Fills a square box of a length and height (m) and loads its lid with a stress (Pa).
    fn fill(length: f64, height: f64, stress: f64, seed: u64) -> Result<Self> {
        let mut world = column([length; 2], height, seed)?;
        let area = length * length;
        let down = vec![Part::HalfSpace { normal: -Vec3::z(), offset: 0.0 }];
        let at = Vec3::z() * WALL_HEIGHT;
        let lid = world.driven("lid", down, at, STEEL_FRICTION, Some(plate()));
        let parts = walls(&mut world, length, [0.5 * height, WALL_HEIGHT]);
        let upper = world.driven("upper half", parts, Vec3::zeros(), STEEL_FRICTION, Some(plate()));
        let mut parts = walls(&mut world, length, [-THICKNESS, 0.5 * height]);
        parts.push(Part::HalfSpace { normal: Vec3::z(), offset: 0.0 });
        let lower = world.driven("lower half", parts, Vec3::zeros(), STEEL_FRICTION, None);
        compact(&mut world, lid, area, height, stress * area)?;
        [lid, upper].into_iter().for_each(|body| release(&mut world, body, 2));
        world.forces[lid] = Vec3::z() * (PLATE_WEIGHT - stress * area);
        // A counterweight carries the upper half, which follows the stones.
        world.forces[upper] = Vec3::z() * PLATE_WEIGHT;
        rest(&mut world)?;
        Ok(Self { world, lid, lower, area })
    }

    fn lid_height(&self) -> f64 {
        self.world.state.position[self.world.model.grains.len() + self.lid].z
    }

    /// Moves the lower half under a normal stress (Pa).
    fn shear(&mut self, stress: f64) -> Result<ShearCurve> {
        let h = self.world.model.stepping.h();
        let start = self.lid_height();
        let mut record = vec![];
        for k in 1..=(DISPLACEMENT / SPEED / h).round() as usize {
            let moved = SPEED * h * k as f64;
            self.world.targets[self.lower] = Pose::at(Vec3::x() * moved);
            let force = -self.world.step()?.reactions[self.lower].impulse.x / h;
            record.push([moved, force / (self.area * stress), self.lid_height() - start]);
        }
        Ok(averaged(&record, (AVERAGE / SPEED / h).round() as usize))
    }
}

/// Returns the means of groups of `n` rows.
fn averaged(record: &[[f64; 3]], n: usize) -> ShearCurve {
    let mean = |rows: &[[f64; 3]], k: usize| rows.iter().map(|r| r[k]).sum::<f64>() / n as f64;
    record.chunks_exact(n).map(|rows| [0, 1, 2].map(|k| mean(rows, k))).collect()
}

/// Figures of one test.
struct ShearResult {
    record: ShearCurve,
    /// Largest ratio of shear to normal stress.
    peak: f64,
    /// Ratio over the last fifth of the displacement.
    residual: f64,
    /// Rise of the lid at the end, m.
    dilation: f64,
}

impl ShearResult {
    fn new(record: ShearCurve) -> Self {
        let peak = record.iter().map(|row| row[1]).fold(0.0, f64::max);
        let last = &record[record.len() - record.len() / 5..];
        let residual = last.iter().map(|row| row[1]).sum::<f64>() / last.len() as f64;
        Self { peak, residual, dilation: record[record.len() - 1][2], record }
    }
}

/// Measures shear stress and dilation of ballast in a shear box.
pub fn shear(size: &SuiteSize, console: &dyn Reporter) -> Result<ValidationCheck> {
    let stresses: &[f64] = if size.quick { &[15e3, 75e3] } else { &[15e3, 27e3, 51e3, 75e3] };
    let [length, height] = if size.quick { [0.18, 0.13] } else { [0.3, 0.2] };
    let mut check = ValidationCheck::new(
        "shear box",
        format!(
            "Stones of 25 to 50 mm, μ = {STONE_FRICTION}, compacted to a solid fraction of {SOLID_FRACTION} in a box of \
             {length} × {length} × {height} m with steel walls, μ = {STEEL_FRICTION}; loaded lid; the lower half moves \
             at {} mm/s, the upper one is free to rise. Ratios over the stress on the lid, means over {} mm; one specimen per stress.",
            1e3 * SPEED,
            1e3 * AVERAGE
        ),
        "Indraratna et al. 2014: fresh ballast, box of 0.3 × 0.3 × 0.2 m, 15 to 75 kPa; critical state of coarse soil: \
         Dołżyk-Szypcio 2019",
    );
    let found = map_parallel("shear tests", stresses, console, |&stress| {
        Ok(ShearResult::new(ShearBox::fill(length, height, stress, 1)?.shear(stress)?))
    })?;
    let peaks: Vec<f64> = found.iter().map(|r| r.peak).collect();
    let rises: Vec<f64> = found.iter().map(|r| 1e3 * r.dilation).collect();
    for (stress, peak) in stresses.iter().zip(&peaks) {
        let name = format!("peak shear over normal stress at {} kPa", stress / 1e3);
        // Stones jam in the small box, five of them wide.
        check.findings.push(match PEAKS.iter().find(|(published, _)| published == stress) {
            Some((_, range)) if !size.quick => {
                CheckFinding::between(name, *peak, *range).with_known_deviation(0.6, DENSITY)
            }
            _ => CheckFinding::informational(name, *peak, "falls with the stress"),
        });
    }
    let ends = [0, stresses.len() - 1];
    if !size.quick {
        let name = "the peak ratio falls from the lowest to the highest stress";
        check.findings.push(CheckFinding::trend(name, peaks[ends[1]] < peaks[ends[0]]));
    }
    check.findings.push(CheckFinding::trend(
        "the ratio falls by a tenth of its peak or more at all stresses",
        found.iter().all(|r| r.residual < 0.9 * r.peak),
    ));
    for (stress, result) in stresses.iter().zip(&found) {
        let name = format!("ratio over the last fifth of the displacement at {} kPa", stress / 1e3);
        check.findings.push(CheckFinding::informational(
            name,
            result.residual,
            "0.875 (critical state)",
        ));
    }
    for (stress, rise) in stresses.iter().zip(&rises) {
        let name = format!("rise of the lid at {} kPa (mm)", stress / 1e3);
        check.findings.push(CheckFinding::informational(name, *rise, "falls"));
    }
    check
        .findings
        .push(CheckFinding::trend("dilates at all stresses", rises.iter().all(|rise| *rise > 0.0)));
    let falls = rises[ends[1]] < rises[ends[0]];
    let falls = CheckFinding::trend("dilates less at the highest stress than at the lowest", falls);
    check.findings.push(falls.with_known_deviation(1.0, DENSITY));
    let [ratio, rise] = [("shear over normal stress", 1, 1.0), ("rise of the lid (mm)", 2, 1e3)]
        .map(|(y, column, unit)| {
            let chart = Chart::new("Shear box", "displacement (mm)", y).starting_at_zero();
            stresses.iter().zip(&found).fold(chart, |chart, (stress, result)| {
                let curve = result.record.iter().map(|row| [1e3 * row[0], unit * row[column]]);
                let name = format!("{} kPa", stress / 1e3);
                chart.with(&name, curve.collect(), SeriesStyle::Line)
            })
        });
    check.charts = vec![ratio.svg(), rise.svg()];
    Ok(check)
}
