//! Conversion of columns to and from HDF5 datasets.
//!
//! Files are built in memory and written by [`crate::seal`], because the HDF5 library can neither write nor close a file
//! after a full disk.
//! Contract of reading: type, rank, width and number of rows are compared, and the claimed size is
//! bounded by the file's, before anything is allocated.

use crate::error::{Error, Fault, FaultInFile, Result, hdf5 as hdf5_error, io};
use ballast_columns::columns::{Column, Data, wxyz, xyz};
use ballast_columns::{ColumnReader, DataKind};
use hdf5::types::{TypeDescriptor, VarLenUnicode};
use hdf5::{Dataset, File, H5Type};
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

/// Maximum ratio of inflated to deflated bytes.
pub(crate) const DEFLATE_AT_BEST: u64 = 1032;
/// Maximum size of a compressed dataset after inflation, bytes.
const MAX_INFLATED_BYTES: u64 = 1 << 30;

/// Creates a file in memory in the oldest format. Later formats have a checksum of their first block, which
/// the library does not update in the image.
pub(crate) fn new_image(path: &Path) -> Result<File> {
    // No file of this name is created. The path itself may be unusable for the library, which identifies files by name.
    static MADE: AtomicU64 = AtomicU64::new(0);
    let name = format!("image {}", MADE.fetch_add(1, Ordering::Relaxed));
    File::with_options()
        .with_fapl(|p| p.core_options(1 << 20, false).libver_earliest())
        .create(name)
        .map_err(hdf5_error(path, "image in memory"))
}

/// Opens a file for reading without a lock, so that readers do not block a writer.
pub(crate) fn open(path: &Path) -> hdf5::Result<File> {
    File::with_options().with_fapl(|p| p.file_locking(false)).open(path)
}

/// Returns the bytes of a file in memory.
pub(crate) fn bytes_of(file: &File, path: &Path) -> Result<Vec<u8>> {
    file.flush().map_err(hdf5_error(path, "image in memory"))?;
    let failed = || io(path, "copy the image of")(std::io::Error::other("HDF5 gave no image"));
    let id = file.id();
    hdf5::sync::sync(|| {
        // SAFETY: the library's lock is held; a null buffer of length 0 asks for the size.
        let size = unsafe { hdf5_sys::h5f::H5Fget_file_image(id, std::ptr::null_mut(), 0) };
        let mut image = vec![0_u8; usize::try_from(size).map_err(|_| failed())?];
        // SAFETY: the buffer is as long as said, and no other thread writes the file in between.
        let copied =
            unsafe { hdf5_sys::h5f::H5Fget_file_image(id, image.as_mut_ptr().cast(), image.len()) };
        if copied == size { Ok(image) } else { Err(failed()) }
    })
}

/// Writes one column as a dataset; creates its group if necessary.
pub(crate) fn put(file: &File, path: &Path, column: &Column) -> Result<()> {
    let name = column.name;
    let done = match &column.data {
        Data::F64(v) => put_array(file, name, column.width, v),
        Data::Vectors(rows) => {
            let flat: Vec<f64> = rows.iter().flat_map(xyz).collect();
            put_array(file, name, column.width, &flat)
        }
        Data::Quaternions(rows) => {
            let flat: Vec<f64> = rows.iter().flat_map(wxyz).collect();
            put_array(file, name, column.width, &flat)
        }
        Data::U64(v) => put_array(file, name, column.width, v),
        Data::U32(v) => put_array(file, name, column.width, v),
        Data::U16(v) => put_array(file, name, column.width, v),
        Data::U8(v) => put_array(file, name, column.width, v),
        Data::Text(v) => {
            let texts: std::result::Result<Vec<VarLenUnicode>, _> =
                v.iter().map(|t| t.parse()).collect();
            match texts {
                Ok(texts) => put_array(file, name, 1, &texts),
                Err(_) => {
                    let fault = Fault::new(name, "text without NUL", format!("{v:?}"));
                    return Err(fault.refused(path));
                }
            }
        }
    };
    done.map_err(hdf5_error(path, name))
}

/// Writes an array as a dataset; creates its group if necessary.
pub(crate) fn put_array<T: H5Type>(
    file: &File,
    name: &str,
    width: usize,
    values: &[T],
) -> hdf5::Result<()> {
    // Without time stamps, so that equal content gives equal bytes.
    let builder = file
        .new_dataset::<T>()
        .obj_track_times(false)
        .no_chunk()
        .with_lcpl(|p| p.create_intermediate_group(true));
    let dataset = match width {
        1 => builder.shape(values.len()).create(name)?,
        _ => builder.shape((values.len() / width, width)).create(name)?,
    };
    // A dataset without rows has no storage to write to.
    if values.is_empty() { Ok(()) } else { dataset.write_raw(values) }
}

/// Source of columns: a file that is read dataset by dataset.
pub(crate) struct ColumnSource<'a> {
    pub path: &'a Path,
    pub file: &'a File,
    /// Size of the file, bytes: an uncompressed dataset cannot be larger.
    pub size: u64,
    /// True if datasets may be compressed, as in files of other programs.
    pub packed: bool,
}

