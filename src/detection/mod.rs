//! Contacts of a configuration: broad phase, narrow phase, identity from step to step.
//!
//! Contacts are a function of the configuration alone: pair lists and separating axes that are kept
//! from earlier steps make it faster, never different.

mod broad_phase;
mod detector;
mod grid;
mod matching;
mod narrow_phase;
mod reach;
mod travel;

pub use detector::Detector;
pub use matching::{remember, warm_start};
pub use reach::{Reach, top_speed};

use crate::math::Vec3;

/// Contact points of one configuration, sorted by bodies, then feature. Structure of arrays.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Contacts {
    /// Candidate and antagonist `[nc]`. The candidate is a grain; the antagonist is a grain of
    /// higher number or a driven body.
    pub bodies: Vec<[u32; 2]>,
    /// Identity of the point inside its pair: parts and features `[nc]`.
    pub feature: Vec<u64>,
    /// Middle between the two surfaces, world `[nc]`, m.
    pub point: Vec<Vec3>,
    /// Unit normal from antagonist to candidate, world `[nc]`.
    pub normal: Vec<Vec3>,
    /// Signed gap `[nc]`, m; negative is penetration.
    pub gap: Vec<f64>,
}

impl Contacts {
    /// Number of contact points.
    pub fn len(&self) -> usize {
        self.bodies.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.bodies.is_empty()
    }

    /// Forgets all contacts, keeps the memory.
    pub fn clear(&mut self) {
        self.bodies.clear();
        self.feature.clear();
        self.point.clear();
        self.normal.clear();
        self.gap.clear();
    }

    /// Appends one contact point.
    pub fn push(&mut self, bodies: [u32; 2], feature: u64, point: Vec3, normal: Vec3, gap: f64) {
        self.bodies.push(bodies);
        self.feature.push(feature);
        self.point.push(point);
        self.normal.push(normal);
        self.gap.push(gap);
    }
}
