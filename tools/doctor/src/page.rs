//! docs/doctor.md: an introduction, and the table of checks.

use std::fmt::Write as _;
use std::path::Path;

use crate::checks::CHECKS;

const INTRODUCTION: &str = include_str!("page.md");

#[test]
fn the_page_of_the_doctor_is_current() {
    let mut text = INTRODUCTION.to_owned();
    for check in CHECKS {
        write!(
            text,
            "\n### {}\n\n{}. Needs {}.\n\n| | |\n|---|---|\n| what it does | {} |\n\
             | limits | {} |\n| source of the limits | {} |\n| remedy | {} |\n",
            check.id,
            capital(check.title),
            check.needs.text(),
            check.does,
            check.limits,
            check.source,
            check.remedy
        )
        .unwrap();
    }
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/doctor.md");
    if std::env::var_os("UPDATE_PAGES").is_some_and(|value| value == "1") {
        std::fs::write(&path, &text).unwrap();
    }
    let found = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(text == found, "docs/doctor.md: UPDATE_PAGES=1 cargo test -p doctor page");
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}
