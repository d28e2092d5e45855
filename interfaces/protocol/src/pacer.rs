//! Free running: simulated time follows the wall clock, and bodies follow the motions that come in meanwhile.
//!
//! Reads: samples of motion, the wall clock as given. Writes: nothing; it says which window is due, and with which
//! inputs. No transport, no clock of its own.
//!
//! Contract:
//! * A sample's time is of the sender's own clock, ns at the pace of the run; only differences count. The first one
//!   lands a fixed latency after the present of the run, the others as far from it as they were sent apart: what
//!   comes early or late by less than the latency changes nothing.
//! * EmptyRequest is extrapolated. A window waits for the samples that cover it; when a body has been silent for longer
//!   than the greatest age, time stops, however far its samples reach. It goes on when all bodies are heard of again:
//!   then the next sample lands the latency after the present, as at first, and is reached from where the body stands.
//! * A run that cannot keep the pace falls behind by so much at most; then it takes up the samples of now.
//! * A sample that would end the run is of no use: too far ahead, or farther away than its body can be led.
//! * ResumeInfo is bounded: samples beyond it, out of order or of no use are dropped and counted.

mod reach;

use crate::lockstep::{ComponentState, ErrorCode, RequestError, StatusReport};
use crate::messages::{BodyMotion, InterpolationMode, MotionKnot, ns};
use ballast::component::{self, Component};
use reach::Reach;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// Most samples of a body that wait.
pub const MAX_SAMPLES_PER_BODY: usize = 4096;
/// Longest window and latency, simulated ns, and greatest age, wall ms.
const MAX_DURATION_NS: u64 = 60_000_000_000;
const MAX_SAMPLE_AGE_MS: u64 = 3_600_000;
/// Fastest pace.
const MAX_REAL_TIME_FACTOR: f64 = 1000.0;

/// How time is to run by itself.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RealTimeMode {
    /// Simulated over wall time, above 0.
    pub real_time_factor: f64,
    /// Length of a window, ns: whole time steps.
    pub window_ns: u64,
    /// How long after it has come a sample is reached, simulated ns; at least a window.
    pub latency_ns: u64,
    /// How long a body may be silent before time stops, wall ms.
    pub max_sample_age_ms: u64,
    /// Bodies that follow their samples; all others stay.
    pub bodies: Vec<String>,
    /// Between samples.
    #[serde(default)]
    pub interpolation: InterpolationMode,
}

/// How a free run goes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RealTimeStatus {
    /// Simulated over wall time, as settings for.
    pub real_time_factor: f64,
    /// How far the run is behind its pace, simulated ns.
    pub lag_ns: u64,
    /// Samples that were of no use: unreadable, out of order, too many, too far ahead, too far away.
    pub dropped_samples: u64,
    /// How often the pace could not be kept and was taken up anew.
    pub overruns: u64,
}

/// What is to be done.
#[derive(Debug, Clone, PartialEq)]
pub enum NextAction {
    /// Compute the window from the present to `t1_ns`.
    Compute { t1_ns: u64, motions: Vec<BodyMotion> },
    /// Nothing before this wall time, ns, unless a sample comes.
    WaitUntil(u64),
    /// Nothing until samples come.
    WaitForSamples,
}

/// Keeps the pace and the samples.
#[derive(Debug, Clone, PartialEq)]
pub struct Pacer {
    settings: RealTimeMode,
    tracks: Vec<Track>,
    /// Simulated time, ns.
    now_ns: u64,
    /// Simulated less sender's time, ns; none before the first sample.
    offset: Option<i64>,
    /// When it was found, wall ns, as long as time stands.
    found_at: Option<u64>,
    /// Simulated and wall time from which the pace is counted, ns.
    anchor: [u64; 2],
    /// Since when time stands, and for which body, wall ns.
    starved: Option<(u64, usize)>,
    dropped: u64,
    overruns: u64,
}

/// The motion of a body, in simulated time: from the last knot before the present on.
#[derive(Debug, Clone, PartialEq)]
struct Track {
    body: String,
    reach: Reach,
    knots: VecDeque<MotionKnot>,
    /// Wall ns.
    heard_at: u64,
}

impl Track {
    fn end_ns(&self) -> u64 {
        self.knots.back().map_or(0, |k| k.time_ns.max(0) as u64)
    }

    /// Forgets what lies beyond the first knot at or after the present: the motion so far stays what it was.
    fn cut(&mut self, now_ns: u64) {
        let first = self.knots.iter().position(|k| k.time_ns >= ns(now_ns));
        self.knots.truncate(first.map_or(self.knots.len(), |i| i + 1));
    }
}

