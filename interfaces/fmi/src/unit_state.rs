//! States of an instance that an importer keeps, and their bytes.

use crate::bed_backend::{BedState, no_bytes};
use crate::inputs::InputMarks;
use crate::status::{Complaint, UnitPhase};
use ballast::model::Model;
use ballast_columns::bytes::{self, StoredColumns};
use ballast_columns::columns::{self, Column, Data};
use ballast_columns::{ColumnReader, Fault, decode};
use std::sync::{Arc, OnceLock};

/// Everything that the next step of an instance depends on.
#[derive(Debug, Clone)]
pub struct UnitState {
    /// Token of the unit.
    pub token: Arc<str>,
    /// State of the bed.
    pub state: BedState,
    /// Values of all variables.
    pub values: Vec<f64>,
    /// Inputs that were set.
    pub marks: InputMarks,
    /// UnitPhase of the instance.
    pub phase: UnitPhase,
    /// Time of the importer at the start of the run, s.
    pub start_s: f64,
    bytes: OnceLock<Vec<u8>>,
}

impl UnitState {
    /// Joins the parts of a state.
    pub fn new(
        token: Arc<str>,
        state: BedState,
        values: Vec<f64>,
        marks: InputMarks,
        phase: UnitPhase,
        start_s: f64,
    ) -> Self {
        Self { token, state, values, marks, phase, start_s, bytes: OnceLock::new() }
    }

    /// Returns the state as bytes, f64 bit for bit; they are computed once.
    ///
    /// # Errors
    /// A state that a server keeps.
    pub fn to_bytes(&self) -> Result<&[u8], Complaint> {
        #[cfg_attr(not(feature = "zenoh"), allow(irrefutable_let_patterns))]
        let BedState::Local(state) = &self.state else { return Err(no_bytes()) };
        Ok(self.bytes.get_or_init(|| {
            let flags = self.marks.moved.iter().zip(&self.marks.twisted);
            let flags = flags.map(|(&moved, &twisted)| u8::from(moved) + 2 * u8::from(twisted));
            let column = |name, data| Column { name, width: 1, data };
            let own = [
                column("unit/token", Data::Text(vec![self.token.to_string()])),
                column("unit/values", Data::F64((&self.values).into())),
                column("unit/inputs", Data::U8(flags.collect())),
                column("unit/phase", Data::U8(vec![self.phase as u8])),
                column("unit/start_s", Data::F64(vec![self.start_s].into())),
            ];
            let (state, memory) = (columns::of_state(state), columns::of_memory(state));
            bytes::encode(state.iter().chain(&memory).chain(&own))
        }))
    }

    /// Reads what [`UnitState::to_bytes`] has written for the same unit.
    ///
    /// # Errors
    /// Changed bytes, or those of another unit.
    pub fn from_bytes(
        bytes: &[u8],
        token: &Arc<str>,
        model: &Model,
        elements: usize,
    ) -> Result<Self, Fault> {
        let source = StoredColumns::decode(bytes)?;
        let found = source.text("unit/token")?;
        if found != **token {
            return Err(Fault::new("unit/token", format!("{token}, a state of this unit"), found));
        }
        let state = decode::state(&source, model)?;
        state.check(model).map_err(|e| Fault::new("state", "one of this unit", e))?;
        let flags: Vec<u8> = source.numbers("unit/inputs", Some(model.driven.len()), 1)?;
        let phase: u8 = source.number("unit/phase")?;
        let phase = UnitPhase::ALL.into_iter().find(|p| *p as u8 == phase);
        Ok(Self::new(
            Arc::clone(token),
            BedState::Local(Arc::new(state)),
            source.numbers("unit/values", Some(elements), 1)?,
            InputMarks {
                moved: flags.iter().map(|flag| flag & 1 != 0).collect(),
                twisted: flags.iter().map(|flag| flag & 2 != 0).collect(),
            },
            phase.ok_or_else(|| Fault::new("unit/phase", "a phase of an instance", "another"))?,
            source.real("unit/start_s")?,
        ))
    }
}
