//! Time that a motion covers, and its gaps.

use crate::error::{Error, Result};
use ballast::component::Waveform;
use std::path::Path;

/// Ratio to the usual interval of poses above which an interval is a gap.
const GAP_RATIO: u64 = 10;
/// Maximum time without a pose, ns. Nothing is known of the motion within a longer one.
pub(super) const MAX_GAP_NS: u64 = 600_000_000_000;

/// Returns the maximum time without a pose for a message.
pub(super) fn gap_limit() -> String {
    format!("at most {} s", MAX_GAP_NS / 1_000_000_000)
}

/// Returns start and end of the common time of all bodies, ns of the file; zeros without bodies.
///
/// # Errors
/// Bodies without a common time.
pub(super) fn common_time(path: &Path, waveforms: &[(String, Waveform)]) -> Result<[u64; 2]> {
    let firsts = waveforms.iter().filter_map(|(body, w)| Some((w.knots.first()?.time_ns, body)));
    let lasts = waveforms.iter().filter_map(|(body, w)| Some((w.knots.last()?.time_ns, body)));
    let (Some((start, late)), Some((end, early))) = (firsts.max(), lasts.min()) else {
        return Ok([0, 0]);
    };
    if start <= end {
        return Ok([start, end]);
    }
    let found = format!(
        "{late:?} from {start} ns on, and {early:?} up to {end} ns; if these are stamps of different clocks, use the times \
         of recording with --time log"
    );
    Err(Error::unsuitable(path, "times", "a time with poses of all bodies", found))
}

/// Refuses gaps above [`MAX_GAP_NS`] within the common time `start` to `end` (ns of the file) of all bodies.
pub(super) fn check_gaps(
    path: &Path,
    waveforms: &[(String, Waveform)],
    [start, end]: [u64; 2],
) -> Result<()> {
    for (body, waveform) in waveforms {
        let pairs = waveform.knots.windows(2).map(|pair| [pair[0].time_ns, pair[1].time_ns]);
        let mut gaps =
            pairs.filter(|[a, b]| b.min(&end).saturating_sub(*a.max(&start)) > MAX_GAP_NS);
        if let Some(gap) = gaps.next() {
            let [from, to] = gap.map(seconds);
            let expected = format!("{} from pose to pose", gap_limit());
            let found = format!(
                "none from {from} to {to} s of the file; leave out the poses before or after, for example with `mcap filter`"
            );
            return Err(Error::unsuitable(path, format!("poses of {body:?}"), expected, found));
        }
    }
    Ok(())
}

/// Returns notes about the common time `start` to `end` (ns of the file) of all bodies.
pub(super) fn notes(waveforms: &[(String, Waveform)], [start, end]: [u64; 2]) -> Vec<String> {
    let ends = |w: &Waveform| Some([w.knots.first()?.time_ns, w.knots.last()?.time_ns]);
    let spans: Vec<(&str, [u64; 2])> =
        waveforms.iter().filter_map(|(body, w)| Some((&body[..], ends(w)?))).collect();
    let sample = waveforms.iter().filter_map(|(_, w)| median_interval(w)).max().unwrap_or_default();
    let first = spans.iter().map(|(_, [first, _])| *first).min().unwrap_or(start);
    let last = spans.iter().map(|(_, [_, last])| *last).max().unwrap_or(end);
    let bodies_with = |is_one: &dyn Fn(&[u64; 2]) -> bool| {
        let bodies: Vec<&str> =
            spans.iter().filter(|(_, span)| is_one(span)).map(|(body, _)| *body).collect();
        bodies.join(", ")
    };
    let mut notes = Vec::new();
    if start - first > sample {
        let bodies = bodies_with(&|[first, _]| *first == start);
        let [start, first] = [start, first].map(seconds);
        notes.push(format!(
            "the replay begins at {start} s of the file, not at {first} s: before, there is no pose of {bodies}"
        ));
    }
    if last - end > sample {
        let bodies = bodies_with(&|[_, last]| *last == end);
        let [end, last] = [end, last].map(seconds);
        notes.push(format!(
            "the replay ends at {end} s of the file, not at {last} s: after, there is no pose of {bodies}"
        ));
    }
    notes.extend(waveforms.iter().filter_map(|(body, w)| gap(body, w, [start, end])));
    notes
}

/// Returns a note about the longest gap of a body.
fn gap(body: &str, waveform: &Waveform, [start, end]: [u64; 2]) -> Option<String> {
    let usual = median_interval(waveform)?;
    let pairs = waveform.knots.windows(2).map(|pair| [pair[0].time_ns, pair[1].time_ns]);
    let gaps = pairs.filter(|[from, to]| {
        *from < end && *to > start && to - from > GAP_RATIO.saturating_mul(usual)
    });
    let [from, to] = gaps.max_by_key(|[from, to]| to - from)?;
    Some(format!(
        "{body}: no pose from {} to {} s of the file, at its longest; usually there is one every {} s. The motion is \
         interpolated between them",
        seconds(from),
        seconds(to),
        seconds(usual)
    ))
}

/// Returns the median interval of poses, ns; `None` for a single pose.
fn median_interval(waveform: &Waveform) -> Option<u64> {
    median(waveform.knots.windows(2).map(|pair| pair[1].time_ns - pair[0].time_ns))
}

/// Returns the median of some intervals, ns; `None` if there are none.
pub(super) fn median(intervals: impl Iterator<Item = u64>) -> Option<u64> {
    let mut intervals: Vec<u64> = intervals.collect();
    intervals.sort_unstable();
    intervals.get(intervals.len() / 2).copied()
}

/// Formats a time in seconds to the ns, without trailing zeros: times of a file may count from 1970.
fn seconds(ns: u64) -> String {
    let (whole, rest) = (ns / 1_000_000_000, format!("{:09}", ns % 1_000_000_000));
    match rest.trim_end_matches('0') {
        "" => whole.to_string(),
        rest => format!("{whole}.{rest}"),
    }
}
