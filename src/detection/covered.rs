//! Removal of contacts on surfaces that another body covers (T-39).
//!
//! Two blocks that stand flush form one surface. Each of them alone has sides and edges there that no third body can reach,
//! and a body that slides over the joint would be stopped by them. Such a contact is hidden: its foot lies on the
//! covering body, the covering body covers all of the touched feature near the foot, and it extends beyond the plane of
//! the contact. A hidden contact is removed, unless its point on the grain lies inside the touched body: then it takes the
//! nearest face that is not covered.
//!
//! Reads: model, configuration, contacts. Writes: [`Contacts`]. Cost: a scalar product per contact point and neighbour of
//! its grain; more only where a foot lies on a neighbour.
//! Contract: a function of the contacts and shapes of the configuration; threads do not matter.

use super::contacts::Contacts;
use super::narrow_phase::{ConvexBody, part_of};
use crate::geometry::HalfSpace;
use crate::math::Vec3;
use rayon::prelude::*;

/// Distance within which a point counts as on a surface, over the sum of the radii involved.
const TOLERANCE: f64 = 1e-6;
/// Distance of a foot above the neighbour's plane of contact up to which the foot may lie on the neighbour, m.
const PLANE_TOLERANCE: f64 = 1e-6;
/// Cosine of the largest angle between a contact's normal and that of the face to which it is turned.
const MIN_FACE_ALIGNMENT: f64 = 0.5;
/// Grains per unit of parallel work.
const CHUNK: usize = 64;

/// Body, or one part of a driven body, that a grain touches.
#[derive(Debug, Clone, Copy)]
pub(super) enum TouchedBody<'a> {
    Convex(ConvexBody<'a>),
    HalfSpace(HalfSpace),
}

/// One contact point seen from one of its two grains.
#[derive(Debug, Clone, Copy)]
struct TouchPoint {
    contact: u32,
    /// 0 if the grain is the candidate, 1 if it is the antagonist.
    side: usize,
    /// Number of the touched body, and its part.
    other: [u32; 2],
    /// Point of the contact on the touched body, world, m.
    foot: Vec3,
    /// Outward normal of the touched body, world.
    normal: Vec3,
    gap: f64,
}

/// Buffers of [`CoveredContacts::remove`].
#[derive(Debug, Default)]
pub(super) struct CoveredContacts {
    /// Start of each grain's contacts as candidate `[ng + 1]`.
    starts: Vec<u32>,
    /// Start of each grain's contacts as antagonist `[ng + 1]`.
    antagonist_starts: Vec<u32>,
    /// Contacts sorted by antagonist grain.
    by_antagonist: Vec<u32>,
    covered: Vec<Covered>,
    removed: Vec<bool>,
}

/// Hidden contacts of a chunk of grains.
#[derive(Debug, Default)]
struct Covered {
    points: Vec<TouchPoint>,
    /// Closest point of each touched body or part.
    neighbours: Vec<TouchPoint>,
    hidden: Vec<HiddenPoint>,
}

/// Contact point on a covered feature.
#[derive(Debug, Clone, Copy)]
struct HiddenPoint {
    point: TouchPoint,
    /// Point over the face that it is turned to; `None` outside the touched body.
    uncovered: Option<TouchPoint>,
}

impl CoveredContacts {
    /// Removes covered contacts from `contacts`, or turns them to an uncovered face; `body` gives each body or part in its
    /// configuration, by body and part.
    pub fn remove<'a>(
        &mut self,
        grains: usize,
        contacts: &mut Contacts,
        body: &(impl Fn([u32; 2]) -> TouchedBody<'a> + Sync),
    ) {
        self.index(grains, contacts);
        self.covered.resize_with(grains.div_ceil(CHUNK), Covered::default);
        let (starts, antagonist_starts) = (&self.starts, &self.antagonist_starts);
        let by_antagonist = &self.by_antagonist;
        let found = &*contacts;
        self.covered.par_iter_mut().enumerate().for_each(|(chunk, covered)| {
            covered.hidden.clear();
            for grain in chunk * CHUNK..((chunk + 1) * CHUNK).min(grains) {
                let own = starts[grain]..starts[grain + 1];
                let range =
                    antagonist_starts[grain] as usize..antagonist_starts[grain + 1] as usize;
                let points = &mut covered.points;
                points.clear();
                points.extend(own.map(|i| TouchPoint::new(found, i, 0)));
                points.extend(by_antagonist[range].iter().map(|i| TouchPoint::new(found, *i, 1)));
                let neighbours = &mut covered.neighbours;
                neighbours.clear();
                for point in points.iter() {
                    match neighbours.last_mut().filter(|n| n.other == point.other) {
                        Some(closest) if point.gap < closest.gap => *closest = *point,
                        Some(_) => {}
                        None => neighbours.push(*point),
                    }
                }
                let is_hidden =
                    |point: &TouchPoint| neighbours.iter().any(|n| n.covers(point, body));
                for point in points.iter().filter(|point| is_hidden(point)) {
                    let uncovered = point.over_nearest_face(grain as u32, body, &is_hidden);
                    covered.hidden.push(HiddenPoint { point: *point, uncovered });
                }
            }
        });
        if self.covered.iter().all(|covered| covered.hidden.is_empty()) {
            return;
        }
        self.removed.clear();
        self.removed.resize(contacts.len(), false);
        let hidden = || self.covered.iter().flat_map(|covered| &covered.hidden);
        for HiddenPoint { point, .. } in hidden() {
            self.removed[point.contact as usize] = true;
        }
        for HiddenPoint { point, .. } in hidden() {
            self.turn_to_face(point, contacts, body);
        }
        for point in hidden().filter_map(|point| point.uncovered) {
            point.write(contacts);
            self.removed[point.contact as usize] = false;
        }
        contacts.retain(|i| !self.removed[i]);
    }

