//! Cases, and a store of their prepared beds.
//!
//! The program, the Python package and the server all open cases through this crate, so that they share prepared beds.

use ballast::model::Model;
use ballast::state::State;
use ballast::track::plan::Plan;
use ballast::track::{self, Bed, DepositProgress};
use ballast_hdf5::checkpoint::{self, Kind};
use std::collections::BTreeMap;
use std::io::{self, ErrorKind};
use std::ops::ControlFlow;
use std::path::PathBuf;

mod case;
mod progress;

pub use case::Case;
pub use progress::PreparationProgress;

/// Error of preparing, reading or writing a bed.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A folder where beds cannot be written.
    #[error("{}: beds cannot be written: {source}", path.display())]
    Folder {
        /// Folder of the store.
        path: PathBuf,
        /// Reason given by the system.
        source: io::Error,
    },
    /// A stored bed that cannot be read.
    #[error(transparent)]
    Read(ballast_hdf5::Error),
    /// A prepared bed that cannot be written.
    #[error(transparent)]
    Write(ballast_hdf5::Error),
    /// A stored file that is not the bed of the case.
    #[error("{}: expected the bed of this case, found {found}", path.display())]
    Mismatch {
        /// File in the store.
        path: PathBuf,
        /// Description of the file's content.
        found: String,
    },
    /// A case whose bed cannot be prepared.
    #[error("preparing the bed of {case}: {source}")]
    Preparation {
        /// Name of the case.
        case: String,
        /// Reason given by the core.
        source: ballast::Error,
    },
    /// A case whose tools or sleepers do not fit into its bed.
    #[error("{case}: {source}")]
    Scene {
        /// Name of the case.
        case: String,
        /// Reason given by the core.
        source: ballast::Error,
    },
}

/// Folder of prepared beds, one file for each content key.
#[derive(Debug, Clone)]
pub struct BedStore {
    folder: PathBuf,
}

impl BedStore {
    /// Creates a store in `folder`, which [`BedStore::prepare`] creates if it does not exist.
    pub fn new(folder: impl Into<PathBuf>) -> Self {
        Self { folder: folder.into() }
    }

    /// Returns the path of the file for the bed of `plan`, whether or not it exists.
    pub fn path(&self, plan: &Plan) -> PathBuf {
        self.folder.join(format!("{}.h5", ballast_scenario::content_key(plan)))
    }

    /// Reads the bed of `plan`; `None` if the store does not have it.
    ///
    /// # Errors
    /// A file that is damaged, of another version, or not the bed of this plan.
    pub fn find(&self, plan: &Plan) -> Result<Option<Bed>, Error> {
        let path = self.path(plan);
        if !path.exists() {
            return Ok(None);
        }
        let stored = checkpoint::read(&path).map_err(Error::Read)?;
        if stored.kind != Kind::Bed || stored.key != ballast_scenario::content_key(plan) {
            let found =
                format!("the {} of {:?}, bed {}", stored.kind.name(), stored.case_name, stored.key);
            return Err(Error::Mismatch { path, found });
        }
        let settlements = settlements(&stored.extra);
        Ok(Some(Bed { model: stored.model, state: stored.state, settlements }))
    }

    /// Prepares the bed of a case and writes it. `watch` receives every step and may stop the preparation; the result is
    /// then `None`.
    ///
    /// # Errors
    /// A case whose bed cannot be prepared; a folder or file that cannot be written.
    pub fn prepare(
        &self,
        case: &Case,
        watch: &mut dyn FnMut(&DepositProgress) -> ControlFlow<()>,
    ) -> Result<Option<Bed>, Error> {
        // Fails before the expensive part.
        self.create_folder(&case.plan)?;
        let failed = |source| Error::Preparation { case: case.plan.name.clone(), source };
        let Some(bed) = track::deposit(&case.plan, watch).map_err(failed)? else { return Ok(None) };
        let settlements = bed.settlements;
        let mut notes = BTreeMap::new();
        if !settlements.is_empty() {
            let written: Vec<String> = settlements.iter().map(f64::to_string).collect();
            notes.insert(SETTLEMENTS.to_owned(), written.join(" "));
        }
        let bed = case.checkpoint_of(Kind::Bed, bed.model, bed.state, notes);
        checkpoint::write(self.path(&case.plan), &bed).map_err(Error::Write)?;
        Ok(Some(Bed { model: bed.model, state: bed.state, settlements }))
    }

    /// Creates the folder and checks that the bed of `plan` can be written there.
    fn create_folder(&self, plan: &Plan) -> Result<(), Error> {
        // The HDF5 library opens no path that is not UTF-8.
        let not_utf8 = || io::Error::new(ErrorKind::InvalidInput, "expected a name in UTF-8");
        let folder = self.folder.to_str().ok_or_else(not_utf8);
        let created = folder.and_then(std::fs::create_dir_all);
        let writable = created.and_then(|()| ballast_hdf5::replaceable(&self.path(plan)));
        writable.map_err(|source| Error::Folder { path: self.folder.clone(), source })
    }
}

/// Note of a stored bed with the settlements of its traffic, m.
const SETTLEMENTS: &str = "traffic_settlements_m";

/// Returns the settlements of the traffic from the notes of a stored bed, m; none if there was no traffic.
fn settlements(notes: &BTreeMap<String, String>) -> Vec<f64> {
    let values = notes.get(SETTLEMENTS).map_or("", String::as_str).split(' ');
    values.filter_map(|value| value.parse().ok()).collect()
}

/// Returns model and state at the start of a plan's run on `bed`.
///
/// # Errors
/// Tools or sleepers that do not fit into the bed.
pub fn scene(plan: &Plan, bed: Bed) -> Result<(Model, State), Error> {
    track::scene(plan, bed).map_err(|source| Error::Scene { case: plan.name.clone(), source })
}

/// Returns model and state at the start of a plan's run without grains. The prescribed motions do not depend on them.
///
/// # Errors
/// As for [`scene`] and [`BedStore::prepare`].
pub fn empty_scene(plan: &Plan) -> Result<(Model, State), Error> {
    let failed = |source| Error::Preparation { case: plan.name.clone(), source };
    scene(plan, track::empty_bed(plan).map_err(failed)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    const CASE: &str = include_str!("../../../examples/first.toml");

    fn case() -> Case {
        Case::parse(CASE.into(), "first").expect("an example")
    }

    #[test]
    fn a_stopped_preparation_leaves_no_file() {
        let folder = tempfile::tempdir().expect("a folder");
        let beds = BedStore::new(folder.path().join("new"));
        let stopped = beds.prepare(&case(), &mut |_| ControlFlow::Break(())).expect("a stop");
        assert!(stopped.is_none());
        assert!(beds.find(&case().plan).expect("an empty store").is_none());
    }

    #[test]
    fn another_file_in_place_of_a_bed_is_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let beds = BedStore::new(folder.path());
        std::fs::write(beds.path(&case().plan), b"no bed").expect("a file");
        assert!(matches!(beds.find(&case().plan), Err(Error::Read(_))));
        std::fs::write(folder.path().join("file"), b"").expect("a file");
        // No file can be created in the second, not even by root.
        for unusable in [folder.path().join("file/beds"), "/proc".into()] {
            let mut watch = |_: &DepositProgress| panic!("prepares a bed that cannot be written");
            let refused = BedStore::new(unusable).prepare(&case(), &mut watch);
            assert!(matches!(refused, Err(Error::Folder { .. })));
        }
    }
}
