//! Datasets that grow by rows, and texts in attributes.

use hdf5::types::{FixedAscii, FixedUnicode, TypeDescriptor};
use hdf5::{Attribute, Dataset, Group, H5Type, Result};
use ndarray::{ArrayView, IxDyn, SliceInfo, SliceInfoElem};

/// Maximum number of rows in a chunk, the unit of compression and reading.
const MAX_CHUNK_ROWS: usize = 1 << 16;

/// Usual maximum length of the texts of an attribute, bytes.
const LONG_TEXT: usize = 128;
/// Maximum length of the texts of an attribute, bytes.
const MAX_TEXT_BYTES: usize = 4096;

/// Maximum number of texts of an attribute.
const MAX_TEXTS: usize = 1 << 16;

/// Size of an uncompressed chunk, bytes.
const TABLE_CHUNK_BYTES: usize = 1 << 11;

/// Creates a group without time stamps, so that equal runs give equal files.
pub(crate) fn group(parent: &Group, name: &str) -> Result<Group> {
    parent.create_group_builder().obj_track_times(false).create(name)
}

/// Creates an empty compressed dataset of rows `[tail..]` for [`append_portion`]s of about `portion` rows.
pub(crate) fn create<T: H5Type>(
    group: &Group,
    name: &str,
    tail: &[usize],
    portion: usize,
) -> Result<()> {
    let portion = portion.max(16);
    let rows = portion.div_ceil(portion.div_ceil(MAX_CHUNK_ROWS));
    let builder = group.new_dataset::<T>().shuffle();
    // Level 1 takes half the time of the usual 6, for a few percent more bytes.
    finish(builder.deflate(1), name, tail, rows)
}

/// Creates an empty uncompressed dataset of rows `[tail..]` for [`append`].
///
/// A compressed chunk that gets more rows changes its size and position; a crash meanwhile loses its earlier rows. An
/// uncompressed chunk is extended in place.
pub(crate) fn create_table<T: H5Type>(group: &Group, name: &str, tail: &[usize]) -> Result<()> {
    let row = size_of::<T>() * tail.iter().product::<usize>().max(1);
    finish(group.new_dataset::<T>(), name, tail, TABLE_CHUNK_BYTES.div_ceil(row))
}

/// Creates an empty dataset of large rows `[tail..]`, each compressed separately.
pub(crate) fn create_one_by_one<T: H5Type>(
    group: &Group,
    name: &str,
    tail: [usize; 2],
) -> Result<()> {
    finish(group.new_dataset::<T>().shuffle().deflate(1), name, &tail, 1)
}

fn finish(
    builder: hdf5::DatasetBuilderEmpty,
    name: &str,
    tail: &[usize],
    rows: usize,
) -> Result<()> {
    let mut chunk = vec![rows];
    chunk.extend_from_slice(tail);
    let builder = builder.obj_track_times(false).chunk(chunk);
    match *tail {
        [] => builder.shape(0..).create(name)?,
        [a] => builder.shape((0.., a)).create(name)?,
        [a, b, ..] => builder.shape((0.., a, b)).create(name)?,
    };
    Ok(())
}

/// Appends rows in a new chunk, so that no compressed chunk is written twice.
/// Returns the first new row; there may be unused rows before it.
pub(crate) fn append_portion<T: H5Type>(group: &Group, name: &str, values: &[T]) -> Result<usize> {
    let dataset = group.dataset(name)?;
    let chunk = dataset.chunk().and_then(|c| c.first().copied()).unwrap_or(1);
    write(&dataset, dataset.shape()[0].next_multiple_of(chunk), values)
}

/// Appends rows; `values.len()` is a multiple of a row's size. Returns the first new row.
pub(crate) fn append<T: H5Type>(group: &Group, name: &str, values: &[T]) -> Result<usize> {
    let dataset = group.dataset(name)?;
    write(&dataset, dataset.shape()[0], values)
}

fn write<T: H5Type>(dataset: &Dataset, first: usize, values: &[T]) -> Result<usize> {
    let mut shape = dataset.shape();
    let more = values.len() / shape[1..].iter().product::<usize>();
    if more == 0 {
        // Offsets must be inside the dataset or at its end.
        return Ok(shape[0]);
    }
    shape[0] = first + more;
    dataset.resize(shape.clone())?;
    shape[0] = more;
    let view = ArrayView::from_shape(IxDyn(&shape), values)?;
    dataset.write_slice(view, rows(first..first + more, shape.len())?)?;
    Ok(first)
}

type Rows = SliceInfo<Vec<SliceInfoElem>, IxDyn, IxDyn>;

