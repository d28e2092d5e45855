//! The commands, one per file.

pub mod bench;
pub mod check;
pub mod completions;
pub mod export;
mod given;
pub mod inspect;
pub mod prepare;
pub mod replay;
pub mod report;
pub mod resume;
pub mod run;
pub mod schema;
pub mod solve;
mod solve_table;
pub mod sweep;
pub mod validate;
pub mod verify;
