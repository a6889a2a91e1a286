//! How records and their stretches are called.

use std::collections::BTreeSet;

/// Behind the name of a stretch.
const END: &str = " s]";

/// A stretch of a recording, from and to these times (s).
pub(crate) fn segment(recording: &str, from: f64, to: f64) -> String {
    format!("{recording}[{from:.1}..{to:.1}{END}")
}

/// The recording that a stretch of this name was cut from; other names stay as they are.
pub(crate) fn recording_of(name: &str) -> &str {
    name.strip_suffix(END)
        .and_then(|name| name.rsplit_once('['))
        .map_or(name, |(recording, _)| recording)
}

/// Records as captions call them: by the names of their files, where those differ.
pub(crate) fn labels<'a>(names: impl Iterator<Item = &'a str> + Clone) -> Vec<&'a str> {
    let short = |name: &'a str| name.rsplit('/').next().unwrap_or(name);
    let distinct: BTreeSet<&str> = names.clone().map(short).collect();
    match distinct.len() == names.clone().count() {
        true => names.map(short).collect(),
        false => names.collect(),
    }
}

/// What a model was held against: stretches of one recording together.
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
    fn records_are_called_by_their_files_where_those_differ() {
        assert_eq!(labels(["../a/one.csv", "/b/two.csv"].into_iter()), ["one.csv", "two.csv"]);
        assert_eq!(labels(["a/one.csv", "b/one.csv"].into_iter()), ["a/one.csv", "b/one.csv"]);
    }

    #[test]
    fn stretches_are_told_together_and_a_bracket_in_a_name_is_none() {
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
