//! The reference of the command line is complete and current.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::fmt::Write as _;
use std::path::Path;

use clap::CommandFactory as _;

use crate::cli::Cli;
use crate::reference::man;

const INTRODUCTION: &str = "# Command line\n\nGenerated from `farreach --help` by \
    `UPDATE_DOCS=1 cargo test --bin farreach`; do not edit.\n";

/// Every command, depth first, with its path.
fn commands(command: &clap::Command, path: &str, found: &mut Vec<(String, clap::Command)>) {
    found.push((path.to_owned(), command.clone()));
    for sub in command.get_subcommands().filter(|sub| sub.get_name() != "help") {
        commands(sub, &format!("{path} {}", sub.get_name()), found);
    }
}

fn all() -> Vec<(String, clap::Command)> {
    let mut root = Cli::command().term_width(100);
    root.build();
    let mut found = Vec::new();
    commands(&root, "farreach", &mut found);
    found
}

#[test]
fn the_page_of_the_command_line_is_current() {
    let mut text = INTRODUCTION.to_owned();
    for (path, mut command) in all() {
        let help = command.render_long_help().to_string();
        let help = help.lines().map(str::trim_end).collect::<Vec<_>>().join("\n");
        write!(text, "\n## {path}\n\n```text\n{}\n```\n", help.trim_end()).unwrap();
    }
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/cli.md");
    if std::env::var_os("UPDATE_DOCS").is_some_and(|value| value == "1") {
        std::fs::write(&path, &text).unwrap();
    }
    let found = std::fs::read_to_string(&path).unwrap_or_default();
    let line = text.lines().zip(found.lines()).position(|(new, old)| new != old);
    assert!(text == found, "docs/cli.md differs from line {line:?} on: {INTRODUCTION}");
}

#[test]
fn every_command_shows_an_example() {
    for (path, mut command) in all() {
        if !command.has_subcommands() {
            let help = command.render_long_help().to_string();
            assert!(help.contains("Example"), "{path}: {help}");
        }
    }
}

#[test]
fn every_command_has_a_man_page() {
    let directory = tempfile::tempdir().unwrap();
    man(Cli::command(), directory.path()).unwrap();
    for (path, _) in all() {
        let page = directory.path().join(path.replace(' ', "-") + ".1");
        assert!(page.exists(), "{}", page.display());
    }
    assert!(man(Cli::command(), &directory.path().join("absent")).is_err());
}
