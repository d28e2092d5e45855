//! Where two bodies are near each other along an axis: all corners of the gap between them.
//!
//! Seen along the axis, the gap between the facing surfaces of two convex bodies is a convex
//! function, linear over pieces whose corners are vertices of A, vertices of B, and crossings of an
//! edge of A with an edge of B. Corners with a gap up to the alert distance are all that can touch
//! next. A body that rolls over a vertex or rocks over an edge is held by the neighbouring corner
//! before it gets there; the closest features alone would let it in.
//!
//! A corner with gap g <= alert has its feet on A and B at most `alert - s` off the support planes,
//! s being the separation along the axis. So the edges with an end in that slab decide, and of
//! them the parts in the slab ([`facing`](super::facing)).
//!
//! Which corners of the bodies and which pairs of edges may make corners of the gap changes little
//! from step to step: they are listed with a margin, and the list serves while the bodies and the axis
//! have moved by less. What a list holds too much makes no corner, so results do not depend on it.
//!
//! Only what is near the contact has to be bounded. The feet of a corner are at most r = max(alert, -s)
//! apart, whatever the axis is. Where the list was made they were less than r + Δ + φ l apart, Δ and φ
//! being the bodies' motion since ([`Anchor`]) and l a foot's distance from the anchor's point. So there they
//! were in a slab of r + Δ + φ l - s0, s0 being the separation then, and l is no more than the lever of
//! what faces the other body in the list's slab.

use super::anchor::Anchor;
use super::facing::{Below, Frame, Segment, Sides, Slack};
use super::few::Few;
use super::pair::Pair;
use super::reduce::Candidate;
use super::rim::{EDGES, Rim};
use super::worth::Worth;
use super::{SLAB, feature};
use crate::geometry::Polyhedron;
use crate::math::{Vec3, frame, round, widen};

/// How far bodies may move against each other before a list is made again, over the radii.
const PATH: f64 = 3e-3;
/// How far the axis may turn in the frame of A before that.
const TURN: f64 = 8e-3;
/// How much thicker than asked for the slab of a list is, over the radii.
const THICKER: f64 = 6e-3;
/// Faces steeper than this along the axis count as its sides.
pub const STEEP: f64 = 1e-9;

/// The axis and the bounds of the search.
#[derive(Debug, Clone, Copy)]
pub struct Axis {
    /// From A to B, in the frame of A.
    pub normal: Vec3,
    /// Largest gap of interest, m.
    pub alert: f64,
    /// Separation along the axis less what rounding takes: no corner's gap is below it, m.
    pub lowest: f64,
    /// How far off the support planes the feet of a corner may be, m.
    pub slab: f64,
    /// How far beside a face a vertex may be and still count as over it, m.
    pub tolerance: f64,
}

/// Features of both bodies that may make corners of the gap, and for which configurations.
#[derive(Debug, Clone, Copy, Default)]
pub struct PatchList {
    anchor: Anchor,
    axis: [f32; 3],
    /// Alert distance that it was made for, m.
    alert: f64,
    /// How far feet may have moved apart, and their distance, m.
    reach: f32,
    /// No foot is further from the anchor's point, m.
    lever: f32,
    /// Whether some of the edges may turn away from the other body.
    unsure: bool,
    /// Corners of A and of B that may be over the other body.
    vertices: [Few<8>; 2],
    /// Faces of the other body that decide about each of them.
    below: [[Below; 8]; 2],
    /// Edges of A and of B that may cross.
    rims: [Rim; 2],
    /// Pairs of them, by their places on the rims: that of A times [`EDGES`] plus that of B.
    pairs: Few<32>,
}

impl PatchList {
    /// Whether the list has all that `axis` can find.
    fn holds(&self, pair: &Pair, axis: &Axis) -> bool {
        let Some(moved) = self.anchor.moved(pair) else { return false };
        let turn = (widen(&self.axis) - axis.normal).norm() + 1e-6;
        let reach = axis.reach() + moved.at_point + f64::from(self.lever) * moved.turn;
        moved.at_point <= PATH * pair.size
            && turn <= TURN
            && moved.turn <= TURN
            && reach <= self.reach.into()
            && axis.alert <= self.alert
    }

