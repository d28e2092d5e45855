//! Columns of ballast grains that collapse.

use super::check::{Check, Finding, exponent};
use super::heaps::{SEED, grains, stones};
use super::several::in_turn;
use super::size::Size;
use super::world::{D, FALL, GRAVITY, World};
use ballast::math::Vec3;
use ballast_report::plot::{Chart, Mark};
use ballast_session::Outcome;
use ballast_session::Reporter;
use rand::RngExt;
use rand_pcg::Pcg64;
use std::f64::consts::PI;

/// Of grains and floor.
const FRICTION: f64 = 0.6;
/// Solid fraction of grains that have come to rest, for their number.
const LOOSE: f64 = 0.5;
/// Solid fraction of the suspension that grains sink from.
const SUSPENDED: f64 = 0.35;
/// Places that a grain is hung at the lowest of: the fewer, the higher the pile of the spheres.
const PLACES: usize = 10;
/// Aspect ratio up to which runout is linear (Lube et al. 2004).
const LOW: f64 = 1.7;
/// Aspect ratio above which it goes with the root by every experiment known here: from 1.7 on by Lube et al. 2004, from
/// 3 on by Lajeunesse et al. 2004 (Phys. Fluids 16, 2371).
const TALL: f64 = 3.0;

/// A sector of a round column about the z axis, from the x axis on: flow and deposit of the column are symmetric, so
/// planes without friction may stand for the rest of it.
struct Sector {
    radius: f64,
    /// Below π.
    angle: f64,
}

impl Sector {
    /// m².
    fn area(&self) -> f64 {
        0.5 * self.angle * self.radius.powi(2)
    }

    /// Number of grains that fill it to an aspect ratio.
    fn count(&self, aspect: f64) -> usize {
        let grain = PI / 6.0 * D.powi(3);
        (LOOSE * self.area() * aspect * self.radius / grain).round() as usize
    }

    /// Normals of the planes of symmetry that bound it, into it.
    fn sides(&self) -> [Vec3; 2] {
        [Vec3::y(), Vec3::new(self.angle.sin(), -self.angle.cos(), 0.0)]
    }

    /// Normals of the planes of the tube, outwards: tangents of the circle, as far apart as 32 around it.
    fn tube(&self) -> Vec<Vec3> {
        let n = (self.angle / (PI / 16.0)).ceil();
        let direction = |k: usize| {
            let angle = self.angle * (k as f64 + 0.5) / n;
            Vec3::new(angle.cos(), angle.sin(), 0.0)
        };
        (0..n as usize).map(direction).collect()
    }

    /// Whether a place is as far as `margin` from all of its planes.
    fn holds(&self, at: &Vec3, margin: f64) -> bool {
        self.sides().iter().all(|n| n.dot(at) >= margin)
            && self.tube().iter().all(|n| n.dot(at) <= self.radius - margin)
    }

    /// The floor and the planes of symmetry.
    fn frame(&self, world: &mut World) {
        world.wall("floor", Vec3::zeros(), Vec3::z(), FRICTION);
        for (k, normal) in self.sides().into_iter().enumerate() {
            world.wall(&format!("side {k}"), Vec3::zeros(), normal, 0.0);
        }
    }

    /// Any place in it for a sphere of a radius (m).
    fn place(&self, rng: &mut Pcg64, reach: f64) -> [f64; 2] {
        loop {
            let [along, across] = [rng.random::<f64>(), rng.random::<f64>()];
            let at = Vec3::new(along, across * self.angle.sin(), 0.0) * self.radius;
            if self.holds(&at, reach) {
                return [at.x, at.y];
            }
        }
    }
}

