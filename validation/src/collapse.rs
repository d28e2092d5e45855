//! Collapse of columns of ballast grains.

use super::check::{CheckFinding, ValidationCheck, exponent};
use super::heaps::{FIRST_SEED, grains, stones};
use super::samples_progress::map_in_order;
use super::suite_size::SuiteSize;
use super::world::{D, GRAVITY, SETTLING_SPEED, World};
use ballast::math::Vec3;
use ballast_report::plot::{Chart, SeriesStyle};
use ballast_session::{Reporter, Result};
use rand::RngExt;
use rand_pcg::Pcg64;
use std::f64::consts::PI;

/// Friction of grains and floor.
const FRICTION: f64 = 0.6;
/// Solid fraction at rest, which determines the number of grains.
const LOOSE_FRACTION: f64 = 0.5;
/// Solid fraction of the suspension from which the grains sink.
const SUSPENDED_FRACTION: f64 = 0.35;
/// Tries for the place of a grain; fewer give a higher column.
const PLACES: usize = 10;
/// Aspect ratio up to which runout is linear (Lube et al. 2004).
const MAX_LINEAR_ASPECT: f64 = 1.7;
/// Aspect ratio above which runout follows the square root in all experiments: from 1.7 in Lube et al. 2004, from 3 in
/// Lajeunesse et al. 2004 (Phys. Fluids 16, 2371).
const MIN_ROOT_ASPECT: f64 = 3.0;

/// Sector of a round column about the z axis, starting at the x axis. Flow and deposit are symmetric, so frictionless planes
/// replace the rest of the column.
struct Sector {
    radius: f64,
    /// Opening angle below π, rad.
    angle: f64,
}

impl Sector {
    /// Cross-section, m².
    fn area(&self) -> f64 {
        0.5 * self.angle * self.radius.powi(2)
    }

    /// Number of grains for an aspect ratio.
    fn count(&self, aspect: f64) -> usize {
        let grain = PI / 6.0 * D.powi(3);
        (LOOSE_FRACTION * self.area() * aspect * self.radius / grain).round() as usize
    }

    /// Inward normals of the planes of symmetry.
    fn sides(&self) -> [Vec3; 2] {
        [Vec3::y(), Vec3::new(self.angle.sin(), -self.angle.cos(), 0.0)]
    }

    /// Outward normals of the planes of the tube: tangents of the circle, 32 for a whole one.
    fn tube(&self) -> Vec<Vec3> {
        let n = (self.angle / (PI / 16.0)).ceil();
        let direction = |k: usize| {
            let angle = self.angle * (k as f64 + 0.5) / n;
            Vec3::new(angle.cos(), angle.sin(), 0.0)
        };
        (0..n as usize).map(direction).collect()
    }

    /// Returns true if a point is at least `margin` (m) inside all planes.
    fn contains(&self, at: &Vec3, margin: f64) -> bool {
        self.sides().iter().all(|n| n.dot(at) >= margin)
            && self.tube().iter().all(|n| n.dot(at) <= self.radius - margin)
    }

    /// Adds the floor and the planes of symmetry.
    fn add_boundary(&self, world: &mut World) {
        world.wall("floor", Vec3::zeros(), Vec3::z(), FRICTION);
        for (k, normal) in self.sides().into_iter().enumerate() {
            world.wall(&format!("side {k}"), Vec3::zeros(), normal, 0.0);
        }
    }

    /// Returns a random place for a sphere of a radius (m).
    fn place(&self, rng: &mut Pcg64, reach: f64) -> [f64; 2] {
        loop {
            let [along, across] = [rng.random::<f64>(), rng.random::<f64>()];
            let at = Vec3::new(along, across * self.angle.sin(), 0.0) * self.radius;
            if self.contains(&at, reach) {
                return [at.x, at.y];
            }
        }
    }
}

