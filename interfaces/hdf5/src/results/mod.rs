//! Results of a run: one HDF5 file that viewers can open.
//!
//! `/VTKHDF`: frames, for ParaView and VTK 9.4 on: blocks `grains`, `sleepers`, `tines`, `boundary`
//! (true polyhedra; cell data `body`, `speed` m/s, `load` N) and `contacts` (points that carry a
//! force). `/frames`: step of each frame, poses. `/tables`: tables of numbers over the steps.
//! `/metadata`: the case. Reads: model, state, workspace.
//! Contract: [`ResultsWriter::frame`] passes all data to the operating system. After a crash the file is readable up to its
//! last frame, or the last flush of a table, unless the crash was inside a flush. In both cases
//! [`ResultsWriter::append_to`] continues from the last [`ResultsWriter::secure`].

mod background_writer;
mod block;
mod frame_data;
mod growing;
mod index_backup;
mod reader;
mod surface;
mod table_buffer;

pub use background_writer::BackgroundWriter;
pub use frame_data::FrameData;
pub use reader::{BlockFrame, FieldArray, ResultsReader, ResultsTable};

use crate::error::{Fault, FaultInFile, Result, hdf5 as hdf5_error, io};
use crate::seal;
use ballast::geometry::Polyhedron;
use ballast::model::{DrivenBody, Model};
use ballast::state::State;
use ballast::workspace::Workspace;
use ballast_columns::{columns, columns_hash};
use block::{FieldLocation, VtkBlock};
use hdf5::plist::file_access::{
    CacheDecreaseMode, CacheIncreaseMode, FlashIncreaseMode, MetadataCacheConfig,
};
use hdf5::{File, Group};
use index_backup::IndexBackup;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use surface::{Extent, SurfaceMesh};
use table_buffer::TableBuffer;

/// Name of the block of contact points.
const CONTACTS: &str = "contacts";

/// Returns true if results may have a block with this name.
pub(crate) fn is_block(name: &str) -> bool {
    name == CONTACTS || surface::is_named(name)
}

/// Version of the format.
pub const VERSION: u32 = 2;

pub(crate) const FORMAT: &str = "ballast-results";

/// Seal of complete results, which detects a changed byte before the HDF5 library reads it.
const SEAL: seal::SealFormat = seal::SealFormat { name: "ballast-results-end", version: 1 };

/// Origin of a results file.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ResultsMetadata {
    /// Name of the case.
    pub case_name: String,
    /// Text of the case file.
    pub case_text: String,
    /// Content key of the bed at the start of the run.
    pub key: String,
    /// Name and version of the writing program.
    pub program: String,
}

/// Writer of the results of one run. Used by one thread, because HDF5 serialises all calls.
#[derive(Debug)]
pub struct ResultsWriter {
    path: PathBuf,
    file: File,
    model: Model,
    last_step: Option<u64>,
    /// Surfaces of the bodies, known after the first frame.
    surfaces: Vec<SurfaceMesh>,
    series: BTreeMap<String, TableBuffer>,
    index_backup: IndexBackup,
}

/// Opens a file for writing so that a crash between two flushes leaves the file of the first one. For crashes inside a flush
/// see [`index_backup`].
fn open(path: &Path, new: bool) -> hdf5::Result<File> {
    let mut options = File::with_options();
    options.with_fapl(|p| {
        // Not 1.10: its files have a mark while they are written, and could not be opened after a crash.
        p.libver_v18();
        // A viewer may read the file meanwhile; many parallel file systems have no locks.
        p.file_locking(false);
        // Data are written at once, so that a full disk is an error of that write. A cache would write them when the
        // dataset is closed, where the error is lost.
        p.chunk_cache(0, 0, 1.0);
        // Metadata are written by a flush only, all together.
        p.mdc_config(&MetadataCacheConfig {
            evictions_enabled: false,
            incr_mode: CacheIncreaseMode::Off,
            flash_incr_mode: FlashIncreaseMode::Off,
            decr_mode: CacheDecreaseMode::Off,
            ..MetadataCacheConfig::default()
        })
    });
    // The root group has no time stamps either.
    options.with_fcpl(|p| p.obj_track_times(false));
    if new { options.create(path) } else { options.open_rw(path) }
}

/// Repairs the file at `path` after a crash inside a flush, before it is read by a continued run.
///
/// # Errors
/// As for [`ResultsWriter::append_to`], which also repairs the file.
pub fn mend(path: &Path) -> Result<()> {
    index_backup::restore(path)
}