/// A column in a tube that is taken away.
pub fn collapse(size: &Size, console: &dyn Reporter) -> Outcome<Check> {
    let (radius, degrees, aspects): (_, f64, &[f64]) = if size.quick {
        (5.0, 90.0, &[0.6, 1.2, 2.4])
    } else {
        (20.0, 30.0, &[0.5, 1.0, 1.5, 2.5, 4.0, 6.0, 9.0])
    };
    let sector = Sector { radius: radius * D, angle: degrees.to_radians() };
    let mut check = Check::new(
        "column collapse",
        format!(
            "Ballast grains, d = {D} m, μ = {FRICTION}, in a tube of radius {radius} d that vanishes, {degrees}° of it between \
             planes without friction; radius within which 97 % of the grains end, over that before."
        ),
        "Lube et al. 2004, J. Fluid Mech. 508, 175: r/r0 = 1 + 1.24 a for a < 1.7, 1 + 1.6 √a above, for R/d > 20; \
         Lajeunesse et al. 2004, Phys. Fluids 16, 2371: √a above 3",
    );
    let law = |a: f64| if a < LOW { 1.0 + 1.24 * a } else { 1.0 + 1.6 * a.sqrt() };
    let points = in_turn("columns", aspects, console, |&aspect| fall_apart(&sector, aspect))?;
    for [aspect, runout] in &points {
        let name = format!("r/r0 at a = {aspect:.2}");
        check.findings.push(Finding::told(name, *runout, format!("{:.2}", law(*aspect))));
    }
    let rises = points.windows(2).all(|p| p[1][1] > p[0][1]);
    let slope = (points[1][1] - 1.0) / points[1][0];
    check.findings.push(Finding::trend("runout rises with the aspect ratio", rises));
    let name = format!("coefficient (r/r0 − 1)/a at a = {:.2}", points[1][0]);
    let known = (law(points[1][0]) - 1.0) / points[1][0];
    check.findings.push(Finding::told(name, slope, format!("{known:.2}")));
    if !size.quick {
        let further = points.iter().map(|[a, runout]| [*a, runout - 1.0]);
        let (short, tall): (Vec<[f64; 2]>, Vec<_>) = further.partition(|p| p[0] < TALL);
        let low: Vec<_> = short.iter().copied().filter(|p| p[0] < LOW).collect();
        let slope = |points: &[[f64; 2]]| exponent(points[0], points[points.len() - 1]);
        let between = [short[short.len() - 1], tall[0]];
        let name = |which: &str| format!("exponent of r/r0 − 1 over a, {which}");
        check.findings.extend([
            Finding::near(name(&format!("below {LOW}")), slope(&low), 1.0, 0.15),
            Finding::told(
                name(&format!("from {:.2} to {:.2}", between[0][0], between[1][0])),
                slope(&between),
                "between them",
            ),
            Finding::near(name(&format!("above {TALL}")), slope(&tall), 0.5, 0.1),
        ]);
    }
    let known = points.iter().map(|p| [p[0], law(p[0])]).collect();
    let chart = Chart::new("Runout of columns", "aspect ratio a = h0/r0", "r/r0")
        .with("measured", points, Mark::Points)
        .with("Lube et al. 2004", known, Mark::Expected);
    check.charts.push(chart.svg());
    if size.quick {
        check.remark = "The law is for R/d > 20; columns this narrow show the trend.".into();
    }
    Ok(check)
}

/// Aspect ratio before and runout after, for a column of about this aspect ratio.
fn fall_apart(sector: &Sector, aspect: f64) -> Outcome<[f64; 2]> {
    let place = |rng: &mut Pcg64, reach: f64| sector.place(rng, reach);
    let mut world = grains(&stones(), sector.count(aspect), FRICTION, SEED, PLACES, place)?;
    sector.frame(&mut world);
    for (k, out) in sector.tube().into_iter().enumerate() {
        world.wall(&format!("tube {k}"), out * sector.radius, -out, 0.2);
    }
    world.suspend(sector.area(), SUSPENDED)?;
    world.settle(FALL, 2e-3)?;
    // An even column is twice as high as its centre of mass.
    let height = 2.0 * world.height();
    let before = extent(&world);
    world.without_walls();
    sector.frame(&mut world);
    // The collapse takes some three times as long as a fall from the top; stones at its edge roll a little longer.
    let fall = (height / GRAVITY).sqrt();
    world.run(fall)?;
    let most = (8.0 * fall / world.model.stepping.h()) as usize;
    for _ in 0..most {
        if world.mean_speed() < 0.01 {
            break;
        }
        world.step()?;
    }
    Ok([height / sector.radius, extent(&world) / before])
}

/// Radius within which 97 % of the grains' centres are, m.
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
    fn sectors_have_their_share_of_the_column_and_hold_what_is_inside() {
        let sector = Sector { radius: 20.0 * D, angle: PI / 6.0 };
        assert!((12.0 * sector.area() / (PI * (20.0 * D).powi(2)) - 1.0).abs() < 1e-12);
        // Half of 12th of a column as high as wide, in stones.
        assert_eq!(sector.count(1.0), (0.5 * 20.0_f64.powi(3) * 6.0 / 12.0).round() as usize);
        let at = |r: f64, angle: f64| Vec3::new(angle.cos(), angle.sin(), 0.0) * r;
        assert!(sector.holds(&at(19.0 * D, PI / 12.0), 0.5 * D));
        assert!(!sector.holds(&at(19.8 * D, PI / 12.0), 0.5 * D), "the tube");
        assert!(!sector.holds(&at(10.0 * D, 0.01), 0.5 * D), "a side");
        assert!(!sector.holds(&at(10.0 * D, PI / 6.0 - 0.01), 0.5 * D), "the other side");
        assert!(!sector.holds(&at(10.0 * D, -0.1), 0.0), "outside");
    }
}
