//! `ballast schema`: the JSON Schema of case files, for editors; or of what is said over a network, for partners.

use crate::console::write_out;
use crate::exit::{Failure, Outcome};

pub fn schema(protocol: bool) -> Outcome {
    let schema = match protocol {
        true => ballast_protocol::schema::control_plane(),
        false => ballast_scenario::schema(),
    };
    let text = serde_json::to_string_pretty(&schema)
        .map_err(|e| Failure::Failed(format!("the schema cannot be written as JSON: {e}")))?;
    write_out(&text);
    Ok(())
}
