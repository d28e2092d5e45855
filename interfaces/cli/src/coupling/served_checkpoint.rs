//! Checkpoints of a served run: state, number of the last window, and what that was answered.

use crate::case::{self, Case, CaseOverrides, RUN_ID};
use ballast::component::Parameters;
use ballast_hdf5::checkpoint::{self, Checkpoint};
use ballast_protocol::lockstep::{Lockstep, ResumeInfo, SavedState};
use ballast_protocol::messages::{AdvanceReply, Digest};
use ballast_protocol::{from_cdr, to_cdr};
use ballast_session::{Failure, Result};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;

const SEQ: &str = "seq";
/// Limit of the penetration, m; parameters of the solver are in the model.
const PENETRATION: &str = "penetration";
/// Fingerprint of the last window's request, and its reply: CDR, in hexadecimal digits.
const REQUEST: &str = "answered_request";
const REPLY: &str = "answered_reply";
/// There where other parameters were set since that reply.
const OUTDATED: &str = "answered_under_other_parameters";
/// The client that has driven last, and how many have one after another.
const CLIENT: &str = "last_client";
const OWNERS: &str = "owners";

/// Writes the checkpoint of a run.
pub fn write(path: &Path, case: &Case, lockstep: &Lockstep) -> Result {
    Ok(checkpoint::write(path, &of(path, case, lockstep)?)?)
}

/// Returns the bytes of the checkpoint of a run, for the recording at `path`.
pub fn bytes(path: &Path, case: &Case, lockstep: &Lockstep) -> Result<Vec<u8>> {
    Ok(checkpoint::to_bytes(path, &of(path, case, lockstep)?)?)
}

fn of(path: &Path, case: &Case, lockstep: &Lockstep) -> Result<Checkpoint> {
    let component = lockstep.component();
    let place = lockstep.position();
    let mut extra = BTreeMap::from([(RUN_ID.into(), place.run_id)]);
    extra.insert(SEQ.into(), place.seq.to_string());
    extra.insert(PENETRATION.into(), component.parameters().penetration.to_string());
    let memory = lockstep.resume_info();
    extra.insert(CLIENT.into(), memory.last_client);
    extra.insert(OWNERS.into(), memory.owner_count.to_string());
    if memory.is_outdated {
        extra.insert(OUTDATED.into(), true.to_string());
    }
    if let Some((request, reply)) = memory.answered {
        let bytes = to_cdr(&reply).map_err(|e| Failure::at(path, e))?;
        extra.insert(REQUEST.into(), request.to_string());
        extra.insert(REPLY.into(), bytes.iter().map(|b| format!("{b:02x}")).collect());
    }
    Ok(case.checkpoint(component.model(), component.state(), extra))
}

/// Returns a description of the run of a checkpoint; `None` if it is of no served run.
pub fn name(path: &Path) -> Result<Option<String>> {
    let saved = checkpoint::read(path)?;
    let seq = saved.extra.get(SEQ).cloned().unwrap_or_default();
    Ok(saved.extra.get(RUN_ID).map(|run| format!("run {run} after window {seq}")))
}

/// Takes a run up where its checkpoint was written; `lockstep` is at the beginning of the case as it is now.
pub fn resume(path: &Path, lockstep: &mut Lockstep) -> Result {
    let saved = checkpoint::read(path)?;
    let notes = &saved.extra;
    let note = |key: &str| {
        let missing =
            || Failure::at(path, format!("expected a served run's, with {key}, found none"));
        notes.get(key).ok_or_else(missing)
    };
    let (run_id, seq) = (note(RUN_ID)?, note(SEQ)?);
    let no_number = |key: &str, found: &str| {
        Failure::at(path, format!("{key}: expected a number, found {found:?}"))
    };
    let seq = seq.parse().map_err(|_| no_number(SEQ, seq))?;
    let penetration = note(PENETRATION)?;
    let penetration = penetration.parse().map_err(|_| no_number(PENETRATION, penetration))?;
    if !Parameters::are_only_difference(lockstep.component().model(), &saved.model) {
        let what = "expected a run of this case, bed and solver, found one of another; start over with --force";
        return Err(Failure::at(path, what));
    }
    let owners = note(OWNERS)?;
    let memory = ResumeInfo {
        answered: answered(notes).map_err(|e| Failure::at(path, e))?,
        is_outdated: notes.contains_key(OUTDATED),
        last_client: note(CLIENT)?.clone(),
        owner_count: owners.parse().map_err(|_| no_number(OWNERS, owners))?,
    };
    let solver = &saved.model.solver;
    let (iterations, tolerance) = (solver.max_iterations, solver.tolerance);
    let parameters = Parameters { iterations, tolerance, penetration };
    let saved = SavedState { state: saved.state.into(), parameters };
    let result = lockstep.resume(run_id.clone(), seq, saved, memory);
    result.map_err(|e| Failure::at(path, e))
}

