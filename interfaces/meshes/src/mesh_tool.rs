//! Convex parts of a tool from a surface mesh.

use crate::corners::{MAX_CANDIDATES, choose_corners, corners_text, extreme_points, whole_corners};
use crate::decomposition::decompose;
use crate::deviation::deviation;
use crate::{MeshError, TriangleMesh};
use ballast::geometry::AxisBox;
use ballast::math::Vec3;
use serde_json::{Value, json};
use std::path::Path;

/// Maximum number of triangles, for which a decomposition takes some minutes.
const MAX_TRIANGLES: usize = 200_000;
/// Maximum difference between the volumes of the parts and of the mesh, over that of the mesh.
const MAX_VOLUME_DIFFERENCE: f64 = 0.1;

/// Place of a tool in its mesh.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ToolPlacement {
    /// Unit of the mesh, m.
    pub unit: f64,
    /// Point of the mesh that becomes the origin, in its unit.
    pub origin: Vec3,
    /// Direction in the mesh that becomes x, the direction of the squeeze: a unit vector.
    pub forward: Vec3,
    /// Direction in the mesh that becomes z, up: a unit vector perpendicular to `forward`.
    pub up: Vec3,
}

impl ToolPlacement {
    fn place(&self, point: &Vec3) -> Vec3 {
        let axes = [self.forward, self.up.cross(&self.forward), self.up];
        Vec3::from(axes.map(|axis| axis.dot(&(point - self.origin)) * self.unit))
    }
}

/// Limits of a decomposition.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PartLimits {
    /// Maximum number of parts.
    pub parts: usize,
    /// Maximum number of corners of a part.
    pub corners: usize,
    /// Volume that the hulls of the pieces may have in excess, over that of the mesh, before more pieces are cut.
    pub excess_volume: f64,
}

/// Convex parts with the form of a surface mesh. Lengths in m.
#[derive(Debug, Clone, PartialEq)]
pub struct MeshTool {
    /// Name of the file.
    pub name: String,
    /// Number of triangles of the mesh.
    pub triangles: usize,
    /// Volume inside the mesh, m³.
    pub mesh_volume: f64,
    /// Sum of the volumes of the parts, m³.
    pub volume: f64,
    /// Largest distance of the parts outside of the mesh, m.
    pub added_distance: f64,
    /// Largest distance of the mesh outside of the parts, m.
    pub lost_distance: f64,
    /// Corners of the parts.
    pub parts: Vec<Vec<Vec3>>,
    /// Bounding box of the parts.
    pub bounds: AxisBox,
}

