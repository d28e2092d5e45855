//! Contact points of one configuration.

use super::history::ContactHistory;
use crate::math::Vec3;
use crate::motion::Motion;
use std::ops::Range;

/// Contact points of one configuration as structure of arrays, sorted by bodies, then feature.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Contacts {
    /// Candidate and antagonist `[nc]`. The candidate is a grain; the antagonist is a grain of higher number or a
    /// driven body.
    pub bodies: Vec<[u32; 2]>,
    /// Identity of the point inside its pair: parts and features `[nc]`.
    pub feature: Vec<u64>,
    /// Midpoint between the two surfaces, world `[nc]`, m.
    pub point: Vec<Vec3>,
    /// Unit normal from antagonist to candidate, world `[nc]`.
    pub normal: Vec<Vec3>,
    /// Signed gap `[nc]`, m; negative is penetration.
    pub gap: Vec<f64>,
}

impl Contacts {
    /// Returns the number of contact points.
    pub fn len(&self) -> usize {
        self.bodies.len()
    }

    /// True if there is no contact.
    pub fn is_empty(&self) -> bool {
        self.bodies.is_empty()
    }

    /// Removes all contacts and keeps the allocations.
    pub fn clear(&mut self) {
        self.bodies.clear();
        self.feature.clear();
        self.point.clear();
        self.normal.clear();
        self.gap.clear();
    }

    /// Keeps the contacts for which `is_kept` returns true.
    pub(super) fn retain(&mut self, is_kept: impl Fn(usize) -> bool) {
        let mut kept = 0;
        for i in (0..self.len()).filter(|&i| is_kept(i)) {
            self.bodies[kept] = self.bodies[i];
            self.feature[kept] = self.feature[i];
            self.point[kept] = self.point[i];
            self.normal[kept] = self.normal[i];
            self.gap[kept] = self.gap[i];
            kept += 1;
        }
        self.bodies.truncate(kept);
        self.feature.truncate(kept);
        self.point.truncate(kept);
        self.normal.truncate(kept);
        self.gap.truncate(kept);
    }

    /// Appends one contact point.
    pub fn push(&mut self, bodies: [u32; 2], feature: u64, point: Vec3, normal: Vec3, gap: f64) {
        self.bodies.push(bodies);
        self.feature.push(feature);
        self.point.push(point);
        self.normal.push(normal);
        self.gap.push(gap);
    }
    /// Returns the range of the contacts of two bodies.
    pub fn pair_range(&self, bodies: [u32; 2]) -> Range<usize> {
        let start = self.bodies.partition_point(|b| *b < bodies);
        start..start + self.bodies[start..].partition_point(|b| *b == bodies)
    }

    /// Returns the opening speed of contact `i`, m/s, where `twist(b)` are velocity and angular velocity of body `b`.
    pub fn opening_speed(
        &self,
        i: usize,
        motion: &Motion,
        twist: impl Fn(usize) -> (Vec3, Vec3),
    ) -> f64 {
        let surface = |b: u32| {
            let (v, w) = twist(b as usize);
            v + w.cross(&(self.point[i] - motion.position[b as usize]))
        };
        let [c, a] = self.bodies[i];
        self.normal[i].dot(&(surface(c) - surface(a)))
    }

    /// Inserts contacts, or replaces point and normal of those with the same bodies and feature.
    ///
    /// A known contact keeps its gap if it penetrates. `impulse` and `history` stay aligned with the contacts; new ones have none.
    pub fn merge(
        &mut self,
        others: &Contacts,
        impulse: &mut Vec<Vec3>,
        history: &mut ContactHistory,
    ) {
        for k in 0..others.len() {
            let (bodies, feature) = (others.bodies[k], others.feature[k]);
            let (point, normal, gap) = (others.point[k], others.normal[k], others.gap[k]);
            let known = self.pair_range(bodies);
            let i = known.start + self.feature[known.clone()].partition_point(|f| *f < feature);
            if known.contains(&i) && self.feature[i] == feature {
                (self.point[i], self.normal[i]) = (point, normal);
                if self.gap[i] >= 0.0 {
                    self.gap[i] = gap;
                }
            } else {
                self.bodies.insert(i, bodies);
                self.feature.insert(i, feature);
                self.point.insert(i, point);
                self.normal.insert(i, normal);
                self.gap.insert(i, gap);
                impulse.insert(i, Vec3::zeros());
                history.insert(i);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn merged_contacts_are_inserted_in_order_or_replace_equal_features() {
        let row = |x: f64| Vec3::repeat(x);
        let mut contacts = Contacts::default();
        for (bodies, feature, gap) in
            [([0, 1], 3, 1e-3), ([0, 1], 7, -1e-3), ([2, 3], 1, 2e-3), ([2, 4], 1, 2e-3)]
        {
            contacts.push(bodies, feature, row(0.0), Vec3::x(), gap);
        }
        let mut impulse = vec![row(1.0), row(2.0), row(3.0), row(4.0)];
        let mut others = Contacts::default();
        for (bodies, feature) in [([2, 3], 5), ([0, 1], 7), ([0, 1], 5), ([0, 1], 3), ([1, 9], 1)] {
            others.push(bodies, feature, row(9.0), Vec3::z(), 5e-4);
        }
        let mut history =
            ContactHistory { impulse: impulse.clone(), overlap: vec![1.0, 2.0, 3.0, 4.0] };
        contacts.merge(&others, &mut impulse, &mut history);
        let places = [[0, 1], [0, 1], [0, 1], [1, 9], [2, 3], [2, 3], [2, 4]];
        assert_eq!(contacts.bodies, places);
        assert_eq!(contacts.feature, [3, 5, 7, 1, 1, 5, 1]);
        assert_eq!(contacts.gap, [5e-4, 5e-4, -1e-3, 5e-4, 2e-3, 5e-4, 2e-3]);
        assert_eq!(impulse, [1.0, 0.0, 2.0, 0.0, 3.0, 0.0, 4.0].map(row));
        assert_eq!(history.impulse, impulse);
        assert_eq!(history.overlap, [1.0, 0.0, 2.0, 0.0, 3.0, 0.0, 4.0]);
        let is_new = |i: usize| contacts.normal[i] == Vec3::z() && contacts.point[i] == row(9.0);
        assert_eq!([0, 1, 2, 3, 4, 5, 6].map(is_new), [true, true, true, true, false, true, false]);
    }
}
