//! Which frames poses are told in.
//!
//! Contract: transforms are not put together. Poses in a frame that the file itself places would be those of bodies that
//! do not move with it, so they are refused; a frame of which nothing else is known is taken for the bed's, and named.

use super::knots::Track;
use crate::error::{Error, Result};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// A frame without the slash that older programs begin it with.
fn plain(frame: &str) -> &str {
    frame.trim_start_matches('/')
}

/// Whether a frame is called as the one that all others stand in.
fn is_of_the_bed(frame: &str) -> bool {
    matches!(plain(frame), "" | "world" | "map")
}

/// Refuses poses in a frame that is placed in another one; `placed` has the frames that transforms lead to, each as
/// `TOPIC:FRAME`.
pub(super) fn expect_still(
    path: &Path,
    tracks: &BTreeMap<String, Track>,
    placed: &BTreeSet<String>,
) -> Result<()> {
    let placed: BTreeMap<&str, &str> =
        placed.iter().filter_map(|f| f.split_once(':')).map(|(t, f)| (plain(f), t)).collect();
    for (body, track) in tracks {
        for frame in track.pose_frames.iter().filter(|frame| !is_of_the_bed(frame)) {
            let Some(topic) = placed.get(plain(frame)) else { continue };
            let expected = "some in the frame of the bed, since transforms are not put together (docs/src/guide/recordings.md \
                            tells how to bring them there)";
            let found = format!("some in the frame {frame:?}, which {topic} places in another one");
            return Err(Error::unsuitable(path, format!("poses of {body:?}"), expected, found));
        }
    }
    Ok(())
}

/// Frames that may be others than the bed's.
pub(super) fn notes(tracks: &BTreeMap<String, Track>) -> Vec<String> {
    let mut told: BTreeMap<(&str, &str), Vec<&str>> = BTreeMap::new();
    for (body, track) in tracks {
        for frame in track.pose_frames.iter().filter(|frame| !is_of_the_bed(frame)) {
            told.entry(("poses", frame)).or_default().push(body);
        }
        // Of one frame with the poses, they need no word of their own.
        let others = track.twist_frames.difference(&track.pose_frames);
        for frame in others.filter(|frame| !is_of_the_bed(frame)) {
            told.entry(("twists", frame)).or_default().push(body);
        }
    }
    let note = |((what, frame), bodies): ((&str, &str), Vec<&str>)| {
        format!(
            "{what} in the frame {frame:?} are taken as if in that of the bed: of {}",
            bodies.join(", ")
        )
    };
    told.into_iter().map(note).collect()
}
