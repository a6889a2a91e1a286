//! Encodes MATLAB files of version 5 (Level 5 MAT-file format), little-endian and uncompressed.
//!
//! Own code, as the crates that write such files drop characters that are not ASCII.

use std::io::{self, Write};

use anyhow::bail;
use recording::column::Column;

/// A value of a variable.
#[derive(Debug)]
pub(crate) enum Value {
    /// Rows, and the columns, each of that length.
    Matrix(usize, Vec<Column>),
    /// A row of characters; one beyond the basic plane of Unicode becomes U+FFFD.
    Text(String),
    /// A column of cells.
    Cell(Vec<Value>),
    /// A structure with one element.
    Structure(Vec<(&'static str, Value)>),
}

// Types of data elements.
const INT8: u32 = 1;
const INT32: u32 = 5;
const UINT32: u32 = 6;
const DOUBLE: u32 = 9;
const MATRIX: u32 = 14;
const UTF8: u32 = 16;
// Classes of arrays.
const CELL_CLASS: u8 = 1;
const STRUCT_CLASS: u8 = 2;
const CHAR_CLASS: u8 = 4;
const DOUBLE_CLASS: u8 = 6;

/// Length of the text at the beginning of a file.
const HEADER_TEXT: usize = 116;
/// Bytes for the name of a field, with the zero at its end.
const FIELD_NAME: usize = 32;
/// Bytes of an element's type and length.
const TAG: usize = 8;
/// Bytes of a number.
const BYTES: usize = size_of::<f64>();
/// Numbers that are written at a time.
const PIECE: usize = 8 * 1024;
/// Largest variable that every reader of the format accepts (bytes).
const LARGEST: usize = 0x7fff_ffff;

impl Value {
    /// A column of numbers.
    pub(crate) fn column(values: Vec<f64>) -> Self {
        Self::Matrix(values.len(), vec![values.into()])
    }

    /// A column of texts.
    pub(crate) fn texts(texts: impl IntoIterator<Item = impl Into<String>>) -> Self {
        Self::Cell(texts.into_iter().map(|text| Self::Text(text.into())).collect())
    }
}

impl From<f64> for Value {
    fn from(value: f64) -> Self {
        Self::column(vec![value])
    }
}

impl From<&str> for Value {
    fn from(value: &str) -> Self {
        Self::Text(value.to_owned())
    }
}

/// Writes a whole file with these variables; `description` is its first line, of which 116 ASCII
/// characters are kept.
///
/// # Errors
/// Where a variable is larger than 2 GiB, before anything is written; those of the output and of
/// the columns.
pub(crate) fn write_mat(
    description: &str,
    variables: &[(&str, Value)],
    out: &mut dyn Write,
) -> anyhow::Result<()> {
    for (name, value) in variables {
        let bytes = size(name, value);
        if bytes > LARGEST {
            bail!(
                "`{name}` has {bytes} bytes, and a variable of a MATLAB file at most {LARGEST}: \
                 cut the recording (`farreach rec cut`)"
            );
        }
    }
    let ascii = description.chars().map(|c| if c.is_ascii_graphic() { c as u8 } else { b' ' });
    let mut header: Vec<u8> = ascii.take(HEADER_TEXT).collect();
    header.resize(HEADER_TEXT, b' ');
    // No data of subsystems, version 1.0, and the mark of little-endian files.
    header.extend([0; 8]);
    header.extend(0x0100_u16.to_le_bytes());
    header.extend(b"IM");
    out.write_all(&header)?;
    for (name, value) in variables {
        write_array(name, value, out)?;
    }
    Ok(())
}

/// Bytes of a data element with so many bytes of data: type, length, data, and zeros up to a
/// multiple of eight bytes.
const fn element_size(data: usize) -> usize {
    TAG + data.next_multiple_of(8)
}

fn write_tag(kind: u32, length: usize, out: &mut dyn Write) -> io::Result<()> {
    out.write_all(&kind.to_le_bytes())?;
    out.write_all(&(length as u32).to_le_bytes())
}

fn write_element(kind: u32, data: &[u8], out: &mut dyn Write) -> io::Result<()> {
    write_tag(kind, data.len(), out)?;
    out.write_all(data)?;
    out.write_all(&[0; 8][..data.len().next_multiple_of(8) - data.len()])
}

/// Bytes of an array with its name.
fn size(name: &str, value: &Value) -> usize {
    let contents = match value {
        Value::Matrix(_, columns) => element_size(BYTES * numbers(columns)),
        Value::Text(text) => element_size(wide(text).len()),
        Value::Cell(values) => values.iter().map(|value| size("", value)).sum(),
        Value::Structure(fields) => {
            let names = TAG + element_size(fields.len() * FIELD_NAME);
            names + fields.iter().map(|(_, value)| size("", value)).sum::<usize>()
        }
    };
    TAG + head_size(name) + contents
}

/// Bytes of what is in front of an array's contents: its flags, dimensions and name.
const fn head_size(name: &str) -> usize {
    2 * element_size(8) + element_size(name.len())
}

fn numbers(columns: &[Column]) -> usize {
    columns.iter().map(Column::len).sum()
}

/// A text as readers can count it: in characters of 16 bits. All of them know UTF-8, unlike UTF-16.
fn wide(text: &str) -> String {
    let wide = |c: char| if c.len_utf16() > 1 { char::REPLACEMENT_CHARACTER } else { c };
    text.chars().map(wide).collect()
}

fn write_array(name: &str, value: &Value, out: &mut dyn Write) -> io::Result<()> {
    let text = match value {
        Value::Text(text) => wide(text),
        _ => String::new(),
    };
    let (class, rows, columns) = match value {
        Value::Matrix(rows, columns) => (DOUBLE_CLASS, *rows, columns.len()),
        Value::Text(_) => (CHAR_CLASS, usize::from(!text.is_empty()), text.chars().count()),
        Value::Cell(values) => (CELL_CLASS, values.len(), 1),
        Value::Structure(_) => (STRUCT_CLASS, 1, 1),
    };
    write_tag(MATRIX, size(name, value) - TAG, out)?;
    write_element(UINT32, &[class, 0, 0, 0, 0, 0, 0, 0], out)?;
    let dimensions = [rows as i32, columns as i32].map(i32::to_le_bytes).concat();
    write_element(INT32, &dimensions, out)?;
    write_element(INT8, name.as_bytes(), out)?;
    match value {
        Value::Matrix(_, columns) => {
            write_tag(DOUBLE, BYTES * numbers(columns), out)?;
            for column in columns {
                write_numbers(column, out)?;
            }
            Ok(())
        }
        Value::Text(_) => write_element(UTF8, text.as_bytes(), out),
        Value::Cell(values) => values.iter().try_for_each(|value| write_array("", value, out)),
        Value::Structure(fields) => {
            // The length of the names is a small element: length and type share four bytes.
            out.write_all(&(4 << 16 | INT32).to_le_bytes())?;
            out.write_all(&(FIELD_NAME as u32).to_le_bytes())?;
            let mut names = Vec::with_capacity(fields.len() * FIELD_NAME);
            for (name, _) in fields {
                let mut field: Vec<u8> = name.bytes().take(FIELD_NAME - 1).collect();
                field.resize(FIELD_NAME, 0);
                names.extend(field);
            }
            write_element(INT8, &names, out)?;
            fields.iter().try_for_each(|(_, value)| write_array("", value, out))
        }
    }
}

/// Writes the numbers of a column, a piece at a time.
fn write_numbers(column: &Column, out: &mut dyn Write) -> io::Result<()> {
    let mut values = vec![0.0; PIECE.min(column.len())];
    let mut at = 0;
    while at < column.len() {
        let length = values.len().min(column.len() - at);
        column.read(at, &mut values[..length])?;
        let bytes: Vec<u8> =
            values[..length].iter().flat_map(|value| value.to_le_bytes()).collect();
        out.write_all(&bytes)?;
        at += length;
    }
    Ok(())
}