    /// Makes the list for `axis` and its neighbours; `false` if it has to be made again in each step.
    fn make(&mut self, pair: &Pair, axis: &Axis, sides: &mut Sides) -> bool {
        let slab = axis.slab + THICKER * pair.size;
        let slack = Slack { path: (PATH + SLAB) * pair.size, turn: TURN };
        sides.list(pair, axis, slab, slack);
        self.anchor = Anchor::default();
        for (side, over) in sides.vertices.iter().enumerate() {
            fill(&mut self.vertices[side], over.iter().map(|o| o.vertex));
            self.below[side].iter_mut().zip(over).for_each(|(below, o)| *below = o.below);
        }
        self.pairs.clear();
        self.rims.iter_mut().for_each(Rim::clear);
        for [a, b] in &sides.pairs {
            let [on_a, on_b] = &mut self.rims;
            self.pairs.push(on_a.add(pair.a, *a) * EDGES + on_b.add(pair.b, *b));
        }
        let whole = self.vertices.iter().all(Few::is_whole)
            && self.rims.iter().all(Rim::is_whole)
            && self.pairs.is_whole();
        if whole {
            self.anchor = Anchor::new(pair, &sides.middle);
            self.axis = round(&axis.normal);
            self.alert = axis.alert;
            self.reach = ((slab - (axis.slab - axis.alert)) * 0.999_999) as f32;
            self.unsure = sides.unsure;
            self.lever = (sides.lever * 1.000_001) as f32;
        }
        whole
    }
}

fn fill<const N: usize>(list: &mut Few<N>, items: impl Iterator<Item = usize>) {
    list.clear();
    items.for_each(|i| list.push(i));
}

impl Axis {
    /// Largest distance between the feet of a corner, m.
    fn reach(&self) -> f64 {
        self.alert.max(self.slab - self.alert)
    }

    /// Fills `out` with the corners of gaps up to the alert distance, in the frame of A.
    pub fn corners(
        &self,
        pair: &Pair,
        list: &mut PatchList,
        worth: &mut Worth,
        sides: &mut Sides,
        out: &mut Vec<Candidate>,
    ) {
        out.clear();
        let frames = self.frames(pair);
        let holds = list.holds(pair, self);
        if holds {
            worth.used();
        }
        if holds || (worth.ask() && list.make(pair, self, sides)) {
            let [of_a, of_b] = &frames;
            let sure = !list.unsure;
            let [on_a, on_b] = &list.rims;
            let Sides { rims: [placed_a, placed_b], .. } = sides;
            on_a.place(pair.a, of_a, placed_a);
            on_b.place(pair.b, of_b, placed_b);
            for both in list.pairs.iter() {
                let (a, b) = (both / EDGES, both % EDGES);
                let edges = [on_a.edges.item(a), on_b.edges.item(b)];
                if sure || (of_a.is_facing(pair.a, edges[0]) && of_b.is_facing(pair.b, edges[1])) {
                    let segments = [on_a.segment(a, placed_a), on_b.segment(b, placed_b)];
                    self.crossing(pair, of_a, edges, &segments, out);
                }
            }
            let over = |side: usize| list.vertices[side].iter().zip(&list.below[side]);
            let a = over(0).filter(|(v, _)| sure || of_a.has_facing_edge(pair.a, *v));
            let b = over(1).filter(|(v, _)| sure || of_b.has_facing_edge(pair.b, *v));
            self.vertices_of_a(pair, of_b, a, out);
            self.vertices_of_b(pair, of_a, b, out);
        } else {
            let slack = Slack { path: SLAB * pair.size, turn: 0.0 };
            sides.list(pair, self, self.slab, slack);
            let Sides { pairs, vertices: [a, b], .. } = sides;
            for edges in pairs {
                let segments =
                    [(pair.a, 0), (pair.b, 1)].map(|(s, k)| frames[k].segment(s, edges[k]));
                self.crossing(pair, &frames[0], *edges, &segments, out);
            }
            self.vertices_of_a(pair, &frames[1], a.iter().map(|o| (o.vertex, &o.below)), out);
            self.vertices_of_b(pair, &frames[0], b.iter().map(|o| (o.vertex, &o.below)), out);
        }
    }

