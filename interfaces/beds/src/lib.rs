//! Cases, and their prepared beds, kept in a folder: found again by what they depend on, or prepared and kept.
//!
//! Every face of the program that opens a case comes through here, so that a bed which one of them has
//! prepared is there for the others.

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
mod pace;

pub use case::Case;
pub use pace::Pace;

/// Why there is no bed.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    #[error("{}: cannot keep beds: {source}", path.display())]
    Folder { path: PathBuf, source: io::Error },
    /// A kept bed that cannot be read.
    #[error(transparent)]
    Kept(ballast_hdf5::Error),
    /// A bed that was prepared and cannot be kept.
    #[error(transparent)]
    Keeping(ballast_hdf5::Error),
    #[error("{}: expected the bed of this case, found {found}", path.display())]
    AnotherBed { path: PathBuf, found: String },
    #[error("preparing the bed of {case}: {source}")]
    Preparation { case: String, source: ballast::Error },
    #[error("{case}: {source}")]
    Scene { case: String, source: ballast::Error },
}

/// A folder of prepared beds, one file each.
#[derive(Debug, Clone)]
pub struct Beds {
    folder: PathBuf,
}

impl Beds {
    pub fn in_folder(folder: impl Into<PathBuf>) -> Self {
        Self { folder: folder.into() }
    }

    /// Where the bed of a plan is kept, or will be.
    pub fn path(&self, plan: &Plan) -> PathBuf {
        self.folder.join(format!("{}.h5", ballast_scenario::content_key(plan)))
    }

    /// The bed of a plan, where it was prepared before.
    ///
    /// # Errors
    /// A file that is there, but is no bed of this plan, or damaged, or of another version.
    pub fn find(&self, plan: &Plan) -> Result<Option<Bed>, Error> {
        let path = self.path(plan);
        if !path.exists() {
            return Ok(None);
        }
        let kept = checkpoint::read(&path).map_err(Error::Kept)?;
        if kept.kind != Kind::Bed || kept.key != ballast_scenario::content_key(plan) {
            let found =
                format!("the {} of {:?}, bed {}", kept.kind.name(), kept.case_name, kept.key);
            return Err(Error::AnotherBed { path, found });
        }
        Ok(Some(Bed { model: kept.model, state: kept.state }))
    }

    /// Prepares the bed of a case and keeps it. `watch` sees every step and may stop it: then there is none.
    ///
    /// # Errors
    /// A case that no bed can be prepared for; a folder or file that cannot be written.
    pub fn prepare(
        &self,
        case: &Case,
        watch: &mut dyn FnMut(&DepositProgress) -> ControlFlow<()>,
    ) -> Result<Option<Bed>, Error> {
        // Before the work.
        self.make_folder(&case.plan)?;
        let failed = |source| Error::Preparation { case: case.plan.name.clone(), source };
        let Some(bed) = track::deposit(&case.plan, watch).map_err(failed)? else { return Ok(None) };
        let kept = case.kept(Kind::Bed, (bed.model, bed.state), BTreeMap::new());
        checkpoint::write(self.path(&case.plan), &kept).map_err(Error::Keeping)?;
        Ok(Some(Bed { model: kept.model, state: kept.state }))
    }

    /// Makes the folder, where the bed of `plan` can be written.
    fn make_folder(&self, plan: &Plan) -> Result<(), Error> {
        // The HDF5 library opens no other.
        let unnamed = || io::Error::new(ErrorKind::InvalidInput, "expected a name in UTF-8");
        let named = self.folder.to_str().ok_or_else(unnamed);
        let made = named.and_then(std::fs::create_dir_all);
        let usable = made.and_then(|()| ballast_hdf5::replaceable(&self.path(plan)));
        usable.map_err(|source| Error::Folder { path: self.folder.clone(), source })
    }
}

/// Model and state at the start of a plan's run, on its bed.
///
/// # Errors
/// Tools or sleepers that find no place there.
pub fn scene(plan: &Plan, bed: Bed) -> Result<(Model, State), Error> {
    track::scene(plan, bed).map_err(|source| Error::Scene { case: plan.name.clone(), source })
}

/// The same without stones, before any is poured: what is led where does not depend on them.
///
/// # Errors
/// As for [`scene`] and [`Beds::prepare`].
pub fn bare_scene(plan: &Plan) -> Result<(Model, State), Error> {
    let failed = |source| Error::Preparation { case: plan.name.clone(), source };
    scene(plan, track::empty_bed(plan).map_err(failed)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    const CASE: &str = include_str!("../../../examples/first.toml");

    fn case() -> Case {
        Case::read(CASE.into(), "first").expect("an example")
    }

    #[test]
    fn a_preparation_that_was_stopped_leaves_nothing() {
        let folder = tempfile::tempdir().expect("a folder");
        let beds = Beds::in_folder(folder.path().join("new"));
        let stopped = beds.prepare(&case(), &mut |_| ControlFlow::Break(())).expect("a stop");
        assert!(stopped.is_none());
        assert!(beds.find(&case().plan).expect("nothing").is_none());
    }

    #[test]
    fn another_file_in_the_place_of_a_bed_is_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let beds = Beds::in_folder(folder.path());
        std::fs::write(beds.path(&case().plan), b"no bed").expect("a file");
        assert!(matches!(beds.find(&case().plan), Err(Error::Kept(_))));
        std::fs::write(folder.path().join("file"), b"").expect("a file");
        // No file can be made in the second, not even by root.
        for nowhere in [folder.path().join("file/beds"), "/proc".into()] {
            let mut watch = |_: &DepositProgress| panic!("a bed that cannot be kept is prepared");
            let refused = Beds::in_folder(nowhere).prepare(&case(), &mut watch);
            assert!(matches!(refused, Err(Error::Folder { .. })));
        }
    }
}
