//! 128-bit hash of model and state.

use crate::columns::{self, Column, Data};
use ballast::model::Model;
use ballast::state::State;

/// Returns the hash of model, bodies, contacts and energy: equal bytes have equal hashes.
///
/// The memory of windows and the state of the driver are not part of it, so that runs of one motion end with one hash,
/// whatever drives them.
///
/// The first 128 bits of BLAKE3 over names, widths, lengths and little-endian values of all columns.
/// `0.0` and `-0.0` differ. The hash does not depend on a file.
pub fn state_hash(model: &Model, state: &State) -> u128 {
    columns_hash(&columns::of(model, state))
}

/// Returns the hash of columns.
pub fn columns_hash(columns: &[Column]) -> u128 {
    let mut sink = HashBuffer { hasher: blake3::Hasher::new(), buffer: vec![0; BUFFER] };
    columns.iter().for_each(|column| sink.feed(column));
    let HashBuffer { hasher, .. } = sink;
    let mut first = [0; 16];
    first.copy_from_slice(&hasher.finalize().as_bytes()[..16]);
    u128::from_be_bytes(first)
}

/// Size of the buffer, bytes: large enough for all lanes of the hash, small enough for a cache.
const BUFFER: usize = 1 << 16;

struct HashBuffer {
    hasher: blake3::Hasher,
    buffer: Vec<u8>,
}

impl HashBuffer {
    fn feed(&mut self, column: &Column) {
        self.frame(column.name.as_bytes());
        self.hasher.update(&(column.width as u64).to_le_bytes());
        match &column.data {
            Data::F64(values) => self.words(1, values, |v| v.to_le_bytes()),
            Data::Vectors(rows) => self.floats(rows, columns::xyz),
            Data::Quaternions(rows) => self.floats(rows, columns::wxyz),
            Data::U64(values) => self.words(2, values, |v| v.to_le_bytes()),
            Data::U32(values) => self.words(3, values, |v| v.to_le_bytes()),
            Data::U16(values) => self.words(4, values, |v| v.to_le_bytes()),
            Data::U8(values) => self.words(5, values, |v| [*v]),
            Data::Text(values) => {
                self.head(6, values.len());
                values.iter().for_each(|value| self.frame(value.as_bytes()));
            }
        }
    }

    /// Adds type and number of values.
    fn head(&mut self, tag: u8, count: usize) {
        self.hasher.update(&[tag]);
        self.hasher.update(&(count as u64).to_le_bytes());
    }

    /// Adds a text with its length first, so that adjacent texts differ from their concatenation.
    fn frame(&mut self, bytes: &[u8]) {
        self.hasher.update(&(bytes.len() as u64).to_le_bytes());
        self.hasher.update(bytes);
    }

    /// Adds rows of numbers as a flat sequence.
    fn floats<T, const N: usize>(&mut self, rows: &[T], row: impl Fn(&T) -> [f64; N]) {
        self.head(1, N * rows.len());
        self.through_buffer(rows, 8 * N, |item, place| {
            for (place, value) in place.as_chunks_mut::<8>().0.iter_mut().zip(row(item)) {
                *place = value.to_le_bytes();
            }
        });
    }

    fn words<T, const N: usize>(&mut self, tag: u8, values: &[T], bytes: impl Fn(&T) -> [u8; N]) {
        self.head(tag, values.len());
        self.through_buffer(values, N, |value, place| place.copy_from_slice(&bytes(value)));
    }

    /// Adds the bytes of items, `size` bytes each.
    fn through_buffer<T>(&mut self, items: &[T], size: usize, put: impl Fn(&T, &mut [u8])) {
        for chunk in items.chunks(BUFFER / size) {
            for (place, item) in self.buffer.chunks_exact_mut(size).zip(chunk) {
                put(item, place);
            }
            self.hasher.update(&self.buffer[..chunk.len() * size]);
        }
    }
}
