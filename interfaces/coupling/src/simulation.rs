//! Simulations that a coupling advances: the client of a served component, or a substitute in a test.

use ballast_protocol::description::ComponentDescription;
use ballast_protocol::lockstep::WindowKind;
use ballast_protocol::messages::{AdvanceReply, AdvanceRequest, BodyMotion};
use ballast_zenoh::{Client, Error};

/// Simulation that is advanced in windows and can repeat the last one.
pub trait Simulation {
    /// Returns the time that the simulation has reached, ns.
    fn now_ns(&self) -> u64;

    /// Returns the description of the simulation with the present motion of its bodies.
    ///
    /// # Errors
    /// No valid reply.
    fn description(&self) -> Result<ComponentDescription, Error>;

    /// Computes the window between two times, ns, and returns its result with the series of its steps.
    ///
    /// With [`WindowKind::Redo`] the window is the last one.
    ///
    /// # Errors
    /// The window is refused, or there is no reply.
    fn compute(
        &mut self,
        kind: WindowKind,
        ends: [u64; 2],
        motions: Vec<BodyMotion>,
    ) -> Result<AdvanceReply, Error>;
}

impl Simulation for Client {
    fn now_ns(&self) -> u64 {
        self.position().now_ns
    }

    fn description(&self) -> Result<ComponentDescription, Error> {
        self.describe()
    }

    fn compute(
        &mut self,
        kind: WindowKind,
        ends: [u64; 2],
        motions: Vec<BodyMotion>,
    ) -> Result<AdvanceReply, Error> {
        let request = match kind {
            WindowKind::Advance => self.next_request(ends[1]),
            WindowKind::Redo => self.redo_request(ends),
        };
        self.send(kind, AdvanceRequest { motions, record_steps: true, ..request })
    }
}
