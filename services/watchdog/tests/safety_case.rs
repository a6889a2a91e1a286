//! docs/safety-case.md and the tests say the same: every requirement has as many tests as it
//! claims, and every test that bears an id belongs to a requirement of the document.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

/// Tests of each id in a folder.
fn count(folder: &Path, found: &mut BTreeMap<String, usize>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            count(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            for line in fs::read_to_string(&path).unwrap().lines() {
                if let Some(name) = line.trim_start().strip_prefix("fn sr_") {
                    *found.entry(format!("SR-{}", &name[..2])).or_default() += 1;
                }
            }
        }
    }
}

#[test]
fn every_requirement_has_the_tests_that_it_claims() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let document = fs::read_to_string(root.join("docs/safety-case.md")).unwrap();
    let mut claimed = BTreeMap::new();
    for row in document.lines().filter(|line| line.starts_with("| SR-")) {
        let cells: Vec<&str> = row.split('|').map(str::trim).collect();
        // "`sr_04_*` (9)"; one test where no number is given.
        let number = cells[3].split_once('(').map_or(1, |(_, rest)| {
            rest.chars().take_while(char::is_ascii_digit).collect::<String>().parse().unwrap()
        });
        assert!(claimed.insert(cells[1].to_owned(), number).is_none(), "{} twice", cells[1]);
    }
    let mut found = BTreeMap::new();
    for tests in [
        "services/runtime/tests/gate",
        "services/watchdog/tests/interlock",
        "services/control/tests/law",
        "services/control/tests/setpoint_validation",
        "services/experiment/tests",
        "services/acquisition/tests",
        "tools/lock-step/tests",
    ] {
        count(&root.join(tests), &mut found);
    }
    assert!(found.len() > 20, "{found:?}");
    assert_eq!(claimed, found);
}
