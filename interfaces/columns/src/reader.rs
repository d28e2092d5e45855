//! Sources from which columns are read.

use crate::columns::Data;
use crate::fault::Fault;

/// Function that returns the name of a value in files.
type ValueName<T> = fn(T) -> &'static str;

/// Type of the values of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DataKind {
    /// `f64`.
    F64,
    /// `u64`.
    U64,
    /// `u32`.
    U32,
    /// `u16`.
    U16,
    /// `u8`.
    U8,
    /// UTF-8.
    Text,
}

/// Number that columns hold.
pub trait Number: Copy {
    /// Type of the column.
    const KIND: DataKind;

    /// Returns the numbers of a column of this type.
    fn take(data: Data<'static>) -> Option<Vec<Self>>;
}

/// Implements [`Number`] for the type of a variant of [`Data`].
macro_rules! number {
    ($($type:ty: $variant:ident;)*) => {$(
        impl Number for $type {
            const KIND: DataKind = DataKind::$variant;

            fn take(data: Data<'static>) -> Option<Vec<Self>> {
                match data {
                    Data::$variant(values) => Some(values.into()),
                    _ => None,
                }
            }
        }
    )*};
}

number! {
    f64: F64;
    u64: U64;
    u32: U32;
    u16: U16;
    u8: U8;
}

/// Source of columns.
///
/// Contract: type, width and number of rows are compared before anything of this size is allocated.
pub trait ColumnReader {
    /// Error of reading.
    type Error;

    /// Reads the column `[rows, width]` as a flat array of `kind`; any number of rows if `rows` is `None`.
    ///
    /// # Errors
    /// A column that is missing, or of another type or shape.
    fn read(
        &self,
        name: &str,
        kind: DataKind,
        rows: Option<usize>,
        width: usize,
    ) -> Result<Data<'static>, Self::Error>;

    /// Returns true if there is a column with this name.
    fn has(&self, name: &str) -> bool;

    /// Returns the size of the source, bytes: no column has more values.
    fn size(&self) -> u64;

    /// Converts an invalid value to an error of this source.
    fn error(&self, fault: Fault) -> Self::Error;

    /// Reads numbers `[rows, width]` into a flat array; any number of rows if `rows` is `None`.
    ///
    /// # Errors
    /// As for [`ColumnReader::read`].
    fn numbers<T: Number>(
        &self,
        name: &str,
        rows: Option<usize>,
        width: usize,
    ) -> Result<Vec<T>, Self::Error> {
        let data = self.read(name, T::KIND, rows, width)?;
        let other = || self.error(Fault::new(name, format!("type {:?}", T::KIND), "another"));
        T::take(data).ok_or_else(other)
    }

    /// Reads finite numbers `[rows, width]` into a flat array.
    ///
    /// # Errors
    /// As for [`ColumnReader::read`]; a number that is not finite.
    fn reals(
        &self,
        name: &str,
        rows: Option<usize>,
        width: usize,
    ) -> Result<Vec<f64>, Self::Error> {
        let values: Vec<f64> = self.numbers(name, rows, width)?;
        match values.iter().position(|v| !v.is_finite()) {
            None => Ok(values),
            Some(i) => {
                let found = format!("{} in row {}", values[i], i / width);
                Err(self.error(Fault::new(name, "finite numbers", found)))
            }
        }
    }

    /// Reads the single number in `name`.
    ///
    /// # Errors
    /// As for [`ColumnReader::read`].
    fn number<T: Number>(&self, name: &str) -> Result<T, Self::Error> {
        Ok(self.numbers(name, Some(1), 1)?[0])
    }

    /// Reads the single finite number in `name`.
    ///
    /// # Errors
    /// As for [`ColumnReader::reals`].
    fn real(&self, name: &str) -> Result<f64, Self::Error> {
        Ok(self.reals(name, Some(1), 1)?[0])
    }

    /// Reads texts `[rows]`.
    ///
    /// # Errors
    /// As for [`ColumnReader::read`].
    fn texts(&self, name: &str, rows: Option<usize>) -> Result<Vec<String>, Self::Error> {
        match self.read(name, DataKind::Text, rows, 1)? {
            Data::Text(texts) => Ok(texts),
            _ => Err(self.error(Fault::new(name, "texts", "numbers"))),
        }
    }

    /// Reads the single text in `name`.
    ///
    /// # Errors
    /// As for [`ColumnReader::read`].
    fn text(&self, name: &str) -> Result<String, Self::Error> {
        Ok(self.texts(name, Some(1))?.swap_remove(0))
    }

    /// Reads the single text in `name` as the value of `all` with this name.
    ///
    /// # Errors
    /// As for [`ColumnReader::read`]; a text that names no value.
    fn choice<T: Copy>(&self, name: &str, all: &[T], word: ValueName<T>) -> Result<T, Self::Error> {
        self.choose(name, &self.text(name)?, all, word)
    }

    /// Returns the value of `all` that has the name `text`.
    ///
    /// # Errors
    /// A text that names no value.
    fn choose<T: Copy>(
        &self,
        name: &str,
        text: &str,
        all: &[T],
        word: ValueName<T>,
    ) -> Result<T, Self::Error> {
        all.iter().copied().find(|value| word(*value) == text).ok_or_else(|| {
            let names: Vec<_> = all.iter().map(|value| format!("{:?}", word(*value))).collect();
            self.error(Fault::new(name, names.join(" or "), format!("{text:?}")))
        })
    }
}
