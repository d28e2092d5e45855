//! The JSON Schema of the control plane, made from the same types that read and write it.

use crate::description::ComponentDescription;
use crate::lockstep::{
    AttachReply, AttachRequest, InitRequest, ParameterUpdate, RequestError, RequestKind,
    RunPosition, StateName, StatusReport,
};
use crate::messages::{AdvanceReply, AdvanceRequest};
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde_json::{Map, Value, json};

/// A request without content: `{}`, or no payload at all.
#[derive(Debug, Clone, Copy, Default, serde::Serialize, serde::Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EmptyRequest {}

/// Adds what is asked and what is answered.
type Pair = fn(&mut SchemaGenerator) -> [Schema; 2];

fn pair<Q: JsonSchema, A: JsonSchema>(generator: &mut SchemaGenerator) -> [Schema; 2] {
    [generator.subschema_for::<Q>(), generator.subschema_for::<A>()]
}

/// A request, and what it is answered with unless it is refused.
fn pair_of(verb: RequestKind) -> Pair {
    match verb {
        RequestKind::Attach => pair::<AttachRequest, AttachReply>,
        RequestKind::Init => pair::<InitRequest, RunPosition>,
        RequestKind::Window(_) => pair::<AdvanceRequest, AdvanceReply>,
        RequestKind::Save | RequestKind::Restore | RequestKind::Drop => {
            pair::<StateName, RunPosition>
        }
        RequestKind::Param => pair::<ParameterUpdate, RunPosition>,
        RequestKind::Status => pair::<EmptyRequest, StatusReport>,
        RequestKind::Reset | RequestKind::Detach | RequestKind::Shutdown => {
            pair::<EmptyRequest, RunPosition>
        }
    }
}

/// JSON Schema (2020-12) of the control plane: `$defs` holds `VERB.request` and `VERB.reply` for every request,
/// `refusal` for what a refused one is answered with, and the types that these are made of.
pub fn control_plane() -> Value {
    let mut generator = SchemaGenerator::default();
    let mut named = Map::new();
    let describe: (&str, Pair) = ("describe", pair::<EmptyRequest, ComponentDescription>);
    let verbs = RequestKind::ALL.map(|verb| (verb.word(), pair_of(verb)));
    for (verb, pair) in std::iter::once(describe).chain(verbs) {
        let [request, reply] = pair(&mut generator);
        named.insert(format!("{verb}.request"), request.into());
        named.insert(format!("{verb}.reply"), reply.into());
    }
    named.insert("refusal".into(), generator.subschema_for::<RequestError>().into());
    named.extend(generator.take_definitions(true));
    json!({
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Ballast: requests and replies",
        "description": "Validate against $defs/VERB.request, $defs/VERB.reply or $defs/refusal. `param` without \
                        content is answered with the parameters of `describe`.",
        "$defs": named,
    })
}
