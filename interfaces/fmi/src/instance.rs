//! Instance of a unit: phases, variables and steps, without pointers.
//!
//! Reads: the resources of the unit. Contract: a refused call changes nothing; a discarded step leaves the state of its
//! beginning.

use crate::bed::Error;
use crate::bed_backend::{BedBackend, BedWindow, PartialStep, no_bytes};
use crate::inputs::{InputMarks, InputValues};
use crate::logger::UnitLogger;
use crate::outputs;
use crate::resources::UnitResources;
use crate::served_unit::UnitOutline;
use crate::status::{Complaint, Status, UnitPhase};
use crate::unit_state::UnitState;
use crate::variable_table::VariableTable;
use crate::variables::{INPUT_TIMES, Quantity, TIME, ValueType, Variable, VariableUse};
use ballast::component::{Parameters, WindowInputs, WindowStatus};
use std::ffi::CString;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

/// Outcome of a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepOutcome {
    /// Status of the step.
    pub status: Status,
    /// True if the state is at an earlier time than requested, and valid there.
    pub is_early: bool,
}

/// Instance of a unit.
pub struct Instance {
    token: Arc<str>,
    outline: UnitOutline,
    table: VariableTable,
    bed: Box<dyn BedBackend>,
    values: Vec<f64>,
    marks: InputMarks,
    phase: UnitPhase,
    start_s: f64,
    /// True if the importer accepts steps that end early (FMI 3.0).
    pub accepts_early_return: bool,
    /// Receiver of messages.
    pub logger: UnitLogger,
    /// Text that the importer reads until its next call.
    text: CString,
}

impl Instance {
    /// Creates an instance from the resources of a unit with this token.
    ///
    /// # Errors
    /// Resources that cannot be read, or of another unit; a served component that cannot be owned.
    pub fn new(resources: &Path, token: &str, logger: UnitLogger) -> Result<Self, Error> {
        let (resources, found) = UnitResources::read(resources)?;
        if token != found {
            return Err(Error::Case(format!("expected the token {found}, found {token:?}")));
        }
        let (outline, table, bed) = resources.open(&logger)?;
        Ok(Self {
            values: table.start_values(),
            marks: InputMarks::new(outline.bodies.len()),
            token: token.into(),
            outline,
            table,
            bed,
            phase: UnitPhase::Instantiated,
            start_s: 0.0,
            accepts_early_return: false,
            logger,
            text: CString::default(),
        })
    }

    /// Returns the variables.
    pub fn table(&self) -> &VariableTable {
        &self.table
    }

    /// Returns the phase.
    pub fn phase(&self) -> UnitPhase {
        self.phase
    }

    /// Marks the instance as failed after a panic.
    pub fn fail(&mut self) {
        self.phase = UnitPhase::Failed;
    }

    /// Returns the time of the importer, s.
    pub fn time(&self) -> f64 {
        let run_ns = self.bed.now_ns().saturating_sub(self.outline.start_ns);
        self.start_s + run_ns as f64 * 1e-9
    }

    /// Sets the time of the importer at the start of the run, s.
    ///
    /// # Errors
    /// A time that is not finite.
    pub fn set_start(&mut self, start_s: f64) -> Result<(), Complaint> {
        if !start_s.is_finite() {
            return Err(Complaint::error(format!(
                "start time: expected a finite number, found {start_s}"
            )));
        }
        self.start_s = start_s;
        Ok(())
    }

    /// Enters the initialisation.
    pub fn enter_initialization(&mut self) {
        self.phase = UnitPhase::Initialization;
    }

    /// Leaves the initialisation: threads start, parameters are fixed.
    ///
    /// # Errors
    /// Threads that cannot be started.
    pub fn exit_initialization(&mut self) -> Result<(), Complaint> {
        self.start_threads()?;
        self.phase = UnitPhase::Step;
        Ok(())
    }

