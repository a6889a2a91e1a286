//! Columns of numbers that may be longer than the memory, and their order statistics.

use std::fs::File;
use std::io;
use std::ops::Range;
use std::os::unix::fs::FileExt;
use std::path::PathBuf;

/// Where columns are kept.
#[derive(Clone, Debug, Default)]
pub enum Storage {
    /// In memory.
    #[default]
    Memory,
    /// In temporary files in this folder, which have no names and go with the columns; of each
    /// column a small part is in memory.
    Folder(PathBuf),
}

/// Values of a column that are in memory before they go to its file, and that are read at a time.
const PIECE: usize = 8 * 1024;
/// Values that are read again before the one that is asked for.
const MARGIN: usize = 16;
/// Bytes of a value.
const BYTES: usize = size_of::<f64>();

/// A column of numbers.
#[derive(Debug, Default)]
pub struct Column {
    storage: Storage,
    file: Option<File>,
    /// Values in the file; those in `tail` follow.
    written: usize,
    tail: Vec<f64>,
    /// Values before the first row.
    before: usize,
    rows: usize,
}

impl Column {
    /// An empty column.
    pub fn new(storage: &Storage) -> Self {
        Self { storage: storage.clone(), ..Self::default() }
    }

    /// An empty column that is kept as this one is.
    pub fn another(&self) -> Self {
        Self::new(&self.storage)
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.rows
    }

    /// Whether it has no rows.
    pub fn is_empty(&self) -> bool {
        self.rows == 0
    }

    /// Adds a row at the end, of a column that was not cut.
    ///
    /// # Errors
    /// Those of the temporary file.
    pub fn push(&mut self, value: f64) -> io::Result<()> {
        self.tail.push(value);
        self.rows += 1;
        match &self.storage {
            Storage::Folder(_) if self.tail.len() >= PIECE => self.write_tail(),
            _ => Ok(()),
        }
    }

    fn write_tail(&mut self) -> io::Result<()> {
        let Storage::Folder(folder) = &self.storage else { return Ok(()) };
        let file = match &mut self.file {
            Some(file) => file,
            none => none.insert(tempfile::tempfile_in(folder)?),
        };
        let mut bytes = vec![0u8; self.tail.len() * BYTES];
        for (bytes, value) in bytes.chunks_exact_mut(BYTES).zip(&self.tail) {
            bytes.copy_from_slice(&value.to_le_bytes());
        }
        file.write_all_at(&bytes, (self.written * BYTES) as u64)?;
        self.written += self.tail.len();
        self.tail.clear();
        Ok(())
    }

    /// Keeps these rows alone; beyond the end there are none.
    pub fn cut(&mut self, kept: Range<usize>) {
        let end = kept.end.min(self.rows);
        let start = kept.start.min(end);
        self.before += start;
        self.rows = end - start;
    }

    /// Reads the rows from `at` on.
    ///
    /// # Errors
    /// Those of the temporary file; `UnexpectedEof` beyond the last row.
    pub fn read(&self, at: usize, values: &mut [f64]) -> io::Result<()> {
        if at.checked_add(values.len()).is_none_or(|end| end > self.rows) {
            return Err(beyond(at));
        }
        let at = self.before + at;
        let in_file = self.written.saturating_sub(at).min(values.len());
        let (front, back) = values.split_at_mut(in_file);
        if let Some(file) = self.file.as_ref().filter(|_| !front.is_empty()) {
            let mut bytes = vec![0u8; front.len() * BYTES];
            file.read_exact_at(&mut bytes, (at * BYTES) as u64)?;
            for (value, bytes) in front.iter_mut().zip(bytes.as_chunks::<BYTES>().0) {
                *value = f64::from_le_bytes(*bytes);
            }
        }
        let behind = (at + in_file).saturating_sub(self.written);
        let rest = self.tail.get(behind..behind + back.len()).ok_or_else(|| beyond(at))?;
        back.copy_from_slice(rest);
        Ok(())
    }

