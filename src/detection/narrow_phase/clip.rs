//! Overlap of two faces seen along an axis.

use super::cloud::Cloud;
use super::feature::{Corner, EdgeLabel};
use crate::geometry::Polyhedron;
use crate::math::Vec3;

/// Corner of a polygon on the incident face, in the frame of the reference body.
#[derive(Debug, Clone, Copy)]
pub struct ClipVertex {
    pub point: Vec3,
    pub corner: Corner,
    /// The edge from here to the next corner.
    edge: EdgeLabel,
}

/// Leaves in `polygon` the part of face `incident` that projects along `axis` on face `face` of
/// `reference`, in convex order.
///
/// `other` holds the incident body's vertices in the frame of the reference body; `axis` is a unit
/// vector on the outer side of the face. Points within `tolerance` of a side are inside: faces
/// that match exactly keep their own corners instead of rounding's crossings.
pub fn clip_faces(
    reference: &Polyhedron,
    face: usize,
    axis: &Vec3,
    other: (&Polyhedron, &Cloud, usize),
    tolerance: f64,
    [polygon, scratch]: [&mut Vec<ClipVertex>; 2],
) {
    let (incident, cloud, incident_face) = other;
    polygon.clear();
    polygon.extend(incident.face(incident_face).iter().map(|&v| ClipVertex {
        point: cloud.get(v as usize),
        corner: Corner::vertex(v),
        edge: EdgeLabel::incident(v),
    }));
    let corners = reference.face(face);
    let mut from = reference.vertices[corners[corners.len() - 1] as usize];
    for (k, &v) in corners.iter().enumerate() {
        let to = reference.vertices[v as usize];
        let inward = axis.cross(&(to - from));
        let length = inward.norm();
        if length > 0.0 {
            clip_by_side(
                polygon,
                scratch,
                &from,
                &(inward / length),
                EdgeLabel::side(k),
                tolerance,
            );
            std::mem::swap(polygon, scratch);
        }
        if polygon.is_empty() {
            return;
        }
        from = to;
    }
}

/// Sutherland and Hodgman's step: keeps in `out` what is on the inner side of one plane.
fn clip_by_side(
    polygon: &[ClipVertex],
    out: &mut Vec<ClipVertex>,
    origin: &Vec3,
    inward: &Vec3,
    side: EdgeLabel,
    tolerance: f64,
) {
    out.clear();
    let Some(last) = polygon.last() else { return };
    let mut previous = last;
    let level = inward.dot(origin);
    let mut before = inward.dot(&previous.point) - level;
    let mut last_leaves = false;
    for (i, current) in polygon.iter().enumerate() {
        let here = inward.dot(&current.point) - level;
        let (was_in, is_in) = (before >= -tolerance, here >= -tolerance);
        if was_in && !is_in {
            if before > tolerance {
                out.push(crossing(previous, current, before, here, side, side));
            } else if i == 0 {
                last_leaves = true;
            } else if let Some(v) = out.last_mut() {
                v.edge = side;
            }
        } else if !was_in && is_in && here > tolerance {
            out.push(crossing(previous, current, before, here, side, previous.edge));
        }
        if is_in {
            out.push(*current);
        }
        (previous, before) = (current, here);
    }
    if last_leaves && let Some(v) = out.last_mut() {
        v.edge = side;
    }
}

fn crossing(
    from: &ClipVertex,
    to: &ClipVertex,
    before: f64,
    here: f64,
    side: EdgeLabel,
    next: EdgeLabel,
) -> ClipVertex {
    let point = from.point + (to.point - from.point) * (before / (before - here));
    ClipVertex { point, corner: Corner::crossing(from.edge, side), edge: next }
}
