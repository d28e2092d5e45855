//! Notes about the time that a motion covers, and about gaps.

use ballast::component::Waveform;

/// Ratio to the usual interval of poses above which an interval is a gap.
const GAP_RATIO: u64 = 10;

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
    let pairs = waveform.knots.windows(2);
    let mut distances: Vec<u64> = pairs.map(|pair| pair[1].time_ns - pair[0].time_ns).collect();
    distances.sort_unstable();
    distances.get(distances.len() / 2).copied()
}

/// Formats a time in seconds to the ns, without trailing zeros: times of a file may count from 1970.
fn seconds(ns: u64) -> String {
    let (whole, rest) = (ns / 1_000_000_000, format!("{:09}", ns % 1_000_000_000));
    match rest.trim_end_matches('0') {
        "" => whole.to_string(),
        rest => format!("{whole}.{rest}"),
    }
}