impl ColumnSource<'_> {
    /// Reads numbers `[rows, width]` into a flat array; any number of rows if `rows` is `None`.
    pub fn array<T: H5Type>(
        &self,
        name: &str,
        rows: Option<usize>,
        width: usize,
    ) -> Result<Vec<T>> {
        let dataset = self.dataset(name)?;
        self.check_type(&dataset, name, &T::type_descriptor())?;
        self.check_shape(&dataset, name, rows, width)?;
        dataset.read_raw().map_err(hdf5_error(self.path, name))
    }

    /// Reads texts `[rows]`, which the library does not check.
    fn read_texts(&self, name: &str, rows: Option<usize>) -> Result<Vec<String>> {
        let dataset = self.dataset(name)?;
        self.check_type(&dataset, name, &TypeDescriptor::VarLenUnicode)?;
        self.check_shape(&dataset, name, rows, 1)?;
        let texts: Vec<VarLenUnicode> = dataset.read_raw().map_err(hdf5_error(self.path, name))?;
        // The library does not check UTF-8.
        let checked = texts.iter().map(|t| String::from_utf8(t.as_bytes().to_vec()));
        checked.collect::<std::result::Result<_, _>>().map_err(|e| {
            Fault::new(name, "UTF-8", format!("{:?}", e.as_bytes())).in_file(self.path)
        })
    }

    /// Returns true if the file has an object with this name.
    fn has_object(&self, name: &str) -> bool {
        // Link by link, because the library fails on "a/b" without "a".
        let ends = name.match_indices('/').map(|(end, _)| end).chain([name.len()]);
        ends.into_iter().all(|end| self.file.link_exists(&name[..end]))
    }

    fn dataset(&self, name: &str) -> Result<Dataset> {
        if !self.has_object(name) {
            return Err(Fault::new(name, "a dataset", "nothing").in_file(self.path));
        }
        self.file
            .dataset(name)
            .map_err(|_| Fault::new(name, "a dataset", "something else").in_file(self.path))
    }

    fn check_type(&self, dataset: &Dataset, name: &str, expected: &TypeDescriptor) -> Result<()> {
        match dataset.dtype().and_then(|t| t.to_descriptor()) {
            Ok(found) if found == *expected => Ok(()),
            Ok(found) => {
                Err(Fault::new(name, format!("type {expected}"), found).in_file(self.path))
            }
            Err(_) => {
                Err(Fault::new(name, format!("type {expected}"), "another").in_file(self.path))
            }
        }
    }

    fn check_shape(
        &self,
        dataset: &Dataset,
        name: &str,
        rows: Option<usize>,
        width: usize,
    ) -> Result<()> {
        let shape = dataset.get_shape().map_err(hdf5_error(self.path, name))?;
        let fits = match *shape {
            [n] if width == 1 => rows.is_none_or(|r| r == n),
            [n, w] if width > 1 => w == width && rows.is_none_or(|r| r == n),
            _ => false,
        };
        if !fits {
            let rows = rows.map_or("any".into(), |r| r.to_string());
            let expected = match width {
                1 => format!("shape [{rows}]"),
                _ => format!("shape [{rows}, {width}]"),
            };
            return Err(Fault::new(name, expected, format!("{shape:?}")).in_file(self.path));
        }
        let bytes =
            shape.iter().try_fold(dataset.dtype().map_or(1, |t| t.size()) as u64, |b, &n| {
                b.checked_mul(n as u64)
            });
        let packed = self.packed && dataset.is_chunked();
        let most = if packed { self.most_unpacked(dataset) } else { self.size };
        if bytes.is_none_or(|b| b > most) || (dataset.is_chunked() && !packed) {
            let expected = format!("plain data of at most the file's {} bytes", self.size);
            let found = format!("shape {shape:?}, chunked: {}", dataset.is_chunked());
            let expected = if packed { format!("at most {most} bytes") } else { expected };
            return Err(Fault::new(name, expected, found).in_file(self.path));
        }
        Ok(())
    }

    /// Returns the maximum size of a compressed dataset of this file, chunk buffers included, bytes.
    fn most_unpacked(&self, dataset: &Dataset) -> u64 {
        let stored = dataset.storage_size().min(self.size).saturating_mul(DEFLATE_AT_BEST);
        let chunk = dataset.chunk().unwrap_or_default().into_iter();
        // A dataset of one chunk may be smaller than the chunk, whose buffer is allocated nevertheless.
        let fits =
            chunk.fold(8_u64, |bytes, n| bytes.saturating_mul(n as u64)) <= MAX_INFLATED_BYTES;
        if fits { stored.min(MAX_INFLATED_BYTES) } else { 0 }
    }
}

impl ColumnReader for ColumnSource<'_> {
    type Error = Error;

    fn read(
        &self,
        name: &str,
        kind: DataKind,
        rows: Option<usize>,
        width: usize,
    ) -> Result<Data<'static>> {
        Ok(match kind {
            DataKind::F64 => Data::F64(self.array(name, rows, width)?.into()),
            DataKind::U64 => Data::U64(self.array(name, rows, width)?.into()),
            DataKind::U32 => Data::U32(self.array(name, rows, width)?.into()),
            DataKind::U16 => Data::U16(self.array(name, rows, width)?),
            DataKind::U8 => Data::U8(self.array(name, rows, width)?),
            DataKind::Text => Data::Text(self.read_texts(name, rows)?),
        })
    }

    fn has(&self, name: &str) -> bool {
        self.has_object(name)
    }

    fn size(&self) -> u64 {
        self.size
    }

    fn error(&self, fault: Fault) -> Error {
        fault.in_file(self.path)
    }
}
