//! `ballast tool MESH`: convex parts of a tine from a surface mesh.

use super::stones::{check_out, write_out};
use crate::console::Console;
use ballast::math::Vec3;
use ballast_meshes::{MeshTool, PartLimits, ToolPlacement};
use ballast_session::table::TextTable;
use ballast_session::{Failure, Reporter, Result};
use clap::{Args, ValueEnum};
use std::path::PathBuf;

/// First line of a file with the parts of a tool.
const FIRST_LINE: &str = "# Tool of a case, from `ballast tool`.\n";
/// Extents of tines, m, generously.
const TOOL_EXTENTS: std::ops::RangeInclusive<f64> = 0.02..=3.0;

#[derive(Debug, Args)]
pub struct ToolArgs {
    /// Surface mesh of the tool, closed: STL, OBJ or PLY
    #[arg(value_name = "MESH")]
    pub mesh: PathBuf,
    /// Maximum number of convex parts
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=64))]
    pub parts: u32,
    /// Maximum number of corners of a part
    #[arg(long, value_name = "N", default_value_t = 30, value_parser = clap::value_parser!(u32).range(4..=100))]
    pub corners: u32,
    /// Ratio of volume that the parts may add to the mesh before it is cut further
    #[arg(long, value_name = "RATIO", default_value_t = 0.01, value_parser = ratio)]
    pub tolerance: f64,
    /// Unit of the mesh
    #[arg(long, value_name = "UNIT", value_enum, default_value_t = LengthUnit::Mm)]
    pub unit: LengthUnit,
    /// Reference point in the mesh, in its unit: the middle of the blade's upper edge
    #[arg(long, value_name = "X,Y,Z", default_value = "0,0,0", value_parser = point, allow_hyphen_values = true)]
    pub origin: Vec3,
    /// Axis of the mesh along which the tine squeezes, towards its sleeper
    #[arg(long, value_name = "AXIS", value_enum, default_value_t = MeshAxis::PlusX, allow_hyphen_values = true)]
    pub forward: MeshAxis,
    /// Axis of the mesh that points up
    #[arg(long, value_name = "AXIS", value_enum, default_value_t = MeshAxis::PlusZ, allow_hyphen_values = true)]
    pub up: MeshAxis,
    /// File for the parts as TOML, to be appended to a case
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum LengthUnit {
    M,
    Cm,
    Mm,
    In,
}

impl LengthUnit {
    /// Length in m.
    fn length(self) -> f64 {
        match self {
            Self::M => 1.0,
            Self::Cm => 1e-2,
            Self::Mm => 1e-3,
            Self::In => 0.0254,
        }
    }
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum MeshAxis {
    #[value(name = "+x")]
    PlusX,
    #[value(name = "-x")]
    MinusX,
    #[value(name = "+y")]
    PlusY,
    #[value(name = "-y")]
    MinusY,
    #[value(name = "+z")]
    PlusZ,
    #[value(name = "-z")]
    MinusZ,
}

impl MeshAxis {
    fn direction(self) -> Vec3 {
        let k = self as usize;
        Vec3::ith(k / 2, if k.is_multiple_of(2) { 1.0 } else { -1.0 })
    }
}

fn ratio(text: &str) -> Result<f64, String> {
    let ratio = text.parse().ok().filter(|x| (0.0..=1.0).contains(x));
    ratio.ok_or_else(|| "expected a number from 0 to 1".into())
}

fn point(text: &str) -> Result<Vec3, String> {
    let numbers: Vec<f64> = text.split(',').filter_map(|x| x.trim().parse().ok()).collect();
    match numbers[..] {
        [x, y, z] if numbers.iter().all(|x| x.is_finite()) => Ok(Vec3::new(x, y, z)),
        _ => Err("expected three numbers with commas between them".into()),
    }
}

pub fn tool(args: ToolArgs, console: Console) -> Result {
    let [forward, up] = [args.forward, args.up].map(MeshAxis::direction);
    if forward.dot(&up) != 0.0 {
        let text = "--forward and --up: expected two different axes of the mesh, found one";
        return Err(Failure::Usage(text.into()));
    }
    check_out(args.out.as_deref(), "the parts of a tool (TOML)", FIRST_LINE)?;
    let placement = ToolPlacement { unit: args.unit.length(), origin: args.origin, forward, up };
    let limits = PartLimits {
        parts: args.parts as usize,
        corners: args.corners as usize,
        excess_volume: args.tolerance,
    };
    let tool = MeshTool::read(&args.mesh, &placement, &limits)
        .map_err(|e| Failure::Failed(e.to_string()))?;
    let extent = (tool.bounds.high - tool.bounds.low).max();
    if !TOOL_EXTENTS.contains(&extent) {
        console.warning(&format!(
            "{}: expected a tool of {} to {} m, found one of {extent:.3} m; see --unit",
            tool.name,
            TOOL_EXTENTS.start(),
            TOOL_EXTENTS.end()
        ));
    }
    let mut table = TextTable::new("tool", MeshTool::COLUMNS);
    table.row(tool.cells());
    console.event("tool", tool.json());
    console.result(&table.text());
    let toml = format!("{FIRST_LINE}{}", tool.toml_text());
    write_out(args.out.as_deref(), "--out FILE writes the parts for a case", &toml, console)
}
