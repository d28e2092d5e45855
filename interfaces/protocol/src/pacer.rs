//! Real-time mode: simulated time follows the wall clock, and bodies follow motion samples that arrive meanwhile.
//!
//! Reads: motion samples and the wall clock. Writes: nothing; it decides which window to compute next and with which
//! inputs. It has no transport and reads no clock.
//!
//! Contract:
//! * Sample times are those of the sender's clock, ns at the pace of the run; only differences count. The first sample
//!   is mapped to the current time plus the latency, later ones keep their distance to it. Jitter below the latency
//!   has no effect.
//! * Nothing is extrapolated. A window waits for the samples that cover it. Time pauses when a body has sent no sample
//!   for longer than the maximum age, and resumes when all bodies send again. The next sample is then mapped to the
//!   current time plus the latency, and the motion starts from the current pose.
//! * A run that falls behind by more than a limit restarts from the current samples and counts an overrun.
//! * Samples that would end the run are rejected: too far ahead in time, or too far away for the body.
//! * Memory is bounded: samples that are too many, out of order or rejected are dropped and counted.

mod motion_limit;

use crate::lockstep::{ComponentState, ErrorCode, RequestError, StatusReport};
use crate::messages::{BodyMotion, MotionKnot, ns};
use crate::real_time::{RealTimeMode, RealTimeStatus};
use ballast::component::{self, Component};
use motion_limit::SampleMotionLimit;
use std::collections::VecDeque;

/// Maximum number of queued samples per body.
pub const MAX_SAMPLES_PER_BODY: usize = 4096;
/// Maximum window and latency, simulated ns.
const MAX_DURATION_NS: u64 = 60_000_000_000;
/// Maximum setting of the sample age, wall ms.
const MAX_SAMPLE_AGE_MS: u64 = 3_600_000;
/// Maximum real-time factor.
const MAX_REAL_TIME_FACTOR: f64 = 1000.0;

/// Next action of the computing thread.
#[derive(Debug, Clone, PartialEq)]
pub enum NextAction {
    /// Compute the window from the current time to `t1_ns`.
    Compute {
        /// End of the window, ns.
        t1_ns: u64,
        /// Motions of the bodies.
        motions: Vec<BodyMotion>,
    },
    /// Wait until this wall time, ns, or until a sample arrives.
    WaitUntil(u64),
    /// Wait until samples arrive.
    WaitForSamples,
}

/// Scheduler of the real-time mode: queues samples and decides when to compute a window.
#[derive(Debug, Clone, PartialEq)]
pub struct Pacer {
    settings: RealTimeMode,
    tracks: Vec<SampleTrack>,
    /// Simulated time, ns.
    now_ns: u64,
    /// Simulated time minus sender's time, ns; `None` before the first sample.
    offset: Option<i64>,
    /// Wall time at which the offset was set, ns, while time is paused.
    offset_set_at: Option<u64>,
    /// Simulated and wall time at which the pace was last synchronised, ns.
    anchor: [u64; 2],
    /// Start of the pause, wall ns, and the body without samples; `None` while time advances.
    paused: Option<(u64, usize)>,
    dropped: u64,
    overruns: u64,
}

/// Motion samples of a body in simulated time, from the last knot before the current time.
#[derive(Debug, Clone, PartialEq)]
struct SampleTrack {
    body: String,
    limit: SampleMotionLimit,
    knots: VecDeque<MotionKnot>,
    /// Wall time of the last sample, ns.
    last_sample_at: u64,
}

impl SampleTrack {
    fn end_ns(&self) -> u64 {
        self.knots.back().map_or(0, |k| k.time_ns.max(0) as u64)
    }

    /// Removes the knots after the first one at or after the current time; the past motion stays unchanged.
    fn truncate_future(&mut self, now_ns: u64) {
        let first = self.knots.iter().position(|k| k.time_ns >= ns(now_ns));
        self.knots.truncate(first.map_or(self.knots.len(), |i| i + 1));
    }
}

