//! Content of a unit: the prepared bed and the case that it belongs to.

use ballast::component::{Component, Limits};
use ballast::model::Model;
use ballast::observe::{SqueezeRule, Zone};
use ballast::state::State;
use ballast::track;
use ballast_columns::bytes::{self, StoredColumns};
use ballast_columns::columns::{self, Column, Data};
use ballast_columns::{ColumnReader, Fault, decode, validate};
use ballast_scenario::CaseOverrides;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// Name of the bed's file among the resources of a unit.
pub const BED_FILE: &str = "bed.ballast";

/// Error of a unit's content.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A file that cannot be read.
    #[error("{path}: {source}")]
    Io {
        /// Path of the file.
        path: String,
        /// Reason given by the system.
        source: std::io::Error,
    },
    /// Bytes that are no bed, or of another version.
    #[error("bed of the unit: {0}")]
    Content(#[from] Fault),
    /// A case that cannot be read.
    #[error("case of the unit: {0}")]
    Case(String),
    /// A model or state that cannot be advanced.
    #[error(transparent)]
    Refused(#[from] ballast::component::Refusal),
    /// A case without something to measure or to move.
    #[error(transparent)]
    Core(#[from] ballast::Error),
    /// A served component that cannot be owned, or a wrong file that names it.
    #[error("served bed: {0}")]
    Served(String),
    /// A description or an archive that cannot be written.
    #[error("unit: {0}")]
    Package(String),
}

/// Bed at the start of a run, with its case.
#[derive(Debug, Clone)]
pub struct UnitBed {
    /// Name of the case.
    pub name: String,
    /// Model of the bed, the tools and the sleepers.
    pub model: Arc<Model>,
    /// State at the start of the run.
    pub state: Arc<State>,
    /// Zones to measure.
    pub zones: Vec<Zone>,
    /// Length of the case's run, ns.
    pub duration_ns: u64,
    /// Text of the case.
    pub case_text: String,
    /// Overrides of the case.
    pub overrides: CaseOverrides,
    squeezes: SqueezeRule,
}

impl UnitBed {
    /// Joins the start of a run with the text of its case.
    ///
    /// # Errors
    /// A text that is no case, or not that of the model.
    pub fn new(
        model: Model,
        state: State,
        case_text: String,
        overrides: CaseOverrides,
    ) -> Result<Self, Error> {
        let read = ballast_scenario::read_case(&case_text, "case of the unit");
        let mut plan = read.map_err(|e| Error::Case(e.to_string()))?.plan;
        overrides.apply(&mut plan);
        Ok(Self {
            squeezes: track::squeezes(&plan, &model)?,
            zones: track::zones(&plan),
            duration_ns: plan.run.duration_ns,
            name: plan.name,
            model: Arc::new(model),
            state: Arc::new(state),
            case_text,
            overrides,
        })
    }

    /// Returns a component at the start of the run.
    ///
    /// A window that fails keeps its complete steps; the caller rolls back.
    ///
    /// # Errors
    /// A model or state that cannot be advanced.
    pub fn component(&self) -> Result<Component, Error> {
        let limits = Limits { keep_partial_window: true, ..Limits::default() };
        let component = Component::new(Arc::clone(&self.model), Arc::clone(&self.state), limits)?;
        Ok(component.with_squeezes(self.squeezes.clone()).with_zones(self.zones.clone()))
    }

    /// Returns the bed as bytes, f64 bit for bit.
    pub fn to_bytes(&self) -> Vec<u8> {
        let notes = self.overrides.to_notes();
        let texts = |name, texts| Column { name, width: 1, data: Data::Text(texts) };
        let about = [
            texts("case/text", vec![self.case_text.clone()]),
            texts("case/override_names", notes.keys().cloned().collect()),
            texts("case/override_values", notes.values().cloned().collect()),
        ];
        let (content, memory) =
            (columns::of(&self.model, &self.state), columns::of_memory(&self.state));
        bytes::encode(content.iter().chain(&memory).chain(&about))
    }

    /// Reads what [`UnitBed::to_bytes`] has written.
    ///
    /// # Errors
    /// Changed bytes, or those of another version.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, Error> {
        let source = StoredColumns::decode(bytes)?;
        let model = decode::model(&source)?;
        let state = decode::state(&source, &model)?;
        validate::check(&model, &state)?;
        let names = source.texts("case/override_names", None)?;
        let values = source.texts("case/override_values", Some(names.len()))?;
        let notes: BTreeMap<_, _> = names.into_iter().zip(values).collect();
        let overrides =
            CaseOverrides::from_notes(&notes).map_err(|e| Error::Case(e.to_string()))?;
        Self::new(model, state, source.text("case/text")?, overrides)
    }

    /// Reads the bed in the folder of a unit's resources; returns it with its instantiation token.
    ///
    /// # Errors
    /// A file that cannot be read, or is no bed.
    pub fn read(resources: &Path) -> Result<(Self, String), Error> {
        let path = resources.join(BED_FILE);
        let bytes = std::fs::read(&path)
            .map_err(|source| Error::Io { path: path.display().to_string(), source })?;
        Ok((Self::from_bytes(&bytes)?, instantiation_token(&bytes)))
    }
}

/// Returns the token of a unit, which ties description and bed together (FMI 2: `guid`).
pub fn instantiation_token(bed: &[u8]) -> String {
    format!("{{ballast-{}-{}}}", env!("CARGO_PKG_VERSION"), &blake3::hash(bed).to_hex()[..32])
}
