//! Verification of a recording: recomputes its windows and compares all messages.

use crate::error::{Error, Result};
use crate::messages::McapMessage;
use crate::recording::{RecordedWindow, WindowReader};
use crate::window;
use ballast::component::{self, Component, Refusal, StepCallback, StopReason, WindowResult};
use ballast::model::Model;
use ballast::observe::Zone;
use ballast::state::State;
use ballast::step::StepReport;
use ballast_protocol::TopicMessage;
use ballast_protocol::messages::{AdvanceReply, StateHash, decode_to_json};
use ballast_protocol::topics::{self, zone_topic};
use serde_json::Value;
use std::ops::ControlFlow;

/// Function that returns the hash of model and state.
pub type HashFn = fn(&Model, &State) -> u128;

/// First difference between a recording and its recomputation.
#[derive(Debug, Clone, PartialEq)]
pub struct Difference {
    /// Number of the window; 0 for the start.
    pub seq: u64,
    /// Step at the end of the window.
    pub step: u64,
    /// Time at the end of the window, ns.
    pub time_ns: u64,
    /// Topic of the message.
    pub topic: String,
    /// Path of the field; empty for the whole message.
    pub field: String,
    /// Recorded value.
    pub recorded: String,
    /// Computed value.
    pub computed: String,
}

impl std::fmt::Display for Difference {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { seq, step, time_ns, topic, field, recorded, computed } = self;
        let field = if field.is_empty() { String::new() } else { format!(", {field}") };
        write!(
            f,
            "window {seq}, step {step} at {time_ns} ns, {topic}{field}: recorded {recorded}, \
             computed {computed}"
        )
    }
}

/// Result of a verification.
#[derive(Debug, Clone, PartialEq)]
pub enum VerificationResult {
    /// All windows are identical.
    Identical {
        /// Number of windows.
        windows: u64,
    },
    /// A window differs.
    Different(Box<Difference>),
    /// The caller stopped the verification.
    Stopped {
        /// Number of identical windows until then.
        windows: u64,
    },
}

/// Recomputes the windows of a recording with a component at the recording's start, and compares them.
///
/// Of the `zones` of the case, those in the recording are measured. `watch` receives the time (ns) after
/// each step and each window, and may stop the verification.
///
/// # Errors
/// A file or window that cannot be read.
pub fn verify(
    windows: &mut WindowReader,
    component: &mut Component,
    zones: &[Zone],
    hash: HashFn,
    watch: &mut (dyn FnMut(u64) -> ControlFlow<()> + Send),
) -> Result<VerificationResult> {
    let start = StateHash::from(hash(component.model(), component.state()));
    let recorded = windows.meta().initial_hash;
    if start != recorded {
        let texts = [recorded.to_string(), start.to_string()];
        return Ok(different(0, component.state(), "metadata", "initial_hash", texts));
    }
    let mut count = 0;
    let refused = |windows: &WindowReader, e| Error::Refused(e, windows.path().into());
    // Messages before a window: for the first one, those of the recording's start.
    let mut start = topics::start_messages(component.model(), component.state())
        .map_err(|e| refused(windows, e))?;
    while let Some(window) = windows.next()? {
        let seq = window.record.seq;
        if let Some((topic, [field, recorded, computed])) = compare(&window.before, &start) {
            let texts = [recorded, computed];
            return Ok(different(seq.saturating_sub(1), component.state(), &topic, &field, texts));
        }
        start.clear();
        let mut outcome = match advance(&window, component, watch) {
            Ok(outcome) => outcome,
            Err(WindowStop::Stopped) => return Ok(VerificationResult::Stopped { windows: count }),
            Err(WindowStop::Refused(refusal)) => {
                let texts = ["a computed window".into(), format!("refused: {refusal}")];
                return Ok(different(seq, component.state(), window::STEP, "request", texts));
            }
        };
        let reply = reply(&window, component, zones, hash, &mut outcome);
        let entries = window::window_messages(
            component.model(),
            component.state(),
            &window.record.request,
            &reply,
        )
        .map_err(|e| refused(windows, e))?;
        if let Some((topic, [field, recorded, computed])) = compare(&window.messages, &entries) {
            let texts = [recorded, computed];
            return Ok(different(seq, component.state(), &topic, &field, texts));
        }
        count += 1;
        if watch(component.now_ns()).is_break() {
            return Ok(VerificationResult::Stopped { windows: count });
        }
    }
    Ok(VerificationResult::Identical { windows: count })
}

fn different(
    seq: u64,
    state: &State,
    topic: &str,
    field: &str,
    texts: [String; 2],
) -> VerificationResult {
    let [recorded, computed] = texts;
    let (topic, field) = (topic.into(), field.into());
    let (step, time_ns) = (state.step, state.time_ns);
    VerificationResult::Different(Box::new(Difference {
        seq,
        step,
        time_ns,
        topic,
        field,
        recorded,
        computed,
    }))
}

/// Reason of a window that was not computed to its end.
enum WindowStop {
    /// The caller stopped it.
    Stopped,
    /// The component refused it, with this message.
    Refused(String),
}

