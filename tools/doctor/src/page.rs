//! The checks as Markdown: for `--list`, and for docs/doctor.md, behind its introduction.

use crate::checks::CHECKS;

/// Every check: what it does and needs, its limits, their source, the remedy.
pub(crate) fn listing() -> String {
    let section = |check: &crate::checks::Check| {
        format!(
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
    };
    CHECKS.iter().map(section).collect()
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    let first = letters.next().map(char::to_uppercase);
    first.into_iter().flatten().chain(letters).collect()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    const INTRODUCTION: &str = include_str!("page_introduction.txt");

    #[test]
    fn the_page_of_the_doctor_is_current() {
        let text = INTRODUCTION.to_owned() + &super::listing();
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/doctor.md");
        if std::env::var_os("UPDATE_PAGES").is_some_and(|value| value == "1") {
            std::fs::write(&path, &text).unwrap();
        }
        let found = std::fs::read_to_string(&path).unwrap_or_default();
        assert!(text == found, "docs/doctor.md: UPDATE_PAGES=1 cargo test -p doctor page");
    }
}
