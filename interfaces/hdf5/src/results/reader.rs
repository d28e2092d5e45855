//! Reader of results files: frames as polygons or points, tables, metadata.
//!
//! Contract: sizes are compared with the file's size before anything is allocated. Damaged compressed data give an error of
//! the HDF5 library with the position. Complete results are sealed, so the library never reads a damaged one.

use super::block::VtkBlock;
use super::{FORMAT, SEAL, VERSION, growing};
use crate::error::{Error, Fault, FaultInFile, Result, hdf5 as hdf5_error, io};
use crate::{image, seal};
use ballast::math::Pose;
use ballast_columns::decode::pose;
use hdf5::{Dataset, File, Group, H5Type};
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Reader of a results file.
#[derive(Debug)]
pub struct ResultsReader {
    path: PathBuf,
    file: File,
    size: u64,
    is_closed: bool,
    steps: Vec<u64>,
}

/// Content of one block in one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct BlockFrame {
    /// Positions of the points `[np]`, m.
    pub points: Vec<[f32; 3]>,
    /// Ends of the polygons in `corners` `[nf]`; empty for a block of points.
    pub polygon_ends: Vec<i64>,
    /// Indices of the points of the polygons, one after the other.
    pub corners: Vec<i64>,
    /// Arrays with one value per polygon.
    pub cell_data: Vec<FieldArray>,
    /// Arrays with one value per point.
    pub point_data: Vec<FieldArray>,
}

/// Named array of values, flat `[rows * width]`.
#[derive(Debug, Clone, PartialEq)]
pub struct FieldArray {
    /// Name of the array.
    pub name: String,
    /// Number of values per row.
    pub width: usize,
    /// Values, row by row.
    pub values: Vec<f32>,
}

/// Table of numbers over the steps.
#[derive(Debug, Clone, PartialEq)]
pub struct ResultsTable {
    /// Name and unit of each column.
    pub columns: Vec<(String, String)>,
    /// Step of each row `[n]`.
    pub steps: Vec<u64>,
    /// Values, flat `[n * columns]`.
    pub rows: Vec<f64>,
}