impl Pacer {
    /// Starts the real-time mode of `component` at the wall time `wall_ns`.
    ///
    /// Time is paused until every body has sent a sample. A moving body continues from its velocity to its first sample.
    ///
    /// # Errors
    /// [`ErrorCode::ParameterInvalid`], also if a body that follows no samples moves; [`ErrorCode::UnknownBody`].
    pub fn new(
        settings: RealTimeMode,
        component: &Component,
        wall_ns: u64,
    ) -> Result<Self, RequestError> {
        let refuse = |place: &str, expected: String, found: String| {
            let place = format!("real_time.{place}");
            Err(RequestError::expected(ErrorCode::ParameterInvalid, &place, expected, found))
        };
        let RealTimeMode { real_time_factor, window_ns, latency_ns, max_sample_age_ms, .. } =
            settings;
        let (model, state) = (component.model(), component.state());
        let step = model.stepping.step_ns;
        if !(real_time_factor > 0.0 && real_time_factor <= MAX_REAL_TIME_FACTOR) {
            return refuse(
                "real_time_factor",
                format!("above 0, at most {MAX_REAL_TIME_FACTOR}"),
                real_time_factor.to_string(),
            );
        }
        if window_ns == 0 || window_ns % step != 0 || window_ns > MAX_DURATION_NS {
            let expected = format!("whole time steps of {step} ns, at most {MAX_DURATION_NS} ns");
            return refuse("window_ns", expected, window_ns.to_string());
        }
        if !(window_ns..=MAX_DURATION_NS).contains(&latency_ns) {
            let expected = format!("from a window, {window_ns} ns, to {MAX_DURATION_NS} ns");
            return refuse("latency_ns", expected, latency_ns.to_string());
        }
        if !(1..=MAX_SAMPLE_AGE_MS).contains(&max_sample_age_ms) {
            return refuse(
                "max_sample_age_ms",
                format!("1 to {MAX_SAMPLE_AGE_MS} ms"),
                max_sample_age_ms.to_string(),
            );
        }
        let repeated =
            (0..settings.bodies.len()).any(|i| settings.bodies[..i].contains(&settings.bodies[i]));
        if settings.bodies.is_empty() || repeated {
            let found = format!("{:?}", settings.bodies);
            return refuse("bodies", "names of bodies, each at most once".into(), found);
        }
        let now_ns = component.now_ns();
        let track = |body: &String| {
            let d = model.driven_index(body).ok_or_else(|| {
                let known: Vec<_> = model.driven.iter().map(|d| &d.name).collect();
                let expected = format!("one of {known:?}");
                RequestError::expected(ErrorCode::UnknownBody, "real_time.bodies", expected, body)
            })?;
            let pose = state.imposed(model, d).into();
            let twist = component.twist(d).unwrap_or_default().into();
            let start = MotionKnot { time_ns: ns(now_ns), pose, twist };
            let limit = SampleMotionLimit::new(component, d, settings.interpolation.into());
            Ok(SampleTrack {
                body: body.clone(),
                limit,
                knots: [start].into(),
                last_sample_at: wall_ns,
            })
        };
        let tracks = settings.bodies.iter().map(track).collect::<Result<_, RequestError>>()?;
        let limits = component.limits();
        for (d, driven) in model.driven.iter().enumerate() {
            let twist = component.twist(d).unwrap_or_default();
            let [velocity, angular_velocity] =
                [twist.velocity, twist.angular_velocity].map(|v| v.norm());
            let moves =
                velocity > limits.join_speed || angular_velocity > limits.join_angular_velocity;
            if moves && !settings.bodies.contains(&driven.name) {
                let expected = "all bodies that move; stop the others first";
                let found = format!(
                    "{:?}, at {velocity:.3e} m/s, {angular_velocity:.3e} rad/s",
                    driven.name
                );
                return refuse("bodies", expected.into(), found);
            }
        }
        Ok(Self {
            settings,
            tracks,
            now_ns,
            offset: None,
            offset_set_at: None,
            anchor: [now_ns, wall_ns],
            paused: Some((wall_ns, 0)),
            dropped: 0,
            overruns: 0,
        })
    }

    /// Returns the names of the bodies that follow samples.
    pub fn bodies(&self) -> &[String] {
        &self.settings.bodies
    }