/// Measures the runout of columns whose tube vanishes.
pub fn collapse(size: &SuiteSize, console: &dyn Reporter) -> Result<ValidationCheck> {
    let (radius, degrees, aspects): (_, f64, &[f64]) = if size.quick {
        (5.0, 90.0, &[0.6, 1.2, 2.4])
    } else {
        (20.0, 30.0, &[0.5, 1.0, 1.5, 2.5, 4.0, 6.0, 9.0])
    };
    let sector = Sector { radius: radius * D, angle: degrees.to_radians() };
    let mut check = ValidationCheck::new(
        "column collapse",
        format!(
            "Ballast grains, d = {D} m, μ = {FRICTION}, in a tube of radius {radius} d that vanishes, {degrees}° of it between \
             planes without friction; radius that contains 97 % of the grains, after over before."
        ),
        "Lube et al. 2004, J. Fluid Mech. 508, 175: r/r0 = 1 + 1.24 a for a < 1.7, 1 + 1.6 √a above, for R/d > 20; \
         Lajeunesse et al. 2004, Phys. Fluids 16, 2371: √a above 3",
    );
    let law = |a: f64| if a < MAX_LINEAR_ASPECT { 1.0 + 1.24 * a } else { 1.0 + 1.6 * a.sqrt() };
    let points = map_in_order("columns", aspects, console, |&aspect| runout(&sector, aspect))?;
    for [aspect, runout] in &points {
        let name = format!("r/r0 at a = {aspect:.2}");
        check.findings.push(CheckFinding::informational(
            name,
            *runout,
            format!("{:.2}", law(*aspect)),
        ));
    }
    let rises = points.windows(2).all(|p| p[1][1] > p[0][1]);
    let slope = (points[1][1] - 1.0) / points[1][0];
    check.findings.push(CheckFinding::trend("runout rises with the aspect ratio", rises));
    let name = format!("coefficient (r/r0 − 1)/a at a = {:.2}", points[1][0]);
    let known = (law(points[1][0]) - 1.0) / points[1][0];
    check.findings.push(CheckFinding::informational(name, slope, format!("{known:.2}")));
    if !size.quick {
        let further = points.iter().map(|[a, runout]| [*a, runout - 1.0]);
        let (short, tall): (Vec<[f64; 2]>, Vec<_>) = further.partition(|p| p[0] < MIN_ROOT_ASPECT);
        let low: Vec<_> = short.iter().copied().filter(|p| p[0] < MAX_LINEAR_ASPECT).collect();
        let slope = |points: &[[f64; 2]]| exponent(points[0], points[points.len() - 1]);
        let between = [short[short.len() - 1], tall[0]];
        let name = |which: &str| format!("exponent of r/r0 − 1 over a, {which}");
        check.findings.extend([
            CheckFinding::near(name(&format!("below {MAX_LINEAR_ASPECT}")), slope(&low), 1.0, 0.15),
            CheckFinding::informational(
                name(&format!("from {:.2} to {:.2}", between[0][0], between[1][0])),
                slope(&between),
                "between them",
            ),
            CheckFinding::near(name(&format!("above {MIN_ROOT_ASPECT}")), slope(&tall), 0.5, 0.1),
        ]);
    }
    let known = points.iter().map(|p| [p[0], law(p[0])]).collect();
    let chart = Chart::new("Runout of columns", "aspect ratio a = h0/r0", "r/r0")
        .with("measured", points, SeriesStyle::Points)
        .with("Lube et al. 2004", known, SeriesStyle::Expected);
    check.charts.push(chart.svg());
    if size.quick {
        check.remark = "The law is for R/d > 20; columns this narrow show the trend.".into();
    }
    Ok(check)
}

/// Returns the exact aspect ratio and the runout of a column of about this aspect ratio.
fn runout(sector: &Sector, aspect: f64) -> Result<[f64; 2]> {
    let place = |rng: &mut Pcg64, reach: f64| sector.place(rng, reach);
    let mut world = grains(&stones(), sector.count(aspect), FRICTION, FIRST_SEED, PLACES, place)?;
    sector.add_boundary(&mut world);
    for (k, out) in sector.tube().into_iter().enumerate() {
        world.wall(&format!("tube {k}"), out * sector.radius, -out, 0.2);
    }
    world.suspend(sector.area(), SUSPENDED_FRACTION)?;
    world.settle(SETTLING_SPEED, 2e-3)?;
    // Twice the height of the centre of mass of a uniform column.
    let height = 2.0 * world.height();
    let before = extent(&world);
    world.remove_walls();
    sector.add_boundary(&mut world);
    // A collapse takes about three times as long as a fall from the top; grains at the edge roll a little longer.
    let fall = (height / GRAVITY).sqrt();
    world.run(fall)?;
    let max_steps = (8.0 * fall / world.model.stepping.h()) as usize;
    for _ in 0..max_steps {
        if world.mean_speed() < 0.01 {
            break;
        }
        world.step()?;
    }
    Ok([height / sector.radius, extent(&world) / before])
}

/// Returns the radius that contains 97 % of the grains' centres, m.
fn extent(world: &World) -> f64 {
    let n = world.model.grains.len();
    let mut radii: Vec<f64> = world.state.position[..n].iter().map(|p| p.x.hypot(p.y)).collect();
    radii.sort_by(f64::total_cmp);
    radii[(0.97 * (n - 1) as f64) as usize] + 0.5 * D
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sector_has_its_share_of_the_column() {
        let sector = Sector { radius: 20.0 * D, angle: PI / 6.0 };
        assert!((12.0 * sector.area() / (PI * (20.0 * D).powi(2)) - 1.0).abs() < 1e-12);
        // Half of a twelfth of a column as high as wide, in grains.
        assert_eq!(sector.count(1.0), (0.5 * 20.0_f64.powi(3) * 6.0 / 12.0).round() as usize);
        let at = |r: f64, angle: f64| Vec3::new(angle.cos(), angle.sin(), 0.0) * r;
        assert!(sector.contains(&at(19.0 * D, PI / 12.0), 0.5 * D));
        assert!(!sector.contains(&at(19.8 * D, PI / 12.0), 0.5 * D), "the tube");
        assert!(!sector.contains(&at(10.0 * D, 0.01), 0.5 * D), "a side");
        assert!(!sector.contains(&at(10.0 * D, PI / 6.0 - 0.01), 0.5 * D), "the other side");
        assert!(!sector.contains(&at(10.0 * D, -0.1), 0.0), "outside");
    }
}