    /// Gives the other points of the pair of a removed point the normal of the face on which their feet lie: the common normal
    /// of the pair was that of the removed point.
    fn turn_to_face<'a>(
        &self,
        hidden: &TouchPoint,
        contacts: &mut Contacts,
        body: &impl Fn([u32; 2]) -> TouchedBody<'a>,
    ) {
        let TouchedBody::Convex(touched) = body(hidden.other) else { return };
        let bodies = contacts.bodies[hidden.contact as usize];
        let side = usize::from(bodies[1] != hidden.other[0]);
        for i in contacts.pair_range(bodies) {
            let point = TouchPoint::new(contacts, i as u32, side);
            if self.removed[i] || point.other != hidden.other || point.normal != hidden.normal {
                continue;
            }
            let foot = touched.pose.inverse_point(&point.foot);
            let normal = touched.pose.orientation.inverse() * point.normal;
            let tolerance = TOLERANCE * touched.shape.radius;
            let faces = || touched.shape.face_normals.iter().zip(&touched.shape.face_offsets);
            let height = |(n, offset): (&Vec3, &f64)| n.dot(&foot) - offset;
            // The foot on a separating plane (T-40) lies outside the body, and its plane stands for no face.
            if faces().any(|face| height(face) > tolerance) {
                continue;
            }
            let near = faces().filter(|(n, _)| n.dot(&normal) > MIN_FACE_ALIGNMENT);
            let on = near.filter(|face| height(*face) >= -tolerance);
            let Some((n, offset)) = on.max_by(|a, b| height(*a).total_cmp(&height(*b))) else {
                continue;
            };
            let gap = n.dot(&(foot + normal * point.gap)) - offset;
            point.over_plane(touched.pose.orientation * n, gap).write(contacts);
        }
    }

    /// Indexes contacts by candidate, in whose order they are, and by antagonist grain.
    fn index(&mut self, grains: usize, contacts: &Contacts) {
        let Self { starts, antagonist_starts, by_antagonist, .. } = self;
        for counts in [&mut *starts, &mut *antagonist_starts] {
            counts.clear();
            counts.resize(grains + 1, 0);
        }
        for [candidate, antagonist] in contacts.bodies.iter().map(|pair| pair.map(|b| b as usize)) {
            starts[candidate + 1] += 1;
            if antagonist < grains {
                antagonist_starts[antagonist] += 1;
            }
        }
        for i in 0..grains {
            starts[i + 1] += starts[i];
            antagonist_starts[i + 1] += antagonist_starts[i];
        }
        by_antagonist.clear();
        by_antagonist.resize(antagonist_starts[grains] as usize, 0);
        // Backwards, so that each end becomes the start and equal antagonists keep their order.
        for (i, [_, antagonist]) in contacts.bodies.iter().enumerate().rev() {
            if (*antagonist as usize) < grains {
                let place = &mut antagonist_starts[*antagonist as usize];
                *place -= 1;
                by_antagonist[*place as usize] = i as u32;
            }
        }
    }
}

impl TouchPoint {
    /// Contact `i` seen from its candidate (`side` 0) or its antagonist (1).
    fn new(contacts: &Contacts, i: u32, side: usize) -> Self {
        let k = i as usize;
        let normal = if side == 0 { contacts.normal[k] } else { -contacts.normal[k] };
        let part = if side == 0 { part_of(contacts.feature[k]) } else { 0 };
        Self {
            contact: i,
            side,
            other: [contacts.bodies[k][1 - side], part],
            foot: contacts.point[k] - normal * (0.5 * contacts.gap[k]),
            normal,
            gap: contacts.gap[k],
        }
    }

    /// Writes point, normal and gap to the contact.
    fn write(&self, contacts: &mut Contacts) {
        let i = self.contact as usize;
        contacts.point[i] = self.foot + self.normal * (0.5 * self.gap);
        contacts.normal[i] = if self.side == 0 { self.normal } else { -self.normal };
        contacts.gap[i] = self.gap;
    }

    /// Returns the same point of the grain at a distance `gap` over a plane with this outward normal.
    fn over_plane(&self, normal: Vec3, gap: f64) -> Self {
        let on_grain = self.foot + self.normal * self.gap;
        Self { foot: on_grain - normal * gap, normal, gap, ..*self }
    }

