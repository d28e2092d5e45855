//! Caches of a pair from step to step, and buffers of a search.

use super::cache::CacheBackoff;
use super::candidate_axes::{CandidateAxes, EdgePairs};
use super::edges::NearEdge;
use super::facing::FacingFeatures;
use super::manifold::{ContactPoint, HullBuffers, ManifoldPoint};
use super::patch::PatchCache;
use crate::lanes;
use crate::math::{Vec3, widen};

/// Results of earlier searches for a pair of shapes. Affects cost only, never results.
#[derive(Debug, Clone, Default)]
pub struct PairCache {
    /// Axis from A to B, in the frame of A, that separated the pair; zero if none.
    pub separating_axis: [f32; 3],
    /// Lower bound of the distance plus the travel of both bodies when it was found, m.
    pub separated_until: f64,
    /// Cache of a touching pair. Boxed, because most listed pairs do not touch.
    pub contacts: Option<Box<ContactCache>>,
}

/// Results of earlier searches for a pair that touches.
#[derive(Debug, Clone, Copy, Default)]
pub struct ContactCache {
    /// Numbers plus one of the edges of A and of B that were closest; zero if none.
    pub edges: [u32; 2],
    /// Numbers plus one of the best faces of A and of B; zero if none.
    pub faces: [u32; 2],
    pub candidate_axes: CandidateAxes,
    pub axes_backoff: CacheBackoff,
    pub patch: PatchCache,
    pub patch_backoff: CacheBackoff,
}

impl PairCache {
    /// Returns the axis that separated the pair, if any.
    pub fn known_axis(&self) -> Option<Vec3> {
        (self.separating_axis != [0.0; 3]).then(|| widen(&self.separating_axis))
    }

    /// True if bodies with this sum of travel, m, are certainly more than `alert` (m) apart.
    pub fn is_surely_separated(&self, travel: f64, alert: f64) -> bool {
        travel + alert < self.separated_until
    }

    /// Prefetches the cache of a touching pair. Returns true if there is one.
    pub fn prefetch(&self) -> bool {
        self.contacts.as_deref().map(lanes::prefetch).is_some()
    }

    /// Records that bodies with this sum of travel, m, are at least `apart` (m) from each other.
    pub fn record_separation(&mut self, travel: f64, apart: f64) {
        // A sum this large has lost too many digits to be compared.
        self.separated_until = travel + (apart - 1e-12 * (travel + apart));
    }
}

/// Buffers of the search.
#[derive(Debug, Default)]
pub struct Scratch {
    /// Points found so far; those of a pair are sorted by feature.
    pub points: Vec<ContactPoint>,
    pub near_a: Vec<NearEdge>,
    pub near_b: Vec<NearEdge>,
    /// Heights of the vertices over the slab, m.
    pub heights: Vec<f64>,
    pub edge_pairs: EdgePairs,
    pub facing: FacingFeatures,
    pub candidates: Vec<ManifoldPoint>,
    pub hull: HullBuffers,
    /// Unused cache for the next pair that may touch.
    pub spare_cache: Option<Box<ContactCache>>,
}
