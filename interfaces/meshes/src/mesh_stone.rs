//! Convex stone of a surface mesh.

use crate::corners::{ChosenCorners, MAX_CANDIDATES, choose_corners, corners_text, extreme_points};
use crate::{MeshError, TriangleMesh};
use ballast::geometry::{ShapeDescriptors, convex_hull};
use ballast::math::Vec3;
use serde_json::{Value, json};
use std::path::Path;

/// Convex stone with the form of a surface mesh. Volumes and lengths are in the unit of the mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct MeshStone {
    /// Name of the file.
    pub name: String,
    /// Number of triangles of the mesh.
    pub triangles: usize,
    /// Volume inside the mesh; `None` if the mesh is not closed.
    pub mesh_volume: Option<f64>,
    /// Volume of the convex hull of the mesh.
    pub hull_volume: f64,
    /// Volume of the stone, which lies inside the hull.
    pub volume: f64,
    /// Corners of the stone, around its middle.
    pub corners: Vec<Vec3>,
    /// Descriptors of the stone.
    pub descriptors: ShapeDescriptors,
    /// Nominal diameter of the stone.
    pub nominal_diameter: f64,
}

impl MeshStone {
    /// Reads a mesh and chooses at most `most` corners of its convex hull.
    ///
    /// # Errors
    /// Files that are no mesh, and meshes that are flat or make no stone for contact detection.
    pub fn read(path: &Path, most: usize) -> Result<Self, MeshError> {
        let mesh = TriangleMesh::read(path)?;
        let no_stone = |found: String| MeshError::Content {
            path: path.into(),
            expected: "a surface around a volume".into(),
            found,
        };
        let mut points = extreme_points(&mesh.points, MAX_CANDIDATES);
        // Scans may lie far from their origin.
        let middle = points.iter().sum::<Vec3>() / points.len() as f64;
        points.iter_mut().for_each(|p| *p -= middle);
        let (hull, _) = convex_hull(&points)
            .map_err(|_| no_stone("points nearly in one plane, or hardly any".into()))?;
        let chosen = choose_corners(&points, most);
        let Some(ChosenCorners { corners, stone, .. }) = chosen else {
            return Err(no_stone("a flat or needle-shaped one".into()));
        };
        Ok(Self {
            name: path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            triangles: mesh.triangles.len(),
            mesh_volume: mesh.volume(),
            hull_volume: hull.volume,
            volume: stone.volume,
            descriptors: ShapeDescriptors::of(&stone),
            nominal_diameter: stone.nominal_diameter(),
            corners,
        })
    }

    /// Headings of the columns of a table of stones, after the name.
    pub const COLUMNS: [&str; 7] = [
        "corners",
        "of hull",
        "hull of mesh",
        "elongation",
        "flatness",
        "sphericity",
        "angularity",
    ];

    /// Returns the name and the columns of the stone in a table.
    pub fn cells(&self) -> [String; 8] {
        let percent = |share: f64| format!("{:.1} %", 100.0 * share);
        [
            self.name.clone(),
            self.corners.len().to_string(),
            percent(self.volume / self.hull_volume),
            self.mesh_volume.map_or("not closed".into(), |v| percent(self.hull_volume / v)),
            format!("{:.2}", self.descriptors.elongation()),
            format!("{:.2}", self.descriptors.flatness()),
            format!("{:.2}", self.descriptors.sphericity),
            format!("{:.0}°", self.descriptors.angularity.to_degrees()),
        ]
    }

    /// Returns the stone as TOML that a case can end with, with its descriptors as a comment.
    pub fn toml_text(&self) -> String {
        let ShapeDescriptors { length, width, thickness, sphericity, .. } = self.descriptors;
        let [length, width, thickness] =
            [length, width, thickness].map(|side| side / self.nominal_diameter);
        format!(
            "# {}: {} corners, {:.1} % of the volume of the hull; L, I, S = {length:.2}, {width:.2}, {thickness:.2} \
             nominal diameters, sphericity {sphericity:.2}\n[[bed.grains.stones]]\n{}",
            self.name,
            self.corners.len(),
            100.0 * self.volume / self.hull_volume,
            corners_text(&self.corners),
        )
    }

    /// Converts the stone to JSON.
    pub fn json(&self) -> Value {
        let d = &self.descriptors;
        json!({
            "file": self.name,
            "triangles": self.triangles,
            "mesh_volume": self.mesh_volume,
            "hull_volume": self.hull_volume,
            "volume": self.volume,
            "nominal_diameter": self.nominal_diameter,
            "elongation": d.elongation(),
            "flatness": d.flatness(),
            "sphericity": d.sphericity,
            "angularity_deg": d.angularity.to_degrees(),
            "corners": self.corners.iter().map(|c| [c.x, c.y, c.z]).collect::<Vec<_>>(),
        })
    }
}
