//! A 128-bit fingerprint of model and state.

use crate::columns::{self, Column, Data};
use ballast::model::Model;
use ballast::state::State;

/// Fingerprint of everything that decides how a run continues: equal bytes, equal fingerprint.
///
/// The first 128 bits of BLAKE3 over names, widths, lengths and little-endian values of all columns.
/// `0.0` and `-0.0` differ. Not changed by how or where a file was written.
pub fn state_hash(model: &Model, state: &State) -> u128 {
    of_columns(&columns::of(model, state))
}

pub(crate) fn of_columns(columns: &[Column]) -> u128 {
    let mut hasher = blake3::Hasher::new();
    for column in columns {
        feed(&mut hasher, column);
    }
    let mut first = [0; 16];
    first.copy_from_slice(&hasher.finalize().as_bytes()[..16]);
    u128::from_be_bytes(first)
}

fn feed(hasher: &mut blake3::Hasher, column: &Column) {
    frame(hasher, column.name.as_bytes());
    hasher.update(&(column.width as u64).to_le_bytes());
    match &column.data {
        Data::F64(values) => words(hasher, 1, values, |v| v.to_le_bytes()),
        Data::Vectors(rows) => floats(hasher, rows, columns::xyz),
        Data::Quaternions(rows) => floats(hasher, rows, columns::wxyz),
        Data::U64(values) => words(hasher, 2, values, |v| v.to_le_bytes()),
        Data::U32(values) => words(hasher, 3, values, |v| v.to_le_bytes()),
        Data::U16(values) => words(hasher, 4, values, |v| v.to_le_bytes()),
        Data::U8(values) => words(hasher, 5, values, |v| [*v]),
        Data::Text(values) => {
            head(hasher, 6, values.len());
            for value in values {
                frame(hasher, value.as_bytes());
            }
        }
    }
}

/// What kind of values, and how many.
fn head(hasher: &mut blake3::Hasher, tag: u8, count: usize) {
    hasher.update(&[tag]);
    hasher.update(&(count as u64).to_le_bytes());
}

/// Length first, so that neighbouring texts cannot trade letters.
fn frame(hasher: &mut blake3::Hasher, bytes: &[u8]) {
    hasher.update(&(bytes.len() as u64).to_le_bytes());
    hasher.update(bytes);
}

/// Rows of numbers, as the same numbers one after the other.
fn floats<T, const N: usize>(
    hasher: &mut blake3::Hasher,
    rows: &[T],
    row: impl Fn(&T) -> [f64; N],
) {
    head(hasher, 1, N * rows.len());
    through_buffer(hasher, rows, 8 * N, |item, place| {
        for (place, value) in place.as_chunks_mut::<8>().0.iter_mut().zip(row(item)) {
            *place = value.to_le_bytes();
        }
    });
}

fn words<T, const N: usize>(
    hasher: &mut blake3::Hasher,
    tag: u8,
    values: &[T],
    bytes: impl Fn(&T) -> [u8; N],
) {
    head(hasher, tag, values.len());
    through_buffer(hasher, values, N, |value, place| place.copy_from_slice(&bytes(value)));
}

/// Puts the bytes of items, `size` of each, into a buffer that is large enough for all lanes of the hash and small
/// enough for a cache.
fn through_buffer<T>(
    hasher: &mut blake3::Hasher,
    items: &[T],
    size: usize,
    put: impl Fn(&T, &mut [u8]),
) {
    let mut buffer = [0; 1 << 16];
    for chunk in items.chunks(buffer.len() / size) {
        for (place, item) in buffer.chunks_exact_mut(size).zip(chunk) {
            put(item, place);
        }
        hasher.update(&buffer[..chunk.len() * size]);
    }
}
