//! Pouring of grains without dynamics: each grain is laid at the lowest of several random places.
//!
//! Reads: grain shapes, the bed's relief. Writes: grains and their poses.
//! Cost: O(tries × cells under a grain) per grain.
//! Contract: no two grains overlap, none leaves the box; a function of the random stream alone.
//!
//! Laid so, a bed of ballast has a compactness of about 0.4 before it is shaken down by gravity: it
//! falls by a few grain sizes only, where a lattice of bounding spheres would fall from several
//! times its height.

use super::height_map::{Footprint, HeightMap, turned_bounds};
use crate::error::{Error, Result};
use crate::geometry::{
    AxisBox, GrainShape, Polyhedron, ShapeDescriptors, random_grain, random_rotation,
    stone_with_corners,
};
use crate::math::{Pose, Quat, Vec3};
use crate::track::plan::{BedPlan, GrainPlan, SieveFraction, SizeClass};
use rand::RngExt;
use rand_pcg::Pcg64;
use std::iter::Cycle;
use std::vec::IntoIter;

/// Places tried for each grain; more make a denser and more even bed.
const PLACEMENT_ATTEMPTS: usize = 100;
/// Maximum attempts without any place before the bed counts as too narrow.
const MAX_ATTEMPTS: usize = 10_000;
/// Maximum number of grains in a row without a place before the cribs count as narrower than grains.
const MAX_CONSECUTIVE_FAILURES: usize = 20;
/// Attempts under a block, per grain that would cover it.
const FILL_ATTEMPTS_PER_GRAIN: f64 = 400.0;
/// Clearance between a grain and the surface that it is laid upon, m, so that rounding makes no overlap.
const CLEARANCE: f64 = 1e-5;
/// Cells of the raster across the smallest grains.
pub const CELLS_PER_GRAIN: f64 = 14.0;

/// Source of the different shapes of a bed: given stones in turn, or random grains.
struct ShapeSource {
    random: GrainShape,
    /// Given stones of nominal diameter 1.
    stones: Cycle<IntoIter<Polyhedron>>,
}

impl ShapeSource {
    fn new(grains: &GrainPlan) -> Result<Self> {
        let stones = grains.stones.iter().map(|corners| stone_with_corners(corners));
        let stones: Vec<Polyhedron> = stones.collect::<Result<_>>()?;
        Ok(Self { random: grains.shape, stones: stones.into_iter().cycle() })
    }

    /// Returns the next shape, of nominal diameter `size` (m).
    fn next(&mut self, rng: &mut Pcg64, size: f64) -> Result<Polyhedron> {
        match self.stones.next() {
            Some(stone) => Ok(stone.scaled(size)),
            None => random_grain(rng, &self.random, size),
        }
    }
}

/// The grain shapes of a bed and how often each is drawn.
#[derive(Debug, Clone)]
pub(super) struct Templates {
    /// First and one past last shape of each class.
    classes: Vec<(usize, usize)>,
    shares: Vec<f64>,
}

impl Templates {
    /// Makes the plan's shapes; the number for each class follows its share, at least one.
    pub fn generate(bed: &BedPlan, rng: &mut Pcg64, shapes: &mut Vec<Polyhedron>) -> Result<Self> {
        let total: f64 = bed.grains.classes.iter().map(|c| c.share).sum();
        if bed.grains.classes.is_empty() || !(total > 0.0) {
            return Err(Error::Model {
                place: "bed.grains.classes".into(),
                expected: "at least one class, of positive shares".into(),
                found: format!("{} of sum {total}", bed.grains.classes.len()),
            });
        }
        let fractions: Vec<SieveFraction> =
            bed.grains.classes.iter().filter_map(|c| c.fraction).collect();
        if fractions.len() == bed.grains.classes.len() {
            return Self::generate_between_sieves(&bed.grains, &fractions, rng, shapes);
        }
        let mut source = ShapeSource::new(&bed.grains)?;
        let mut classes = Vec::new();
        for &SizeClass { size, share, .. } in &bed.grains.classes {
            let count = (f64::from(bed.grains.templates) * share / total).round().max(1.0) as usize;
            let first = shapes.len();
            for _ in 0..count {
                shapes.push(source.next(rng, size)?);
            }
            classes.push((first, shapes.len()));
        }
        let shares = bed.grains.classes.iter().map(|c| c.share / total).collect();
        Ok(Self { classes, shares })
    }

