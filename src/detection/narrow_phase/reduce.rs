//! The four points of a manifold that span the largest area, the deepest always among them.

use crate::math::Vec3;

/// Largest number of points kept per pair of convex parts.
pub const MAX_POINTS: usize = 4;

/// A candidate point of a manifold.
#[derive(Debug, Clone, Copy)]
pub struct Candidate {
    pub point: Vec3,
    pub gap: f64,
    pub feature: u64,
}

/// Keeps at most [`MAX_POINTS`] of `points`, corners of a convex polygon in order around `n`.
///
/// With the deepest point D first in the order, the area of D b c e is that of D b c plus that of
/// D c e: for each c the best b before it and the best e after it are independent, so O(p²) finds
/// the largest area exactly.
pub fn keep_four(points: &mut Vec<Candidate>, n: &Vec3) {
    let count = points.len();
    if count <= MAX_POINTS {
        return;
    }
    let deepest = (1..count).fold(0, |d, i| if points[i].gap < points[d].gap { i } else { d });
    points.rotate_left(deepest);
    let apex = points[0].point;
    let area = |i: usize, j: usize| {
        n.dot(&(points[i].point - apex).cross(&(points[j].point - apex))).abs()
    };
    let widest = |range: std::ops::Range<usize>, c: usize| {
        range.fold((-1.0, 0), |best, i| if area(i, c) > best.0 { (area(i, c), i) } else { best })
    };
    let mut best = (f64::NEG_INFINITY, [0, 1, 2, 3]);
    for c in 2..count - 1 {
        let (before, b) = widest(1..c, c);
        let (after, e) = widest(c + 1..count, c);
        if before + after > best.0 {
            best = (before + after, [0, b, c, e]);
        }
    }
    let kept = best.1.map(|i| points[i]);
    points.clear();
    points.extend(kept);
}

/// Orders `points` as the corners of their convex hull seen along `n` and forgets the points
/// inside it, save the deepest, which then comes first.
pub fn convex_order(points: &mut Vec<Candidate>, n: &Vec3) {
    if points.len() < 3 {
        return;
    }
    let (t, s) = crate::math::frame::tangents(n);
    let flat = |c: &Candidate| (t.dot(&c.point), s.dot(&c.point));
    points.sort_by(|a, b| {
        let ((ax, ay), (bx, by)) = (flat(a), flat(b));
        ax.total_cmp(&bx).then(ay.total_cmp(&by)).then(a.feature.cmp(&b.feature))
    });
    let turns_right = |a: &Candidate, b: &Candidate, c: &Candidate| {
        n.dot(&(b.point - a.point).cross(&(c.point - a.point))) <= 0.0
    };
    let count = points.len();
    let mut hull: Vec<Candidate> = Vec::with_capacity(count + 1);
    for pass in 0..2 {
        let base = hull.len();
        for k in 0..count {
            let p = points[if pass == 0 { k } else { count - 1 - k }];
            while hull.len() >= base + 2
                && turns_right(&hull[hull.len() - 2], &hull[hull.len() - 1], &p)
            {
                hull.pop();
            }
            hull.push(p);
        }
        hull.pop();
    }
    let deepest = points.iter().copied().reduce(|d, c| if c.gap < d.gap { c } else { d });
    points.clear();
    if let Some(d) = deepest
        && !hull.iter().any(|c| c.feature == d.feature)
    {
        points.push(d);
    }
    points.extend(hull);
}