    /// Ends the simulation.
    pub fn terminate(&mut self) {
        self.phase = UnitPhase::Terminated;
    }

    /// Returns to the state after the creation.
    ///
    /// # Errors
    /// A served component that does not reply.
    pub fn reset(&mut self) -> Result<(), Complaint> {
        self.bed.reset()?;
        self.values = self.table.start_values();
        self.marks = InputMarks::new(self.outline.bodies.len());
        self.phase = UnitPhase::Instantiated;
        self.start_s = 0.0;
        Ok(())
    }

    /// Refuses another number of values than expected.
    ///
    /// # Errors
    /// Another number.
    pub fn expect_count(&self, expected: usize, found: usize) -> Result<(), Complaint> {
        if expected == found {
            return Ok(());
        }
        Err(Complaint::error(format!("values: expected {expected}, found {found}")))
    }

    /// Returns the variable of a value reference and its elements.
    fn find(&self, reference: u32) -> Result<(&Variable, Range<usize>), Complaint> {
        self.table.find(reference).ok_or_else(|| {
            Complaint::error(format!(
                "value reference: expected one of the description, found {reference}"
            ))
        })
    }

    /// Reads variables of the types `kinds`, one after the other; `put` receives the place and the value.
    ///
    /// # Errors
    /// References of other types, or another number of values than `places`.
    pub fn get(
        &self,
        references: &[u32],
        kinds: &[ValueType],
        places: usize,
        mut put: impl FnMut(usize, f64),
    ) -> Result<(), Complaint> {
        let mut ranges = Vec::with_capacity(references.len());
        let mut count = 0;
        for &reference in references {
            if reference == TIME && kinds.contains(&ValueType::Real) {
                ranges.push(None);
                count += 1;
                continue;
            }
            let (variable, elements) = self.find(reference)?;
            expect_kind(variable, kinds)?;
            count += elements.len();
            ranges.push(Some(elements));
        }
        self.expect_count(count, places)?;
        let mut place = 0;
        for range in ranges {
            let values =
                range.map_or_else(|| vec![self.time()], |range| self.values[range].to_vec());
            for value in values {
                put(place, value);
                place += 1;
            }
        }
        Ok(())
    }

    /// Sets variables of the types `kinds`, one after the other.
    ///
    /// # Errors
    /// References of other types or of variables that cannot be set here; values that cannot be used. Nothing is set then.
    pub fn set(
        &mut self,
        references: &[u32],
        kinds: &[ValueType],
        values: &[f64],
    ) -> Result<(), Complaint> {
        let mut changes = Vec::with_capacity(references.len());
        let mut rest = values;
        for &reference in references {
            let (variable, elements) = self.find(reference)?;
            expect_kind(variable, kinds)?;
            self.expect_settable(variable)?;
            let Some((given, after)) = rest.split_at_checked(elements.len()) else {
                return Err(Complaint::error(format!(
                    "values: expected more than {}",
                    values.len()
                )));
            };
            rest = after;
            for &value in given {
                check_value(variable, value)?;
            }
            changes.push((elements, given, variable.quantity));
        }
        self.expect_count(values.len() - rest.len(), values.len())?;
        for (elements, given, quantity) in changes {
            self.values[elements].copy_from_slice(given);
            self.marks.mark(quantity);
        }
        Ok(())
    }

    fn expect_settable(&self, variable: &Variable) -> Result<(), Complaint> {
        let is_settable = match variable.usage {
            VariableUse::Input | VariableUse::Tunable => true,
            VariableUse::Fixed => self.phase != UnitPhase::Step,
            VariableUse::Output | VariableUse::Constant | VariableUse::Local => false,
        };
        if is_settable {
            return Ok(());
        }
        let expected =
            "an input, a tunable parameter, or a parameter before the end of the initialization";
        Err(Complaint::error(format!("set: expected {expected}, found {:?}", variable.name)))
    }