fn advance(
    window: &RecordedWindow,
    component: &mut Component,
    watch: &mut (dyn FnMut(u64) -> ControlFlow<()> + Send),
) -> std::result::Result<WindowResult, WindowStop> {
    let refused = |e: &dyn std::fmt::Display| WindowStop::Refused(e.to_string());
    if let Some(set) = window.parameters {
        component.set_parameters(&set.into()).map_err(|e| refused(&e))?;
    }
    let asked = window.record.request.inputs().map_err(|e| refused(&e))?;
    let inputs = component::WindowInputsRef { motions: &asked.motions, loads: &asked.loads };
    let mut observe = StepCallback(|state: &State, _: &StepReport| {
        // A window may be long; one that is complete is compared.
        match watch(state.time_ns) {
            ControlFlow::Break(()) if state.time_ns < asked.t1_ns => {
                ControlFlow::Break(StopReason::Cancel)
            }
            _ => ControlFlow::Continue(()),
        }
    });
    component.advance_observed(asked.t1_ns, inputs, &mut observe).map_err(|e| match e {
        Refusal::Cancelled => WindowStop::Stopped,
        other => refused(&other),
    })
}

/// Returns the reply, with the zones that the recording has.
fn reply(
    window: &RecordedWindow,
    component: &Component,
    zones: &[Zone],
    hash: HashFn,
    outcome: &mut WindowResult,
) -> AdvanceReply {
    let (model, state) = (component.model(), component.state());
    let is_recorded = |zone: &&Zone| {
        let topic = zone_topic(&zone.name);
        window.messages.iter().any(|m| m.channel.topic == topic)
    };
    let zones: Vec<Zone> = zones.iter().filter(is_recorded).cloned().collect();
    outcome.zones = component::measure_zones(model, state, &zones);
    AdvanceReply::of(&window.record.request, model, outcome, hash(model, state).into())
}

/// Returns topic, field, recorded and computed value of the first difference, or of the first message without a computed
/// counterpart.
fn compare(recorded: &[McapMessage], computed: &[TopicMessage]) -> Option<(String, [String; 3])> {
    let mut rest: Vec<&McapMessage> = recorded.iter().collect();
    for entry in computed {
        let place = rest.iter().position(|m| m.channel.topic == entry.topic);
        let Some(message) = place.map(|i| rest.remove(i)) else {
            let texts = ["message".into(), "none".into(), "one".into()];
            return Some((entry.topic.clone(), texts));
        };
        if message.data != entry.bytes || message.channel.schema != entry.kind {
            return Some((entry.topic.clone(), field(message, entry)));
        }
    }
    let more = rest.first()?;
    Some((more.channel.topic.clone(), ["message".into(), "one".into(), "none".into()]))
}

fn field(message: &McapMessage, entry: &TopicMessage) -> [String; 3] {
    if message.channel.schema != entry.kind {
        return ["type".into(), message.channel.schema.clone(), entry.kind.into()];
    }
    let values = [&message.data, &entry.bytes].map(|bytes| decode_to_json(entry.kind, bytes));
    match values {
        [Ok(recorded), Ok(computed)] => first_difference(&recorded, &computed, String::new())
            .unwrap_or_else(|| ["bytes".into(), "other bytes".into(), "equal values".into()]),
        [Err(e), _] | [_, Err(e)] => ["message".into(), format!("unreadable: {e}"), "one".into()],
    }
}

/// Returns the path of the first different leaf, and both leaves.
fn first_difference(a: &Value, b: &Value, path: String) -> Option<[String; 3]> {
    match (a, b) {
        (Value::Object(x), Value::Object(y)) if x.len() == y.len() => {
            x.iter().find_map(|(k, v)| {
                let below = if path.is_empty() { k.clone() } else { format!("{path}.{k}") };
                first_difference(v, y.get(k).unwrap_or(&Value::Null), below)
            })
        }
        (Value::Array(x), Value::Array(y)) if x.len() == y.len() => x
            .iter()
            .zip(y)
            .enumerate()
            .find_map(|(i, (v, w))| first_difference(v, w, format!("{path}[{i}]"))),
        _ => {
            // Compares texts, because zeros of opposite sign are equal as numbers.
            let texts = [a.to_string(), b.to_string()];
            let [recorded, computed] = &texts;
            (recorded != computed).then(|| [path, recorded.clone(), computed.clone()])
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn the_first_different_leaf_is_found() {
        let a = json!({"x": {"y": [1.0, {"z": 2.5}]}, "w": 0.0});
        let changed = |pointer: &str, value: Value| {
            let mut b = a.clone();
            *b.pointer_mut(pointer).unwrap() = value;
            first_difference(&a, &b, String::new()).map(|[path, ..]| path)
        };
        assert_eq!(changed("/x/y/0", json!(1.0)), None);
        assert_eq!(changed("/x/y/1/z", json!(2.25)).unwrap(), "x.y[1].z");
        assert_eq!(changed("/w", json!(-0.0)).unwrap(), "w");
        assert_eq!(changed("/x/y", json!([1.0])).unwrap(), "x.y");
    }
}
