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
        Data::F64(values) => words(hasher, 1, values, |v| v.to_bits().to_le_bytes()),
        Data::U64(values) => words(hasher, 2, values, |v| v.to_le_bytes()),
        Data::U32(values) => words(hasher, 3, values, |v| v.to_le_bytes()),
        Data::U16(values) => words(hasher, 4, values, |v| v.to_le_bytes()),
        Data::U8(values) => words(hasher, 5, values, |v| [*v]),
        Data::Text(values) => {
            hasher.update(&[6]);
            hasher.update(&(values.len() as u64).to_le_bytes());
            for value in values {
                frame(hasher, value.as_bytes());
            }
        }
    }
}

/// Length first, so that neighbouring texts cannot trade letters.
fn frame(hasher: &mut blake3::Hasher, bytes: &[u8]) {
    hasher.update(&(bytes.len() as u64).to_le_bytes());
    hasher.update(bytes);
}

fn words<T, const N: usize>(
    hasher: &mut blake3::Hasher,
    tag: u8,
    values: &[T],
    bytes: impl Fn(&T) -> [u8; N],
) {
    hasher.update(&[tag]);
    hasher.update(&(values.len() as u64).to_le_bytes());
    let mut buffer = [0; 4096];
    for chunk in values.chunks(buffer.len() / N) {
        for (place, value) in buffer.chunks_exact_mut(N).zip(chunk) {
            place.copy_from_slice(&bytes(value));
        }
        hasher.update(&buffer[..chunk.len() * N]);
    }
}
