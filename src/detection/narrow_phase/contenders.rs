//! Which axes can separate a pair best until the bodies have moved against each other.
//!
//! Reads: pairs. Writes: lists of feature numbers and bounds on all that is not listed. Cost: bytes per
//! pair; two roots to ask whether they hold.
//! Contract: where the best of the listed axes beats the bounds, the full search finds the same axis,
//! to the bit. Where it does not, the full search is asked.
//!
//! Let the anchor's point be displaced by Δ and unit vectors by φ at most ([`Anchor`]); lists hold while
//! Δ <= P and φ <= Φ, which is [`TURN`]. A corner w of B bounds the separation along a face of A from
//! above, and moves by at most Δ + φ l, l being its distance from the anchor's point. So with a
//! common lever λ no separation that was bounded by s exceeds s + Δ + φ λ, if Φ (l - λ) is added to s
//! where l > λ. The same holds for faces of B and corners of A.
//!
//! For two edges at an angle θ let d join their closest points. Their axis n turns by an angle with a sine
//! of at most x = Φ / sin θ, which takes at most x² |n · d| from n · d and adds at most x times
//! the part of d across n. Motion of the edges adds Δ + φ l. Only pairs of edges that may hold the
//! deepest points have to be bounded ([`super::edges`]).

use super::anchor::{Anchor, Moved};
use super::closest;
use super::edges::{self, LoneEdge};
use super::facing::Slack;
use super::few::Few;
use super::pair::{self, Faces, Pair, larger, smaller};
use super::supports::{Supports, TURN};
use super::{SLAB, TIE};
use crate::math::Vec3;

/// P over the sum of the radii.
const PATH: f64 = 4e-3;
/// λ over the sum of the radii.
const LEVER: f64 = 0.2;
/// Axes that separate by less than the best by this, over the sum of the radii, are not listed.
const NEAR: f64 = 1e-3;

/// Lists of a pair, and where they were made.
#[derive(Debug, Clone, Copy, Default)]
pub struct Contenders {
    anchor: Anchor,
    /// Alert distance that the pairs of edges were listed for, m.
    alert: f64,
    /// No face, no pair of edges that is not listed separated by more, m.
    bounds: [f32; 2],
    /// Faces of A and of B.
    pub faces: [Few<5>; 2],
    edges: [Few<6>; 2],
    /// Whether all listed pairs of edges make an axis while the lists hold.
    pub crossing: bool,
    /// For axes near the best one.
    pub supports: Supports,
}

/// What no axis that is not listed exceeds by now, m; ties are counted in.
#[derive(Debug, Clone, Copy)]
pub struct Bounds {
    pub faces: f64,
    /// Infinite if pairs of edges are not known.
    pub edges: f64,
}

impl Contenders {
    /// Bounds on what is not listed, if the lists hold for `pair`.
    pub fn bounds(&self, pair: &Pair) -> Option<Bounds> {
        let Moved { at_point, turn } = self.anchor.moved(pair)?;
        if at_point > PATH * pair.size || turn > TURN || pair.alert > self.alert {
            return None;
        }
        let more = at_point + (LEVER * turn + SLAB + TIE) * pair.size;
        let [faces, edges] = self.bounds.map(|b| f64::from(b) + more);
        Some(Bounds { faces, edges })
    }

    /// Forgets all.
    pub fn clear(&mut self) {
        self.anchor = Anchor::default();
    }

    /// Pairs of edges that may be the best axis.
    pub fn edge_pairs(&self) -> impl Iterator<Item = [usize; 2]> {
        let [a, b] = &self.edges;
        a.iter().zip(b.iter()).map(|(a, b)| [a, b])
    }

    /// How far bodies may have moved against each other, all of their points, where lists hold.
    pub fn slack(pair: &Pair) -> Slack {
        // The anchor's point is less than the alert distance beside both bodies.
        let lever = 2.0 * pair.a.radius.max(pair.b.radius) + pair.alert;
        Slack { path: (PATH + SLAB) * pair.size + TURN * lever, turn: TURN }
    }