impl Pacer {
    /// A run of `component` by itself from now on, wall ns. It stands until every body is heard of. A body that moves
    /// goes on from there to its first sample.
    ///
    /// # Errors
    /// [`ErrorCode::ParameterInvalid`], also where a body moves that is to stay; [`ErrorCode::UnknownBody`].
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
            return refuse("bodies", "names of bodies, each once".into(), found);
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
            let reach = Reach::of(component, d, settings.interpolation.into());
            Ok(Track { body: body.clone(), reach, knots: [start].into(), heard_at: wall_ns })
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
                let expected = "all bodies that move; bring the others to rest first";
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
            found_at: None,
            anchor: [now_ns, wall_ns],
            starved: Some((wall_ns, 0)),
            dropped: 0,
            overruns: 0,
        })
    }

    /// The bodies that follow their samples.
    pub fn bodies(&self) -> &[String] {
        &self.settings.bodies
    }

    /// Takes a sample that has come at `wall_ns`.
    pub fn take(&mut self, body: &str, sample: MotionKnot, wall_ns: u64) {
        if self.accept(body, sample, wall_ns).is_none() {
            self.dropped += 1;
        }
    }

    /// Counts samples that could not be read.
    pub fn count_unreadable(&mut self, samples: u64) {
        self.dropped += samples;
    }

    /// Takes a sample if it is of use. It is judged here: a bad one must not end the run later.
    fn accept(&mut self, body: &str, sample: MotionKnot, wall_ns: u64) -> Option<()> {
        let b = self.tracks.iter().position(|t| t.body == body)?;
        let time_ns = self.land(b, sample.time_ns, wall_ns)?;
        if self.starved.is_none() && time_ns > self.farthest_ns(wall_ns) {
            return None;
        }
        let knot = MotionKnot { time_ns: ns(time_ns), ..sample };
        let track = &mut self.tracks[b];
        if time_ns <= track.end_ns() || track.knots.len() >= MAX_SAMPLES_PER_BODY {
            return None;
        }
        let (last, next) = (*track.knots.back()?, component::Knot::try_from(knot).ok()?);
        let mut numbers = next.velocity.iter().chain(&next.angular_velocity);
        let is_sound = next.pose.is_sound() && numbers.all(|x| x.is_finite());
        let is_near = track.reach.fits(&component::Knot::try_from(last).ok()?, &next);
        (is_sound && is_near).then(|| {
            track.knots.push_back(knot);
            track.heard_at = wall_ns;
        })
    }

    /// How far ahead a sample is of use: as early as it may come, and by the greatest age, so that clocks may drift
    /// apart; one that is farther would be waited for while nothing is heard.
    fn farthest_ns(&self, wall_ns: u64) -> u64 {
        let present = self.now_ns.saturating_add(self.behind_ns(wall_ns));
        present.saturating_add(2 * self.settings.latency_ns).saturating_add(self.age_ns())
    }

    /// The greatest age, simulated ns.
    fn age_ns(&self) -> u64 {
        (self.settings.max_sample_age_ms as f64 * 1e6 * self.settings.real_time_factor) as u64
    }

    /// Where the time lands in the run that the sender of body `b` tells.
    fn land(&mut self, b: usize, sent_ns: i64, wall_ns: u64) -> Option<u64> {
        let lands = |offset: i64| sent_ns.checked_add(offset).and_then(|t| u64::try_from(t).ok());
        let latency = self.settings.latency_ns;
        // One that is heard for the first time after another one has set the time may be as late as it may be silent.
        let is_next = self.found_at.is_some_and(|at| self.tracks[b].heard_at < at);
        let late = if is_next { self.age_ns() } else { 0 };
        let near = self.now_ns..=self.now_ns.saturating_add(2 * latency).saturating_add(late);
        if let Some(time) = self.offset.and_then(lands)
            && (self.starved.is_none() || near.contains(&time))
        {
            return Some(time);
        }
        if self.offset.is_some() && self.starved.is_none() {
            // From before the run's beginning; time goes on as it does.
            return None;
        }
        // Time stands, and this is the first that is heard after a while: it sets the time of all.
        let offset = ns(self.now_ns.saturating_add(latency)).checked_sub(sent_ns)?;
        (self.offset, self.found_at) = (Some(offset), Some(wall_ns));
        self.tracks.iter_mut().for_each(|track| track.cut(self.now_ns));
        lands(offset)
    }

    /// What is due at `wall_ns`.
    pub fn due(&mut self, wall_ns: u64) -> NextAction {
        let t1_ns = self.now_ns.saturating_add(self.settings.window_ns);
        let age_ns = self.settings.max_sample_age_ms * 1_000_000;
        let is_silent = |t: &Track| wall_ns.saturating_sub(t.heard_at) >= age_ns;
        // The one that was heard last of all is silent first.
        let missing = (0..self.tracks.len())
            .filter(|b| self.tracks[*b].end_ns() < t1_ns || is_silent(&self.tracks[*b]))
            .min_by_key(|b| self.tracks[*b].heard_at);
        if let Some((_, body)) = &mut self.starved {
            if let Some(b) = missing {
                *body = b;
                return NextAction::WaitForSamples;
            }
            (self.starved, self.anchor) = (None, [self.now_ns, wall_ns]);
            self.found_at = None;
        }
        if let Some(b) = missing.filter(|b| is_silent(&self.tracks[*b])) {
            self.stand(b);
            return NextAction::WaitForSamples;
        }
        let silent_at = self.tracks.iter().map(|t| t.heard_at.saturating_add(age_ns)).min();
        let silent_at = silent_at.unwrap_or(u64::MAX);
        let behind = self.behind_ns(wall_ns);
        if behind < self.settings.window_ns {
            let wait = (self.settings.window_ns - behind) as f64 / self.settings.real_time_factor;
            return NextAction::WaitUntil(
                wall_ns.saturating_add((wait as u64).max(1)).min(silent_at),
            );
        }
        if missing.is_some() {
            return NextAction::WaitUntil(silent_at);
        }
        // What lies so far behind is older than what a body may be silent for.
        let most = self.settings.latency_ns.saturating_add(self.age_ns());
        if behind > most.saturating_add(self.settings.window_ns) {
            self.overruns += 1;
            self.stand(0);
            self.starved = Some((wall_ns, 0));
            self.offset = None;
            return NextAction::WaitForSamples;
        }
        NextAction::Compute {
            t1_ns,
            motions: self.tracks.iter().map(|t| self.motion(t, t1_ns)).collect(),
        }
    }

    /// Stops time for a body.
    fn stand(&mut self, b: usize) {
        self.starved = Some((self.tracks[b].heard_at, b));
        self.tracks.iter_mut().for_each(|track| track.cut(self.now_ns));
    }

    /// The knots that a window needs.
    fn motion(&self, track: &Track, t1_ns: u64) -> BodyMotion {
        let end = track.knots.iter().position(|k| k.time_ns >= ns(t1_ns));
        let knots = track.knots.iter().take(end.map_or(track.knots.len(), |i| i + 1));
        BodyMotion {
            body: track.body.clone(),
            interpolation: self.settings.interpolation,
            allow_jump: false,
            knots: knots.copied().collect(),
        }
    }

    /// The run has come to `now_ns`.
    pub fn done(&mut self, now_ns: u64) {
        self.now_ns = now_ns;
        for track in &mut self.tracks {
            while track.knots.get(1).is_some_and(|k| k.time_ns <= ns(now_ns)) {
                track.knots.pop_front();
            }
        }
    }

    /// How far the run is behind its pace, simulated ns.
    fn behind_ns(&self, wall_ns: u64) -> u64 {
        let [run, wall] = self.anchor;
        let passed = wall_ns.saturating_sub(wall) as f64 * self.settings.real_time_factor;
        run.saturating_add(passed as u64).saturating_sub(self.now_ns)
    }

    /// Says in the status of a component that it runs by itself, or for whom it stands and since when.
    pub fn tell(&self, status: &mut StatusReport, wall_ns: u64) {
        let lag_ns = if self.starved.is_some() { 0 } else { self.behind_ns(wall_ns) };
        status.real_time = Some(RealTimeStatus {
            real_time_factor: self.settings.real_time_factor,
            lag_ns,
            dropped_samples: self.dropped,
            overruns: self.overruns,
        });
        match self.starved {
            Some((since, b)) => {
                let from = status.owner.as_deref().unwrap_or("its owner");
                status.state = ComponentState::WaitingForInput;
                status.waiting_for = Some(format!("input of {} from {from}", self.tracks[b].body));
                status.waiting_since_ms = Some(wall_ns.saturating_sub(since) / 1_000_000);
            }
            None => {
                status.state = ComponentState::Running;
                (status.waiting_for, status.waiting_since_ms) = (None, None);
            }
        }
    }
}
