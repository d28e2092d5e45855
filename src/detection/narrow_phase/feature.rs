//! Identity of a contact point inside its pair of bodies, stable while the same features touch.
//!
//! Layout from the highest bit: part of the driven body (12), kind (2), then 50 bits by kind.

use crate::geometry::Polyhedron;

/// Position of the 12 bits of the antagonist's part number, which distinguish 4096 parts.
const PART_SHIFT: u32 = 52;
const KIND_SHIFT: u32 = 50;

/// Returns the 25 bits of an edge or, at one end of it, of a vertex.
fn edge_or_vertex(edge: u32, vertices: impl Fn() -> [u16; 2], parameter: f64) -> u64 {
    if parameter <= 0.0 {
        1 << 24 | u64::from(vertices()[0])
    } else if parameter >= 1.0 {
        1 << 24 | u64::from(vertices()[1])
    } else {
        u64::from(edge & 0xff_ffff)
    }
}

/// Returns the identity of a point on an edge (or its end) of A and one of B, given numbers and parameters.
#[inline]
pub fn edges([a, b]: [&Polyhedron; 2], edges: [usize; 2], [s, t]: [f64; 2]) -> u64 {
    let on_a = edge_or_vertex(edges[0] as u32, || a.edges[edges[0]].vertices, s);
    let on_b = edge_or_vertex(edges[1] as u32, || b.edges[edges[1]].vertices, t);
    2 << KIND_SHIFT | on_a << 25 | on_b
}

/// Returns the identity of a vertex of A over the other body or a half-space.
pub fn vertex(v: usize) -> u64 {
    3 << KIND_SHIFT | v as u64
}

/// Returns the identity of a vertex of B over A.
pub fn vertex_of_b(v: usize) -> u64 {
    3 << KIND_SHIFT | 1 << 25 | v as u64
}

/// Returns the identity of a feature on part `part` of a driven body.
pub fn with_part(feature: u64, part: usize) -> u64 {
    (part as u64) << PART_SHIFT | feature
}

/// Returns the part of the antagonist on which the feature is.
pub fn part_of(feature: u64) -> u32 {
    (feature >> PART_SHIFT) as u32
}
