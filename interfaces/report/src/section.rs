//! Section of the bed in a vertical plane along the track: true polyhedra, sleepers and tines.
//!
//! Reads: model, poses. Cost: O(edges). Contract: a convex body leaves one convex polygon.

use crate::plot::{Legend, Outline, OutlineDrawing};
use ballast::geometry::Polyhedron;
use ballast::math::{Pose, Vec3};
use ballast::model::{Model, Part, Role};
use ballast_session::table::figure;

/// Returns the polygon (x, z) in which the plane `y` cuts a body; fewer than three corners if it does not.
pub fn cut(body: &Polyhedron, pose: &Pose, y: f64) -> Vec<[f64; 2]> {
    let corners: Vec<Vec3> = body.vertices.iter().map(|v| pose.point(v)).collect();
    let mut crossings: Vec<[f64; 2]> = (body.edges.iter())
        .filter_map(|edge| {
            let [a, b] = edge.vertices.map(|k| corners[k as usize]);
            let (da, db) = (a.y - y, b.y - y);
            // A corner in the plane counts as on one side: no crossing is found twice.
            ((da < 0.0) != (db < 0.0)).then(|| {
                let p = a + (b - a) * (da / (da - db));
                [p.x, p.z]
            })
        })
        .collect();
    let n = crossings.len().max(1) as f64;
    let middle = crossings.iter().fold([0.0; 2], |m, p| [m[0] + p[0] / n, m[1] + p[1] / n]);
    let angle = |p: &[f64; 2]| (p[1] - middle[1]).atan2(p[0] - middle[0]);
    crossings.sort_by(|a, b| angle(a).total_cmp(&angle(b)));
    crossings
}

/// Section of the bed, with shaded grains.
pub struct SectionPicture<'a> {
    pub model: &'a Model,
    /// Position of the plane, m.
    pub y: f64,
    /// Corners of the picture in x and z, m.
    pub low: [f64; 2],
    pub high: [f64; 2],
    /// Values that grains are shaded by `[ng]`.
    pub values: &'a [f64],
    pub unit: &'a str,
    pub legend: &'a Legend,
}

impl SectionPicture<'_> {
    /// Draws the bodies at `poses` `[nb]`.
    pub fn picture(&self, title: &str, poses: &[Pose]) -> String {
        let mut outlines = Vec::new();
        let model = self.model;
        for (grain, &shape) in model.grains.shape.iter().enumerate() {
            let corners = cut(&model.shapes[shape as usize], &poses[grain], self.y);
            let value = self.values[grain];
            let class = format!("grain s{}", self.legend.shade(value));
            let tooltip = format!("grain {grain}: {value:.1} {}", self.unit);
            self.add(corners, class, tooltip, &mut outlines);
        }
        let grains = outlines.len();
        let mut tools: Vec<&str> = vec![];
        for (d, body) in model.driven.iter().enumerate() {
            let class = match body.role {
                Role::Tine => "tool",
                Role::Sleeper | Role::Plate => "block",
                Role::Boundary => continue,
            };
            let before = outlines.len();
            for corners in cuts(model, d, poses, self.y) {
                self.add(corners, class.into(), body.name.clone(), &mut outlines);
            }
            if outlines.len() > before {
                tools.push(&body.name);
            }
        }
        let mut description = format!("section at y = {} m, {grains} stones", figure(self.y, 3));
        tools.iter().for_each(|name| description += &format!(", {name}"));
        let Legend { low, high, label } = self.legend;
        description += &format!("; shades: {label}, {} to {}", figure(*low, 2), figure(*high, 2));
        let title = title.to_string();
        OutlineDrawing { title, description, low: self.low, high: self.high, outlines }
            .svg(Some(self.legend))
    }

    fn add(&self, corners: Vec<[f64; 2]>, class: String, tooltip: String, out: &mut Vec<Outline>) {
        let corners = below(&corners, self.high[1]);
        if corners.len() > 2 {
            out.push(Outline { corners, class, tooltip });
        }
    }
}

/// Returns the polygons in which the plane `y` cuts the parts of driven body `d` at `poses` `[nb]`.
pub fn cuts(model: &Model, d: usize, poses: &[Pose], y: f64) -> Vec<Vec<[f64; 2]>> {
    let convex = |part: &Part| match part {
        Part::Convex { shape, pose } => {
            let pose = poses[model.grains.len() + d].then(pose);
            Some(cut(&model.shapes[*shape as usize], &pose, y))
        }
        _ => None,
    };
    let cuts = model.driven[d].parts.iter().filter_map(convex);
    cuts.filter(|corners| corners.len() > 2).collect()
}

/// Returns the part of a convex polygon below the upper edge of the picture.
pub fn below(corners: &[[f64; 2]], z: f64) -> Vec<[f64; 2]> {
    let mut out = Vec::with_capacity(corners.len() + 1);
    for (k, a) in corners.iter().enumerate() {
        let b = &corners[(k + 1) % corners.len()];
        if a[1] <= z {
            out.push(*a);
        }
        if (a[1] <= z) != (b[1] <= z) {
            let share = (z - a[1]) / (b[1] - a[1]);
            out.push([a[0] + share * (b[0] - a[0]), z]);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use ballast::geometry::cuboid;
    use ballast::math::Quat;

    fn area(p: &[[f64; 2]]) -> f64 {
        let n = p.len();
        (0..n).map(|k| p[k][0] * p[(k + 1) % n][1] - p[(k + 1) % n][0] * p[k][1]).sum::<f64>() / 2.0
    }

    #[test]
    fn a_cut_cube_leaves_its_section() {
        let cube = cuboid(Vec3::repeat(0.5));
        let level = Pose::at(Vec3::new(3.0, 1.0, 2.0));
        assert!((area(&cut(&cube, &level, 1.2)) - 1.0).abs() < 1e-12);
        assert!(cut(&cube, &level, 1.6).is_empty());
        // Through its middle, across a space diagonal: a regular hexagon of area 3√3/4.
        let diagonal = Vec3::repeat(1.0).normalize();
        let turn = Quat::rotation_between(&diagonal, &Vec3::y()).unwrap();
        let tipped = Pose { position: Vec3::zeros(), orientation: turn };
        let hexagon = cut(&cube, &tipped, 0.0);
        assert_eq!(hexagon.len(), 6);
        assert!((area(&hexagon) - 0.75 * 3f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn what_sticks_out_of_the_picture_is_cut_off() {
        let square = vec![[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        assert!((area(&below(&square, 0.25)) - 0.25).abs() < 1e-12);
        assert!((area(&below(&square, 2.0)) - 1.0).abs() < 1e-12);
        assert!(below(&square, -1.0).is_empty());
    }
}
