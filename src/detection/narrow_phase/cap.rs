//! The features of one body that face the other one, along an axis and its neighbours.
//!
//! Contract: while [`Cap::holds`], every edge with an end in the slab is listed, with both ends and
//! both faces; so the lowest corner is, and the planes of the listed faces bound the body inside the
//! slab: a point of the slab outside the body is outside a face that reaches into the slab.
//!
//! A corner's height over the support plane changes by at most 2 r |Δn| when the axis turns by Δn, r
//! the body's radius. It does not depend on the other body at all.

use super::few::Few;
use crate::geometry::Polyhedron;
use crate::math::Vec3;

/// How much thicker than asked for the slab is made, over the radius.
const MARGIN: f64 = 2e-2;
/// What single precision takes from that.
const ROUNDING: f64 = 1e-6;

/// Features of one body in a slab below its support plane.
#[derive(Debug, Clone, Copy, Default)]
pub struct Cap {
    /// Outward axis in the body's frame.
    axis: [f32; 3],
    /// Thickness, m; zero: nothing is listed.
    slab: f32,
    /// Ends of the listed edges.
    pub corners: Few<18>,
    pub edges: Few<24>,
    pub faces: Few<18>,
}

impl Cap {
    /// Whether the lists hold for a slab of this thickness along `axis`.
    pub fn holds(&self, shape: &Polyhedron, axis: &Vec3, slab: f64) -> bool {
        let turn = (Vec3::from(self.axis.map(f64::from)) - axis).norm();
        slab + (2.0 * turn + ROUNDING) * shape.radius <= f64::from(self.slab)
            && self.corners.is_whole()
            && self.edges.is_whole()
            && self.faces.is_whole()
    }

    /// Lists the features again, for a slab of this thickness along `axis` and some more.
    pub fn make(&mut self, shape: &Polyhedron, axis: &Vec3, slab: f64, marks: &mut Marks) {
        self.axis = [axis.x as f32, axis.y as f32, axis.z as f32];
        self.slab = (slab + MARGIN * shape.radius) as f32;
        self.corners.clear();
        self.edges.clear();
        self.faces.clear();
        marks.heights.clear();
        marks.heights.extend(shape.vertices.iter().map(|v| axis.dot(v)));
        let top = marks.heights.iter().fold(f64::NEG_INFINITY, |t, h| if *h > t { *h } else { t });
        let limit = top - f64::from(self.slab);
        marks.corners.clear();
        marks.corners.resize(shape.vertices.len(), false);
        marks.faces.clear();
        marks.faces.resize(shape.face_count(), false);
        for (index, edge) in shape.edges.iter().enumerate() {
            if edge.vertices.iter().any(|v| marks.heights[*v as usize] >= limit) {
                self.edges.push(index);
                edge.vertices.iter().for_each(|v| marks.corners[*v as usize] = true);
                edge.faces.iter().for_each(|f| marks.faces[*f as usize] = true);
            }
        }
        list(&marks.corners, &mut self.corners);
        list(&marks.faces, &mut self.faces);
    }
}

fn list<const N: usize>(marks: &[bool], out: &mut Few<N>) {
    marks.iter().enumerate().filter(|(_, m)| **m).for_each(|(k, _)| out.push(k));
}

/// Buffers for [`Cap::make`].
#[derive(Debug, Default)]
pub struct Marks {
    heights: Vec<f64>,
    corners: Vec<bool>,
    faces: Vec<bool>,
}
