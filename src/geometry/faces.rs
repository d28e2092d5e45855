//! Whole polygonal faces and edges of a hull, from its extreme points.
//!
//! Reads: points and candidate triangles. Writes: faces and edges. Cost: O(faces · points).
//! Contract: points are scaled to a size of about 1; `tolerance` is a distance in that scale. A set
//! of faces is returned only if it is a closed surface: each edge in two faces, V − E + F = 2.

use super::plane::{self, PlanePoint, cross};
use super::polyhedron::Edge;
use crate::math::{Vec3, frame};
use std::collections::BTreeMap;

/// Faces (counter-clockwise seen from outside) and edges of a closed surface.
pub(super) struct Surface {
    pub faces: Vec<Vec<u16>>,
    pub edges: Vec<Edge>,
}

/// Returns faces through the planes of `triangles`; coplanar triangles become one face.
pub(super) fn merge(points: &[Vec3], triangles: &[[u16; 3]], tolerance: f64) -> Option<Surface> {
    let mut order: Vec<(f64, [u16; 3])> =
        triangles.iter().map(|&t| (double_area(points, t), t)).collect();
    // Largest first: their planes are the best conditioned, slivers then lie in them.
    order.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let mut faces: Vec<Vec<u16>> = Vec::new();
    let mut on_plane: Vec<Vec<u16>> = vec![Vec::new(); points.len()];
    for (_, t) in order {
        let known = |k: usize| &on_plane[t[k] as usize];
        if known(0).iter().any(|f| known(1).contains(f) && known(2).contains(f)) {
            continue;
        }
        let Some((face, members)) = face_through(points, t, tolerance) else { continue };
        let index = u16::try_from(faces.len()).ok()?;
        members.iter().for_each(|&p| on_plane[p as usize].push(index));
        faces.push(face);
    }
    close(points.len(), faces)
}

/// Returns the hull by gift wrapping: the face that supports all points closes each open edge.
pub(super) fn wrap(points: &[Vec3], tolerance: f64) -> Option<Surface> {
    let first = first_face(points, tolerance)?;
    let mut faces = vec![first];
    let mut edges: BTreeMap<[u16; 2], ()> = directed(&faces[0]).map(|e| (e, ())).collect();
    let mut next = 0;
    while next < faces.len() {
        let around: Vec<[u16; 2]> = directed(&faces[next]).collect();
        for [a, b] in around {
            if edges.contains_key(&[b, a]) {
                continue;
            }
            let c = pivot(points, b, a, tolerance)?;
            let (face, _) = face_through(points, [b, a, c], tolerance)?;
            // Without this check a face that lacks the edge, or repeats one, would make the loop endless.
            let fresh = directed(&face).all(|e| !edges.contains_key(&e));
            if !fresh || !directed(&face).any(|e| e == [b, a]) {
                return None;
            }
            edges.extend(directed(&face).map(|e| (e, ())));
            faces.push(face);
        }
        next += 1;
    }
    close(points.len(), faces)
}

/// Returns the first triangle at the point farthest from the origin that supports all points.
fn first_face(points: &[Vec3], tolerance: f64) -> Option<Vec<u16>> {
    let n = points.len() as u16;
    let top = (0..n).max_by(|&a, &b| {
        points[a as usize].norm_squared().total_cmp(&points[b as usize].norm_squared())
    })?;
    (0..n)
        .flat_map(|b| (0..n).map(move |c| [top, b, c]))
        .filter(|&t| t[0] != t[1] && t[1] != t[2] && t[0] != t[2])
        .find_map(|t| face_through(points, t, tolerance).map(|(face, _)| face))
}

