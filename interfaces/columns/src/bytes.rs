//! Columns as one block of bytes, which needs no HDF5.
//!
//! Contract: decoded columns are the encoded ones, f64 bit for bit; a changed byte is refused by the digest in front.
//! Columns are read by name, so that a block can hold more of them than model and state.

use crate::columns::{Column, Data, wxyz, xyz};
use crate::fault::Fault;
use crate::reader::{ColumnReader, DataKind};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// First bytes of a block: format and version.
const MAGIC: [u8; 16] = *b"ballast-bytes 1\n";
/// Length of the digest behind them, bytes.
const DIGEST: usize = 32;

/// Values of a stored column.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
enum StoredData {
    F64(Vec<f64>),
    U64(Vec<u64>),
    U32(Vec<u32>),
    U16(Vec<u16>),
    U8(Vec<u8>),
    Text(Vec<String>),
}

/// Stored column without its name.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct StoredColumn {
    width: u32,
    data: StoredData,
}

impl From<&Column<'_>> for StoredColumn {
    fn from(column: &Column) -> Self {
        let data = match &column.data {
            Data::F64(values) => StoredData::F64(values.to_vec()),
            Data::Vectors(rows) => StoredData::F64(rows.iter().flat_map(xyz).collect()),
            Data::Quaternions(rows) => StoredData::F64(rows.iter().flat_map(wxyz).collect()),
            Data::U64(values) => StoredData::U64(values.to_vec()),
            Data::U32(values) => StoredData::U32(values.to_vec()),
            Data::U16(values) => StoredData::U16(values.clone()),
            Data::U8(values) => StoredData::U8(values.clone()),
            Data::Text(values) => StoredData::Text(values.clone()),
        };
        Self { width: column.width as u32, data }
    }
}

impl StoredColumn {
    fn kind(&self) -> DataKind {
        match self.data {
            StoredData::F64(_) => DataKind::F64,
            StoredData::U64(_) => DataKind::U64,
            StoredData::U32(_) => DataKind::U32,
            StoredData::U16(_) => DataKind::U16,
            StoredData::U8(_) => DataKind::U8,
            StoredData::Text(_) => DataKind::Text,
        }
    }

    fn len(&self) -> usize {
        match &self.data {
            StoredData::F64(values) => values.len(),
            StoredData::U64(values) => values.len(),
            StoredData::U32(values) => values.len(),
            StoredData::U16(values) => values.len(),
            StoredData::U8(values) => values.len(),
            StoredData::Text(values) => values.len(),
        }
    }

    fn data(&self) -> Data<'static> {
        match self.data.clone() {
            StoredData::F64(values) => Data::F64(values.into()),
            StoredData::U64(values) => Data::U64(values.into()),
            StoredData::U32(values) => Data::U32(values.into()),
            StoredData::U16(values) => Data::U16(values),
            StoredData::U8(values) => Data::U8(values),
            StoredData::Text(values) => Data::Text(values),
        }
    }
}

/// Returns columns as a block of bytes.
pub fn encode<'a, 'b: 'a>(columns: impl IntoIterator<Item = &'a Column<'b>>) -> Vec<u8> {
    let stored: BTreeMap<&str, StoredColumn> =
        columns.into_iter().map(|column| (column.name, column.into())).collect();
    let content = postcard::to_allocvec(&stored).expect("columns have a length");
    [&MAGIC[..], blake3::hash(&content).as_bytes(), &content].concat()
}

/// Columns of a block of bytes.
#[derive(Debug, Clone, PartialEq)]
pub struct StoredColumns {
    columns: BTreeMap<String, StoredColumn>,
    size: u64,
}

impl StoredColumns {
    /// Reads a block that [`encode`] has written.
    ///
    /// # Errors
    /// Bytes of another format or version, or changed ones.
    pub fn decode(bytes: &[u8]) -> Result<Self, Fault> {
        let Some((head, content)) = bytes.split_at_checked(MAGIC.len() + DIGEST) else {
            let found = format!("{} bytes", bytes.len());
            return Err(Fault::new("header", "columns of Ballast", found));
        };
        let (magic, digest) = head.split_at(MAGIC.len());
        if magic != MAGIC {
            let [expected, found] =
                [&MAGIC, magic].map(|text| String::from_utf8_lossy(text).trim().to_string());
            return Err(Fault::new("header", expected, found));
        }
        let found = blake3::hash(content);
        if digest != found.as_bytes() {
            return Err(Fault::new("checksum", "the digest of the content", found.to_hex()));
        }
        let columns = postcard::from_bytes(content)
            .map_err(|e| Fault::new("content", "named columns", e.to_string()))?;
        Ok(Self { columns, size: bytes.len() as u64 })
    }
}

impl ColumnReader for StoredColumns {
    type Error = Fault;

    fn read(
        &self,
        name: &str,
        kind: DataKind,
        rows: Option<usize>,
        width: usize,
    ) -> Result<Data<'static>, Fault> {
        let Some(column) = self.columns.get(name) else {
            return Err(Fault::new(name, "a column", "nothing"));
        };
        if column.kind() != kind {
            let [expected, found] = [kind, column.kind()].map(|kind| format!("type {kind:?}"));
            return Err(Fault::new(name, expected, found));
        }
        let (len, stored_width) = (column.len(), column.width as usize);
        let is_whole = stored_width == width && len % width == 0;
        if !is_whole || rows.is_some_and(|rows| rows != len / width) {
            let rows = rows.map_or("any".into(), |rows| rows.to_string());
            let found = format!("{len} values in rows of {stored_width}");
            return Err(Fault::new(name, format!("shape [{rows}, {width}]"), found));
        }
        Ok(column.data())
    }

    fn has(&self, name: &str) -> bool {
        self.columns.contains_key(name)
    }

    fn size(&self) -> u64 {
        self.size
    }

    fn error(&self, fault: Fault) -> Fault {
        fault
    }
}
