//! What a motion leaves out of the file, and what it bridges.

use ballast::component::Waveform;

/// Times the usual distance of poses, from which on a longer one is called a gap.
const GAP: u64 = 10;

/// Notes about the stretch `start` to `end` (ns of the file) that all bodies have in common.
pub(super) fn notes(waveforms: &[(String, Waveform)], [start, end]: [u64; 2]) -> Vec<String> {
    let ends = |w: &Waveform| Some([w.knots.first()?.time_ns, w.knots.last()?.time_ns]);
    let spans: Vec<(&str, [u64; 2])> =
        waveforms.iter().filter_map(|(body, w)| Some((&body[..], ends(w)?))).collect();
    let sample = waveforms.iter().filter_map(|(_, w)| usual_distance(w)).max().unwrap_or_default();
    let first = spans.iter().map(|(_, [first, _])| *first).min().unwrap_or(start);
    let last = spans.iter().map(|(_, [_, last])| *last).max().unwrap_or(end);
    let of = |is_one: &dyn Fn(&[u64; 2]) -> bool| {
        let bodies: Vec<&str> =
            spans.iter().filter(|(_, span)| is_one(span)).map(|(body, _)| *body).collect();
        bodies.join(", ")
    };
    let mut notes = Vec::new();
    if start - first > sample {
        let bodies = of(&|[first, _]| *first == start);
        let [start, first] = [start, first].map(seconds);
        notes.push(format!(
            "the replay begins at {start} s of the file, not at {first} s: before, there is no pose of {bodies}"
        ));
    }
    if last - end > sample {
        let bodies = of(&|[_, last]| *last == end);
        let [end, last] = [end, last].map(seconds);
        notes.push(format!(
            "the replay ends at {end} s of the file, not at {last} s: after, there is no pose of {bodies}"
        ));
    }
    notes.extend(waveforms.iter().filter_map(|(body, w)| gap(body, w, [start, end])));
    notes
}

/// The longest stretch without a pose, where it is out of proportion.
fn gap(body: &str, waveform: &Waveform, [start, end]: [u64; 2]) -> Option<String> {
    let usual = usual_distance(waveform)?;
    let pairs = waveform.knots.windows(2).map(|pair| [pair[0].time_ns, pair[1].time_ns]);
    let gaps = pairs
        .filter(|[from, to]| *from < end && *to > start && to - from > GAP.saturating_mul(usual));
    let [from, to] = gaps.max_by_key(|[from, to]| to - from)?;
    Some(format!(
        "{body}: no pose from {} to {} s of the file, at its longest; usually there is one every {} s. The motion goes \
         on from one to the other",
        seconds(from),
        seconds(to),
        seconds(usual)
    ))
}

/// The median distance in time of neighbours, ns; none of a single pose.
fn usual_distance(waveform: &Waveform) -> Option<u64> {
    let pairs = waveform.knots.windows(2);
    let mut distances: Vec<u64> = pairs.map(|pair| pair[1].time_ns - pair[0].time_ns).collect();
    distances.sort_unstable();
    distances.get(distances.len() / 2).copied()
}

/// To the ns, without zeros that say nothing: times of a file may count from 1970.
fn seconds(ns: u64) -> String {
    let (whole, rest) = (ns / 1_000_000_000, format!("{:09}", ns % 1_000_000_000));
    match rest.trim_end_matches('0') {
        "" => whole.to_string(),
        rest => format!("{whole}.{rest}"),
    }
}