    /// Adds a sample that arrived at the wall time `wall_ns`, or counts it as dropped.
    pub fn add_sample(&mut self, body: &str, sample: MotionKnot, wall_ns: u64) {
        if self.accept(body, sample, wall_ns).is_none() {
            self.dropped += 1;
        }
    }

    /// Counts samples that could not be decoded.
    pub fn count_unreadable(&mut self, samples: u64) {
        self.dropped += samples;
    }

    /// Adds a sample if it is valid, so that no invalid one ends the run later.
    fn accept(&mut self, body: &str, sample: MotionKnot, wall_ns: u64) -> Option<()> {
        let b = self.tracks.iter().position(|t| t.body == body)?;
        let time_ns = self.map_time(b, sample.time_ns, wall_ns)?;
        if self.paused.is_none() && time_ns > self.max_time_ns(wall_ns) {
            return None;
        }
        let knot = MotionKnot { time_ns: ns(time_ns), ..sample };
        let track = &mut self.tracks[b];
        if time_ns <= track.end_ns() || track.knots.len() >= MAX_SAMPLES_PER_BODY {
            return None;
        }
        let (last, next) = (*track.knots.back()?, component::Knot::try_from(knot).ok()?);
        let mut numbers = next.velocity.iter().chain(&next.angular_velocity);
        let is_finite = next.pose.is_sound() && numbers.all(|x| x.is_finite());
        let is_near = track.limit.allows(&component::Knot::try_from(last).ok()?, &next);
        (is_finite && is_near).then(|| {
            track.knots.push_back(knot);
            track.last_sample_at = wall_ns;
        })
    }

    /// Returns the latest valid time of a sample, simulated ns.
    ///
    /// It allows twice the latency plus the maximum age, so that clocks may drift.
    fn max_time_ns(&self, wall_ns: u64) -> u64 {
        let present = self.now_ns.saturating_add(self.lag_ns(wall_ns));
        present.saturating_add(2 * self.settings.latency_ns).saturating_add(self.max_age_ns())
    }

    /// Returns the maximum sample age, simulated ns.
    fn max_age_ns(&self) -> u64 {
        (self.settings.max_sample_age_ms as f64 * 1e6 * self.settings.real_time_factor) as u64
    }

    /// Maps a time of the sender of body `b` to simulated time, ns; `None` rejects the sample.
    fn map_time(&mut self, b: usize, sent_ns: i64, wall_ns: u64) -> Option<u64> {
        let mapped = |offset: i64| sent_ns.checked_add(offset).and_then(|t| u64::try_from(t).ok());
        let latency = self.settings.latency_ns;
        // The first sample of a body after another body set the offset may be late by the maximum age.
        let is_next = self.offset_set_at.is_some_and(|at| self.tracks[b].last_sample_at < at);
        let late = if is_next { self.max_age_ns() } else { 0 };
        let near = self.now_ns..=self.now_ns.saturating_add(2 * latency).saturating_add(late);
        if let Some(time) = self.offset.and_then(mapped)
            && (self.paused.is_none() || near.contains(&time))
        {
            return Some(time);
        }
        if self.offset.is_some() && self.paused.is_none() {
            // Before the start of the run; the offset stays.
            return None;
        }
        // Time is paused and this is the first sample after the pause: it sets the offset of all bodies.
        let offset = ns(self.now_ns.saturating_add(latency)).checked_sub(sent_ns)?;
        (self.offset, self.offset_set_at) = (Some(offset), Some(wall_ns));
        self.tracks.iter_mut().for_each(|track| track.truncate_future(self.now_ns));
        mapped(offset)
    }