/// Returns the third vertex of the face that contains the directed edge `a → b`.
fn pivot(points: &[Vec3], a: u16, b: u16, tolerance: f64) -> Option<u16> {
    let (pa, pb) = (points[a as usize], points[b as usize]);
    let mut best: Option<(u16, Vec3)> = None;
    for c in (0..points.len() as u16).filter(|&c| c != a && c != b) {
        let to_c = points[c as usize] - pa;
        let normal = (pb - pa).cross(&to_c);
        // Points on the edge's own line span no plane with it.
        let spans = normal.norm() > 4.0 * tolerance * (pb - pa).norm();
        if spans && best.as_ref().is_none_or(|(_, normal)| normal.dot(&to_c) > 0.0) {
            best = Some((c, normal));
        }
    }
    best.map(|(c, _)| c)
}

fn double_area(points: &[Vec3], [a, b, c]: [u16; 3]) -> f64 {
    let a = points[a as usize];
    (points[b as usize] - a).cross(&(points[c as usize] - a)).norm()
}

/// Returns the face in the plane of triangle `t` and all points on that plane; `None` if a point is above.
fn face_through(points: &[Vec3], t: [u16; 3], tolerance: f64) -> Option<(Vec<u16>, Vec<u16>)> {
    let a = points[t[0] as usize];
    let across = (points[t[1] as usize] - a).cross(&(points[t[2] as usize] - a));
    let normal = across.try_normalize(f64::MIN_POSITIVE)?;
    let mut members = Vec::new();
    for (i, p) in points.iter().enumerate() {
        let height = normal.dot(&(p - a));
        if height > tolerance {
            return None;
        }
        if height >= -tolerance {
            members.push(i as u16);
        }
    }
    let (u, v) = frame::tangents(&normal);
    let flat = members
        .iter()
        .map(|&i| ([u.dot(&points[i as usize]), v.dot(&points[i as usize])], i))
        .collect();
    let face = polygon(flat, tolerance)?;
    Some((face, members))
}

/// Returns the convex polygon around points in a plane, starting at its lowest index.
///
/// Vertices within `tolerance` of the line through their neighbours are dropped.
fn polygon(mut flat: Vec<PlanePoint<u16>>, tolerance: f64) -> Option<Vec<u16>> {
    let mut chain = Vec::with_capacity(flat.len() + 1);
    plane::hull(&mut flat, &mut chain);
    while let Some(k) = (0..chain.len()).find(|&k| {
        let n = chain.len();
        let (before, after) = (chain[(k + n - 1) % n].0, chain[(k + 1) % n].0);
        let base = libm::hypot(after[0] - before[0], after[1] - before[1]);
        cross(before, chain[k].0, after) <= tolerance * base
    }) {
        chain.remove(k);
        if chain.len() < 3 {
            return None;
        }
    }
    let lowest = (0..chain.len()).min_by_key(|&k| chain[k].1)?;
    chain.rotate_left(lowest);
    Some(chain.into_iter().map(|(_, i)| i).collect())
}

/// Iterates over the directed edges of a face.
pub(super) fn directed(face: &[u16]) -> impl Iterator<Item = [u16; 2]> + '_ {
    (0..face.len()).map(|k| [face[k], face[(k + 1) % face.len()]])
}

/// Orders faces and pairs their edges; `None` unless the surface is closed.
fn close(point_count: usize, mut faces: Vec<Vec<u16>>) -> Option<Surface> {
    faces.sort();
    let mut sides: BTreeMap<[u16; 2], u16> = BTreeMap::new();
    for (f, face) in faces.iter().enumerate() {
        let f = u16::try_from(f).ok()?;
        for edge in directed(face) {
            if sides.insert(edge, f).is_some() {
                return None;
            }
        }
    }
    let mut edges = Vec::with_capacity(sides.len() / 2);
    for (&[a, b], &forward) in &sides {
        let backward = *sides.get(&[b, a])?;
        if a < b {
            edges.push(Edge { vertices: [a, b], faces: [forward, backward] });
        }
    }
    let mut used = vec![false; point_count];
    faces.iter().flatten().for_each(|&p| used[p as usize] = true);
    let corners = used.iter().filter(|&&u| u).count();
    (corners + faces.len() == edges.len() + 2).then_some(Surface { faces, edges })
}
