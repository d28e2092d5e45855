//! Recordings of windows of several steps, in a world without bodies.

use ballast::component::{Component, Limits, WindowInputsRef};
use ballast::model::Solver;
use ballast::state::State;
use ballast::track::plan::Plan;
use ballast_mcap::recording::WindowReader;
use ballast_mcap::verify::{VerificationResult, verify};
use ballast_mcap::{Drive, RecordingMetadata, WindowRecorder};
use ballast_protocol::lockstep::{WindowKind, empty_model};
use ballast_protocol::messages::{AdvanceReply, StateHash};
use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;

fn world() -> Component {
    Component::new(Arc::new(empty_model()), State::default(), Limits::default()).unwrap()
}

/// A case whose steps are solved as those of the world are.
fn plan() -> Plan {
    let mut plan = ballast_scenario::read_case(crate::setup::CASE, "tiny").unwrap().plan;
    plan.run.solver = Solver::default();
    plan.run.output_ns = 0;
    plan
}

fn hash(state: &State) -> StateHash {
    ballast_hdf5::state_hash(&empty_model(), state).into()
}

fn begin(path: &Path, component: &Component) -> ballast_mcap::Result<WindowRecorder> {
    let (model, state) = (component.model(), component.state());
    let names = ["world", "key", ""].map(String::from);
    let meta = RecordingMetadata::of(names, BTreeMap::new(), model, Drive::Inputs, hash(state));
    WindowRecorder::begin(path, &plan(), &meta, model, state, || Err("no checkpoint here"))
}

/// Adds a window of several steps (ns).
fn window(recording: &mut WindowRecorder, component: &mut Component, steps: u64) {
    let t1 = component.now_ns() + steps;
    let outcome = component.advance_to(t1, WindowInputsRef::default()).unwrap();
    let request = recording.request(outcome.t0_ns, outcome.t1_ns, vec![]);
    let (model, state) = (component.shared_model(), component.save());
    let reply = AdvanceReply::of(&request, &model, &outcome, hash(&state));
    recording.window(model, WindowKind::Advance, &request, &reply, state).unwrap();
}

/// Verifies up to a time, ns.
fn verified(path: &Path, stop_ns: u64) -> VerificationResult {
    let mut windows = WindowReader::open(path).unwrap();
    let mut watch =
        |now| if now >= stop_ns { ControlFlow::Break(()) } else { ControlFlow::Continue(()) };
    verify(&mut windows, &mut world(), &[], ballast_hdf5::state_hash, &mut watch).unwrap()
}

#[test]
fn a_recording_that_is_let_go_has_its_last_window_and_is_stopped_within_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let mut component = world();
    let mut recording = begin(&path, &component).unwrap();
    window(&mut recording, &mut component, 10);
    window(&mut recording, &mut component, 100);
    drop(recording);
    assert_eq!(verified(&path, u64::MAX), VerificationResult::Identical { windows: 2 });
    assert_eq!(verified(&path, 10), VerificationResult::Stopped { windows: 1 });
    assert_eq!(verified(&path, 60), VerificationResult::Stopped { windows: 1 });
    assert_eq!(verified(&path, 110), VerificationResult::Stopped { windows: 2 });
}

#[test]
fn a_checkpoint_is_asked_for_where_the_case_does_not_begin() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let mut component = world();
    begin(&path, &component).unwrap().finish().unwrap();
    component.advance_to(5, WindowInputsRef::default()).unwrap();
    let said = begin(&path, &component).err().unwrap().to_string();
    assert_eq!(said, "no checkpoint here");
}
