//! docs/safety-case.md and the project say the same: every requirement has as many tests as it
//! claims, where it says that they are, and code that exists; every fault is tried by what its row
//! names, or says why by nothing.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// Where the project's own Rust is.
const SOURCES: [&str; 7] = ["files", "ipc-types", "launch", "plant", "services", "tests", "tools"];

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn page(name: &str) -> String {
    fs::read_to_string(root().join("docs").join(name)).unwrap()
}

/// The name of each function with `#[test]` (in a property, too), and its file from the root.
fn tests() -> Vec<(String, String)> {
    let root = root();
    let mut found = Vec::new();
    let mut folders: Vec<PathBuf> = SOURCES.iter().map(|folder| root.join(folder)).collect();
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() && !path.ends_with("target") {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                let file = path.strip_prefix(&root).unwrap().to_str().unwrap().to_owned();
                let text = fs::read_to_string(&path).unwrap();
                found.extend(tests_in(&text).map(|name| (name.to_owned(), file.clone())));
            }
        }
    }
    found
}

fn tests_in(text: &str) -> impl Iterator<Item = &str> {
    let mut is_test = false;
    text.lines().filter_map(move |line| {
        let line = line.trim_start();
        is_test |= line == "#[test]";
        let name = line.strip_prefix("fn ")?.split('(').next()?;
        std::mem::take(&mut is_test).then_some(name)
    })
}

/// What stands under a heading of the page, to the next heading as high or higher.
fn section<'a>(text: &'a str, heading: &str) -> &'a str {
    let begin = text.find(&format!("\n{heading}\n")).unwrap_or_else(|| panic!("no {heading:?}"));
    let body = &text[begin + heading.len() + 2..];
    &body[..body.find("\n## ").unwrap_or(body.len())]
}

/// Cells of a row of a table; `\|` is part of one.
fn cells(row: &str) -> Vec<String> {
    let row = row.trim().trim_start_matches('|').trim_end_matches('|').replace("\\|", "\0");
    row.split('|').map(|cell| cell.trim().replace('\0', "|")).collect()
}

/// The first table of a text: its heading, and its rows.
fn table(text: &str) -> (Vec<String>, Vec<Vec<String>>) {
    let mut lines = text.lines().skip_while(|line| !line.starts_with('|'));
    let heading = cells(lines.next().unwrap());
    let rows: Vec<_> = lines.skip(1).take_while(|line| line.starts_with('|')).map(cells).collect();
    for row in &rows {
        assert_eq!(row.len(), heading.len(), "{row:?}");
    }
    (heading, rows)
}

/// What stands in backticks.
fn quoted(text: &str) -> impl Iterator<Item = &str> {
    text.split('`').skip(1).step_by(2)
}

/// Number of tests that a cell claims: "`sr_04_*` (9)", and those after each "and": "(3, and 5 in
/// `…`)", "(4), and one whole-system". One test where no number is given.
fn claimed(cell: &str) -> usize {
    let mut number = match cell.split_once('(') {
        Some((_, rest)) => {
            let digits: String = rest.chars().take_while(char::is_ascii_digit).collect();
            digits.parse().unwrap_or_else(|_| panic!("no number of tests: {cell}"))
        }
        None => 1,
    };
    let words: Vec<&str> = cell.split([' ', ',', '(', ')']).collect();
    for pair in words.windows(2).filter(|pair| pair[0] == "and") {
        number += match pair[1] {
            "one" => 1,
            "two" => 2,
            "three" => 3,
            digits => digits.parse().unwrap_or_else(|_| panic!("and {digits}? {cell}")),
        };
    }
    number
}

#[test]
fn numbers_of_tests_are_added_up() {
    for (cell, expected) in [
        ("`sr_15_*`", 1),
        ("`sr_04_*` (11)", 11),
        ("`sr_10_*` (4: three properties of 2,000 cases each, every sequence of four events)", 4),
        ("`sr_14_*` (4, and 5 in `services/watchdog/src/`)", 9),
        ("`sr_19_*` (5, and two whole-system)", 7),
        ("`sr_27_*` (4, one property of 256 cases), and one whole-system", 5),
    ] {
        assert_eq!(claimed(cell), expected, "{cell}");
    }
}

