//! Reads MATLAB files of version 5, as far as the tests need it.
#![allow(dead_code, unreachable_pub, clippy::unwrap_used, clippy::expect_used)]

use std::collections::BTreeMap;

/// A variable, or the whole file as a structure.
#[derive(Clone, Debug)]
pub enum Value {
    /// Its size, and its numbers column by column.
    Numbers([usize; 2], Vec<f64>),
    Text(String),
    Cells(Vec<Value>),
    Fields(BTreeMap<String, Value>),
}

impl Value {
    pub fn at(&self, name: &str) -> &Self {
        let Self::Fields(fields) = self else { panic!("{self:?} has no field {name}") };
        fields.get(name).unwrap_or_else(|| panic!("no field {name}"))
    }

    pub fn has(&self, name: &str) -> bool {
        matches!(self, Self::Fields(fields) if fields.contains_key(name))
    }

    pub fn size(&self) -> [usize; 2] {
        let Self::Numbers(size, _) = self else { panic!("{self:?}") };
        *size
    }

    pub fn numbers(&self) -> &[f64] {
        let Self::Numbers(_, numbers) = self else { panic!("{self:?}") };
        numbers
    }

    pub fn text(&self) -> &str {
        let Self::Text(text) = self else { panic!("{self:?}") };
        text
    }

    pub fn texts(&self) -> Vec<String> {
        let Self::Cells(cells) = self else { panic!("{self:?}") };
        cells.iter().map(|cell| cell.text().to_owned()).collect()
    }
}

/// The variables of a file.
pub fn read(bytes: &[u8]) -> Value {
    assert_eq!(&bytes[124..128], b"\x00\x01IM", "version and byte order");
    let (mut rest, mut variables) = (&bytes[128..], BTreeMap::new());
    while !rest.is_empty() {
        let (name, value) = array(take(&mut rest, 14));
        variables.insert(name, value);
    }
    Value::Fields(variables)
}

fn word(bytes: &[u8]) -> u32 {
    u32::from_le_bytes(bytes[..4].try_into().unwrap())
}

/// The data of the next element, which must be of that type.
fn take<'a>(rest: &mut &'a [u8], kind: u32) -> &'a [u8] {
    let first = word(rest);
    let (data, end) = if first >> 16 != 0 {
        // A small element.
        assert_eq!(first & 0xffff, kind);
        (&rest[4..4 + (first >> 16) as usize], 8)
    } else {
        assert_eq!(first, kind);
        let length = word(&rest[4..]) as usize;
        (&rest[8..8 + length], 8 + length.next_multiple_of(8))
    };
    *rest = &rest[end..];
    data
}

fn array(mut body: &[u8]) -> (String, Value) {
    let rest = &mut body;
    let class = take(rest, 6)[0];
    let dimensions = take(rest, 5);
    let size = [word(dimensions) as usize, word(&dimensions[4..]) as usize];
    let name = String::from_utf8(take(rest, 1).to_vec()).unwrap();
    let count = size[0] * size[1];
    let value = match class {
        1 => Value::Cells((0..count).map(|_| array(take(rest, 14)).1).collect()),
        2 => {
            let length = word(take(rest, 5)) as usize;
            let names = take(rest, 1).chunks(length).map(|name| {
                let end = name.iter().position(|byte| *byte == 0).unwrap();
                String::from_utf8(name[..end].to_vec()).unwrap()
            });
            Value::Fields(names.map(|name| (name, array(take(rest, 14)).1)).collect())
        }
        4 => {
            let text = String::from_utf8(take(rest, 16).to_vec()).unwrap();
            assert_eq!(text.chars().count(), count);
            Value::Text(text)
        }
        6 => {
            let bytes = take(rest, 9).chunks(8);
            let numbers: Vec<f64> =
                bytes.map(|b| f64::from_le_bytes(b.try_into().unwrap())).collect();
            assert_eq!(numbers.len(), count);
            Value::Numbers(size, numbers)
        }
        other => panic!("class {other}"),
    };
    assert!(rest.is_empty(), "{} bytes too many in {name}", rest.len());
    (name, value)
}