impl ResultsWriter {
    /// Creates or replaces a file.
    pub fn create(path: impl AsRef<Path>, model: &Model, meta: &ResultsMetadata) -> Result<Self> {
        let path = path.as_ref();
        // Before the file is emptied: a backup must never be restored into another file.
        index_backup::remove(path)?;
        // The library's message for a missing folder does not name the cause.
        std::fs::File::create(path).map_err(io(path, "create"))?;
        let file = open(path, true).map_err(hdf5_error(path, "file"))?;
        let writer = Self {
            path: path.into(),
            file,
            model: model.clone(),
            last_step: None,
            surfaces: vec![],
            series: BTreeMap::new(),
            index_backup: IndexBackup::default(),
        };
        writer.start(meta).map_err(hdf5_error(path, "start of the file"))?;
        Ok(writer)
    }

    fn start(&self, meta: &ResultsMetadata) -> hdf5::Result<()> {
        let metadata = growing::group(&self.file, "metadata")?;
        growing::texts(&metadata, "format", &[FORMAT])?;
        growing::number(&metadata, "version", VERSION)?;
        growing::texts(&metadata, "case_name", &[&meta.case_name])?;
        growing::long_text(&metadata, "case_text", &meta.case_text)?;
        growing::texts(&metadata, "key", &[&meta.key])?;
        growing::texts(&metadata, "program", &[&meta.program])?;
        growing::texts(&metadata, "bodies_hash", &[&bodies_hash(&self.model)])?;
        growing::number(&metadata, "grains", self.model.grains.len() as u64)?;
        let driven = &self.model.driven;
        let names: Vec<&str> = driven.iter().map(|d| d.name.as_str()).collect();
        let role = |d: &DrivenBody| d.role.name();
        growing::texts(&metadata, "driven", &names)?;
        growing::texts(&metadata, "driven_roles", &driven.iter().map(role).collect::<Vec<_>>())?;
        let frames = growing::group(&self.file, "frames")?;
        let nb = self.model.body_count();
        growing::create_table::<u64>(&frames, "step", &[])?;
        growing::create_one_by_one::<f64>(&frames, "position", [nb.max(1), 3])?;
        growing::create_one_by_one::<f64>(&frames, "orientation", [nb.max(1), 4])?;
        growing::texts(&frames, "components", &["position: x, y, z", "orientation: w, x, y, z"])?;
        growing::group(&self.file, "tables")?;
        self.file.flush()
    }

    /// Continues an existing file from the checkpoint of step `at_step`; removes later frames and rows,
    /// which a stopped run wrote after the checkpoint. Interrupted at any moment, the call can be repeated.
    pub fn append_to(path: impl AsRef<Path>, model: &Model, at_step: u64) -> Result<Self> {
        let path = path.as_ref();
        index_backup::restore(path)?;
        let reader = ResultsReader::open(path)?;
        let metadata = reader.metadata("bodies_hash")?;
        let expected = bodies_hash(model);
        if metadata != expected {
            let fault = Fault::new("bodies", format!("those of the file, {metadata}"), expected);
            return Err(fault.refused(path));
        }
        let steps = reader.steps().to_vec();
        let kept = steps.partition_point(|&step| step <= at_step);
        // Of a cut that was interrupted, only the frames that stay are intact.
        let poses = if kept == 0 { None } else { Some(reader.poses(0)?) };
        let tables = reader.table_names()?;
        drop(reader);
        seal::take_from_end(path, &SEAL)?;
        let file = open(path, false).map_err(hdf5_error(path, "file"))?;
        // Repairs the file after a crash inside the cut, until the backup of the cut file replaces it.
        IndexBackup::default().write(path, &file)?;
        let mut writer = Self {
            path: path.into(),
            file,
            model: model.clone(),
            last_step: kept.checked_sub(1).map(|k| steps[k]),
            surfaces: vec![],
            series: BTreeMap::new(),
            index_backup: IndexBackup::default(),
        };
        if let Some(poses) = poses {
            let extent = surface::extent(model, &poses);
            writer.surfaces = surface::all(model, &poses, &extent);
        }
        writer.cut(kept, at_step, &tables).map_err(hdf5_error(path, "earlier frames"))?;
        writer.index_backup.write(path, &writer.file)?;
        Ok(writer)
    }

