//! Edges of a body that may make corners of the gap, by the corners that they need.

use super::cache::IndexList;
use super::frame::{AxisFrame, ProjectedEdge};
use crate::geometry::Polyhedron;

/// How many edges are kept in mind.
pub const MAX_EDGES: usize = 16;
/// How many of their ends.
const MAX_END_VERTICES: usize = 20;

/// Edges, and their ends by place in the list of corners.
#[derive(Debug, Clone, Copy, Default)]
pub struct EdgeCache {
    corners: IndexList<MAX_END_VERTICES>,
    pub edges: IndexList<MAX_EDGES>,
    ends: [[u8; 2]; MAX_EDGES],
}

impl EdgeCache {
    pub fn clear(&mut self) {
        self.corners.clear();
        self.edges.clear();
    }

    pub fn is_complete(&self) -> bool {
        self.corners.is_complete() && self.edges.is_complete()
    }

    /// Place of an edge in the list, to which it is appended if it is new.
    pub fn add(&mut self, shape: &Polyhedron, index: usize) -> usize {
        let place = self.edges.position_or_push(index);
        self.ends[place] = shape.edges[index]
            .vertices
            .map(|v| self.corners.position_or_push(usize::from(v)) as u8);
        place
    }

    /// Places the corners.
    #[inline]
    pub fn place(
        &self,
        shape: &Polyhedron,
        frame: &AxisFrame,
        TransformedVertices(corners): &mut TransformedVertices,
    ) {
        for (place, v) in corners.iter_mut().zip(self.corners.iter()) {
            *place = frame.place(&shape.vertices[v]);
        }
    }

    /// The edge at a place in the list, its corners being placed.
    #[inline]
    pub fn segment(
        &self,
        place: usize,
        TransformedVertices(corners): &TransformedVertices,
    ) -> ProjectedEdge {
        let [start, end] = self.ends[place].map(usize::from);
        ProjectedEdge::between(corners[start], corners[end])
    }
}

/// Corners of a rim in the coordinates of the axis.
#[derive(Debug, Default)]
pub struct TransformedVertices([[f64; 3]; MAX_END_VERTICES]);