impl ResultsReader {
    /// Opens a results file.
    ///
    /// # Errors
    /// [`Error::Version`] for another version, [`Error::Damaged`] for another kind of file.
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let size = std::fs::metadata(path).map_err(io(path, "open"))?.len();
        let start = seal::start_of(path)?;
        if start.starts_with(b"ballast-") {
            let line = String::from_utf8_lossy(&start);
            let found = line.lines().next().unwrap_or_default();
            return Err(Fault::new("format", FORMAT, found).in_file(path));
        }
        let is_closed = seal::check_at_end(path, &SEAL)?;
        let file = image::open(path).map_err(hdf5_error(path, "file"))?;
        let mut reader = Self { path: path.into(), file, size, is_closed, steps: vec![] };
        reader.check_format()?;
        let steps = reader.dataset("frames/step")?;
        reader.steps = reader.rows(&steps, 0..rows_of(&steps), 1)?;
        Ok(reader)
    }

    fn check_format(&self) -> Result<()> {
        if !self.file.link_exists("metadata") {
            let found = "an HDF5 file without /metadata";
            return Err(Fault::new("format", FORMAT, found).in_file(&self.path));
        }
        let metadata = self.group("metadata")?;
        let version = metadata.attr("version").and_then(|a| a.read_scalar::<u32>());
        let version = version.map_err(hdf5_error(&self.path, "metadata/version"))?;
        let format = self.metadata("format")?;
        if format == FORMAT && version == VERSION {
            return Ok(());
        }
        Err(Error::Version {
            path: self.path.clone(),
            expected: format!("{FORMAT} {VERSION}"),
            found: format!("{format} {version}"),
        })
    }

    /// Returns true if the writer has closed the file. A running or killed run has not.
    pub fn is_closed(&self) -> bool {
        self.is_closed
    }

    /// Steps of the frames.
    pub fn steps(&self) -> &[u64] {
        &self.steps
    }

    /// Returns a text of `/metadata`: `case_name`, `case_text`, `key` or `program`.
    pub fn metadata(&self, name: &str) -> Result<String> {
        if name == "case_text" {
            let text = self.dataset("metadata/case_text")?;
            let bytes: Vec<u8> = self.rows(&text, 0..text.size(), 1)?;
            return Ok(String::from_utf8_lossy(&bytes).into_owned());
        }
        let texts = growing::read_texts(&self.group("metadata")?, name);
        let texts = texts.map_err(hdf5_error(&self.path, &format!("metadata/{name}")))?;
        Ok(texts.into_iter().next().unwrap_or_default())
    }

    /// Returns the number of grains and the names of the driven bodies.
    pub fn bodies(&self) -> Result<(u64, Vec<String>)> {
        let metadata = self.group("metadata")?;
        let read = || -> hdf5::Result<_> {
            Ok((metadata.attr("grains")?.read_scalar()?, growing::read_texts(&metadata, "driven")?))
        };
        read().map_err(hdf5_error(&self.path, "metadata"))
    }

    /// Returns the role of each driven body: `boundary`, `sleeper` or `tine`.
    pub fn roles(&self) -> Result<Vec<String>> {
        let metadata = self.group("metadata")?;
        let roles = growing::read_texts(&metadata, "driven_roles");
        roles.map_err(hdf5_error(&self.path, "metadata/driven_roles"))
    }

    /// Returns the names of the blocks.
    pub fn blocks(&self) -> Result<Vec<String>> {
        if !self.file.link_exists("VTKHDF") {
            return Ok(vec![]);
        }
        VtkBlock::names(&self.group("VTKHDF")?).map_err(hdf5_error(&self.path, "VTKHDF"))
    }

    /// Returns the simulated time of each frame, s.
    pub fn times(&self) -> Result<Vec<f64>> {
        let Some(block) = self.blocks()?.into_iter().next() else { return Ok(vec![]) };
        let values = self.dataset(&format!("VTKHDF/{block}/Steps/Values"))?;
        self.rows(&values, 0..self.steps.len(), 1)
    }

    /// Returns the poses of all bodies in a frame.
    pub fn poses(&self, frame: usize) -> Result<Vec<Pose>> {
        let (grains, driven) = self.bodies()?;
        let bodies = usize::try_from(grains).unwrap_or(usize::MAX).saturating_add(driven.len());
        let row = |name: &str, width: usize| -> Result<Vec<f64>> {
            self.rows(&self.dataset(name)?, frame..frame + 1, bodies.saturating_mul(width))
        };
        let (position, orientation) = (row("frames/position", 3)?, row("frames/orientation", 4)?);
        let both = position.chunks_exact(3).zip(orientation.chunks_exact(4));
        let pose = |(p, q): (&[f64], &[f64])| pose(&[p[0], p[1], p[2], q[0], q[1], q[2], q[3]]);
        Ok(both.map(pose).collect())
    }

    /// Returns one block in one frame.
    pub fn block(&self, block: &str, frame: usize) -> Result<BlockFrame> {
        let at = format!("VTKHDF/{block}");
        let number = |name: &str, row: usize| -> Result<usize> {
            let dataset = self.dataset(&format!("{at}/{name}"))?;
            let value: Vec<i64> = self.rows(&dataset, row..row + 1, 1)?;
            usize::try_from(value[0])
                .map_err(|_| Fault::new(name, "0 or above", value[0]).in_file(&self.path))
        };
        let part = number("Steps/PartOffsets", frame)?;
        let first = number("Steps/PointOffsets", frame)?;
        let points = number("NumberOfPoints", part)?;
        let polygons = number("Polygons/NumberOfCells", part)?;
        let corners = number("Polygons/NumberOfConnectivityIds", part)?;
        let of_frame = first..first.saturating_add(points);
        let flat: Vec<f32> = self.rows(&self.dataset(&format!("{at}/Points"))?, of_frame, 3)?;
        let ends = self.dataset(&format!("{at}/Polygons/Offsets"))?;
        let ids = self.dataset(&format!("{at}/Polygons/Connectivity"))?;
        let mut frame_of = BlockFrame {
            points: flat.as_chunks().0.to_vec(),
            polygon_ends: self.rows(&ends, 1..polygons.saturating_add(1), 1)?,
            corners: self.rows(&ids, 0..corners, 1)?,
            cell_data: vec![],
            point_data: vec![],
        };
        self.check_polygons(block, &frame_of)?;
        frame_of.cell_data = self.arrays(&at, "Cell", frame, polygons)?;
        frame_of.point_data = self.arrays(&at, "Point", frame, points)?;
        Ok(frame_of)
    }

    fn check_polygons(&self, block: &str, frame: &BlockFrame) -> Result<()> {
        let ends = &frame.polygon_ends;
        let last = ends.last().copied().unwrap_or(0);
        let good = ends.is_sorted()
            && ends.first().is_none_or(|&e| e >= 0)
            && last == frame.corners.len() as i64
            && frame.corners.iter().all(|&c| (0..frame.points.len() as i64).contains(&c));
        if good {
            return Ok(());
        }
        let expected = "rising ends of polygons, corners among the points";
        Err(Fault::new(format!("VTKHDF/{block}/Polygons"), expected, "others").in_file(&self.path))
    }

    fn arrays(&self, at: &str, on: &str, frame: usize, rows: usize) -> Result<Vec<FieldArray>> {
        let data = self.group(&format!("{at}/{on}Data"))?;
        let mut names = data.member_names().map_err(hdf5_error(&self.path, at))?;
        names.sort();
        let array = |name: String| {
            let offsets = self.dataset(&format!("{at}/Steps/{on}DataOffsets/{name}"))?;
            let first: Vec<i64> = self.rows(&offsets, frame..frame + 1, 1)?;
            let first = first[0].max(0) as usize;
            let dataset = self.dataset(&format!("{at}/{on}Data/{name}"))?;
            let width = dataset.shape().get(1).copied().unwrap_or(1);
            let values = self.rows(&dataset, first..first.saturating_add(rows), width)?;
            Ok(FieldArray { name, width, values })
        };
        names.into_iter().map(array).collect()
    }

    /// Returns the names of the tables.
    pub fn table_names(&self) -> Result<Vec<String>> {
        let names = self.group("tables")?.member_names();
        let mut names = names.map_err(hdf5_error(&self.path, "tables"))?;
        names.sort();
        Ok(names)
    }

    /// Returns a table.
    pub fn table(&self, name: &str) -> Result<ResultsTable> {
        let at = format!("tables/{name}");
        let group = self.group(&at)?;
        let texts = |name| growing::read_texts(&group, name).map_err(hdf5_error(&self.path, &at));
        let columns: Vec<_> = texts("columns")?.into_iter().zip(texts("units")?).collect();
        let steps = self.dataset(&format!("{at}/step"))?;
        let n = rows_of(&steps);
        let rows = self.rows(&self.dataset(&format!("{at}/rows"))?, 0..n, columns.len())?;
        Ok(ResultsTable { columns, steps: self.rows(&steps, 0..n, 1)?, rows })
    }

    fn group(&self, name: &str) -> Result<Group> {
        self.file.group(name).map_err(hdf5_error(&self.path, name))
    }

    fn dataset(&self, name: &str) -> Result<Dataset> {
        self.file.dataset(name).map_err(hdf5_error(&self.path, name))
    }

    /// Returns the number of rows with `width` values of a dataset, limited by its size.
    fn rows<T: H5Type>(
        &self,
        dataset: &Dataset,
        range: Range<usize>,
        width: usize,
    ) -> Result<Vec<T>> {
        let (shape, place) = (dataset.shape(), dataset.name());
        let refused = |expected: String| {
            Fault::new(&*place, expected, format!("shape {shape:?}")).in_file(&self.path)
        };
        let product = |shape: &[usize], one: u64| {
            shape.iter().try_fold(one, |all, &n| all.checked_mul(n as u64))
        };
        let stored = dataset.storage_size().min(self.size);
        let most = stored.saturating_mul(image::DEFLATE_AT_BEST);
        if product(&shape, size_of::<T>() as u64).is_none_or(|bytes| bytes > most) {
            return Err(refused(format!("at most {most} bytes, of which {stored} are stored")));
        }
        let Some((&rows, within)) = shape.split_first() else {
            return Err(refused(format!("rows of {width} values")));
        };
        if range.end > rows || product(within, 1) != Some(width as u64) {
            return Err(refused(format!("rows {range:?} of {width} values")));
        }
        growing::read(dataset, range).map_err(hdf5_error(&self.path, &place))
    }
}

/// Returns the claimed size of a dataset.
fn rows_of(dataset: &Dataset) -> usize {
    dataset.shape().first().copied().unwrap_or(0)
}