    /// The values in memory.
    ///
    /// # Errors
    /// Those of the temporary file.
    pub fn into_vec(mut self) -> io::Result<Vec<f64>> {
        if self.file.is_none() {
            self.tail.truncate(self.before + self.rows);
            self.tail.drain(..self.before);
            return Ok(self.tail);
        }
        let mut values = vec![0.0; self.rows];
        self.read(0, &mut values)?;
        Ok(values)
    }

    /// The values, where they are in memory; none otherwise.
    pub fn in_memory(&self) -> &[f64] {
        let rows = self.before..self.before + self.rows;
        self.tail.get(rows).filter(|_| self.file.is_none()).unwrap_or_default()
    }

    /// Reads the rows one by one.
    pub fn cursor(&self) -> Cursor<'_> {
        match self.file {
            None => Cursor::of(self.in_memory()),
            Some(_) => Cursor(Source::Column { column: self, piece: Vec::new(), first: 0 }),
        }
    }
}

impl From<Vec<f64>> for Column {
    fn from(values: Vec<f64>) -> Self {
        Self { rows: values.len(), tail: values, ..Self::default() }
    }
}

fn beyond(row: usize) -> io::Error {
    io::Error::new(io::ErrorKind::UnexpectedEof, format!("row {row} of a column is not there"))
}

/// Reads rows of a column, fast where each is near the one before.
#[derive(Debug)]
pub struct Cursor<'a>(Source<'a>);

#[derive(Debug)]
enum Source<'a> {
    Slice(&'a [f64]),
    Column {
        column: &'a Column,
        /// The rows that were read last, and the number of the first of them.
        piece: Vec<f64>,
        first: usize,
    },
}

impl<'a> Cursor<'a> {
    /// Reads values that are in memory.
    pub fn of(values: &'a [f64]) -> Self {
        Self(Source::Slice(values))
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        match &self.0 {
            Source::Slice(values) => values.len(),
            Source::Column { column, .. } => column.len(),
        }
    }

    /// Whether it has no rows.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The value in a row.
    ///
    /// # Errors
    /// Those of the temporary file; `UnexpectedEof` where there is no such row.
    pub fn at(&mut self, row: usize) -> io::Result<f64> {
        match &mut self.0 {
            Source::Slice(values) => values.get(row).copied().ok_or_else(|| beyond(row)),
            Source::Column { column, piece, first } => {
                if let Some(value) = row.checked_sub(*first).and_then(|at| piece.get(at)) {
                    return Ok(*value);
                }
                if row >= column.len() {
                    return Err(beyond(row));
                }
                // Most rows of the piece lie in the direction in which the rows are read.
                let backward = row < *first;
                let lead = if backward { PIECE - MARGIN } else { MARGIN };
                let from = row.saturating_sub(lead);
                piece.clear();
                piece.resize(PIECE.min(column.len() - from), 0.0);
                *first = from;
                let read = column.read(from, piece);
                if read.is_err() {
                    piece.clear();
                }
                read?;
                piece.get(row - from).copied().ok_or_else(|| beyond(row))
            }
        }
    }

    /// Hands all values on, in order.
    ///
    /// # Errors
    /// Those of [`Self::at`].
    pub fn each(&mut self, mut take: impl FnMut(f64)) -> io::Result<()> {
        for row in 0..self.len() {
            take(self.at(row)?);
        }
        Ok(())
    }
}

/// Bits of a value that are looked at in one pass.
const DIGIT: u32 = 16;

