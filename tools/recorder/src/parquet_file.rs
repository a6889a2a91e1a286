//! Tables in Apache Parquet files, written a row group at a time, so that the memory does not grow
//! with their length.

use std::io::Write;
use std::sync::Arc;

use anyhow::bail;
use parquet::basic::{Compression, LogicalType, Repetition, TimeUnit, Type as Physical};
use parquet::data_type::{ByteArray, ByteArrayType, DoubleType, Int32Type, Int64Type};
use parquet::file::metadata::KeyValue;
use parquet::file::properties::{EnabledStatistics, WriterProperties};
use parquet::file::writer::{SerializedColumnWriter, SerializedFileWriter};
use parquet::schema::types::Type;

/// Most bytes of a row group before it is encoded; more only where rows that are pushed at a time
/// have more.
const GROUP_BYTES: usize = 32 << 20;
/// What a text is counted as (bytes).
const TEXT_BYTES: usize = 128;

/// What the values of a column are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// An instant (ns since 1970, UTC).
    Instant,
    /// Unsigned integers of 8 or 16 bits.
    Small(i8),
    /// Unsigned integers of 32 bits.
    U32,
    /// Unsigned integers of 64 bits.
    U64,
    /// Signed integers of 64 bits.
    I64,
    /// Floating-point numbers of 64 bits.
    F64,
    /// UTF-8 text.
    Text,
}

impl Kind {
    fn physical(self) -> Physical {
        match self {
            Self::Small(_) | Self::U32 => Physical::INT32,
            Self::Instant | Self::U64 | Self::I64 => Physical::INT64,
            Self::F64 => Physical::DOUBLE,
            Self::Text => Physical::BYTE_ARRAY,
        }
    }

    fn logical(self) -> Option<LogicalType> {
        match self {
            Self::Instant => Some(LogicalType::timestamp(true, TimeUnit::NANOS)),
            Self::Small(bits) => Some(LogicalType::integer(bits, false)),
            Self::U32 => Some(LogicalType::integer(32, false)),
            Self::U64 => Some(LogicalType::integer(64, false)),
            Self::I64 | Self::F64 => None,
            Self::Text => Some(LogicalType::String),
        }
    }

    fn field(self, name: &str) -> anyhow::Result<Type> {
        let field = Type::primitive_type_builder(name, self.physical())
            .with_repetition(Repetition::REQUIRED)
            .with_logical_type(self.logical());
        Ok(field.build()?)
    }

    fn bytes(self) -> usize {
        match self.physical() {
            Physical::INT32 => size_of::<i32>(),
            Physical::BYTE_ARRAY => TEXT_BYTES,
            _ => size_of::<i64>(),
        }
    }

    /// No values yet, with room for so many.
    pub(crate) fn values(self, rows: usize) -> Values {
        match self.physical() {
            Physical::INT32 => Values::I32(Vec::with_capacity(rows)),
            Physical::INT64 => Values::I64(Vec::with_capacity(rows)),
            Physical::DOUBLE => Values::F64(Vec::with_capacity(rows)),
            _ => Values::Text(Vec::with_capacity(rows)),
        }
    }
}

/// Values of a column, as a file holds them: unsigned ones by their bits.
#[derive(Clone, Debug)]
pub(crate) enum Values {
    I32(Vec<i32>),
    I64(Vec<i64>),
    F64(Vec<f64>),
    Text(Vec<ByteArray>),
}

impl Values {
    fn len(&self) -> usize {
        match self {
            Self::I32(values) => values.len(),
            Self::I64(values) => values.len(),
            Self::F64(values) => values.len(),
            Self::Text(values) => values.len(),
        }
    }

    fn clear(&mut self) {
        match self {
            Self::I32(values) => values.clear(),
            Self::I64(values) => values.clear(),
            Self::F64(values) => values.clear(),
            Self::Text(values) => values.clear(),
        }
    }

    fn append(&mut self, rows: Self) -> anyhow::Result<()> {
        match (self, rows) {
            (Self::I32(values), Self::I32(rows)) => values.extend(rows),
            (Self::I64(values), Self::I64(rows)) => values.extend(rows),
            (Self::F64(values), Self::F64(rows)) => values.extend(rows),
            (Self::Text(values), Self::Text(rows)) => values.extend(rows),
            _ => bail!("a column cannot take values of another kind"),
        }
        Ok(())
    }

    fn write(&self, column: &mut SerializedColumnWriter<'_>) -> parquet::errors::Result<usize> {
        match self {
            Self::I32(values) => column.typed::<Int32Type>().write_batch(values, None, None),
            Self::I64(values) => column.typed::<Int64Type>().write_batch(values, None, None),
            Self::F64(values) => column.typed::<DoubleType>().write_batch(values, None, None),
            Self::Text(values) => column.typed::<ByteArrayType>().write_batch(values, None, None),
        }
    }
}

/// Writes a table of these columns.
pub(crate) struct ParquetWriter<W: Write + Send> {
    writer: SerializedFileWriter<W>,
    /// The row group that is being filled.
    group: Vec<Values>,
    /// Rows that it has room for.
    group_rows: usize,
}