    fn cut(&mut self, frames: usize, at_step: u64, tables: &[String]) -> hdf5::Result<()> {
        if frames == 0 {
            // Without a frame, the next one determines the drawn size of half-spaces.
            self.surfaces.clear();
            if self.file.link_exists("VTKHDF") {
                self.file.unlink("VTKHDF")?;
            }
        } else {
            let root = self.file.group("VTKHDF")?;
            for name in VtkBlock::names(&root)? {
                VtkBlock::open(&root, &name)?.truncate(frames)?;
            }
        }
        let group = self.file.group("frames")?;
        for name in ["step", "position", "orientation"] {
            growing::truncate(&group, name, frames)?;
        }
        for name in tables {
            let table = TableBuffer::open(&self.file.group("tables")?, name, at_step)?;
            self.series.insert(name.clone(), table);
        }
        self.file.flush()
    }

    /// Writes a frame: bodies and forces after a step, which must be later than the previous frame.
    pub fn frame(&mut self, model: &Model, state: &State, workspace: &Workspace) -> Result<()> {
        self.write(&FrameData::take(model, state, workspace))
    }

    /// Writes a frame from data that were collected earlier.
    pub fn write(&mut self, frame: &FrameData) -> Result<()> {
        let nb = self.model.body_count();
        if frame.poses.len() != nb || frame.speed.len() != nb {
            let fault = Fault::new("frame", format!("{nb} bodies"), frame.poses.len());
            return Err(fault.refused(&self.path));
        }
        if let Some(last) = self.last_step.filter(|&last| frame.step <= last) {
            let fault = Fault::new("frame", format!("a step after {last}"), frame.step);
            return Err(fault.refused(&self.path));
        }
        let place = format!("frame of step {}", frame.step);
        self.add(frame).map_err(hdf5_error(&self.path, &place))?;
        self.last_step = Some(frame.step);
        self.flush()
    }

    fn add(&mut self, frame: &FrameData) -> hdf5::Result<()> {
        if !self.file.link_exists("VTKHDF") {
            self.lay_out(frame)?;
        }
        let root = self.file.group("VTKHDF")?;
        let shapes = &self.model.shapes;
        for surface in &self.surfaces {
            add_surface(&VtkBlock::open(&root, surface.name)?, surface, shapes, frame)?;
        }
        add_contacts(&VtkBlock::open(&root, CONTACTS)?, frame)?;
        let group = self.file.group("frames")?;
        let position: Vec<f64> =
            frame.poses.iter().flat_map(|p| columns::xyz(&p.position)).collect();
        let orientation: Vec<f64> =
            frame.poses.iter().flat_map(|p| columns::wxyz(&p.orientation)).collect();
        if !frame.poses.is_empty() {
            growing::append(&group, "position", &position)?;
            growing::append(&group, "orientation", &orientation)?;
        }
        // Data are written before the counters, so that a crash in between loses this frame only.
        self.file.flush()?;
        for name in VtkBlock::names(&root)? {
            VtkBlock::open(&root, &name)?.show()?;
        }
        growing::append(&group, "step", &[frame.step]).map(drop)
    }

    /// Creates the blocks; the first frame determines the size of the scene.
    fn lay_out(&mut self, frame: &FrameData) -> hdf5::Result<()> {
        let root = block::create_root(&self.file)?;
        let extent: Extent = surface::extent(&self.model, &frame.poses);
        self.surfaces = surface::all(&self.model, &frame.poses, &extent);
        let shapes = &self.model.shapes;
        for (index, surface) in self.surfaces.iter().enumerate() {
            let points = surface.points(shapes, &frame.poses).len();
            let (starts, corners, bodies) = surface.topology(shapes);
            let block = VtkBlock::create(&root, surface.name, index, points)?;
            for name in ["speed", "load"] {
                block.declare::<f32>(FieldLocation::Cells, name, 1, bodies.len())?;
            }
            block.declare::<i32>(FieldLocation::Cells, "body", 1, bodies.len())?;
            block.set_polygons(points, &starts, &corners)?;
            block.set_constant(FieldLocation::Cells, "body", &bodies)?;
            block::link(&root, surface.name)?;
        }
        let expected = 2 * self.model.grains.len();
        let block = VtkBlock::create(&root, CONTACTS, self.surfaces.len(), expected)?;
        for name in ["force", "normal"] {
            block.declare::<f32>(FieldLocation::Points, name, 3, expected)?;
        }
        for name in ["normal_force", "gap"] {
            block.declare::<f32>(FieldLocation::Points, name, 1, expected)?;
        }
        for name in ["candidate", "antagonist"] {
            block.declare::<i32>(FieldLocation::Points, name, 1, expected)?;
        }
        block::link(&root, CONTACTS)
    }

