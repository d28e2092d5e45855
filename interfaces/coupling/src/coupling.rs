//! Coupling of a simulation and a partner, advanced in windows.

use crate::guess::MotionGuess;
use crate::motion::{MotionScale, cubic_motion, displacements, start_motion};
use crate::{
    CouplingSettings, Error, ForceRows, MotionRow, MotionRows, Partner, Scheme, Simulation,
};
use ballast_protocol::description::{BodyDescription, ComponentDescription};
use ballast_protocol::lockstep::WindowKind;
use ballast_protocol::messages::{AdvanceReply, BodySeries, ReplyStatus};
use std::collections::BTreeMap;

/// Result of a coupled window.
#[derive(Debug, Clone)]
pub struct Window {
    /// Number of times the simulation computed the window.
    pub iterations: u32,
    /// Largest difference between the motion of the partner and that of the simulation at the end, m.
    ///
    /// Rotations count with the lever of the settings, velocities with the length of the window.
    pub residual: f64,
    /// True if the residual is within the tolerance; explicit schemes always converge.
    pub is_converged: bool,
    /// Work of the partner on the ballast, by the forces and the motion that the partner computed with, J.
    pub work_given: f64,
    /// Work of the moved bodies on the ballast, by the simulation, J.
    pub work_received: f64,
    /// Motion of the simulation at the end.
    pub motion: MotionRows,
    /// Result of the simulation, with the series of its steps.
    pub reply: AdvanceReply,
}

impl Window {
    /// Returns the energy that the interface loses, J: work given by the partner minus work received by the ballast.
    pub fn energy_residual(&self) -> f64 {
        self.work_given - self.work_received
    }
}

/// Coupling of a simulation and a partner.
///
/// Bodies that the partner moves must be rigid on their holder (`rigid = true` in `[tines.mount]`): mass and flexibility
/// belong to the partner.
pub struct Coupling<S, P> {
    side: SimulationSide<S>,
    partner: P,
    settings: CouplingSettings,
    guess: MotionGuess,
    mean_forces: BTreeMap<String, [f64; 6]>,
    /// Motion of the partner at the end of the last window.
    given: MotionRows,
}

/// Simulation with the window that it computes.
struct SimulationSide<S> {
    simulation: S,
    description: ComponentDescription,
    /// Start and end of the window, ns.
    ends: [u64; 2],
    /// True if the simulation has computed the window and can repeat it.
    is_computed: bool,
    /// Motion of the simulation at the start of the window.
    followed: MotionRows,
}

/// Motion of both sides in a window, and the forces that the partner felt.
struct Exchange {
    iterations: u32,
    residual: f64,
    given: MotionRows,
    followed: MotionRows,
    forces: ForceRows,
    reply: AdvanceReply,
}

impl<S: Simulation, P: Partner + Send> Coupling<S, P> {
    /// Couples a simulation and a partner at the time of the simulation.
    ///
    /// # Errors
    /// A setting out of range, or no description of the simulation.
    pub fn new(simulation: S, partner: P, settings: CouplingSettings) -> Result<Self, Error> {
        settings.check()?;
        let description = simulation.description()?;
        let ends = [simulation.now_ns(); 2];
        let bodies = description.bodies.iter();
        Ok(Self {
            guess: MotionGuess::new(settings.acceleration, settings.relaxation),
            mean_forces: bodies.map(|body| (body.name.clone(), [0.0; 6])).collect(),
            side: SimulationSide {
                simulation,
                description,
                ends,
                is_computed: false,
                followed: MotionRows::new(),
            },
            partner,
            settings,
            given: MotionRows::new(),
        })
    }

    /// Returns the simulation.
    pub fn simulation(&self) -> &S {
        &self.side.simulation
    }

    /// Returns the partner.
    pub fn partner(&self) -> &P {
        &self.partner
    }

    /// Ends the coupling and returns both sides.
    pub fn into_sides(self) -> (S, P) {
        (self.side.simulation, self.partner)
    }