    /// Returns the hash of model and state as a text that lives until the next call.
    ///
    /// # Errors
    /// A reference to another variable.
    pub fn text(&mut self, reference: u32) -> Result<*const std::ffi::c_char, Complaint> {
        let (variable, _) = self.find(reference)?;
        expect_kind(variable, &[ValueType::Text])?;
        let text = CString::new(self.bed.state_hash()).unwrap_or_default();
        // Of two equal references in one call, the first pointer stays valid.
        if text != self.text {
            self.text = text;
        }
        Ok(self.text.as_ptr())
    }

    /// Advances from `from_s` by `step_s` (s, time of the importer).
    ///
    /// # Errors
    /// Another time than that of the instance; a time that is no whole number of time steps; inputs that the component
    /// refuses; a served component that does not reply.
    pub fn do_step(
        &mut self,
        from_s: f64,
        step_s: f64,
        partial: PartialStep,
    ) -> Result<StepOutcome, Complaint> {
        let end_ns = self.end_of_step(from_s, step_s)?;
        self.bed.set_parameters(&self.parameters())?;
        let inputs = self.window_inputs(end_ns)?;
        self.start_threads()?;
        let BedWindow { result, reason } = self.bed.advance(end_ns, &inputs, partial)?;
        let status = match (result.status, partial) {
            (WindowStatus::Ok, _) => Status::Ok,
            (WindowStatus::Warn, _) => {
                let steps = result.solver.steps_not_converged;
                let text = format!("{steps} of {} time steps did not converge", result.steps);
                self.logger.log(Status::Warning, &text);
                Status::Warning
            }
            (WindowStatus::Early, PartialStep::Keep) => {
                let text = format!("step at {} s: {reason}", self.time());
                self.logger.log(Status::Discard, &text);
                Status::Ok
            }
            (WindowStatus::Early, PartialStep::RollBack) | (WindowStatus::Discard, _) => {
                return Err(Complaint::discard(format!("step from {from_s} s: {reason}")));
            }
        };
        outputs::write(&self.table, &result, &mut self.values);
        Ok(StepOutcome { status, is_early: result.status == WindowStatus::Early })
    }

    /// Returns the inputs of the next window.
    ///
    /// # Errors
    /// An orientation that is none.
    pub fn window_inputs(&self, end_ns: u64) -> Result<WindowInputs, Complaint> {
        let at_start = self.parameter(Quantity::InputsAt) == 2.0;
        let (table, values, marks) = (&self.table, &self.values[..], &self.marks);
        let inputs = InputValues { table, values, marks, at_start };
        inputs.window(&*self.bed, &self.outline.bodies, end_ns)
    }

    /// Returns the end of a step on the grid of time steps, ns.
    fn end_of_step(&self, from_s: f64, step_s: f64) -> Result<u64, Complaint> {
        let h = self.outline.step_ns;
        let h_s = h as f64 * 1e-9;
        let now = self.time();
        if !(from_s.is_finite() && step_s.is_finite() && step_s > 0.0) {
            let found = format!("{from_s} s and {step_s} s");
            return Err(Complaint::error(format!(
                "step: expected a finite time and a length above 0 s, found {found}"
            )));
        }
        // Importers add up steps: their time differs from the grid by rounding.
        if (from_s - now).abs() > GRID_TOLERANCE * h_s {
            return Err(Complaint::error(format!(
                "step: expected the time {now} s, found {from_s} s"
            )));
        }
        let steps = (from_s + step_s - now) / h_s;
        let whole = steps.round();
        let is_on_grid = (steps - whole).abs() <= GRID_TOLERANCE && (1.0..=1e12).contains(&whole);
        let end = (whole as u64).checked_mul(h);
        match end.and_then(|ahead| self.bed.now_ns().checked_add(ahead)) {
            Some(end_ns) if is_on_grid => Ok(end_ns),
            _ => Err(Complaint::discard(format!(
                "step: expected a whole number of time steps of {h_s} s, found {step_s} s"
            ))),
        }
    }

