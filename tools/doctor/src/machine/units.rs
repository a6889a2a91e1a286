//! The unit files, where systemd runs: whether they are installed, whole, and of this version.

use std::path::{Path, PathBuf};
use std::process::Command;

use ipc_types::PROCESSES;
use runtime::Verdict;
use serde::Serialize;

use crate::bench::Bench;
use crate::outcome::Outcome;

/// systemd runs where this is (`sd_booted`).
const BOOTED: &str = "/run/systemd/system";
/// Where unit files are looked for, in this order.
const FOLDERS: [&str; 3] =
    ["/etc/systemd/system", "/usr/local/lib/systemd/system", "/usr/lib/systemd/system"];

/// What was found.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub(crate) struct Units {
    /// Unit files of this version.
    expected: usize,
    /// Those that are installed.
    installed: usize,
    /// Those that are not.
    missing: Vec<String>,
    /// Processes that an installed unit does not start as this version does.
    stale: Vec<String>,
    /// What systemd-analyze says of them; empty where it says nothing.
    said: String,
}

pub(crate) fn examine(_bench: &mut Bench<'_>) -> anyhow::Result<Outcome> {
    if !Path::new(BOOTED).is_dir() {
        let remedy = "nothing to do: farreach's own launcher supervises the rig";
        return Ok(Outcome::skipped("systemd does not run this machine", remedy));
    }
    let found = look();
    Ok(judge(&found).measured(&found))
}

fn look() -> Units {
    let names: Vec<String> = PROCESSES
        .iter()
        .map(|entry| format!("farreach-{}@.service", entry.name()))
        .chain(["farreach@.target".to_owned()])
        .collect();
    let find = |name: &String| {
        FOLDERS.iter().map(|folder| Path::new(folder).join(name)).find(|path| path.exists())
    };
    let paths: Vec<PathBuf> = names.iter().filter_map(find).collect();
    let missing = names.iter().filter(|name| find(name).is_none()).cloned().collect();
    let stale = PROCESSES.iter().filter_map(|entry| {
        let path = find(&format!("farreach-{}@.service", entry.name()))?;
        let text = std::fs::read_to_string(path).unwrap_or_default();
        (!starts(&text, entry.name())).then(|| entry.name().to_owned())
    });
    Units {
        expected: names.len(),
        installed: paths.len(),
        missing,
        stale: stale.collect(),
        said: if paths.is_empty() { String::new() } else { analyzed(&paths) },
    }
}

/// Whether a unit's text starts `farreach service NAME`.
fn starts(text: &str, name: &str) -> bool {
    let command = format!("farreach service {name}");
    text.lines().any(|line| line.starts_with("ExecStart=") && line.trim_end().ends_with(&command))
}

fn analyzed(paths: &[PathBuf]) -> String {
    match Command::new("systemd-analyze").args(["verify", "--man=no"]).args(paths).output() {
        Ok(output) => {
            let text = [output.stdout, output.stderr].concat();
            String::from_utf8_lossy(&text).trim().to_owned()
        }
        Err(error) => format!("systemd-analyze: {error}"),
    }
}

fn judge(found: &Units) -> Outcome {
    let Units { expected, installed, missing, stale, said } = found;
    if *installed == 0 {
        let remedy = "nothing to do for rigs that `farreach up` starts; launch/README.md has how \
                      to install the units";
        return Outcome::skipped("no unit files are installed", remedy);
    }
    if !said.is_empty() {
        let first = said.lines().next().unwrap_or_default();
        return Outcome::new(Verdict::Fail, format!("systemd-analyze: {first}"));
    }
    if !stale.is_empty() {
        let text = format!("of another version: {}", stale.join(", "));
        return Outcome::new(Verdict::Fail, text);
    }
    let text = format!("{installed} of {expected} installed and valid");
    if missing.is_empty() {
        return Outcome::new(Verdict::Pass, text);
    }
    Outcome::new(Verdict::Warn, format!("{text}; missing {}", missing.join(", ")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_whole_valid_and_of_this_version() {
        let sound = Units { expected: 10, installed: 10, ..Units::default() };
        assert_eq!(judge(&sound).verdict, Verdict::Pass);
        let few = Units { installed: 9, missing: vec!["x".to_owned()], ..sound.clone() };
        assert_eq!(judge(&few).verdict, Verdict::Warn);
        assert_eq!(judge(&Units { installed: 0, ..sound.clone() }).verdict, Verdict::Skipped);
        let bad = Units { said: "Unknown key\nmore".to_owned(), ..sound.clone() };
        assert_eq!(judge(&bad).value, "systemd-analyze: Unknown key");
        assert_eq!(judge(&bad).verdict, Verdict::Fail);
        let stale = Units { stale: vec!["control".to_owned()], ..sound };
        assert_eq!(judge(&stale).verdict, Verdict::Fail);
    }

    #[test]
    fn a_unit_starts_its_own_process() {
        let text = "[Service]\nExecStart=/usr/local/bin/farreach service control\n";
        assert!(starts(text, "control"));
        assert!(!starts(text, "logger"));
        assert!(!starts("", "control"));
    }
}
