//! `ballast stones MESH...`: stones of a case from surface meshes.

use crate::console::Console;
use ballast_meshes::MeshStone;
use ballast_session::files::{begins_with, check_replaceable, replace_text};
use ballast_session::table::TextTable;
use ballast_session::{Failure, Reporter, Result};
use clap::Args;
use std::path::{Path, PathBuf};

/// First line of a file with stones.
const FIRST_LINE: &str = "# Stones of a case, from `ballast stones`.\n";

#[derive(Debug, Args)]
pub struct StonesArgs {
    /// Surface meshes, one stone each: STL, OBJ or PLY
    #[arg(required = true, value_name = "MESH")]
    pub meshes: Vec<PathBuf>,
    /// Maximum number of corners of a stone
    #[arg(long, value_name = "N", default_value_t = 30, value_parser = clap::value_parser!(u32).range(4..=100))]
    pub corners: u32,
    /// File for the stones as TOML, to be appended to a case
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
}

pub fn stones(args: StonesArgs, console: Console) -> Result {
    check_out(args.out.as_deref(), "stones of a case (TOML)", FIRST_LINE)?;
    let mut table = TextTable::new("stone", MeshStone::COLUMNS);
    let mut toml = FIRST_LINE.to_string();
    for path in &args.meshes {
        let stone = MeshStone::read(path, args.corners as usize)
            .map_err(|e| Failure::Failed(e.to_string()))?;
        table.row(stone.cells());
        console.event("stone", stone.json());
        toml += &stone.toml_text();
    }
    console.result(&table.text());
    write_out(args.out.as_deref(), "--out FILE writes the stones for a case", &toml, console)
}

/// Refuses to replace a file that does not begin with `first_line`.
pub(super) fn check_out(out: Option<&Path>, what: &str, first_line: &str) -> Result {
    let Some(out) = out else { return Ok(()) };
    let is_replaceable = || begins_with(out, first_line.as_bytes());
    check_replaceable(out, what, is_replaceable).map_err(|e| Failure::at(out, e))
}

/// Writes a piece of a case to `out`; without a file, prints the `hint`.
pub(super) fn write_out(out: Option<&Path>, hint: &str, toml: &str, console: Console) -> Result {
    match out {
        Some(out) => {
            replace_text(out, toml)?;
            console.result(&out.display().to_string());
        }
        None => console.note(hint),
    }
    Ok(())
}
