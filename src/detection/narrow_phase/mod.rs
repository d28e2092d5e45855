//! Contact points of two convex polyhedra.
//!
//! Reads: two shapes and their poses. Writes: at most four points. Cost: a little more than a microsecond per
//! touching pair of ballast grains that hardly move, nothing for a pair that is still apart for certain.
//!
//! 1. An axis that separated the pair before rejects it, if it still does.
//! 2. Face normals of both bodies ([`faces`]), then axes perpendicular to two edges ([`edges`]):
//!    the axis of largest separation over all of them. For bodies that overlap this is
//!    the axis of least depth.
//! 3. Bodies apart whose closest points are at vertices have as axis the line between them.
//! 4. Along the axis, the patch: all corners of the gap up to the alert distance ([`patch`]), of
//!    which the four that best stand for it are reported ([`reduce`]). The patch of a face's axis
//!    also tells where the bodies are closest or overlap, and so which edges step 2 has to ask.
//!
//! Stages 2 and 4 ask lists of those features that can matter, kept from earlier steps while they hold
//! ([`contenders`], [`patch`]), for bodies that move slowly enough ([`worth`]). Bodies of which nothing is kept are
//! first asked for a direction that shows them apart ([`mod@apart`]).
//!
//! Contract: the result depends on shapes and poses alone, not on [`PairMemory`]. Two bodies at a
//! distance of at most `alert` have a contact, others have none; the lowest gap is that distance or,
//! for bodies that overlap, minus the least depth. The points' feet, half a gap to either side along
//! the common normal, are on the surfaces that face each other; feet of wide gaps may be a
//! little beside the overlap.

mod anchor;
mod apart;
mod closest;
mod contenders;
mod edges;
mod faces;
mod facing;
mod feature;
mod few;
mod half_space;
mod pair;
mod patch;
mod reduce;
mod report;
mod rim;
mod search;
mod supports;
mod worth;

use crate::geometry::Polyhedron;
use crate::lanes;
use crate::math::{Pose, Vec3, round, widen};
use contenders::{Contenders, EdgePairs};
use edges::NearEdge;
use facing::Sides;
use pair::Pair;
use patch::PatchList;
use reduce::{Candidate, Hull};
use worth::Worth;

pub use feature::on_part;
pub use half_space::touch_half_space;

/// Separations closer than this fraction of the bodies' radii count as equal: then faces of A are
/// preferred to those of B, and faces to edges.
const TIE: f64 = 2.5e-10;

/// What is added to slabs and distances that only choose features, over the radii: faces are flat to
/// 1e-7 only.
const SLAB: f64 = 1e-6;

/// A convex body of the configuration.
#[derive(Debug, Clone, Copy)]
pub struct Solid<'a> {
    pub shape: &'a Polyhedron,
    pub pose: Pose,
}

/// What earlier steps' searches tell the next one about a pair of shapes; it changes the cost, never
/// the result.
#[derive(Debug, Clone, Default)]
pub struct PairMemory {
    /// An axis from A to B, in the frame of A, that separated the pair; zero if none.
    axis: [f32; 3],
    /// The bodies' distance is at least this less what they have travelled together, m.
    apart_until: f64,
    /// Elsewhere, as most pairs that are listed do not touch.
    touching: Option<Box<Touching>>,
}

/// The same about bodies that touch.
#[derive(Debug, Clone, Copy, Default)]
struct Touching {
    /// One above the edges of A and of B that were closest; zero if none.
    edges: [u32; 2],
    /// One above the best faces of A and of B; zero if none.
    faces: [u32; 2],
    contenders: Contenders,
    contenders_worth: Worth,
    patch: PatchList,
    patch_worth: Worth,
}

impl PairMemory {
    /// An axis that separated the pair, if there is one.
    fn axis(&self) -> Option<Vec3> {
        (self.axis != [0.0; 3]).then(|| widen(&self.axis))
    }

    /// Whether bodies that have travelled this far together, m, are certainly more than `alert` apart.
    pub fn sleeps(&self, travel: f64, alert: f64) -> bool {
        travel + alert < self.apart_until
    }

    /// Brings to the cache what is remembered of bodies that touch; whether there is anything.
    pub fn expect(&self) -> bool {
        self.touching.as_deref().map(lanes::prefetch).is_some()
    }

    /// Notes that bodies that have travelled this far together are at least `apart` from each other.
    fn sleep(&mut self, travel: f64, apart: f64) {
        // A sum this large has lost too many digits to be compared.
        self.apart_until = travel + (apart - 1e-12 * (travel + apart));
    }
}

/// A contact point in world coordinates; the normal points from B to A.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    pub feature: u64,
    pub point: Vec3,
    pub normal: Vec3,
    pub gap: f64,
}

/// Buffers of the search.
#[derive(Debug, Default)]
pub struct Scratch {
    /// What searches have found so far; points of a pair are sorted by feature.
    pub points: Vec<Point>,
    near_a: Vec<NearEdge>,
    near_b: Vec<NearEdge>,
    /// Heights of vertices over the slab.
    heights: Vec<f64>,
    edge_pairs: EdgePairs,
    sides: Sides,
    candidates: Vec<Candidate>,
    hull: Hull,
    /// For the next pair that may touch, as most of those that come near each other do not.
    spare: Option<Box<Touching>>,
}

/// Finds the contact points of A and B with gaps up to `alert` (m) and appends them to
/// `scratch.points`; `travel` is how far both have travelled, m.
pub fn touch(
    a: Solid,
    b: Solid,
    alert: f64,
    travel: f64,
    memory: &mut PairMemory,
    scratch: &mut Scratch,
) {
    let pair = match Pair::new(a, b, alert) {
        Ok(pair) => pair,
        Err(beyond) => return memory.sleep(travel, alert + beyond),
    };
    if let Some(beyond) = memory.axis().and_then(|n| pair.apart_along(&n)) {
        return memory.sleep(travel, alert + beyond);
    }
    if memory.touching.is_none()
        && let Some((n, beyond)) = apart::direction(&pair, memory.axis())
    {
        memory.axis = round(&n);
        return memory.sleep(travel, alert + beyond);
    }
    let mut touching = memory.touching.take().or_else(|| scratch.spare.take()).unwrap_or_default();
    let apart = pair.search(&mut touching, scratch).err();
    if apart.is_none() {
        memory.touching = Some(touching);
    } else {
        *touching = Touching::default();
        scratch.spare = Some(touching);
    }
    memory.axis = apart.map_or([0.0; 3], |n| round(&n));
}
