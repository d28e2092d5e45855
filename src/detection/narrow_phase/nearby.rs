//! Which features of a pair can matter until the bodies have moved against each other.
//!
//! Reads: pairs. Writes: lists of feature numbers. Cost: bytes per pair; a product and a root to ask
//! whether they hold.
//! Contract: a list that holds has every feature that the full search could choose, so that the
//! search over the list finds the same to the bit. It may hold more.
//!
//! Let μ bound how far any point of B has moved in the frame of A, and any point of A in that of B,
//! since the lists were made ([`Anchor`]); they hold while μ <= M. Then a separation along a face has
//! changed by at most M, so all faces within 2 M of the best one are listed. Edges:
//! [`Nearby::slack`] again.

use super::anchor::Anchor;
use super::faces::FACES;
use super::facing::Slack;
use super::few::Few;
use super::pair::Pair;
use crate::math::Vec3;

/// M over the sum of the radii.
const MARGIN: f64 = 4e-3;
/// How far the bodies may turn against each other besides.
const TURN: f64 = 5e-3;
/// How many pairs of edges are kept in mind.
const EDGE_PAIRS: usize = 24;

/// Lists of a pair, and where they were made.
#[derive(Debug, Clone, Copy, Default)]
pub struct Nearby {
    anchor: Anchor,
    has_edges: bool,
    /// Faces of A and of B.
    pub faces: [Few<FACES>; 2],
    edges: [Few<EDGE_PAIRS>; 2],
}

impl Nearby {
    /// Whether the lists of faces hold for `pair`.
    pub fn holds(&self, pair: &Pair) -> bool {
        self.anchor.moved(pair).is_some_and(|m| m.path <= MARGIN * pair.size && m.turn <= TURN)
    }

    /// Whether there are lists that held when they were asked for last.
    pub fn is_kept(&self) -> bool {
        self.anchor.is_set()
    }

    /// Forgets that the lists hold.
    pub fn restart(&mut self) {
        self.anchor = Anchor::default();
        self.has_edges = false;
    }

    /// Keeps the lists, just made, for the next steps; `c` as for [`Anchor::new`].
    pub fn keep(&mut self, pair: &Pair, c: &Vec3) {
        if self.faces.iter().all(Few::is_whole) {
            self.anchor = Anchor::new(pair, c);
        }
    }

    /// How far below the best face another one may be now and become the best while the lists hold.
    pub fn face_margin(pair: &Pair) -> f64 {
        2.0 * MARGIN * pair.size
    }

    /// How far bodies may move against each other between two configurations for which lists hold.
    pub fn slack(pair: &Pair) -> Slack {
        Slack { path: 2.0 * MARGIN * pair.size, turn: 2.0 * TURN }
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
