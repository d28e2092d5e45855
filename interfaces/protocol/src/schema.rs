//! JSON Schema of the control plane, generated from the types that encode and decode it.

use crate::description::ComponentDescription;
use crate::lockstep::{
    AttachReply, AttachRequest, InitRequest, ParameterUpdate, RequestError, RequestKind,
    RunPosition, StateName, StatusReport,
};
use crate::messages::{AdvanceReply, AdvanceRequest};
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde_json::{Map, Value, json};

/// Request without content: `{}`, or no payload.
#[derive(Debug, Clone, Copy, Default, serde::Serialize, serde::Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EmptyRequest {}

/// Function that generates the schemas of a request and its reply.
type SchemaPair = fn(&mut SchemaGenerator) -> [Schema; 2];

fn pair<Q: JsonSchema, A: JsonSchema>(generator: &mut SchemaGenerator) -> [Schema; 2] {
    [generator.subschema_for::<Q>(), generator.subschema_for::<A>()]
}

/// Returns the schema generator of a request kind.
fn pair_of(kind: RequestKind) -> SchemaPair {
    match kind {
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

/// Returns the JSON Schema (2020-12) of the control plane.
///
/// `$defs` holds `NAME.request` and `NAME.reply` for every request, `refusal` for the reply to a refused one, and
/// the types of their fields.
pub fn control_plane_schema() -> Value {
    let mut generator = SchemaGenerator::default();
    let mut named = Map::new();
    let describe: (&str, SchemaPair) = ("describe", pair::<EmptyRequest, ComponentDescription>);
    let requests = RequestKind::ALL.map(|kind| (kind.name(), pair_of(kind)));
    for (name, pair) in std::iter::once(describe).chain(requests) {
        let [request, reply] = pair(&mut generator);
        named.insert(format!("{name}.request"), request.into());
        named.insert(format!("{name}.reply"), reply.into());
    }
    named.insert("refusal".into(), generator.subschema_for::<RequestError>().into());
    named.extend(generator.take_definitions(true));
    json!({
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Ballast: requests and replies",
        "description": "Validate against $defs/NAME.request, $defs/NAME.reply or $defs/refusal. The reply to `param` without \
                        content is the parameters of `describe`.",
        "$defs": named,
    })
}