    /// Declares a table of numbers over the steps, with name and unit of each column. A second call has no effect.
    pub fn table(&mut self, name: &str, columns: &[(&str, &str)]) -> Result<()> {
        if let Some(known) = self.series.get(name) {
            if known.fits(columns) {
                return Ok(());
            }
            let fault = Fault::new(name, known.describe(), format!("{columns:?}"));
            return Err(fault.refused(&self.path));
        }
        if name.is_empty() || name.contains(['/', '\0']) || columns.is_empty() {
            let found = format!("{name:?} with {} columns", columns.len());
            let expected = "a name without \"/\" and at least one column";
            return Err(Fault::new("tables", expected, found).refused(&self.path));
        }
        let create = || TableBuffer::create(&self.file.group("tables")?, name, columns);
        let table = create().map_err(hdf5_error(&self.path, name))?;
        self.series.insert(name.into(), table);
        Ok(())
    }

    /// Appends a row for the end of step `step` to a declared table.
    ///
    /// Rows are collected and written by the thousand, with the next frame, or by [`ResultsWriter::flush`].
    pub fn append(&mut self, name: &str, step: u64, row: &[f64]) -> Result<()> {
        let Some(table) = self.series.get_mut(name) else {
            let known: Vec<_> = self.series.keys().collect();
            let fault = Fault::new("tables", format!("one of {known:?}"), format!("{name:?}"));
            return Err(fault.refused(&self.path));
        };
        table.push(step, row).map_err(|f| f.refused(&self.path))?;
        if table.is_full() {
            let group = self.file.group("tables").map_err(hdf5_error(&self.path, name))?;
            table.store(&group, name).map_err(hdf5_error(&self.path, name))?;
        }
        Ok(())
    }

    /// Passes all data to the operating system.
    pub fn flush(&mut self) -> Result<()> {
        self.flush_all().map_err(hdf5_error(&self.path, "flush"))
    }

    /// Passes all data to the disk and writes a backup of the index, from which a later crash is repaired.
    ///
    /// Called before every checkpoint, so that the results it depends on survive any crash of program or machine.
    pub fn secure(&mut self) -> Result<()> {
        self.flush()?;
        self.index_backup.write(&self.path, &self.file)
    }

    fn flush_all(&mut self) -> hdf5::Result<()> {
        let group: Group = self.file.group("tables")?;
        for (name, table) in &mut self.series {
            table.store(&group, name)?;
        }
        self.file.flush()
    }

    /// Completes and seals the file, and synchronises it with the disk.
    pub fn close(mut self) -> Result<()> {
        self.flush()?;
        let Self { path, file, .. } = self;
        file.close().map_err(hdf5_error(&path, "close"))?;
        seal::put_at_end(&path, &SEAL)?;
        index_backup::remove(&path)
    }

    /// Path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Step of the last frame.
    pub fn last_step(&self) -> Option<u64> {
        self.last_step
    }
}

fn add_surface(
    block: &VtkBlock,
    surface: &SurfaceMesh,
    shapes: &[Polyhedron],
    frame: &FrameData,
) -> hdf5::Result<()> {
    let per_cell = |values: &[f32]| -> Vec<f32> {
        let faces = surface.faces(shapes);
        faces.flat_map(|(body, n)| std::iter::repeat_n(values[body], n)).collect()
    };
    block.add_points(&surface.points(shapes, &frame.poses), false)?;
    block.add(FieldLocation::Cells, "speed", &per_cell(&frame.speed))?;
    block.add(FieldLocation::Cells, "load", &per_cell(&frame.load))?;
    block.again(FieldLocation::Cells, "body")?;
    block.end_step(frame.time)
}

fn add_contacts(block: &VtkBlock, frame: &FrameData) -> hdf5::Result<()> {
    let contacts = &frame.contacts;
    block.add_points(&contacts.point, true)?;
    block.add(FieldLocation::Points, "force", contacts.force.as_flattened())?;
    block.add(FieldLocation::Points, "normal", contacts.normal.as_flattened())?;
    block.add(FieldLocation::Points, "normal_force", &contacts.normal_force)?;
    block.add(FieldLocation::Points, "gap", &contacts.gap)?;
    block.add(FieldLocation::Points, "candidate", &contacts.candidate)?;
    block.add(FieldLocation::Points, "antagonist", &contacts.antagonist)?;
    block.end_step(frame.time)
}

/// Returns a hash of bodies and shapes; a file can only be continued with the same ones.
fn bodies_hash(model: &Model) -> String {
    let nothing = State::default();
    let mut columns = columns::of(model, &nothing);
    columns.retain(|c| ["shapes", "grains", "driven", "parts"].contains(&c.group()));
    format!("{:032x}", columns_hash(&columns))
}