/// The value of this rank, from 0, of those that `each` hands on, by the order of
/// [`f64::total_cmp`]. It asks for the values four times, and its memory does not grow with their
/// number, which must be above the rank.
///
/// # Errors
/// Those of `each`.
pub fn nth<E>(
    rank: usize,
    mut each: impl FnMut(&mut dyn FnMut(f64)) -> Result<(), E>,
) -> Result<f64, E> {
    const SIGN: u64 = 1 << 63;
    // Unsigned numbers in the order of the values.
    let key = |value: f64| match value.to_bits() {
        bits if bits & SIGN != 0 => !bits,
        bits => bits | SIGN,
    };
    let (mut found, mut rank) = (0_u64, rank as u64);
    for shift in [48, 32, 16, 0] {
        let mut counts = vec![0_u64; 1 << DIGIT];
        let above = |key: u64| key.checked_shr(shift + DIGIT).unwrap_or(0);
        each(&mut |value| {
            let key = key(value);
            if above(key) == above(found) {
                counts[(key >> shift) as usize & ((1 << DIGIT) - 1)] += 1;
            }
        })?;
        for (digit, count) in (0_u64..).zip(&counts) {
            if rank < *count {
                found |= digit << shift;
                break;
            }
            rank -= count;
        }
    }
    Ok(f64::from_bits(if found & SIGN != 0 { found & !SIGN } else { !found }))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use proptest::prelude::*;

    use super::*;

    fn folder() -> Storage {
        Storage::Folder(std::env::temp_dir())
    }

    fn column(storage: &Storage, values: impl IntoIterator<Item = f64>) -> Column {
        let mut column = Column::new(storage);
        values.into_iter().for_each(|value| column.push(value).unwrap());
        column
    }

    #[test]
    fn a_column_on_disk_reads_as_one_in_memory_and_holds_a_piece_of_it() {
        let rows = 5 * PIECE + 123;
        let value = |row: usize| (row as f64).sin();
        for storage in [Storage::Memory, folder()] {
            let mut column = column(&storage, (0..rows).map(value));
            let on_disk = matches!(storage, Storage::Folder(_));
            assert_eq!((column.file.is_some(), column.tail.len() < PIECE), (on_disk, on_disk));
            let ranges = [0..rows, 100..rows, 5 * PIECE - 7..rows - 3, 3..17];
            for range in ranges {
                column.cut(0..rows);
                (column.before, column.rows) = (0, rows);
                column.cut(range.clone());
                assert_eq!(column.len(), range.len());
                let expected: Vec<f64> = range.clone().map(value).collect();
                let (mut forward, mut backward) = (column.cursor(), column.cursor());
                for (row, expected) in expected.iter().enumerate() {
                    assert_eq!(forward.at(row).unwrap().to_bits(), expected.to_bits());
                }
                for (row, expected) in expected.iter().enumerate().rev() {
                    assert_eq!(backward.at(row).unwrap().to_bits(), expected.to_bits());
                }
                assert!(forward.at(range.len()).is_err());
                assert!(column.read(range.len() - 1, &mut [0.0; 2]).is_err());
            }
            column.cut(1..3);
            assert_eq!(column.into_vec().unwrap(), [value(4), value(5)]);
        }
    }

    #[test]
    fn both_directions_read_each_value_about_once() {
        let column = column(&folder(), (0..20 * PIECE).map(|row| row as f64));
        let mut pieces = 0;
        let mut cursor = column.cursor();
        let mut last = usize::MAX;
        for row in (0..column.len()).chain((0..column.len()).rev()) {
            assert_eq!(cursor.at(row).unwrap(), row as f64);
            let Source::Column { first, .. } = &cursor.0 else { panic!("it is on the disk") };
            pieces += usize::from(*first != last);
            last = *first;
        }
        assert!(pieces < 2 * 22, "{pieces}");
    }

    proptest! {
        #[test]
        fn the_nth_value_is_that_of_a_sort(
            values in prop::collection::vec(any::<f64>(), 1..200),
            rank in any::<prop::sample::Index>(),
        ) {
            let rank = rank.index(values.len());
            let found = nth(rank, |take| {
                values.iter().for_each(|value| take(*value));
                Ok::<(), ()>(())
            });
            let mut sorted = values.clone();
            sorted.sort_by(f64::total_cmp);
            prop_assert_eq!(found.unwrap().to_bits(), sorted[rank].to_bits());
        }
    }
}
