//! `ballast schema`: JSON Schema of case files, or of the network protocol.

use crate::console::Console;
use ballast_session::{Failure, Reporter, Result};
use serde_json::json;

pub fn schema(protocol: bool, console: Console) -> Result {
    let schema = match protocol {
        true => ballast_protocol::schema::control_plane_schema(),
        false => ballast_scenario::schema(),
    };
    let text = serde_json::to_string_pretty(&schema)
        .map_err(|e| Failure::Failed(format!("cannot write the schema as JSON: {e}")))?;
    console.event("schema", json!({ "schema": schema }));
    console.result(&text);
    Ok(())
}