    /// Returns the point over the face of the touched body that the grain penetrates least, of those that are not hidden;
    /// `None` if the point of the grain lies outside one of these faces or deeper below that one, or all faces are hidden.
    fn over_nearest_face<'a>(
        &self,
        grain: u32,
        body: &impl Fn([u32; 2]) -> TouchedBody<'a>,
        is_hidden: &impl Fn(&Self) -> bool,
    ) -> Option<Self> {
        if self.gap >= 0.0 {
            return None;
        }
        let TouchedBody::Convex(touched) = body(self.other) else { return None };
        let TouchedBody::Convex(grain) = body([grain, 0]) else { return None };
        let tolerance = TOLERANCE * touched.shape.radius;
        let on_grain = touched.pose.inverse_point(&(self.foot + self.normal * self.gap));
        let mut least: Option<(f64, Self)> = None;
        for (n, offset) in touched.shape.face_normals.iter().zip(&touched.shape.face_offsets) {
            let gap = n.dot(&on_grain) - offset;
            let outward = touched.pose.orientation * n;
            let point = self.over_plane(outward, gap);
            if is_hidden(&point) {
                continue;
            }
            if gap > tolerance {
                return None;
            }
            let along = grain.pose.orientation.inverse() * outward;
            let lowest =
                grain.shape.vertices.iter().map(|v| along.dot(v)).fold(f64::INFINITY, f64::min);
            let depth =
                offset - outward.dot(&(grain.pose.position - touched.pose.position)) - lowest;
            if least.is_none_or(|(other, _)| depth < other) {
                least = Some((depth, point));
            }
        }
        // Deeper below another face, the grain is held by the covering body.
        least.map(|(_, point)| point).filter(|point| point.gap >= self.gap - tolerance)
    }

    /// Returns true if the body touched here covers that of `point` at its foot.
    fn covers<'a>(&self, point: &Self, body: &impl Fn([u32; 2]) -> TouchedBody<'a>) -> bool {
        if self.other == point.other {
            return false;
        }
        // The covering body ends at its own plane of contact; nearly all feet lie beyond it.
        let beyond = self.normal.dot(&(point.foot - self.foot));
        if beyond > PLANE_TOLERANCE {
            return false;
        }
        let TouchedBody::Convex(touched) = body(point.other) else { return false };
        match body(self.other) {
            TouchedBody::Convex(cover) => is_covered(point, touched, cover),
            TouchedBody::HalfSpace(cover) => is_covered_by_half_space(point, touched, cover),
        }
    }
}

/// Corners of the feature of `solid` that lies at `foot` with this outward normal, relative to the foot, world.
fn feature_corners<'a>(
    solid: ConvexBody<'a>,
    foot: Vec3,
    normal: Vec3,
    tolerance: f64,
) -> impl Iterator<Item = Vec3> + 'a {
    let corners = solid.shape.vertices.iter().map(move |v| solid.pose.point(v) - foot);
    corners.filter(move |corner| normal.dot(corner) >= -tolerance)
}

/// Returns true if `cover` hides the feature of `touched` at the point.
fn is_covered(point: &TouchPoint, touched: ConvexBody, cover: ConvexBody) -> bool {
    let tolerance = TOLERANCE * (touched.shape.radius + cover.shape.radius);
    let foot = cover.pose.inverse_point(&point.foot);
    let faces = || cover.shape.face_normals.iter().zip(&cover.shape.face_offsets);
    if faces().any(|(n, offset)| n.dot(&foot) - offset > tolerance) {
        return false;
    }
    let corners = || feature_corners(touched, point.foot, point.normal, tolerance);
    let mut is_on_surface = false;
    for (n, offset) in faces() {
        if n.dot(&foot) - offset < -tolerance {
            continue;
        }
        is_on_surface = true;
        let outward = cover.pose.orientation * n;
        if corners().any(|corner| outward.dot(&corner) > tolerance) {
            return false;
        }
    }
    // Bodies that overlap do not cover each other: what lies deep inside is penetration.
    let normal = cover.pose.orientation.inverse() * point.normal;
    is_on_surface && cover.shape.vertices.iter().any(|v| normal.dot(&(v - foot)) > tolerance)
}

/// Returns true if a half-space hides the feature of `touched` at the point.
fn is_covered_by_half_space(point: &TouchPoint, touched: ConvexBody, cover: HalfSpace) -> bool {
    let tolerance = 2.0 * TOLERANCE * touched.shape.radius;
    let height = cover.normal.dot(&point.foot) - cover.offset;
    // A half-space extends beyond every plane but its own.
    let is_parallel =
        cover.normal.cross(&point.normal).norm() < 1e-9 && cover.normal.dot(&point.normal) > 0.0;
    if height.abs() > tolerance || is_parallel {
        return false;
    }
    !feature_corners(touched, point.foot, point.normal, tolerance)
        .any(|corner| cover.normal.dot(&corner) > tolerance)
}