fn answered(notes: &BTreeMap<String, String>) -> Result<Option<(Digest, AdvanceReply)>, String> {
    let (Some(request), Some(reply)) = (notes.get(REQUEST), notes.get(REPLY)) else {
        return Ok(None);
    };
    let request = serde_json::from_value(Value::String(request.clone()));
    let request: Digest = request.map_err(|e| format!("{REQUEST}: {e}"))?;
    let bytes = hexadecimal(reply)
        .ok_or_else(|| format!("{REPLY}: expected hexadecimal digits, found others"))?;
    let reply = from_cdr(&bytes).map_err(|e| format!("{REPLY}: {e}"))?;
    Ok(Some((request, reply)))
}

fn hexadecimal(text: &str) -> Option<Vec<u8>> {
    let pairs = text.as_bytes().chunks(2);
    let byte = |pair: &[u8]| u8::from_str_radix(std::str::from_utf8(pair).ok()?, 16).ok();
    pairs.map(|pair| (pair.len() == 2).then(|| byte(pair)).flatten()).collect()
}

/// Checks that the folder may be written to: that it holds no run that would be lost.
///
/// # Errors
/// A run or an unreadable checkpoint in the folder, without `force`.
pub fn check_free(path: &Path, force: bool) -> Result {
    if force || !path.exists() {
        return Ok(());
    }
    let (held, ways) = match name(path) {
        Ok(Some(run)) => (run, "continue with --resume, start over"),
        Ok(None) => ("a run of `ballast run`".into(), "start over"),
        Err(e) => (format!("a checkpoint that cannot be read ({e})"), "start over"),
    };
    Err(Failure::Usage(format!(
        "{} holds {held}; {ways} with --force, or take another folder with --out",
        path.display()
    )))
}

/// A name for a new run.
pub fn fresh_run() -> Result<String> {
    Ok(format!("run-{}", &ballast_zenoh::random()?[..16]))
}

/// The case as the run of a checkpoint has it: with what is given of schedule and seed, and the rest as it was.
///
/// Refuses another case. Its model may be the same, since zones and squeezes are in none; comments may differ.
pub fn of_the_run(path: &Path, case: Case, given: CaseOverrides) -> Result<Case> {
    let saved = checkpoint::read(path)?;
    let case = case.with_overrides(given.or(CaseOverrides::from_notes(&saved.extra)?));
    let was = Case::parse(saved.case_text, &format!("{}, its case", path.display()))?;
    let was = was.with_overrides(case.overrides);
    if was.plan == case.plan {
        return Ok(case);
    }
    let line = case::first_other_line(&was.text, &case.text).unwrap_or_default();
    let what =
        format!("expected the case of its run, found another: {line}; start over with --force");
    Err(Failure::at(path, what))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answers_survive_a_checkpoint() {
        assert_eq!(hexadecimal("00ff1a"), Some(vec![0, 255, 26]));
        assert_eq!(
            (hexadecimal("0"), hexadecimal("zz"), hexadecimal("+1")),
            (None, None, Some(vec![1]))
        );
        assert_eq!(answered(&BTreeMap::new()), Ok(None));
        let reply = AdvanceReply { seq: 7, code: "ü".into(), ..AdvanceReply::default() };
        let hex = to_cdr(&reply).unwrap().iter().map(|b| format!("{b:02x}")).collect::<String>();
        let digest = Digest::of(b"request");
        let mut notes =
            BTreeMap::from([(REQUEST.to_string(), digest.to_string()), (REPLY.into(), hex)]);
        assert_eq!(answered(&notes), Ok(Some((digest, reply))));
        for (key, bad) in [(REPLY, "00"), (REPLY, "x"), (REQUEST, "12")] {
            let good = notes.insert(key.into(), bad.into()).unwrap();
            assert!(answered(&notes).unwrap_err().contains(key));
            notes.insert(key.into(), good);
        }
    }
}