impl MeshTool {
    /// Reads a mesh and decomposes it into convex parts for contact detection.
    ///
    /// # Errors
    /// Files that are no mesh, surfaces that are not closed, meshes that are too large, and parts whose volume is not that of the mesh.
    pub fn read(
        path: &Path,
        placement: &ToolPlacement,
        limits: &PartLimits,
    ) -> Result<Self, MeshError> {
        let mut mesh = TriangleMesh::read(path)?;
        let refused = |expected: String, found: String| MeshError::Content {
            path: path.into(),
            expected,
            found,
        };
        let triangles = mesh.triangles.len();
        if triangles > MAX_TRIANGLES {
            let expected = format!("at most {MAX_TRIANGLES} triangles");
            return Err(refused(expected, format!("{triangles}; simplify the mesh")));
        }
        mesh.points.iter_mut().for_each(|p| *p = placement.place(p));
        if mesh.volume().is_none() {
            let found = "a surface with holes, or with triangles that face both ways";
            return Err(refused("a closed surface".into(), found.into()));
        }
        let shells = mesh.shells();
        if shells.len() > limits.parts {
            let found = format!("{} of them; allow more parts", shells.len());
            return Err(refused(format!("at most {} closed surfaces", limits.parts), found));
        }
        let mesh_volume: f64 = shells.iter().filter_map(TriangleMesh::volume).sum();
        let pieces = decompose(&shells, limits.parts, limits.excess_volume);
        let chosen: Vec<_> = pieces
            .iter()
            .filter_map(|points| {
                let points = extreme_points(points, MAX_CANDIDATES);
                whole_corners(&points, limits.corners)
                    .or_else(|| choose_corners(&points, limits.corners))
            })
            .collect();
        let volume: f64 = chosen.iter().map(|part| part.stone.volume).sum();
        // Written so that NaN is refused, too.
        if !((volume / mesh_volume - 1.0).abs() <= MAX_VOLUME_DIFFERENCE) {
            return Err(refused(
                format!(
                    "parts with the volume of the mesh within {:.0} %",
                    100.0 * MAX_VOLUME_DIFFERENCE
                ),
                format!(
                    "{:.1} % of it in {} parts; allow more parts or corners",
                    100.0 * volume / mesh_volume,
                    chosen.len()
                ),
            ));
        }
        let parts: Vec<Vec<Vec3>> = chosen.iter().map(|part| part.corners.clone()).collect();
        let solids: Vec<_> = chosen.into_iter().map(|part| (part.stone, part.pose)).collect();
        let [added_distance, lost_distance] = deviation(&shells, &solids)
            .ok_or_else(|| refused("a closed surface".into(), "a damaged one".into()))?;
        Ok(Self {
            name: path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            triangles,
            mesh_volume,
            volume,
            added_distance,
            lost_distance,
            bounds: AxisBox::around(parts.iter().flatten().copied()),
            parts,
        })
    }

    /// Headings of the columns of a table of tools, after the name.
    pub const COLUMNS: [&str; 8] =
        ["parts", "corners", "volume", "of mesh", "outside", "inside", "x, y, z from", "to"];

    /// Returns the name and the columns of the tool in a table.
    pub fn cells(&self) -> [String; 9] {
        let millimetres = |x: f64| format!("{:.2} mm", 1e3 * x);
        let point = |p: Vec3| format!("{:.4}, {:.4}, {:.4} m", p.x, p.y, p.z);
        [
            self.name.clone(),
            self.parts.len().to_string(),
            self.corner_count().to_string(),
            format!("{:.1} cm³", 1e6 * self.volume),
            format!("{:.1} %", 100.0 * self.volume / self.mesh_volume),
            millimetres(self.added_distance),
            millimetres(self.lost_distance),
            point(self.bounds.low),
            point(self.bounds.high),
        ]
    }

    fn corner_count(&self) -> usize {
        self.parts.iter().map(Vec::len).sum()
    }

    /// Returns the parts as TOML that a case can end with, with the deviations from the mesh as a comment.
    pub fn toml_text(&self) -> String {
        let heading = format!(
            "# {}: {} parts with {} corners, {:.1} % of the volume of the mesh; they reach {:.2} mm out of it, and it {:.2} mm out of them\n",
            self.name,
            self.parts.len(),
            self.corner_count(),
            100.0 * self.volume / self.mesh_volume,
            1e3 * self.added_distance,
            1e3 * self.lost_distance,
        );
        let part = |corners: &Vec<Vec3>| format!("[[tines.parts]]\n{}", corners_text(corners));
        heading + &self.parts.iter().map(part).collect::<String>()
    }

    /// Converts the tool to JSON.
    pub fn json(&self) -> Value {
        let array = |p: &Vec3| [p.x, p.y, p.z];
        json!({
            "file": self.name,
            "triangles": self.triangles,
            "mesh_volume_m3": self.mesh_volume,
            "volume_m3": self.volume,
            "added_distance_m": self.added_distance,
            "lost_distance_m": self.lost_distance,
            "low_m": array(&self.bounds.low),
            "high_m": array(&self.bounds.high),
            "parts": self.parts.iter()
                .map(|corners| corners.iter().map(array).collect::<Vec<_>>()).collect::<Vec<_>>(),
        })
    }
}