impl<W: Write + Send> ParquetWriter<W> {
    /// Begins a file.
    ///
    /// # Errors
    /// Those of the output; names of columns that a file cannot have.
    pub(crate) fn new(output: W, columns: &[(String, Kind)]) -> anyhow::Result<Self> {
        let mut fields = Vec::with_capacity(columns.len());
        for (name, kind) in columns {
            fields.push(Arc::new(kind.field(name)?));
        }
        let schema = Type::group_type_builder("farreach").with_fields(fields).build()?;
        // Least and greatest value of a column in a row group let readers leave out what they do
        // not ask for. Those of each page, and where it lies, would be kept for the whole file.
        let properties = WriterProperties::builder()
            .set_compression(Compression::SNAPPY)
            .set_statistics_enabled(EnabledStatistics::Chunk)
            .set_offset_index_disabled(true)
            .set_created_by(format!("farreach {}", env!("CARGO_PKG_VERSION")))
            .build();
        let row: usize = columns.iter().map(|(_, kind)| kind.bytes()).sum();
        let group_rows = (GROUP_BYTES / row.max(1)).max(1);
        Ok(Self {
            writer: SerializedFileWriter::new(output, Arc::new(schema), Arc::new(properties))?,
            group: columns.iter().map(|(_, kind)| kind.values(group_rows)).collect(),
            group_rows,
        })
    }

    /// Adds rows: values of every column, of each as many.
    ///
    /// # Errors
    /// Those of the output.
    pub(crate) fn push(&mut self, rows: Vec<Values>) -> anyhow::Result<()> {
        let more = rows.first().map_or(0, Values::len);
        if self.rows() > 0 && self.rows() + more > self.group_rows {
            self.write_group()?;
        }
        for (values, rows) in self.group.iter_mut().zip(rows) {
            values.append(rows)?;
        }
        Ok(())
    }

    /// Rows that are not written yet.
    fn rows(&self) -> usize {
        self.group.first().map_or(0, Values::len)
    }

    fn write_group(&mut self) -> anyhow::Result<()> {
        let mut group = self.writer.next_row_group()?;
        for values in &mut self.group {
            let Some(mut column) = group.next_column()? else { break };
            values.write(&mut column)?;
            column.close()?;
            values.clear();
        }
        group.close()?;
        Ok(())
    }

    /// Writes what is left, and what is to be known of the file.
    ///
    /// # Errors
    /// Those of the output.
    pub(crate) fn finish(mut self, metadata: Vec<(String, String)>) -> anyhow::Result<()> {
        if self.rows() > 0 {
            self.write_group()?;
        }
        for (key, value) in metadata {
            self.writer.append_key_value_metadata(KeyValue::new(key, value));
        }
        self.writer.close()?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use parquet::column::reader::ColumnReader;
    use parquet::file::reader::{FileReader, SerializedFileReader};

    use super::*;

    #[test]
    fn row_groups_are_bounded_and_hold_every_row() {
        let columns = [("a".to_owned(), Kind::I64), ("b".to_owned(), Kind::Text)];
        let mut bytes = Vec::new();
        let mut writer = ParquetWriter::new(&mut bytes, &columns).unwrap();
        assert_eq!(writer.group_rows, GROUP_BYTES / (8 + TEXT_BYTES));
        writer.group_rows = 100;
        for piece in 0..50 {
            let rows: Vec<i64> = (7 * piece..7 * (piece + 1)).collect();
            let texts = rows.iter().map(|row| ByteArray::from(row.to_string().into_bytes()));
            let texts = Values::Text(texts.collect());
            writer.push(vec![Values::I64(rows), texts]).unwrap();
            assert!(writer.rows() <= 100);
        }
        writer.finish(Vec::new()).unwrap();
        let (groups, values) = read_column(&bytes);
        assert_eq!(groups, [98, 98, 98, 56]);
        assert_eq!(values, (0..350).collect::<Vec<i64>>());
    }

    #[test]
    fn a_column_takes_no_values_of_another_type() {
        let mut bytes = Vec::new();
        let mut writer = ParquetWriter::new(&mut bytes, &[("a".to_owned(), Kind::F64)]).unwrap();
        assert!(writer.push(vec![Values::I64(vec![1])]).is_err());
    }

    /// Rows of each group, and the values of the first column.
    fn read_column(bytes: &[u8]) -> (Vec<usize>, Vec<i64>) {
        let mut file = tempfile::tempfile().unwrap();
        file.write_all(bytes).unwrap();
        let reader = SerializedFileReader::new(file).unwrap();
        let (mut groups, mut values) = (Vec::new(), Vec::new());
        for group in 0..reader.num_row_groups() {
            let group = reader.get_row_group(group).unwrap();
            let rows = group.metadata().num_rows() as usize;
            let ColumnReader::Int64ColumnReader(mut column) = group.get_column_reader(0).unwrap()
            else {
                panic!("another type")
            };
            column.read_records(rows, None, None, &mut values).unwrap();
            groups.push(rows);
        }
        (groups, values)
    }
}