    /// Makes shapes between sieves: each stands for the same mass of its fraction, and is drawn as often as that needs.
    ///
    /// Within a fraction the share by mass is linear in the logarithm of the sieve size, as on a grading chart.
    fn generate_between_sieves(
        grains: &GrainPlan,
        fractions: &[SieveFraction],
        rng: &mut Pcg64,
        shapes: &mut Vec<Polyhedron>,
    ) -> Result<Self> {
        let total: f64 = fractions.iter().map(|f| f.mass_share).sum();
        let mut source = ShapeSource::new(grains)?;
        let (mut classes, mut shares) = (Vec::new(), Vec::new());
        for &SieveFraction { sieves: [low, high], mass_share } in fractions {
            let count = (f64::from(grains.templates) * mass_share / total).round().max(1.0);
            for k in 0..count as usize {
                let sieve = low * libm::pow(high / low, (k as f64 + 0.5) / count);
                let grain = source.next(rng, sieve)?;
                let grain = grain.scaled(sieve / ShapeDescriptors::of(&grain).sieve_size);
                classes.push((shapes.len(), shapes.len() + 1));
                shares.push(mass_share / count / grain.volume);
                shapes.push(grain);
            }
        }
        let sum: f64 = shares.iter().sum();
        shares.iter_mut().for_each(|share| *share /= sum);
        Ok(Self { classes, shares })
    }

    /// Mean volume of a grain, m³.
    pub fn mean_volume(&self, shapes: &[Polyhedron]) -> f64 {
        let mean = |&(first, end): &(usize, usize)| {
            shapes[first..end].iter().map(|s| s.volume).sum::<f64>() / (end - first) as f64
        };
        self.classes.iter().zip(&self.shares).map(|(class, share)| share * mean(class)).sum()
    }

    fn draw(&self, rng: &mut Pcg64) -> usize {
        let mut u: f64 = rng.random();
        let mut class = 0;
        while class + 1 < self.shares.len() && u >= self.shares[class] {
            u -= self.shares[class];
            class += 1;
        }
        let (first, end) = self.classes[class];
        rng.random_range(first..end)
    }
}

/// A grain that has been laid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PlacedGrain {
    pub shape: usize,
    pub pose: Pose,
}

/// A raster fine enough for the grains of a plan.
pub(super) fn height_map(bed: &BedPlan) -> Result<HeightMap> {
    HeightMap::flat([bed.size.x, bed.size.y], bed.grains.min_size() / CELLS_PER_GRAIN)
}

/// Adds grains that already lie in the bed to the relief.
pub(super) fn cover_present<'a>(
    height_map: &mut HeightMap,
    present: impl Iterator<Item = (&'a Polyhedron, Pose)>,
) {
    let mut footprint = Footprint::default();
    for (shape, pose) in present {
        let cells = pose.position / height_map.cell;
        let at = [cells.x.floor(), cells.y.floor()];
        footprint.cover(
            shape,
            &pose.orientation,
            [cells.x - at[0], cells.y - at[1]],
            height_map.cell,
        );
        height_map.add(&footprint, [at[0] as i64, at[1] as i64], pose.position.z);
    }
}

/// Lays grains in random orientation until `volume` (m³) of them lies on the relief.
///
/// # Errors
/// No place where a grain fits between the walls.
pub(super) fn pour(
    height_map: &mut HeightMap,
    templates: &Templates,
    shapes: &[Polyhedron],
    size: &Vec3,
    volume: f64,
    rng: &mut Pcg64,
) -> Result<Vec<PlacedGrain>> {
    let (laid, is_all) = pour_until(1, height_map, templates, shapes, size, volume, rng);
    if is_all { Ok(laid) } else { Err(too_narrow(size)) }
}

/// Lays grains like [`pour`], but leaves out those without a place: cribs may be narrower than grains.
pub(super) fn pour_where_it_fits(
    height_map: &mut HeightMap,
    templates: &Templates,
    shapes: &[Polyhedron],
    size: &Vec3,
    volume: f64,
    rng: &mut Pcg64,
) -> Vec<PlacedGrain> {
    pour_until(MAX_CONSECUTIVE_FAILURES, height_map, templates, shapes, size, volume, rng).0
}