    /// Returns the next action at the wall time `wall_ns`.
    pub fn next_action(&mut self, wall_ns: u64) -> NextAction {
        let t1_ns = self.now_ns.saturating_add(self.settings.window_ns);
        let age_ns = self.settings.max_sample_age_ms * 1_000_000;
        let is_silent = |t: &SampleTrack| wall_ns.saturating_sub(t.last_sample_at) >= age_ns;
        // The body with the oldest sample counts as silent first.
        let missing = (0..self.tracks.len())
            .filter(|b| self.tracks[*b].end_ns() < t1_ns || is_silent(&self.tracks[*b]))
            .min_by_key(|b| self.tracks[*b].last_sample_at);
        if let Some((_, body)) = &mut self.paused {
            if let Some(b) = missing {
                *body = b;
                return NextAction::WaitForSamples;
            }
            (self.paused, self.anchor) = (None, [self.now_ns, wall_ns]);
            self.offset_set_at = None;
        }
        if let Some(b) = missing.filter(|b| is_silent(&self.tracks[*b])) {
            self.pause(b);
            return NextAction::WaitForSamples;
        }
        let silent_at = self.tracks.iter().map(|t| t.last_sample_at.saturating_add(age_ns)).min();
        let silent_at = silent_at.unwrap_or(u64::MAX);
        let lag = self.lag_ns(wall_ns);
        if lag < self.settings.window_ns {
            let wait = (self.settings.window_ns - lag) as f64 / self.settings.real_time_factor;
            return NextAction::WaitUntil(
                wall_ns.saturating_add((wait as u64).max(1)).min(silent_at),
            );
        }
        if missing.is_some() {
            return NextAction::WaitUntil(silent_at);
        }
        // Samples so far behind are older than the maximum age.
        let max_lag = self.settings.latency_ns.saturating_add(self.max_age_ns());
        if lag > max_lag.saturating_add(self.settings.window_ns) {
            self.overruns += 1;
            self.pause(0);
            self.paused = Some((wall_ns, 0));
            self.offset = None;
            return NextAction::WaitForSamples;
        }
        NextAction::Compute {
            t1_ns,
            motions: self.tracks.iter().map(|t| self.motion(t, t1_ns)).collect(),
        }
    }

    /// Pauses time for lack of samples of body `b`.
    fn pause(&mut self, b: usize) {
        self.paused = Some((self.tracks[b].last_sample_at, b));
        self.tracks.iter_mut().for_each(|track| track.truncate_future(self.now_ns));
    }

    /// Returns the knots that a window needs.
    fn motion(&self, track: &SampleTrack, t1_ns: u64) -> BodyMotion {
        let end = track.knots.iter().position(|k| k.time_ns >= ns(t1_ns));
        let knots = track.knots.iter().take(end.map_or(track.knots.len(), |i| i + 1));
        BodyMotion {
            body: track.body.clone(),
            interpolation: self.settings.interpolation,
            allow_jump: false,
            knots: knots.copied().collect(),
        }
    }

    /// Records that the run has reached `now_ns`, and drops knots of the past.
    pub fn window_finished(&mut self, now_ns: u64) {
        self.now_ns = now_ns;
        for track in &mut self.tracks {
            while track.knots.get(1).is_some_and(|k| k.time_ns <= ns(now_ns)) {
                track.knots.pop_front();
            }
        }
    }

    /// Returns the delay of the run behind the wall clock, simulated ns.
    fn lag_ns(&self, wall_ns: u64) -> u64 {
        let [run, wall] = self.anchor;
        let passed = wall_ns.saturating_sub(wall) as f64 * self.settings.real_time_factor;
        run.saturating_add(passed as u64).saturating_sub(self.now_ns)
    }

    /// Writes the state of the real-time mode into the status of a component.
    pub fn write_status(&self, status: &mut StatusReport, wall_ns: u64) {
        let lag_ns = if self.paused.is_some() { 0 } else { self.lag_ns(wall_ns) };
        status.real_time = Some(RealTimeStatus {
            real_time_factor: self.settings.real_time_factor,
            lag_ns,
            dropped_samples: self.dropped,
            overruns: self.overruns,
        });
        match self.paused {
            Some((since, b)) => {
                let from = status.owner.as_deref().unwrap_or("the owner");
                status.state = ComponentState::WaitingForInput;
                status.waiting_for =
                    Some(format!("samples of {} from {from}", self.tracks[b].body));
                status.waiting_since_ms = Some(wall_ns.saturating_sub(since) / 1_000_000);
            }
            None => {
                status.state = ComponentState::Running;
                (status.waiting_for, status.waiting_since_ms) = (None, None);
            }
        }
    }
}
