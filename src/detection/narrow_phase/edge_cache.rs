//! Cached edges of a body that may make corners of the gap, with the vertices that they need.

use super::cache::IndexList;
use super::frame::{AxisFrame, ProjectedEdge};
use crate::geometry::Polyhedron;

/// Maximum number of cached edges.
pub const MAX_EDGES: usize = 16;
/// Maximum number of their end vertices.
const MAX_END_VERTICES: usize = 20;

/// Edges, and their ends as positions in the list of vertices.
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

    /// Returns the position of an edge in the list and appends it if it is new.
    pub fn add(&mut self, shape: &Polyhedron, index: usize) -> usize {
        let place = self.edges.position_or_push(index);
        self.ends[place] = shape.edges[index]
            .vertices
            .map(|v| self.corners.position_or_push(usize::from(v)) as u8);
        place
    }

    /// Transforms the vertices to the coordinates of the axis.
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

    /// Returns the edge at a position in the list, given its transformed vertices.
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

/// Vertices of an edge cache in the coordinates of the axis.
#[derive(Debug, Default)]
pub struct TransformedVertices([[f64; 3]; MAX_END_VERTICES]);
