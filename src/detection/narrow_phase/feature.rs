//! Identity of a contact point inside its pair of bodies, stable while the same features touch.
//!
//! From the highest bit: part of the driven body (12), kind (2), then 50 bits by kind.

/// Bits of the antagonist's part number: parts up to 4096 are told apart.
const PART_SHIFT: u32 = 52;
const KIND_SHIFT: u32 = 50;

/// Which polygon edge a clipped vertex lies on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct EdgeLabel(u64);

impl EdgeLabel {
    /// Edge of the incident face that starts at vertex `v`.
    pub fn incident(v: u16) -> Self {
        Self(u64::from(v))
    }

    /// Side `k` of the reference face.
    pub fn side(k: usize) -> Self {
        Self(0x1_0000 | (k as u64 & 0xffff))
    }
}

/// Corner of a clipped polygon: 34 bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Corner(u64);

impl Corner {
    /// Vertex `v` of the incident face.
    pub fn vertex(v: u16) -> Self {
        // No corner lies on one edge twice, so equal labels are free for vertices.
        Self(u64::from(v) << 17 | u64::from(v))
    }

    /// Where two edges cross, in either order.
    pub fn crossing(a: EdgeLabel, b: EdgeLabel) -> Self {
        Self(a.0.min(b.0) << 17 | a.0.max(b.0))
    }
}

/// A corner of the incident face clipped by face `face` of A (`of_b` false) or of B.
pub fn face(of_b: bool, face: usize, corner: Corner) -> u64 {
    u64::from(of_b) << KIND_SHIFT | (face as u64 & 0xffff) << 34 | corner.0
}

/// An edge or, at one end of it, a vertex: 25 bits.
fn edge_or_vertex(edge: u32, vertices: [u16; 2], parameter: f64) -> u64 {
    if parameter <= 0.0 {
        1 << 24 | u64::from(vertices[0])
    } else if parameter >= 1.0 {
        1 << 24 | u64::from(vertices[1])
    } else {
        u64::from(edge & 0xff_ffff)
    }
}

/// Closest points on an edge (or its end) of A and one of B: (edge, its vertices, parameter).
pub fn edges(a: (u32, [u16; 2], f64), b: (u32, [u16; 2], f64)) -> u64 {
    2 << KIND_SHIFT | edge_or_vertex(a.0, a.1, a.2) << 25 | edge_or_vertex(b.0, b.1, b.2)
}

/// A vertex of the candidate: against a half-space, or alone when clipping left nothing.
pub fn vertex(v: usize) -> u64 {
    3 << KIND_SHIFT | v as u64
}

/// The same feature on part `part` of a driven body.
pub fn on_part(feature: u64, part: usize) -> u64 {
    (part as u64) << PART_SHIFT | feature
}
