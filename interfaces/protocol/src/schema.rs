//! The JSON Schema of the control plane, made from the same types that read and write it.

use crate::description::Description;
use crate::lockstep::{Attach, Attached, Fault, Init, Named, Place, SetParameters, StatusReport};
use crate::messages::{AdvanceReply, AdvanceRequest};
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde_json::{Map, Value, json};

/// A request without content: `{}`, or no payload at all.
#[derive(Debug, Clone, Copy, Default, serde::Serialize, serde::Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Nothing {}

/// Adds what is asked and what is answered.
type Pair = fn(&mut SchemaGenerator) -> [Schema; 2];

fn pair<Q: JsonSchema, A: JsonSchema>(generator: &mut SchemaGenerator) -> [Schema; 2] {
    [generator.subschema_for::<Q>(), generator.subschema_for::<A>()]
}

/// Every request, and what it is answered with unless it is refused.
const REQUESTS: &[(&str, Pair)] = &[
    ("describe", pair::<Nothing, Description>),
    ("attach", pair::<Attach, Attached>),
    ("init", pair::<Init, Place>),
    ("advance", pair::<AdvanceRequest, AdvanceReply>),
    ("redo", pair::<AdvanceRequest, AdvanceReply>),
    ("save", pair::<Named, Place>),
    ("restore", pair::<Named, Place>),
    ("drop", pair::<Named, Place>),
    ("reset", pair::<Nothing, Place>),
    ("param", pair::<SetParameters, Place>),
    ("status", pair::<Nothing, StatusReport>),
    ("detach", pair::<Nothing, Place>),
    ("shutdown", pair::<Nothing, Place>),
];

/// JSON Schema (2020-12) of the control plane: `$defs` holds `VERB.request` and `VERB.reply` for every request,
/// `refusal` for what a refused one is answered with, and the types that these are made of.
pub fn control_plane() -> Value {
    let mut generator = SchemaGenerator::default();
    let mut named = Map::new();
    for (verb, pair) in REQUESTS {
        let [request, reply] = pair(&mut generator);
        named.insert(format!("{verb}.request"), request.into());
        named.insert(format!("{verb}.reply"), reply.into());
    }
    named.insert("refusal".into(), generator.subschema_for::<Fault>().into());
    named.extend(generator.take_definitions(true));
    json!({
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Ballast: requests and replies",
        "description": "Validate against $defs/VERB.request, $defs/VERB.reply or $defs/refusal. `param` without \
                        content is answered with the parameters of `describe`.",
        "$defs": named,
    })
}
