//! Bed inside the unit: a component of this process.

use crate::bed::{Error, UnitBed};
use crate::bed_backend::{BedBackend, BedState, BedWindow, MotionStart, PartialStep};
use crate::status::Complaint;
use ballast::component::{Component, Parameters, Refusal, WindowInputs, WindowStatus};
use ballast::model::Model;
use rayon::{ThreadPool, ThreadPoolBuilder};

/// Bed inside the unit, with the threads that advance it.
pub(crate) struct LocalBed {
    bed: UnitBed,
    component: Component,
    /// Requested number of threads, and the threads.
    pool: Option<(usize, ThreadPool)>,
}

impl LocalBed {
    /// Creates a bed at the start of its run.
    ///
    /// # Errors
    /// A model or state that cannot be advanced.
    pub fn new(bed: UnitBed) -> Result<Self, Error> {
        Ok(Self { component: bed.component()?, bed, pool: None })
    }
}

impl BedBackend for LocalBed {
    fn now_ns(&self) -> u64 {
        self.component.now_ns()
    }

    fn motion_start(&self, d: usize) -> MotionStart {
        let (model, state) = (self.component.model(), self.component.state());
        (state.imposed(model, d), self.component.twist(d))
    }

    fn state_hash(&self) -> String {
        let hash = ballast_columns::state_hash(self.component.model(), self.component.state());
        format!("{hash:032x}")
    }

    fn set_threads(&mut self, threads: usize) -> Result<(), Complaint> {
        if self.pool.as_ref().is_some_and(|(running, _)| *running == threads) {
            return Ok(());
        }
        let pool = ThreadPoolBuilder::new().num_threads(threads).build();
        self.pool = Some((threads, pool.map_err(|e| Complaint::error(format!("threads: {e}")))?));
        Ok(())
    }

    fn set_parameters(&mut self, parameters: &Parameters) -> Result<(), Complaint> {
        self.component.set_parameters(parameters).map_err(refused)
    }

    fn advance(
        &mut self,
        end_ns: u64,
        inputs: &WindowInputs,
        partial: PartialStep,
    ) -> Result<BedWindow, Complaint> {
        let before = self.component.save();
        let (pool, component) = (&self.pool, &mut self.component);
        let mut advance = || component.advance_to(end_ns, inputs);
        let result = match pool {
            Some((_, pool)) => pool.install(advance),
            None => advance(),
        };
        let result = result.map_err(refused)?;
        match (result.status, partial) {
            (WindowStatus::Early, PartialStep::RollBack) | (WindowStatus::Discard, _) => {
                self.component.restore(before).map_err(refused)?;
            }
            _ => {}
        }
        let reason = result.error.as_ref().map_or("ended early".into(), ToString::to_string);
        Ok(BedWindow { result, reason })
    }

    fn save(&mut self) -> Result<BedState, Complaint> {
        Ok(BedState::Local(self.component.save()))
    }

    fn restore(&mut self, state: &BedState, has_failed: bool) -> Result<(), Complaint> {
        #[cfg_attr(not(feature = "zenoh"), allow(irrefutable_let_patterns))]
        let BedState::Local(state) = state else {
            return Err(Complaint::error(
                "state: expected one of a bed inside a unit, found one of a server",
            ));
        };
        let state = state.clone();
        let restored =
            if has_failed { self.component.recover(state) } else { self.component.restore(state) };
        restored.map_err(refused)
    }

    fn reset(&mut self) -> Result<(), Complaint> {
        self.component = self.bed.component().map_err(|e| Complaint::error(e.to_string()))?;
        self.pool = None;
        Ok(())
    }

    fn model(&self) -> Option<&Model> {
        Some(self.component.model())
    }
}

/// Returns the complaint about a request that the component refuses.
fn refused(refusal: Refusal) -> Complaint {
    Complaint::discard(refusal.to_string())
}