#[test]
fn every_requirement_has_the_tests_that_it_claims_where_the_page_says_that_they_are() {
    let document = page("safety-case.md");
    let section = section(&document, "## Requirements and their tests");
    let (heading, rows) = table(section);
    assert_eq!(heading, ["id", "requirement", "code", "tests"]);
    let mut claims = BTreeMap::new();
    for (at, row) in rows.iter().enumerate() {
        assert_eq!(row[0], format!("SR-{:02}", at + 1), "ids are in order, without a gap");
        assert!(row[3].starts_with(&format!("`sr_{:02}_*`", at + 1)), "{row:?}");
        claims.insert(row[0].clone(), claimed(&row[3]));
    }
    let listed: Vec<&str> =
        quoted(&section[..section.find('|').unwrap()]).filter(|name| name.contains('/')).collect();
    for place in &listed {
        assert!(root().join(place).exists(), "{place}");
    }
    let mut found = BTreeMap::new();
    for (name, file) in tests() {
        if let Some(number) = name.strip_prefix("sr_") {
            *found.entry(format!("SR-{}", &number[..2])).or_default() += 1;
            let said = listed.iter().any(|place| file.starts_with(place));
            assert!(said, "the list of where the tests are misses {file}");
        }
    }
    assert!(found.len() > 40, "{found:?}");
    assert_eq!(claims, found);
}

#[test]
fn the_code_of_every_requirement_exists() {
    let document = page("safety-case.md");
    let (_, rows) = table(section(&document, "## Requirements and their tests"));
    for row in &rows {
        assert!(quoted(&row[2]).count() > 0, "{} names no code", row[0]);
        for file in quoted(&row[2]) {
            assert!(root().join(file).exists(), "{}: {file}", row[0]);
        }
    }
}

/// What may stand in `tried by`: a test, a kind of docs/faults.md (at a place or at any), a kind of
/// the campaign.
fn trials() -> BTreeSet<String> {
    let mut known: BTreeSet<String> = tests().into_iter().map(|(name, _)| name).collect();
    for row in table(section(&page("faults.md"), "## Kinds")).1 {
        let kind = quoted(&row[0]).next().unwrap().to_owned();
        if let Some((kind, places)) = kind.split_once('@') {
            known.insert(kind.to_owned());
            known.extend(places.split('|').map(|place| format!("{kind}@{place}")));
        }
        known.insert(kind);
    }
    let campaign = page("fault-campaign.md");
    let kinds = campaign.lines().skip_while(|line| !line.starts_with("| fault |"));
    let kinds: Vec<String> =
        kinds.filter(|line| line.starts_with("| ")).map(|row| cells(row)[0].clone()).collect();
    assert!(kinds.iter().any(|kind| kind == "kill control"), "{kinds:?}");
    known.extend(kinds);
    known
}

#[test]
fn every_fault_is_tried_by_what_it_names_or_says_why_it_is_not() {
    let document = page("safety-case.md");
    let (heading, rows) = table(section(&document, "## Fault table"));
    assert_eq!(heading.first().unwrap(), "id");
    assert_eq!(heading.last().unwrap(), "tried by");
    let known = trials();
    for (at, row) in rows.iter().enumerate() {
        let (id, tried) = (&row[0], row.last().unwrap());
        assert_eq!(*id, format!("F-{:02}", at + 1), "ids are in order, without a gap");
        if let Some(reason) = tried.strip_prefix("not tried") {
            let given = reason.chars().filter(|character| character.is_alphabetic()).count();
            assert!(given > 3, "{id}: not tried, without a reason");
        } else {
            assert!(quoted(tried).count() > 0, "{id} names nothing that tries it: {tried:?}");
        }
        for name in quoted(tried) {
            assert!(known.contains(name), "{id}: {name} is no test and no kind of fault");
        }
    }
}
