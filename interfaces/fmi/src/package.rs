//! Archive of a unit: description, library, case, and the bed or the component that serves it.

use crate::bed::{BED_FILE, Error, UnitBed, instantiation_token};
use crate::description::{BedPlace, MODEL_IDENTIFIER};
use crate::served_unit::{SERVED_FILE, ServedUnit};
use crate::variable_table::VariableTable;
use crate::{description2, description3};
use std::io::{Cursor, Write};
use zip::CompressionMethod;
use zip::write::{SimpleFileOptions, ZipWriter};

/// Name of the library's file on this system.
pub const LIBRARY_FILE: &str = if cfg!(windows) {
    "ballast_fmu.dll"
} else if cfg!(target_os = "macos") {
    "libballast_fmu.dylib"
} else {
    "libballast_fmu.so"
};

/// Version of FMI.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FmiVersion {
    /// FMI 2.0: scalars.
    Two,
    /// FMI 3.0: arrays and terminals.
    Three,
}

impl FmiVersion {
    /// Returns the path of the library in the archive, on this system.
    fn library_path(self) -> String {
        let ending = LIBRARY_FILE.rsplit('.').next().unwrap_or_default();
        let os = std::env::consts::OS;
        let platform = match (self, os) {
            (FmiVersion::Two, "windows") => "win64".into(),
            (FmiVersion::Two, "macos") => "darwin64".into(),
            (FmiVersion::Two, _) => "linux64".into(),
            (FmiVersion::Three, "macos") => format!("{}-darwin", std::env::consts::ARCH),
            (FmiVersion::Three, _) => format!("{}-{os}", std::env::consts::ARCH),
        };
        format!("binaries/{platform}/{MODEL_IDENTIFIER}.{ending}")
    }
}

/// Returns the bytes of a unit with a bed inside and a library; equal content gives equal bytes.
///
/// # Errors
/// A description or an archive that cannot be written.
pub fn unit_bytes(bed: &UnitBed, library: &[u8], version: FmiVersion) -> Result<Vec<u8>, Error> {
    let table = VariableTable::new(bed);
    archive(bed, &table, BedPlace::Unit, (BED_FILE, bed.to_bytes()), library, version)
}

/// Returns the bytes of a unit whose bed a component serves; equal content gives equal bytes.
///
/// # Errors
/// A description or an archive that cannot be written.
pub fn served_unit_bytes(
    bed: &UnitBed,
    served: &ServedUnit,
    library: &[u8],
    version: FmiVersion,
) -> Result<Vec<u8>, Error> {
    let place = BedPlace::Server(&served.component);
    let table = VariableTable::from_variables(served.variables.clone());
    archive(bed, &table, place, (SERVED_FILE, served.to_bytes()?), library, version)
}

/// Writes an archive with a resource that the library reads.
fn archive(
    bed: &UnitBed,
    table: &VariableTable,
    place: BedPlace,
    (resource, bytes): (&str, Vec<u8>),
    library: &[u8],
    version: FmiVersion,
) -> Result<Vec<u8>, Error> {
    let token = instantiation_token(&bytes);
    let failed = |e: &dyn std::fmt::Display| Error::Package(e.to_string());
    let description = match version {
        FmiVersion::Two => description2::model_description(bed, table, &token, place),
        FmiVersion::Three => description3::model_description(bed, table, &token, place),
    };
    let mut files = vec![
        ("modelDescription.xml".to_string(), description.map_err(|e| failed(&e))?, 0o644),
        (version.library_path(), library.to_vec(), 0o755),
        (format!("resources/{resource}"), bytes, 0o644),
        // For people; the library reads the file above.
        ("resources/case.toml".into(), bed.case_text.clone().into_bytes(), 0o644),
    ];
    if version == FmiVersion::Three {
        let terminals = description3::terminals(table).map_err(|e| failed(&e))?;
        files.push(("terminalsAndIcons/terminalsAndIcons.xml".into(), terminals, 0o644));
    }
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    for (name, content, mode) in files {
        let options = SimpleFileOptions::default()
            .compression_method(CompressionMethod::Deflated)
            .unix_permissions(mode);
        archive.start_file(name, options).map_err(|e| failed(&e))?;
        archive.write_all(&content).map_err(|e| failed(&e))?;
    }
    Ok(archive.finish().map_err(|e| failed(&e))?.into_inner())
}