/// Selects rows and all of the other dimensions.
fn rows(rows: std::ops::Range<usize>, dimensions: usize) -> Result<Rows> {
    let all = SliceInfoElem::Slice { start: 0, end: None, step: 1 };
    let mut slices = vec![all; dimensions];
    slices[0] =
        SliceInfoElem::Slice { start: rows.start as isize, end: Some(rows.end as isize), step: 1 };
    Ok(SliceInfo::try_from(slices)?)
}

/// Reads rows into a flat array.
pub(crate) fn read<T: H5Type>(dataset: &Dataset, range: std::ops::Range<usize>) -> Result<Vec<T>> {
    if range.is_empty() {
        return Ok(vec![]);
    }
    let array = dataset.read_slice::<T, _, IxDyn>(rows(range, dataset.ndim())?)?;
    Ok(array.into_iter().collect())
}

/// Truncates a dataset to its first `rows` rows; a shorter one is unchanged.
pub(crate) fn truncate(group: &Group, name: &str, rows: usize) -> Result<()> {
    let dataset = group.dataset(name)?;
    let mut shape = dataset.shape();
    if shape[0] > rows {
        shape[0] = rows;
        dataset.resize(shape.clone())?;
    }
    Ok(())
}

/// Writes a text attribute of fixed length, the only kind that VTK's reader accepts for types.
pub(crate) fn ascii<const N: usize>(group: &Group, name: &str, value: &[u8; N]) -> Result<()> {
    let text = FixedAscii::<N>::from_ascii(value).map_err(|e| e.to_string())?;
    group.new_attr::<FixedAscii<N>>().create(name)?.write_scalar(&text)
}

pub(crate) fn number<T: H5Type>(group: &Group, name: &str, value: T) -> Result<()> {
    match group.attr(name) {
        Ok(attribute) => attribute.write_scalar(&value),
        Err(_) => group.new_attr::<T>().create(name)?.write_scalar(&value),
    }
}

/// Writes texts of one length as an attribute. Texts of variable length would be in a heap of the file, and the library may
/// crash on a damaged heap.
pub(crate) fn texts(group: &Group, name: &str, values: &[&str]) -> Result<()> {
    let longest = values.iter().map(|v| v.len()).max().unwrap_or(0);
    let kind = TypeDescriptor::FixedUnicode(longest.max(1));
    let attribute = group.new_attr_builder().empty_as(kind).shape(values.len()).create(name)?;
    match longest {
        0..=LONG_TEXT => write_texts::<LONG_TEXT>(&attribute, values),
        _ => write_texts::<MAX_TEXT_BYTES>(&attribute, values),
    }
}

fn write_texts<const N: usize>(attribute: &Attribute, values: &[&str]) -> Result<()> {
    let texts: std::result::Result<Vec<FixedUnicode<N>>, _> =
        values.iter().map(|v| v.parse()).collect();
    let texts = texts.map_err(|e| e.to_string())?;
    if texts.is_empty() { Ok(()) } else { attribute.write_raw(&texts) }
}

/// Reads the texts of an attribute and checks that they are UTF-8, which the library does not.
pub(crate) fn read_texts(group: &Group, name: &str) -> Result<Vec<String>> {
    let attribute = group.attr(name)?;
    let shape = attribute.shape();
    let [count] = shape[..] else { return Err(format!("{name}: expected a row of texts").into()) };
    if count > MAX_TEXTS {
        let text = format!("{name}: expected at most {MAX_TEXTS} texts, found {count}");
        return Err(text.into());
    }
    match attribute.dtype()?.to_descriptor()? {
        _ if count == 0 => Ok(vec![]),
        TypeDescriptor::FixedUnicode(0..=LONG_TEXT) => fixed_texts::<LONG_TEXT>(&attribute),
        TypeDescriptor::FixedUnicode(0..=MAX_TEXT_BYTES) => {
            fixed_texts::<MAX_TEXT_BYTES>(&attribute)
        }
        other => {
            let text =
                format!("{name}: expected texts of up to {MAX_TEXT_BYTES} bytes, found {other}");
            Err(text.into())
        }
    }
}

fn fixed_texts<const N: usize>(attribute: &Attribute) -> Result<Vec<String>> {
    let texts: Vec<FixedUnicode<N>> = attribute.read_raw()?;
    Ok(texts.iter().map(|t| String::from_utf8_lossy(t.as_bytes()).into_owned()).collect())
}

/// Writes a text of any length as a dataset of bytes.
pub(crate) fn long_text(group: &Group, name: &str, text: &str) -> Result<()> {
    let builder = group.new_dataset::<u8>().obj_track_times(false).no_chunk();
    let dataset = builder.shape(text.len()).create(name)?;
    // An empty dataset has no storage to write to.
    if text.is_empty() { Ok(()) } else { dataset.write_raw(text.as_bytes()) }
}