    /// Lists the axes that are near the best one, of separation `best` along `normal`; `c` is near both
    /// bodies, `pairs` are the edges that may hold the deepest points while the lists hold, if they are known.
    pub fn make(
        &mut self,
        pair: &Pair,
        normal: &Vec3,
        best: f64,
        c: &Vec3,
        known: Option<[usize; 2]>,
        pairs: Option<&[[usize; 2]]>,
    ) {
        let limit = best - NEAR * pair.size;
        let excess = TURN * LEVER * pair.size;
        let excess = |x: &Vec3| larger(TURN * (x - c).norm() - excess, 0.0);
        let [on_a, on_b] = &mut self.faces;
        let excess_in_b = |x: &Vec3| excess(&(pair.rotation * x + pair.offset));
        let of_a = list_faces(&pair.faces_of_a(), normal, limit, excess, on_a);
        let of_b = list_faces(&pair.faces_of_b(), &-pair.in_b(normal), limit, excess_in_b, on_b);
        let faces = larger(of_a, of_b);
        self.edges.iter_mut().for_each(Few::clear);
        let mut list = |edges: [usize; 2]| {
            self.edges.iter_mut().zip(edges).for_each(|(list, e)| list.push(e));
        };
        let mut bound = f64::INFINITY;
        if let Some(pairs) = pairs {
            bound = f64::NEG_INFINITY;
            for edges in pairs {
                let [a, b] = [edges::edge_of_a(pair, edges[0]), edges::edge_of_b(pair, edges[1])];
                match edges_bound(&a, &b, excess) {
                    Some(b) if b < limit && known != Some(*edges) => bound = larger(bound, b),
                    _ => list(*edges),
                }
            }
        } else if let Some(edges) = known {
            list(edges);
        }
        self.bounds = [faces, bound].map(|b| b as f32);
        let whole = self.faces.iter().all(Few::is_whole) && self.edges.iter().all(Few::is_whole);
        let crossing = self.edge_pairs().all(|edges| {
            let [a, b] = [edges::edge_of_a(pair, edges[0]), edges::edge_of_b(pair, edges[1])];
            edges::arcs_cross(pair, edges, [&a.along, &b.along], 1.001 * TURN)
        });
        self.crossing = crossing;
        self.supports = Supports::new(pair, normal);
        self.alert = pair.alert;
        self.anchor = if whole { Anchor::new(pair, c) } else { Anchor::default() };
    }
}

/// Lists the faces that separate by `limit`; what the others separate by, at most.
///
/// `normal` is the best axis, from `faces.own` to the other body; `excess` is for corners of the other body.
fn list_faces<const N: usize>(
    faces: &Faces,
    normal: &Vec3,
    limit: f64,
    excess: impl Fn(&Vec3) -> f64,
    list: &mut Few<N>,
) -> f64 {
    list.clear();
    let lowest = |n: &Vec3| {
        let corner = faces.lowest_corner_along(n);
        (corner, excess(&corner))
    };
    // A corner deep below one face is often below its neighbours, too.
    let first = lowest(normal);
    let mut last = first;
    let mut bound = f64::NEG_INFINITY;
    for (f, (n, d)) in faces.own.face_normals.iter().zip(&faces.own.face_offsets).enumerate() {
        let above = |(x, more): &(Vec3, f64)| pair::height(n, x) - d + more;
        let mut least = smaller(above(&first), above(&last));
        if least >= limit {
            last = lowest(n);
            least = above(&last);
        }
        if least < limit {
            bound = larger(least, bound);
        } else {
            list.push(f);
        }
    }
    bound
}

/// What two edges separate by while lists hold, at most; `None` if that is too hard to tell.
fn edges_bound(a: &LoneEdge, b: &LoneEdge, excess: impl Fn(&Vec3) -> f64) -> Option<f64> {
    let cross = a.along.cross(&b.along);
    let lengths = a.along.norm_squared() * b.along.norm_squared();
    let cross_squared = cross.norm_squared();
    // 6 degrees: then x <= 0.08.
    if cross_squared <= 1e-2 * lengths {
        return None;
    }
    let n = cross / cross_squared.sqrt();
    let out = n.dot(&a.start);
    // The axis turns by less than 0.1: the origin stays on its side.
    if out * out <= 1e-2 * a.start.norm_squared() {
        return None;
    }
    let x = TURN * (lengths / cross_squared).sqrt();
    let c = closest::closest_on_segments(a, b);
    let between = c.on_b - c.on_a;
    let along = n.dot(&between);
    let beside = (between - n * along).norm();
    let separation = if out < 0.0 { -along } else { along };
    Some(separation + x * x * along.abs() + x * beside + excess(&c.on_b))
}
