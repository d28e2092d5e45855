//! Values of a topic with their times, and the check of these times.
//!
//! Contract: stamps are compared with the times of recording. Stamps that go back or jump would move a body where it never
//! was, or for years.

use super::coverage::{MAX_GAP_NS, gap_limit, median};
use ballast_protocol::MessageError;
use std::collections::BTreeSet;

/// Ratio to the usual interval above which an interval of stamps is a jump, unless the recording has it, too.
const JUMP_RATIO: u128 = 10;

/// Value with its times, ns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct StampedValue<T> {
    /// Time of the value.
    pub time_ns: u64,
    /// Time of recording.
    pub log_ns: u64,
    pub value: T,
}

/// Values of a topic, in the order of the file until they are sorted.
#[derive(Debug, Clone)]
pub(super) struct Series<T> {
    /// Topic, or topic and frame of transforms.
    pub source: String,
    /// Frames of the values.
    pub frames: BTreeSet<String>,
    pub samples: Vec<StampedValue<T>>,
}

/// Inserts a name; returns the additional memory in bytes.
pub(super) fn insert_name(names: &mut BTreeSet<String>, name: &str) -> usize {
    if names.contains(name) {
        return 0;
    }
    names.insert(name.into());
    size_of::<String>() + name.len()
}

impl<T> Default for Series<T> {
    fn default() -> Self {
        Self { source: String::new(), frames: BTreeSet::new(), samples: Vec::new() }
    }
}

impl<T: Copy + PartialEq> Series<T> {
    /// Adds a value; returns the additional memory in bytes.
    pub fn push(&mut self, source: &str, frame: &str, sample: StampedValue<T>) -> usize {
        let more = insert_name(&mut self.frames, frame);
        // Repetitions are skipped: a small file may have any number of them.
        let is_same =
            |last: &StampedValue<T>| (last.time_ns, last.value) == (sample.time_ns, sample.value);
        if self.samples.last().is_some_and(is_same) {
            return more;
        }
        if self.samples.is_empty() {
            self.source = source.into();
        }
        self.samples.push(sample);
        more + size_of::<StampedValue<T>>()
    }

    /// Sorts by time, without repetitions; returns warnings about probable errors of the stamps.
    ///
    /// # Errors
    /// Stamps of a clock that was set, and two different values at one time.
    pub fn sort(&mut self) -> Result<Vec<String>, MessageError> {
        let back = self.samples.windows(2).filter(|pair| pair[1].log_ns < pair[0].log_ns).count();
        let unordered = (back > 0).then(|| {
            format!(
                "{}: expected messages in the order of recording, found {back} recorded before the message ahead of them in \
                 the file; they are sorted. If the clock of the recorder was set back, the motion is wrong",
                self.source
            )
        });
        // Of equal messages, such as those sent again to a late subscriber, the first counts.
        self.samples.sort_by_key(|s| (s.time_ns, s.log_ns));
        self.samples.dedup_by(|b, a| (a.time_ns, a.value) == (b.time_ns, b.value));
        self.samples.sort_by_key(|s| (s.log_ns, s.time_ns));
        let late = self.check_order()?;
        self.samples.sort_by_key(|s| s.time_ns);
        if let Some(pair) = self.samples.windows(2).find(|pair| pair[0].time_ns == pair[1].time_ns)
        {
            let place = format!("{}, {} ns", self.source, pair[0].time_ns);
            let found = "two that differ; choose the other times, --time log or --time stamp";
            return Err(MessageError::new(place, "one message at a time", found));
        }
        let jump = self.check_jumps()?;
        Ok([unordered, late, jump].into_iter().flatten().collect())
    }

    /// Returns a warning about single stamps that go back in the order of recording.
    fn check_order(&self) -> Result<Option<String>, MessageError> {
        let mut latest = self.samples.first();
        let (mut count, mut last_late, mut first) = (0, None::<usize>, None);
        for (i, sample) in self.samples.iter().enumerate() {
            let Some(before) = latest.filter(|latest| sample.time_ns < latest.time_ns) else {
                latest = Some(sample);
                continue;
            };
            if let Some(late) =
                last_late.filter(|late| late + 1 == i).map(|late| self.samples[late])
            {
                let expected = format!("{} ns or later, as in the message before", before.time_ns);
                let found = format!(
                    "{} ns, and further messages before that time: a clock was set back; use the times of recording with \
                     --time log",
                    late.time_ns
                );
                return Err(MessageError::new(self.stamp_at(late.log_ns), expected, found));
            }
            count += 1;
            last_late = Some(i);
            first.get_or_insert(sample.log_ns);
        }
        Ok(first.map(|log_ns| {
            format!(
                "{}: expected stamps in the order of recording, found {count} earlier than in the message before, the \
                 first at {log_ns} ns of the recording; messages are sorted by stamp. --time log uses the times of recording",
                self.source
            )
        }))
    }

    /// Returns a warning about the longest jump of the sorted stamps that the times of recording do not have.
    fn check_jumps(&self) -> Result<Option<String>, MessageError> {
        let steps = |time: fn(&StampedValue<T>) -> u64| {
            self.samples.windows(2).map(move |pair| time(&pair[1]).abs_diff(time(&pair[0])))
        };
        let usual = [median(steps(|s| s.time_ns)), median(steps(|s| s.log_ns))];
        let [usual, usual_log] = usual.map(|ns| u128::from(ns.unwrap_or_default()));
        let jumps = self.samples.windows(2).filter(|pair| {
            let time = u128::from(pair[1].time_ns - pair[0].time_ns);
            let log = u128::from(pair[1].log_ns.abs_diff(pair[0].log_ns));
            let is_long = time > u128::from(MAX_GAP_NS) && log < time / JUMP_RATIO;
            // In units of the usual intervals: simulated time may pass at another rate.
            let limit = JUMP_RATIO.saturating_mul(usual).saturating_mul(log.max(usual_log));
            is_long || time.saturating_mul(usual_log) > limit
        });
        let Some([a, b]) =
            jumps.max_by_key(|pair| pair[1].time_ns - pair[0].time_ns).and_then(<[_]>::first_chunk)
        else {
            return Ok(None);
        };
        let (from, to, apart) = (a.time_ns, b.time_ns, b.log_ns.abs_diff(a.log_ns));
        if to - from > MAX_GAP_NS {
            let expected = format!("{} after the stamp before it, {from} ns", gap_limit());
            let found = format!(
                "{to} ns, in messages recorded {apart} ns apart; use the times of recording with --time log, or leave out \
                 messages with a wrong stamp"
            );
            return Err(MessageError::new(self.stamp_at(b.log_ns), expected, found));
        }
        Ok(Some(format!(
            "{}: expected stamps that advance as the times of recording do, found a jump from {from} to {to} ns in messages \
             recorded {apart} ns apart; motions are interpolated between them. --time log uses the times of recording",
            self.source
        )))
    }

    /// Returns the place of the stamp of the message recorded at `log_ns`.
    fn stamp_at(&self, log_ns: u64) -> String {
        format!("{} at {log_ns} ns, stamp", self.source)
    }
}
