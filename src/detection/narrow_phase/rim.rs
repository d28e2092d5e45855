//! Edges of a body that may make corners of the gap, by the corners that they need.

use super::facing::{Frame, Segment};
use super::few::Few;
use crate::geometry::Polyhedron;

/// How many edges are kept in mind.
pub const EDGES: usize = 16;
/// How many of their ends.
const ENDS: usize = 20;

/// Edges, and their ends by place in the list of corners.
#[derive(Debug, Clone, Copy, Default)]
pub struct Rim {
    corners: Few<ENDS>,
    pub edges: Few<EDGES>,
    ends: [[u8; 2]; EDGES],
}

impl Rim {
    pub fn clear(&mut self) {
        self.corners.clear();
        self.edges.clear();
    }

    pub fn is_whole(&self) -> bool {
        self.corners.is_whole() && self.edges.is_whole()
    }

    /// Place of an edge in the list, to which it is appended if it is new.
    pub fn add(&mut self, shape: &Polyhedron, index: usize) -> usize {
        let place = self.edges.place_of(index);
        self.ends[place] =
            shape.edges[index].vertices.map(|v| self.corners.place_of(usize::from(v)) as u8);
        place
    }

    /// Places the corners.
    #[inline]
    pub fn place(&self, shape: &Polyhedron, frame: &Frame, Placed(corners): &mut Placed) {
        for (place, v) in corners.iter_mut().zip(self.corners.iter()) {
            *place = frame.place(&shape.vertices[v]);
        }
    }

    /// The edge at a place in the list, its corners being placed.
    #[inline]
    pub fn segment(&self, place: usize, Placed(corners): &Placed) -> Segment {
        let [start, end] = self.ends[place].map(usize::from);
        Segment::between(corners[start], corners[end])
    }
}

/// Corners of a rim in the coordinates of the axis.
#[derive(Debug, Default)]
pub struct Placed([[f64; 3]; ENDS]);
