//! Contact points of two convex polyhedra.
//!
//! Reads: two shapes and their poses. Writes: at most four points. Cost: a little more than a microsecond per
//! touching pair of ballast grains that hardly move, nothing for a pair that is surely separated.
//!
//! 1. A cached axis that separated the pair in an earlier step rejects it if it still separates ([`cache`]). Without
//!    a cache, GJK proposes a separating axis ([`separation`]).
//! 2. Face normals of both bodies ([`pair`]), then axes perpendicular to two edges ([`edges`]): the search returns
//!    the axis of largest separation ([`search`]). For overlapping bodies it is the axis of least depth.
//! 3. For separated bodies whose closest points are vertices, the axis is the line between them.
//! 4. Along the axis, the patch contains all corners of the gap up to the alert distance ([`patch`]). Four of them
//!    are reported ([`report`], [`manifold`]). The patch along a face normal also bounds the edges that step 2 must
//!    examine.
//!
//! Steps 2 and 4 use cached lists of features while these are valid ([`candidate_axes`], [`patch`]). Lists are built
//! only for bodies that move slowly relative to each other ([`cache`]).
//!
//! Contract: the result depends on shapes and poses alone, not on [`PairCache`]. Two bodies at a distance of at most
//! `alert` have a contact, others have none. The lowest gap is that distance or, for overlapping bodies, minus the
//! least depth. The feet of a point, half a gap to either side along the common normal, lie on the facing surfaces;
//! feet of wide gaps may lie slightly outside the overlap.

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
mod passing;
mod patch;
mod report;
mod search;
mod separation;

use crate::math::round;
use memory::ContactCache;
use pair::BodyPair;

pub use feature::{part_of, with_part};
pub use manifold::ContactPoint;
pub use memory::{PairCache, Scratch};
pub use pair::ConvexBody;
pub use passing::replace_passing_contact;
pub use report::generate_half_space_contacts;

/// Appends the contact points of A and B with gaps up to `alert` (m) to `scratch.points`.
///
/// `travel` is the sum of the distances that both bodies have travelled, m.
pub fn generate_contacts(
    a: ConvexBody,
    b: ConvexBody,
    alert: f64,
    travel: f64,
    cache: &mut PairCache,
    scratch: &mut Scratch,
) {
    let pair = match BodyPair::new(a, b, alert) {
        Ok(pair) => pair,
        Err(beyond) => return cache.record_separation(travel, alert + beyond),
    };
    if let Some(beyond) = cache.known_axis().and_then(|n| pair.separation_beyond_alert(&n)) {
        return cache.record_separation(travel, alert + beyond);
    }
    if cache.contacts.is_none()
        && let Some((n, beyond)) = separation::direction(&pair, cache.known_axis())
    {
        cache.separating_axis = round(&n);
        return cache.record_separation(travel, alert + beyond);
    }
    let mut contacts =
        cache.contacts.take().or_else(|| scratch.spare_cache.take()).unwrap_or_default();
    let apart = pair.search(&mut contacts, scratch).err();
    if apart.is_none() {
        cache.contacts = Some(contacts);
    } else {
        *contacts = ContactCache::default();
        scratch.spare_cache = Some(contacts);
    }
    cache.separating_axis = apart.map_or([0.0; 3], |n| round(&n));
}
