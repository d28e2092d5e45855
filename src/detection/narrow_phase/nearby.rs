//! Which features of a pair can matter until the bodies have moved against each other.
//!
//! Reads: pairs. Writes: lists of feature numbers. Cost: bytes per pair; a product and a root to ask
//! whether they hold.
//! Contract: a list that holds has every feature that the full search could choose, so that the
//! search over the list finds the same to the bit. It may hold more.
//!
//! Let μ bound how far any point of B has moved in the frame of A, and any point of A in that of B,
//! since the lists were made; they hold while μ <= M. Then a separation along a face has changed by at
//! most M, so all faces within 2 M of the best one are listed. Edges: [`Nearby::moved`] again.
//!
//! With a point c of both bodies, displaced by Δc, and a rotation that moves unit vectors by φ at most,
//! μ = |Δc| + φ l, l the largest distance of a point of either body from c.

use super::faces::FACES;
use super::few::Few;
use super::pair::Pair;
use crate::math::Vec3;

/// M over the sum of the radii.
const MARGIN: f64 = 4e-3;
/// What single precision takes from M, over the sum of the radii.
const ROUNDING: f64 = 2e-6;
/// How many pairs of edges are kept in mind.
const EDGE_PAIRS: usize = 24;

/// Lists of a pair, and where they were made.
#[derive(Debug, Clone, Copy, Default)]
pub struct Nearby {
    anchored: bool,
    has_edges: bool,
    /// The point c in the frames of A and B.
    anchor: [[f32; 3]; 2],
    /// From B to A.
    turn: [f32; 4],
    /// Faces of A and of B.
    pub faces: [Few<FACES>; 2],
    edges: [Few<EDGE_PAIRS>; 2],
}

impl Nearby {
    /// Whether the lists of faces hold for `pair`.
    pub fn holds(&self, pair: &Pair) -> bool {
        self.anchored && {
            let [a, b] = self.anchor.map(|x| Vec3::from(x.map(f64::from)));
            let path = (pair.rotation * b + pair.offset - a).norm();
            let (turn, old) = (pair.turn.coords, nalgebra::Vector4::from(self.turn.map(f64::from)));
            let turn = (turn - old).norm_squared().min((turn + old).norm_squared()).sqrt();
            path + 2.0 * lever(pair) * turn <= (MARGIN - ROUNDING) * pair.size
        }
    }

    /// Forgets that the lists hold.
    pub fn restart(&mut self) {
        self.anchored = false;
        self.has_edges = false;
    }

    /// Keeps the lists, just made, for the next steps; `c` is a point of both bodies or at most the
    /// alert distance off them, in the frame of A.
    pub fn keep(&mut self, pair: &Pair, c: &Vec3) {
        if self.anchored || !self.faces.iter().all(Few::is_whole) {
            return;
        }
        self.anchored = true;
        self.anchor = [*c, pair.point_in_b(c)].map(|x| [x.x as f32, x.y as f32, x.z as f32]);
        let q = pair.turn.coords;
        self.turn = [q.x as f32, q.y as f32, q.z as f32, q.w as f32];
    }

    /// How far below the best face another one may be now and become the best while the lists hold.
    pub fn face_margin(pair: &Pair) -> f64 {
        2.0 * MARGIN * pair.size
    }

    /// How far bodies, and by which angle they, may move against each other between two
    /// configurations for which the lists hold.
    pub fn moved(pair: &Pair) -> [f64; 2] {
        let path = 2.0 * MARGIN * pair.size;
        [path, path / lever(pair)]
    }

    /// Pairs of edges that may be the best axis, if they are known; `None` inside if they are too many.
    pub fn edge_pairs(&self) -> Option<Option<impl Iterator<Item = [usize; 2]>>> {
        let [a, b] = &self.edges;
        let pairs = || a.iter().zip(b.iter()).map(|(a, b)| [a, b]);
        self.has_edges.then(|| (a.is_whole() && b.is_whole()).then(pairs))
    }

    /// Starts the list of pairs of edges.
    pub fn start_edges(&mut self) {
        self.has_edges = true;
        self.edges.iter_mut().for_each(Few::clear);
    }

    /// Appends a pair of edges.
    pub fn push_edges(&mut self, edges: [usize; 2]) {
        self.edges.iter_mut().zip(edges).for_each(|(list, e)| list.push(e));
    }
}

/// Distance of any point of the bodies from a point of both, or near them, at most.
fn lever(pair: &Pair) -> f64 {
    2.0 * pair.a.radius.max(pair.b.radius) + pair.alert
}
