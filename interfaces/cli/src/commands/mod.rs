//! Commands of the program, one per file.

pub mod bench;
pub mod check;
pub mod completions;
mod expected_file;
pub mod export;
pub mod inspect;
pub mod prepare;
pub mod probe;
pub mod replay;
pub mod report;
pub mod resume;
pub mod run;
pub mod schema;
pub mod solve;
mod solve_table;
pub mod stones;
pub mod sweep;
pub mod tool;
pub mod validate;
pub mod verify;
