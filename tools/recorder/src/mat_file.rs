//! Encodes MATLAB files of version 5 (Level 5 MAT-file format), little-endian and uncompressed.
//!
//! Own code, as the crates that write such files drop characters that are not ASCII.

use anyhow::bail;

/// A value of a variable.
#[derive(Clone, Debug)]
pub(crate) enum Value {
    /// Rows, and one list of that length for each column.
    Matrix(usize, Vec<Vec<f64>>),
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
/// Largest variable that every reader of the format accepts (bytes).
const LARGEST: usize = 0x7fff_ffff;

impl Value {
    /// A column of numbers.
    pub(crate) fn column(values: Vec<f64>) -> Self {
        Self::Matrix(values.len(), vec![values])
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

/// A whole file with these variables; `description` is its first line, of which 116 ASCII
/// characters are kept.
///
/// # Errors
/// Where a variable is larger than 2 GiB.
pub(crate) fn encode(description: &str, variables: &[(&str, Value)]) -> anyhow::Result<Vec<u8>> {
    let ascii = description.chars().map(|c| if c.is_ascii_graphic() { c as u8 } else { b' ' });
    let mut bytes: Vec<u8> = ascii.take(HEADER_TEXT).collect();
    bytes.resize(HEADER_TEXT, b' ');
    // No data of subsystems, version 1.0, and the mark of little-endian files.
    bytes.extend([0; 8]);
    bytes.extend(0x0100_u16.to_le_bytes());
    bytes.extend(b"IM");
    for (name, value) in variables {
        let element = array(name, value);
        if element.len() > LARGEST {
            bail!(
                "`{name}` has {} bytes, and a variable of a MATLAB file at most {LARGEST}: cut the \
                 recording (`farreach rec cut`)",
                element.len()
            );
        }
        bytes.extend(element);
    }
    Ok(bytes)
}

/// A data element: type, length, data, and zeros up to a multiple of eight bytes.
fn element(kind: u32, data: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(16 + data.len());
    bytes.extend(kind.to_le_bytes());
    bytes.extend((data.len() as u32).to_le_bytes());
    bytes.extend(data);
    bytes.resize(bytes.len().next_multiple_of(8), 0);
    bytes
}

/// An array of a class: its flags, dimensions and name, and what follows them.
fn of_class(class: u8, size: (usize, usize), name: &str, contents: Vec<u8>) -> Vec<u8> {
    let dimensions = [size.0 as i32, size.1 as i32].map(i32::to_le_bytes).concat();
    let mut body = element(UINT32, &[class, 0, 0, 0, 0, 0, 0, 0]);
    body.extend(element(INT32, &dimensions));
    body.extend(element(INT8, name.as_bytes()));
    body.extend(contents);
    element(MATRIX, &body)
}

fn array(name: &str, value: &Value) -> Vec<u8> {
    match value {
        Value::Matrix(rows, columns) => {
            let numbers: Vec<u8> =
                columns.iter().flatten().flat_map(|number| number.to_le_bytes()).collect();
            of_class(DOUBLE_CLASS, (*rows, columns.len()), name, element(DOUBLE, &numbers))
        }
        Value::Text(text) => {
            // Readers count characters of 16 bits; all of them know UTF-8, unlike UTF-16.
            let wide = |c: char| if c.len_utf16() > 1 { char::REPLACEMENT_CHARACTER } else { c };
            let text: String = text.chars().map(wide).collect();
            let size = (usize::from(!text.is_empty()), text.chars().count());
            of_class(CHAR_CLASS, size, name, element(UTF8, text.as_bytes()))
        }
        Value::Cell(values) => {
            let cells = values.iter().flat_map(|value| array("", value)).collect();
            of_class(CELL_CLASS, (values.len(), 1), name, cells)
        }
        Value::Structure(fields) => {
            // The length of the names is a small element: length and type share four bytes.
            let mut contents = (4 << 16 | INT32).to_le_bytes().to_vec();
            contents.extend((FIELD_NAME as u32).to_le_bytes());
            let mut names = Vec::with_capacity(fields.len() * FIELD_NAME);
            for (name, _) in fields {
                let mut field: Vec<u8> = name.bytes().take(FIELD_NAME - 1).collect();
                field.resize(FIELD_NAME, 0);
                names.extend(field);
            }
            contents.extend(element(INT8, &names));
            contents.extend(fields.iter().flat_map(|(_, value)| array("", value)));
            of_class(STRUCT_CLASS, (1, 1), name, contents)
        }
    }
}
