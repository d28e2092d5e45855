//! Frames of poses and twists.
//!
//! Contract: transforms are not composed. Poses in a frame that the file places in another one are refused; an unknown
//! frame is treated as that of the bed, with a note.

use super::track::PoseTrack;
use crate::error::{Error, Result};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Returns a frame without the leading slash of older programs.
fn plain(frame: &str) -> &str {
    frame.trim_start_matches('/')
}

/// True for the names of the bed's frame.
fn is_bed_frame(frame: &str) -> bool {
    matches!(plain(frame), "" | "world" | "map")
}

/// Refuses poses in a frame that is placed in another one; `placed` has the frames that transforms lead to, each as
/// `TOPIC:FRAME`.
pub(super) fn check_fixed(
    path: &Path,
    tracks: &BTreeMap<String, PoseTrack>,
    placed: &BTreeSet<String>,
) -> Result<()> {
    let placed: BTreeMap<&str, &str> =
        placed.iter().filter_map(|f| f.split_once(':')).map(|(t, f)| (plain(f), t)).collect();
    for (body, track) in tracks {
        for frame in track.poses.frames.iter().filter(|frame| !is_bed_frame(frame)) {
            let Some(topic) = placed.get(plain(frame)) else { continue };
            let expected = "some in the frame of the bed, because transforms are not composed (docs/src/guide/recordings.md \
                            explains the conversion)";
            let found = format!("some in the frame {frame:?}, which {topic} places in another one");
            return Err(Error::unsuitable(path, format!("poses of {body:?}"), expected, found));
        }
    }
    Ok(())
}

/// Returns notes about frames that may differ from the bed's.
pub(super) fn notes(tracks: &BTreeMap<String, PoseTrack>) -> Vec<String> {
    let mut bodies_by_frame: BTreeMap<(&str, &str), Vec<&str>> = BTreeMap::new();
    for (body, track) in tracks {
        for frame in track.poses.frames.iter().filter(|frame| !is_bed_frame(frame)) {
            bodies_by_frame.entry(("poses", frame)).or_default().push(body);
        }
        // Twists in the frame of the poses need no separate note.
        let others = track.twists.frames.difference(&track.poses.frames);
        for frame in others.filter(|frame| !is_bed_frame(frame)) {
            bodies_by_frame.entry(("twists", frame)).or_default().push(body);
        }
    }
    let note = |((what, frame), bodies): ((&str, &str), Vec<&str>)| {
        format!(
            "{what} in the frame {frame:?} are taken as if in that of the bed: of {}",
            bodies.join(", ")
        )
    };
    bodies_by_frame.into_iter().map(note).collect()
}
