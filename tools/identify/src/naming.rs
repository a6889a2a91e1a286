//! Names of records and of the segments cut from them.

use std::collections::BTreeSet;

/// End of the name of a segment.
const END: &str = " s]";

/// Name of the segment of a recording between two times (s).
pub(crate) fn segment(recording: &str, from: f64, to: f64) -> String {
    format!("{recording}[{from:.1}..{to:.1}{END}")
}

/// The recording from which the segment of this name was cut; other names are returned unchanged.
pub(crate) fn recording_of(name: &str) -> &str {
    name.strip_suffix(END)
        .and_then(|name| name.rsplit_once('['))
        .map_or(name, |(recording, _)| recording)
}

/// Short names for captions: file names without folders if they are distinct, else the full names.
pub(crate) fn labels<'a>(names: impl Iterator<Item = &'a str> + Clone) -> Vec<&'a str> {
    let short = |name: &'a str| name.rsplit('/').next().unwrap_or(name);
    let distinct: BTreeSet<&str> = names.clone().map(short).collect();
    match distinct.len() == names.clone().count() {
        true => names.map(short).collect(),
        false => names.collect(),
    }
}

/// The records with which a model was compared, segments of one recording together.
pub(crate) fn held(labels: &[&str]) -> String {
    let told =
        labels.chunk_by(|a, b| recording_of(a) == recording_of(b)).map(|of_one| match of_one {
            [one] => (*one).to_owned(),
            many => format!("{} ({} segments)", recording_of(many[0]), many.len()),
        });
    told.collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_are_named_by_their_files_if_those_are_distinct() {
        assert_eq!(labels(["../a/one.csv", "/b/two.csv"].into_iter()), ["one.csv", "two.csv"]);
        assert_eq!(labels(["a/one.csv", "b/one.csv"].into_iter()), ["a/one.csv", "b/one.csv"]);
    }

    #[test]
    fn segments_are_listed_together_and_brackets_in_names_are_kept() {
        let cut =
            [segment("b[1].mcap", 1.5, 4.5), segment("b[1].mcap", 4.5, 7.4), "c[2].csv".to_owned()];
        assert_eq!(cut[0], "b[1].mcap[1.5..4.5 s]");
        assert_eq!(
            cut.each_ref().map(|name| recording_of(name)),
            ["b[1].mcap", "b[1].mcap", "c[2].csv"]
        );
        assert_eq!(held(&cut.each_ref().map(String::as_str)), "b[1].mcap (2 segments), c[2].csv");
    }
}