    /// Computes the next window on both sides.
    ///
    /// After an error the partner is at the start of the window, and the next call computes the same window.
    ///
    /// # Errors
    /// [`Error::InvalidBody`], [`Error::Partner`], [`Error::Request`] or [`Error::Window`].
    pub fn advance(&mut self) -> Result<Window, Error> {
        if !self.side.is_computed {
            let t0 = self.side.simulation.now_ns();
            let steps = u64::from(self.settings.window_steps);
            self.side.ends = [t0, t0 + steps * self.side.description.step_ns];
        }
        let before = self.partner.save();
        let exchange = match self.settings.scheme {
            // Only the partner knows which bodies it moves, so the first window is staggered.
            Scheme::Parallel if !self.given.is_empty() => self.exchange_parallel(),
            Scheme::Parallel | Scheme::Staggered => self.exchange_staggered(),
            Scheme::Implicit => self.iterate(&before),
        };
        match exchange {
            Ok(exchange) => Ok(self.end(exchange)),
            Err(error) => {
                self.partner.restore(&before);
                Err(error)
            }
        }
    }

    fn exchange_staggered(&mut self) -> Result<Exchange, Error> {
        let forces = self.last_forces();
        let given = self.advance_partner(&forces)?;
        let reply = self.side.compute(&given)?;
        let followed = given.clone();
        Ok(Exchange { iterations: 1, residual: 0.0, given, followed, forces, reply })
    }

    fn exchange_parallel(&mut self) -> Result<Exchange, Error> {
        let (forces, length) = (self.last_forces(), self.side.length());
        let mut predicted = self.given.clone();
        for row in predicted.values_mut() {
            (0..6).for_each(|c| row[c] += length * row[c + 6]);
        }
        let [t0, t1] = self.side.times();
        let (partner, side) = (&mut self.partner, &mut self.side);
        let (reply, given) = std::thread::scope(|scope| {
            let computing = scope.spawn(|| partner.advance(t0, t1, &forces));
            let reply = side.compute(&predicted);
            (reply, computing.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
        });
        let given = side.with_same_bodies(given.map_err(Error::Partner)?)?;
        let scale = self.scale();
        let residual = (scale.vector(&given) - scale.vector(&predicted)).amax();
        Ok(Exchange { iterations: 1, residual, given, followed: predicted, forces, reply: reply? })
    }

    fn iterate(&mut self, before: &P::State) -> Result<Exchange, Error> {
        let mut guess = self.advance_partner(&self.last_forces())?;
        let scale = self.scale();
        self.guess.begin_window();
        let mut last: Option<MotionRows> = None;
        let mut iterations = 1;
        loop {
            let reply = match (self.side.compute(&guess), &last) {
                (Err(error), Some(last))
                    if error.concerns_motion() && iterations < self.settings.max_iterations =>
                {
                    // The guess was too far for the ballast.
                    guess = halfway(last, &guess);
                    self.guess.forget();
                    iterations += 1;
                    continue;
                }
                (reply, _) => reply?,
            };
            last = Some(guess.clone());
            let forces = self.side.forces(&reply);
            self.partner.restore(before);
            let given = self.advance_partner(&forces)?;
            let (followed, answer) = (scale.vector(&guess), scale.vector(&given));
            let residual = (&answer - &followed).amax();
            if residual <= self.settings.tolerance || iterations == self.settings.max_iterations {
                return Ok(Exchange {
                    iterations,
                    residual,
                    given,
                    followed: guess,
                    forces,
                    reply,
                });
            }
            guess = scale.rows(&self.guess.next(&followed, &answer), &guess);
            iterations += 1;
        }
    }

    fn advance_partner(&mut self, forces: &ForceRows) -> Result<MotionRows, Error> {
        let [t0, t1] = self.side.times();
        let given = self.partner.advance(t0, t1, forces).map_err(Error::Partner)?;
        if self.side.followed.is_empty() {
            self.side.find_start(&given)?;
            self.given = self.side.followed.clone();
        }
        self.side.with_same_bodies(given)
    }

    /// Ends a window and keeps what the next one needs.
    fn end(&mut self, exchange: Exchange) -> Window {
        let Exchange { iterations, residual, given, followed, forces, reply } = exchange;
        let (length, steps) = (self.side.length(), self.settings.window_steps as usize);
        let mut work_given = 0.0;
        for (name, row) in &given {
            let ways = displacements(&self.given[name], row, length, steps);
            let products = forces[name].iter().zip(&ways);
            work_given -= products.flat_map(|(f, s)| (0..6).map(|c| f[c] * s[c])).sum::<f64>();
        }
        let bodies = reply.bodies.iter().filter(|b| given.contains_key(&b.body));
        let work_received = bodies.map(|b| b.work).sum();
        let mean = |rows: Vec<[f64; 6]>| -> [f64; 6] {
            let count = rows.len() as f64;
            std::array::from_fn(|c| rows.iter().map(|row| row[c]).sum::<f64>() / count)
        };
        let felt = self.side.forces(&reply);
        self.mean_forces = felt.into_iter().map(|(name, rows)| (name, mean(rows))).collect();
        self.given = given;
        self.side.is_computed = false;
        self.side.followed = followed.clone();
        let is_implicit = self.settings.scheme == Scheme::Implicit;
        let is_converged = !is_implicit || residual <= self.settings.tolerance;
        let motion = followed;
        Window { iterations, residual, is_converged, work_given, work_received, motion, reply }
    }

    /// Returns the mean forces of the last window, for each step of this one.
    fn last_forces(&self) -> ForceRows {
        let steps = self.settings.window_steps as usize;
        self.mean_forces.iter().map(|(name, mean)| (name.clone(), vec![*mean; steps])).collect()
    }

    fn scale(&self) -> MotionScale {
        MotionScale::new(self.settings.lever, self.side.length())
    }
}

/// Returns the rows half the way from one motion to another.
fn halfway(from: &MotionRows, to: &MotionRows) -> MotionRows {
    let row = |(name, row): (&String, &MotionRow)| {
        (name.clone(), std::array::from_fn(|c| 0.5 * (from[name][c] + row[c])))
    };
    to.iter().map(row).collect()
}

impl<S: Simulation> SimulationSide<S> {
    /// Finds the motion with which the bodies of a partner start.
    fn find_start(&mut self, given: &MotionRows) -> Result<(), Error> {
        let start = |name: &String| Ok((name.clone(), start_motion(self.movable_body(name)?)));
        self.followed = given.keys().map(start).collect::<Result<_, Error>>()?;
        Ok(())
    }

