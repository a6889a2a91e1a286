//! Sources of a record's columns in files that name them differently.

use std::str::FromStr;

use super::Problem;

/// A column and its source, written `COLUMN=SOURCE` or `COLUMN=SOURCE*FACTOR`.
///
/// In a CSV file the source is a name in its header. In an MCAP file it is `TOPIC:FIELD`, with dots
/// into messages and brackets into arrays: `/joint_states:position[0]`, `/wrench:wrench.torque.z`.
/// The factor brings it to SI units.
///
/// ```
/// # use recording::record::Mapping;
/// let torque: Mapping = "slave_torque_nm=/handle:wrench.torque.z*0.001".parse()?;
/// assert_eq!((torque.source.as_str(), torque.factor), ("/handle:wrench.torque.z", 0.001));
/// # Ok::<(), recording::record::MappingError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Mapping {
    /// Name of the column in the record.
    pub column: String,
    /// Column or field that it is read from.
    pub source: String,
    /// Factor from the source to SI units.
    pub factor: f64,
}

/// Text that is no mapping.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected COLUMN=SOURCE or COLUMN=SOURCE*FACTOR, found `{0}`")]
pub struct MappingError(String);

impl FromStr for Mapping {
    type Err = MappingError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let wrong = || MappingError(text.to_owned());
        let (column, source) = text.split_once('=').ok_or_else(wrong)?;
        let (source, factor) = match source.rsplit_once('*') {
            Some((source, factor)) => (source, factor.trim().parse().map_err(|_| wrong())?),
            None => (source, 1.0),
        };
        let (column, source) = (column.trim(), source.trim());
        let usable = f64::is_finite(factor) && factor != 0.0;
        if column.is_empty() || source.is_empty() || !usable {
            return Err(wrong());
        }
        Ok(Self { column: column.to_owned(), source: source.to_owned(), factor })
    }
}

impl Mapping {
    /// What is wrong with the column's source.
    pub(super) fn problem(&self, what: String) -> Problem {
        Problem(format!("column mapped by {}={}: {what}", self.column, self.source))
    }
}

/// One element of a path into a message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum PathElement {
    /// The field of that name.
    Field(String),
    /// The element of that number, from 0.
    Index(usize),
}

/// Parses a source `TOPIC:FIELD` into the topic and the path into its messages; `None` where it has
/// another form.
pub(super) fn parse_source(source: &str) -> Option<(&str, Vec<PathElement>)> {
    let (topic, field) = source.rsplit_once(':')?;
    let mut steps = Vec::new();
    for part in field.split('.') {
        let (name, mut rest) = part.split_at(part.find('[').unwrap_or(part.len()));
        if name.is_empty() {
            return None;
        }
        steps.push(PathElement::Field(name.to_owned()));
        while !rest.is_empty() {
            let (index, after) = rest.strip_prefix('[')?.split_once(']')?;
            steps.push(PathElement::Index(index.parse().ok()?));
            rest = after;
        }
    }
    (!topic.is_empty()).then_some((topic, steps))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn invalid_mappings_are_refused() {
        let read = |text: &str| text.parse::<Mapping>();
        assert_eq!(
            read("a = b ").unwrap(),
            Mapping { column: "a".into(), source: "b".into(), factor: 1.0 }
        );
        assert_eq!(
            read("a=b*c*-2e-3").unwrap(),
            Mapping { column: "a".into(), source: "b*c".into(), factor: -2e-3 }
        );
        for text in ["", "a", "=b", "a=", "a=b*", "a=b*two", "a=b*0", "a=b*inf"] {
            let said = read(text).unwrap_err().to_string();
            assert!(said.contains("COLUMN=SOURCE*FACTOR") && said.contains(text), "{said}");
        }
    }

    #[test]
    fn a_source_is_a_topic_and_a_path() {
        let field = |name: &str| PathElement::Field(name.to_owned());
        assert_eq!(parse_source("/a:b"), Some(("/a", vec![field("b")])));
        let way = vec![field("b"), PathElement::Index(2), PathElement::Index(0), field("c")];
        assert_eq!(parse_source("x:y:b[2][0].c"), Some(("x:y", way)));
        for text in ["b", ":b", "/a:", "/a:b.", "/a:b[", "/a:b[]", "/a:b[x]", "/a:b[1]c", "/a:[1]"]
        {
            assert_eq!(parse_source(text), None, "{text}");
        }
    }
}
