//! Runs commands of the recorder, and keeps their files in a folder.
#![allow(dead_code, unreachable_pub, clippy::unwrap_used, clippy::expect_used)]

pub mod experiment;
pub mod long;
pub mod short;

use std::path::PathBuf;

use clap::Parser;
use recorder::Command;

/// The command line of `rec`.
#[derive(Debug, Parser)]
pub struct Line {
    #[command(subcommand)]
    pub command: Command,
}

pub fn rec(words: &[&str]) -> (i32, String) {
    let line = Line::try_parse_from(std::iter::once("rec").chain(words.iter().copied())).unwrap();
    let mut out = Vec::new();
    let code = recorder::run_to(&line.command, &mut out).unwrap();
    (code, String::from_utf8(out).unwrap())
}

pub fn fails(words: &[&str]) -> String {
    let line = Line::try_parse_from(std::iter::once("rec").chain(words.iter().copied())).unwrap();
    format!("{:#}", recorder::run_to(&line.command, &mut Vec::new()).unwrap_err())
}

pub struct Folder(tempfile::TempDir);

impl Folder {
    pub fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }
    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }
    pub fn text(&self, name: &str) -> String {
        self.path(name).to_str().unwrap().to_owned()
    }
}