    /// Returns a body that a partner can move.
    fn movable_body(&self, name: &str) -> Result<&BodyDescription, Error> {
        let body = name.to_string();
        let Some(found) = self.description.bodies.iter().find(|b| b.name == name) else {
            let expected = "a driven body of the component";
            return Err(Error::InvalidBody { body, expected, found: "none of this name" });
        };
        if found.dof_modes.iter().any(|mode| mode != "prescribed") {
            let expected = "a body without a mount";
            let found = "one on springs; set `rigid = true`";
            return Err(Error::InvalidBody { body, expected, found });
        }
        Ok(found)
    }

    /// Returns the motion of a partner if it has the bodies of the first window.
    fn with_same_bodies(&self, given: MotionRows) -> Result<MotionRows, Error> {
        let names = given.keys().chain(self.followed.keys());
        for name in names {
            if given.contains_key(name) != self.followed.contains_key(name) {
                return Err(Error::InvalidBody {
                    body: name.clone(),
                    expected: "the bodies of the first window",
                    found: "others",
                });
            }
        }
        Ok(given)
    }

    /// Computes the window with a motion to its end, for the first time or again.
    fn compute(&mut self, end: &MotionRows) -> Result<AdvanceReply, Error> {
        let kind = if self.is_computed { WindowKind::Redo } else { WindowKind::Advance };
        let motions = end
            .iter()
            .map(|(name, row)| cubic_motion(name, self.ends, &self.followed[name], row))
            .collect();
        let reply = self.simulation.compute(kind, self.ends, motions);
        // A window that was rolled back is the next one.
        self.is_computed = self.simulation.now_ns() == self.ends[1];
        let reply = reply?;
        if matches!(reply.status, ReplyStatus::Ok | ReplyStatus::Warn) {
            return Ok(reply);
        }
        Err(Error::Window(Box::new(reply)))
    }

    /// Returns the forces of each step of a window.
    fn forces(&self, reply: &AdvanceReply) -> ForceRows {
        let step = self.description.step_ns as f64 * 1e-9;
        let rows = |series: &BodySeries| {
            let impulses = series.impulse.iter().zip(&series.angular_impulse);
            impulses.map(|(p, l)| [p.x, p.y, p.z, l.x, l.y, l.z].map(|part| part / step)).collect()
        };
        reply.step_series.bodies.iter().map(|s| (s.body.clone(), rows(s))).collect()
    }

    /// Returns start and end of the window, s.
    fn times(&self) -> [f64; 2] {
        self.ends.map(|t| t as f64 * 1e-9)
    }

    /// Returns the length of the window, s.
    fn length(&self) -> f64 {
        (self.ends[1] - self.ends[0]) as f64 * 1e-9
    }
}
