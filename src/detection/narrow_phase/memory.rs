//! What the narrow phase keeps: caches of a pair from step to step, and buffers of a search.

use super::cache::CacheBackoff;
use super::candidate_axes::{CandidateAxes, EdgePairs};
use super::edges::NearEdge;
use super::facing::FacingFeatures;
use super::manifold::{ContactPoint, HullBuffers, ManifoldPoint};
use super::patch::PatchCache;
use crate::lanes;
use crate::math::{Vec3, widen};

/// What earlier steps' searches tell the next one about a pair of shapes; it changes the cost, never
/// the result.
#[derive(Debug, Clone, Default)]
pub struct PairCache {
    /// An axis from A to B, in the frame of A, that separated the pair; zero if none.
    pub axis: [f32; 3],
    /// The bodies' distance is at least this less what they have travelled together, m.
    pub separated_until: f64,
    /// Elsewhere, as most pairs that are listed do not touch.
    pub touching: Option<Box<ContactCache>>,
}

/// The same about bodies that touch.
#[derive(Debug, Clone, Copy, Default)]
pub struct ContactCache {
    /// One above the edges of A and of B that were closest; zero if none.
    pub edges: [u32; 2],
    /// One above the best faces of A and of B; zero if none.
    pub faces: [u32; 2],
    pub candidate_axes: CandidateAxes,
    pub axes_backoff: CacheBackoff,
    pub patch: PatchCache,
    pub patch_backoff: CacheBackoff,
}

impl PairCache {
    /// An axis that separated the pair, if there is one.
    pub fn axis(&self) -> Option<Vec3> {
        (self.axis != [0.0; 3]).then(|| widen(&self.axis))
    }

    /// Whether bodies that have travelled this far together, m, are certainly more than `alert` apart.
    pub fn is_surely_separated(&self, travel: f64, alert: f64) -> bool {
        travel + alert < self.separated_until
    }

    /// Brings to the cache what is remembered of bodies that touch; whether there is anything.
    pub fn prefetch(&self) -> bool {
        self.touching.as_deref().map(lanes::prefetch).is_some()
    }

    /// Notes that bodies that have travelled this far together are at least `apart` from each other.
    pub fn record_separation(&mut self, travel: f64, apart: f64) {
        // A sum this large has lost too many digits to be compared.
        self.separated_until = travel + (apart - 1e-12 * (travel + apart));
    }
}

/// Buffers of the search.
#[derive(Debug, Default)]
pub struct Scratch {
    /// What searches have found so far; points of a pair are sorted by feature.
    pub points: Vec<ContactPoint>,
    pub near_a: Vec<NearEdge>,
    pub near_b: Vec<NearEdge>,
    /// Heights of vertices over the slab.
    pub heights: Vec<f64>,
    pub edge_pairs: EdgePairs,
    pub sides: FacingFeatures,
    pub candidates: Vec<ManifoldPoint>,
    pub hull: HullBuffers,
    /// For the next pair that may touch, as most of those that come near each other do not.
    pub spare: Option<Box<ContactCache>>,
}
