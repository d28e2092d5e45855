//! Resources of a unit: a bed, or the name of the component that serves it.

use crate::bed::{Error, UnitBed, instantiation_token};
use crate::bed_backend::BedBackend;
use crate::local_bed::LocalBed;
use crate::logger::UnitLogger;
#[cfg(feature = "zenoh")]
use crate::served_bed::ServedBed;
use crate::served_unit::{ServedUnit, UnitOutline};
use crate::variable_table::VariableTable;
use rayon::ThreadPoolBuilder;
use std::path::Path;

/// Resources of a unit.
pub(crate) enum UnitResources {
    /// Bed inside the unit.
    Bed(UnitBed),
    /// Bed on a server.
    Served(ServedUnit),
}

impl UnitResources {
    /// Reads the resources in a folder; returns them with the instantiation token of the unit.
    ///
    /// # Errors
    /// A file that cannot be read, or has other content.
    pub fn read(folder: &Path) -> Result<(Self, String), Error> {
        if let Some((unit, bytes)) = ServedUnit::read(folder)? {
            return Ok((Self::Served(unit), instantiation_token(&bytes)));
        }
        let (bed, token) = UnitBed::read(folder)?;
        Ok((Self::Bed(bed), token))
    }

    /// Returns outline, variables and the bed at the start of its run.
    ///
    /// # Errors
    /// A bed that cannot be advanced, or a served component that cannot be owned.
    pub fn open(
        self,
        logger: &UnitLogger,
    ) -> Result<(UnitOutline, VariableTable, Box<dyn BedBackend>), Error> {
        match self {
            Self::Bed(bed) => {
                // Zones are measured in parallel; the threads of rayon's global pool would never end.
                let pool = ThreadPoolBuilder::new().num_threads(1).build();
                let pool = pool.map_err(|e| Error::Package(format!("threads: {e}")))?;
                let (outline, table) =
                    (UnitOutline::of(&bed), pool.install(|| VariableTable::new(&bed)));
                Ok((outline, table, Box::new(LocalBed::new(bed)?)))
            }
            #[cfg(feature = "zenoh")]
            Self::Served(unit) => {
                let unit = unit.with_environment(|name| std::env::var(name).ok());
                let bed = ServedBed::attach(&unit, logger)?;
                let table = VariableTable::from_variables(unit.variables);
                Ok((unit.outline, table, Box::new(bed)))
            }
            #[cfg(not(feature = "zenoh"))]
            Self::Served(unit) => {
                let (component, _) = (unit.component, logger);
                let found = "one that was built without the feature `zenoh`";
                Err(Error::Served(format!(
                    "{component}: expected a library with network, found {found}"
                )))
            }
        }
    }
}