/// Lays grains until `volume` of them lies, or until `misses` in a row find no place; returns false in the latter case.
fn pour_until(
    misses: usize,
    height_map: &mut HeightMap,
    templates: &Templates,
    shapes: &[Polyhedron],
    size: &Vec3,
    volume: f64,
    rng: &mut Pcg64,
) -> (Vec<PlacedGrain>, bool) {
    let mut laid = Vec::new();
    let (mut poured, mut missed) = (0.0, 0);
    let mut footprint = Footprint::default();
    while poured < volume && missed < misses {
        let shape = templates.draw(rng);
        let orientation = random_rotation(rng);
        match lay(height_map, &shapes[shape], orientation, size, &mut footprint, rng) {
            Some(pose) => {
                poured += shapes[shape].volume;
                missed = 0;
                laid.push(PlacedGrain { shape, pose });
            }
            None => missed += 1,
        }
    }
    (laid, missed < misses)
}

/// Lays grains into the voids right under a block, wherever one happens to fit below its underside
/// on the relief.
pub(super) fn fill_voids(
    height_map: &mut HeightMap,
    templates: &Templates,
    shapes: &[Polyhedron],
    block: &AxisBox,
    rng: &mut Pcg64,
) -> Vec<PlacedGrain> {
    let cell = height_map.cell;
    let size = block.high - block.low;
    let grain = libm::cbrt(templates.mean_volume(shapes));
    let tries = FILL_ATTEMPTS_PER_GRAIN * size.x * size.y / (grain * grain);
    let mut footprint = Footprint::default();
    let mut laid = Vec::new();
    for _ in 0..tries as usize {
        let shape = templates.draw(rng);
        let orientation = random_rotation(rng);
        let bounds = turned_bounds(&shapes[shape], &orientation);
        let x = block.low.x + size.x * rng.random::<f64>();
        let y = block.low.y + size.y * rng.random::<f64>();
        let within = [(x / cell).fract(), (y / cell).fract()];
        // Over the edge it might end up in a neighbour's block, or in a wall.
        let inside = [(x, 0), (y, 1)].iter().all(|&(c, k)| {
            c + bounds.low[k] >= block.low[k] && c + bounds.high[k] <= block.high[k]
        });
        if !inside {
            continue;
        }
        footprint.cover(&shapes[shape], &orientation, within, cell);
        let at = [(x / cell).floor() as i64, (y / cell).floor() as i64];
        let highest = block.low.z - bounds.high.z - CLEARANCE;
        let z = height_map.rest(&footprint, at, highest) + CLEARANCE;
        if z < highest {
            height_map.add(&footprint, at, z);
            laid.push(PlacedGrain {
                shape,
                pose: Pose { position: Vec3::new(x, y, z), orientation },
            });
        }
    }
    laid
}

/// Lays one grain at the lowest of some random places; `None` where there is none.
fn lay(
    height_map: &mut HeightMap,
    shape: &Polyhedron,
    orientation: Quat,
    size: &Vec3,
    footprint: &mut Footprint,
    rng: &mut Pcg64,
) -> Option<Pose> {
    let bounds = turned_bounds(shape, &orientation);
    let within: [f64; 2] = [rng.random(), rng.random()];
    let cell = height_map.cell;
    let range = |axis: usize| {
        let first = ((CLEARANCE - bounds.low[axis]) / cell - within[axis]).ceil() as i64;
        let last =
            ((size[axis] - CLEARANCE - bounds.high[axis]) / cell - within[axis]).floor() as i64;
        (first <= last).then_some(first..=last)
    };
    let (columns, rows) = (range(0)?, range(1)?);
    footprint.cover(shape, &orientation, within, cell);
    let (mut lowest, mut place) = (f64::INFINITY, [0, 0]);
    for tried in 1.. {
        let at = [rng.random_range(columns.clone()), rng.random_range(rows.clone())];
        let z = height_map.rest(footprint, at, lowest);
        if z < lowest {
            (lowest, place) = (z, at);
        }
        if tried >= PLACEMENT_ATTEMPTS && lowest.is_finite() {
            break;
        }
        if tried >= MAX_ATTEMPTS {
            return None;
        }
    }
    let z = lowest + CLEARANCE;
    height_map.add(footprint, place, z);
    let coordinate = |axis: usize| (place[axis] as f64 + within[axis]) * cell;
    Some(Pose { position: Vec3::new(coordinate(0), coordinate(1), z), orientation })
}

fn too_narrow(size: &Vec3) -> Error {
    Error::Model {
        place: "bed.size".into(),
        expected: "room for a grain between the walls".into(),
        found: format!("{} x {} m", size.x, size.y),
    }
}

#[cfg(test)]
#[path = "pour_tests.rs"]
mod tests;
