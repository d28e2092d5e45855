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
//! Contract: the result depends on shapes and poses alone, not on [`PairCache`]. Two bodies at a
//! distance of at most `alert` have a contact, others have none; the lowest gap is that distance or,
//! for bodies that overlap, minus the least depth. The points' feet, half a gap to either side along
//! the common normal, are on the surfaces that face each other; feet of wide gaps may be a
//! little beside the overlap.

mod cache;
mod candidate_axes;
mod edge_cache;
mod edges;
mod facing;
mod feature;
mod frame;
mod manifold;
mod memory;
mod pair;
mod patch;
mod report;
mod search;
mod separation;

use crate::math::round;
use memory::ContactCache;
use pair::BodyPair;

pub use feature::with_part;
pub use memory::{PairCache, Scratch};
pub use pair::ConvexBody;
pub use report::generate_half_space_contacts;

/// Finds the contact points of A and B with gaps up to `alert` (m) and appends them to
/// `scratch.points`; `travel` is how far both have travelled, m.
pub fn generate_contacts(
    a: ConvexBody,
    b: ConvexBody,
    alert: f64,
    travel: f64,
    memory: &mut PairCache,
    scratch: &mut Scratch,
) {
    let pair = match BodyPair::new(a, b, alert) {
        Ok(pair) => pair,
        Err(beyond) => return memory.record_separation(travel, alert + beyond),
    };
    if let Some(beyond) = memory.axis().and_then(|n| pair.separation_beyond_alert(&n)) {
        return memory.record_separation(travel, alert + beyond);
    }
    if memory.touching.is_none()
        && let Some((n, beyond)) = separation::direction(&pair, memory.axis())
    {
        memory.axis = round(&n);
        return memory.record_separation(travel, alert + beyond);
    }
    let mut touching = memory.touching.take().or_else(|| scratch.spare.take()).unwrap_or_default();
    let apart = pair.search(&mut touching, scratch).err();
    if apart.is_none() {
        memory.touching = Some(touching);
    } else {
        *touching = ContactCache::default();
        scratch.spare = Some(touching);
    }
    memory.axis = apart.map_or([0.0; 3], |n| round(&n));
}
