//! Convex hulls in a plane.

/// Point of a plane, and its index, which decides ties.
pub(crate) type PlanePoint<I> = ([f64; 2], I);

/// Returns twice the area of a triangle, positive for a left turn.
pub(crate) fn cross(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// Stores the vertices of the convex hull of `points` in `chain`, turning left (monotone chain).
pub(crate) fn hull<I: Copy + Ord>(points: &mut [PlanePoint<I>], chain: &mut Vec<PlanePoint<I>>) {
    points.sort_unstable_by(|(a, i), (b, j)| {
        a[0].total_cmp(&b[0]).then_with(|| a[1].total_cmp(&b[1])).then_with(|| i.cmp(j))
    });
    chain.clear();
    for pass in 0..2 {
        let base = chain.len();
        for k in 0..points.len() {
            let p = points[if pass == 0 { k } else { points.len() - 1 - k }];
            while chain.len() >= base + 2
                && cross(chain[chain.len() - 2].0, chain[chain.len() - 1].0, p.0) <= 0.0
            {
                chain.pop();
            }
            chain.push(p);
        }
        chain.pop();
    }
}