    /// The coordinates of the axis for points of A and of B.
    pub fn frames(&self, pair: &Pair) -> [Frame; 2] {
        let (t, s) = frame::tangents(&self.normal);
        let axes = [t, s, self.normal];
        let of_b = Frame {
            axes: [pair.in_b(&t), pair.in_b(&s), pair.in_b(&self.normal)],
            origin: [t.dot(&pair.offset), s.dot(&pair.offset), self.normal.dot(&pair.offset)],
            into: 1.0,
        };
        [Frame { axes, origin: [0.0; 3], into: -1.0 }, of_b]
    }

    /// Gap at the vertex at `x`, in the other body's coordinates. The faces `below` it decide, but not far behind:
    /// once one of them has turned steep, the line may seem to enter the body where a face that is not listed
    /// keeps it out, below all corners of the gap.
    #[inline]
    fn gap_at(&self, into: &Frame, other: &Polyhedron, below: &Below, x: &Vec3) -> Option<f64> {
        let gap = into.distance(other, below, x, self.tolerance)?;
        if gap >= self.lowest {
            return Some(gap);
        }
        into.distance(other, &Below::too_many(), x, self.tolerance)
    }

    /// Appends vertices of A over B, with the faces that decide; `into` is the frame of B.
    fn vertices_of_a<'a>(
        &self,
        pair: &Pair,
        into: &Frame,
        vertices: impl Iterator<Item = (usize, &'a Below)>,
        out: &mut Vec<Candidate>,
    ) {
        for (v, below) in vertices {
            let point = &pair.a.vertices[v];
            let gap = self.gap_at(into, pair.b, below, &pair.point_in_b(point));
            self.vertex(feature::vertex(v), point, gap, 1.0, out);
        }
    }

    /// Appends vertices of B over A, with the faces that decide; `into` is the frame of A.
    fn vertices_of_b<'a>(
        &self,
        pair: &Pair,
        into: &Frame,
        vertices: impl Iterator<Item = (usize, &'a Below)>,
        out: &mut Vec<Candidate>,
    ) {
        for (v, below) in vertices {
            let point = pair.corner_of_b(v);
            let gap = self.gap_at(into, pair.a, below, &point);
            self.vertex(feature::vertex_of_b(v), &point, gap, -1.0, out);
        }
    }

    /// Appends the vertex at `point` if the other body is near; `side` is the axis's sign towards it.
    fn vertex(
        &self,
        feature: u64,
        point: &Vec3,
        gap: Option<f64>,
        side: f64,
        out: &mut Vec<Candidate>,
    ) {
        if let Some(gap) = gap.filter(|g| *g <= self.alert) {
            out.push(Candidate { point: point + self.normal * (0.5 * side * gap), gap, feature });
        }
    }

    /// Appends the crossing of an edge of A with one of B; `of_a` is the frame of A.
    // As a call of its own it would cost its arguments a way through memory.
    #[inline(always)]
    fn crossing(
        &self,
        pair: &Pair,
        of_a: &Frame,
        edges: [usize; 2],
        [on_a, on_b]: &[Segment; 2],
        out: &mut Vec<Candidate>,
    ) {
        let Some([s, t]) = crossing(on_a, on_b) else { return };
        let (x, y) = (on_a.at(s), on_b.at(t));
        let gap = y[2] - x[2];
        if gap <= self.alert {
            let [e0, e1, e2] = &of_a.axes;
            let point = e0 * x[0] + e1 * x[1] + e2 * (x[2] + 0.5 * gap);
            out.push(Candidate {
                point,
                gap,
                feature: feature::edges([pair.a, pair.b], edges, [s, t]),
            });
        }
    }
}

/// Where two edges cross, seen along the axis: positions on both, strictly between their ends.
fn crossing(a: &Segment, b: &Segment) -> Option<[f64; 2]> {
    let beside = |d: &[f64; 3], x: [f64; 2]| d[0] * x[1] - d[1] * x[0];
    let between = [b.start[0] - a.start[0], b.start[1] - a.start[1]];
    let far = [between[0] + b.along[0], between[1] + b.along[1]];
    let (p, q) = (beside(&a.along, between), beside(&a.along, far));
    if p * q >= 0.0 {
        return None;
    }
    let t = p / (p - q);
    let over = [between[0] + b.along[0] * t, between[1] + b.along[1] * t];
    let length_squared = a.along[0] * a.along[0] + a.along[1] * a.along[1];
    let s = (a.along[0] * over[0] + a.along[1] * over[1]) / length_squared;
    (s > 0.0 && s < 1.0).then_some([s, t])
}