    fn parameter(&self, quantity: Quantity) -> f64 {
        self.table.first(quantity).map_or(0.0, |first| self.values[first])
    }

    fn parameters(&self) -> Parameters {
        let none_at_zero = |value: f64| (value > 0.0).then_some(value);
        Parameters {
            iterations: self.parameter(Quantity::MaxIterations) as u32,
            tolerance: none_at_zero(self.parameter(Quantity::Tolerance)),
            penetration: none_at_zero(self.parameter(Quantity::MaxPenetration))
                .unwrap_or(f64::INFINITY),
        }
    }

    /// Starts as many threads as the parameter says, unless they run.
    fn start_threads(&mut self) -> Result<(), Complaint> {
        self.bed.set_threads(self.parameter(Quantity::Threads) as usize)
    }

    /// Returns everything that the next step depends on.
    ///
    /// # Errors
    /// A served component that does not reply, or keeps no further state.
    pub fn save(&mut self) -> Result<UnitState, Complaint> {
        Ok(UnitState::new(
            Arc::clone(&self.token),
            self.bed.save()?,
            self.values.clone(),
            self.marks.clone(),
            self.phase,
            self.start_s,
        ))
    }

    /// Restores a state of an instance of the same unit.
    ///
    /// # Errors
    /// A state of another unit, or one that a served component lacks.
    pub fn restore(&mut self, saved: &UnitState) -> Result<(), Complaint> {
        if saved.token != self.token {
            let (expected, found) = (&self.token, &saved.token);
            return Err(Complaint::error(format!(
                "state: expected one of {expected}, found {found}"
            )));
        }
        self.bed.restore(&saved.state, self.phase == UnitPhase::Failed)?;
        self.values.clone_from(&saved.values);
        self.marks.clone_from(&saved.marks);
        (self.phase, self.start_s) = (saved.phase, saved.start_s);
        // The hash covers the parameters.
        self.bed.set_parameters(&self.parameters())
    }

    /// Reads a state of an instance of the same unit.
    ///
    /// # Errors
    /// Changed bytes, or those of another unit; a unit whose bed is on a server.
    pub fn read_state(&self, bytes: &[u8]) -> Result<UnitState, Complaint> {
        let model = self.bed.model().ok_or_else(no_bytes)?;
        let elements = self.table.element_count();
        UnitState::from_bytes(bytes, &self.token, model, elements)
            .map_err(|fault| Complaint::error(format!("serialised state: {fault}")))
    }
}

/// Difference of a time of the importer from the grid that counts as rounding, in time steps.
const GRID_TOLERANCE: f64 = 1e-3;

fn expect_kind(variable: &Variable, kinds: &[ValueType]) -> Result<(), Complaint> {
    if kinds.contains(&variable.kind) {
        return Ok(());
    }
    let Variable { name, kind, .. } = variable;
    Err(Complaint::error(format!("{name}: expected one of {kinds:?}, found {kind:?}")))
}

/// Refuses a value that a variable cannot have.
fn check_value(variable: &Variable, value: f64) -> Result<(), Complaint> {
    let (is_valid, expected) = match variable.quantity {
        Quantity::InputsAt => {
            ((1..=INPUT_TIMES.len()).any(|k| value == k as f64), "1 (end) or 2 (start)")
        }
        Quantity::Threads => ((0.0..=1024.0).contains(&value), "0 to 1024"),
        Quantity::MaxIterations => ((1.0..=f64::from(i32::MAX)).contains(&value), "at least 1"),
        Quantity::Tolerance | Quantity::MaxPenetration => {
            ((0.0..f64::INFINITY).contains(&value), "a finite number of at least 0")
        }
        _ => (value.is_finite(), "a finite number"),
    };
    if is_valid {
        return Ok(());
    }
    Err(Complaint::discard(format!("{}: expected {expected}, found {value}", variable.name)))
}
