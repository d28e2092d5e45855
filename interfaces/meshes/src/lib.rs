//! Stones and tools of a case from surface meshes.
//!
//! [`TriangleMesh`] reads STL, OBJ and PLY. [`MeshStone`] is the convex stone of a mesh with at most a given number of corners, and
//! writes itself as a stone of a case. [`MeshTool`] is a tool of several convex parts, and writes itself as the parts of a tine.

mod corners;
mod decomposition;
mod deviation;
mod mesh_stone;
mod mesh_tool;
mod triangle_mesh;

pub use mesh_stone::MeshStone;
pub use mesh_tool::{MeshTool, PartLimits, ToolPlacement};
pub use triangle_mesh::TriangleMesh;

use std::path::PathBuf;

/// Error of a mesh that cannot be read or makes no stone or tool.
#[derive(Debug, thiserror::Error)]
pub enum MeshError {
    /// A file that cannot be opened.
    #[error("{}: {source}", path.display())]
    Open {
        /// The file.
        path: PathBuf,
        /// Reason of the system.
        source: std::io::Error,
    },
    /// A file of another format, or with damaged content.
    #[error("{}: expected {expected}, found {found}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// Expected content.
        expected: String,
        /// Found content.
        found: String,
    },
}
