//! Which processes run programs of others, as the launcher has it in its file.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use ipc_types::{EventKind, Severity};
use recording::replaced::{Replaced, event_text, in_words};
use serde::Deserialize;

/// The launcher's file in the rig's run directory. That lies in memory, so that the loop, which
/// reads it, waits for no disk.
const FILE: &str = "launch.json";
/// How the file names systemd, which knows of no replaced processes.
const SYSTEMD: &str = "systemd";
const BY_SYSTEMD: &str = "systemd runs this rig, and its units say which programs";

/// Program and arguments by process.
type Commands = BTreeMap<String, Vec<String>>;

/// What is read of the file.
#[derive(Debug, Deserialize)]
struct Launched {
    #[serde(default)]
    supervision: String,
    #[serde(default)]
    replaced: Commands,
}

/// A process that has another program than before, as an event tells it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Change {
    pub(super) kind: EventKind,
    pub(super) severity: Severity,
    pub(super) text: String,
}

/// Follows the file.
#[derive(Debug)]
pub(super) struct Replacements {
    file: PathBuf,
    /// its contents at the last look; `None` where it could not be read
    seen: Option<Vec<u8>>,
    /// as last known
    commands: Commands,
    /// why it is not known at present
    unknown: Option<String>,
}

impl Replacements {
    /// Takes the first look.
    pub(super) fn new(run_directory: &Path) -> Self {
        let mut replacements = Self {
            file: run_directory.join(FILE),
            seen: None,
            commands: Commands::new(),
            unknown: None,
        };
        let _those_before = replacements.look();
        replacements
    }

    /// Looks again, and returns what has changed since the last look.
    pub(super) fn look(&mut self) -> Vec<Change> {
        let found = match fs::read(&self.file) {
            Ok(bytes) if self.seen.as_ref() == Some(&bytes) => return Vec::new(),
            Ok(bytes) => {
                let found = commands_in(&bytes);
                self.seen = Some(bytes);
                found
            }
            Err(error) => {
                self.seen = None;
                Err(error.to_string())
            }
        };
        match found {
            Ok(commands) => {
                self.unknown = None;
                let changes = changes(&self.commands, &commands);
                self.commands = commands;
                changes
            }
            Err(reason) => {
                let reason = if reason == BY_SYSTEMD {
                    reason
                } else {
                    format!("{}: {reason}", self.file.display())
                };
                if self.unknown.as_ref() != Some(&reason) {
                    eprintln!("farreach logger: replaced processes are not known: {reason}");
                }
                self.unknown = Some(reason);
                Vec::new()
            }
        }
    }

    /// What a recording that begins now says of it.
    pub(super) fn now(&self) -> Replaced {
        match &self.unknown {
            Some(reason) => Replaced::Unknown(reason.clone()),
            None => Replaced::Known(self.commands.clone()),
        }
    }

    /// What has changed since a recording began that says `then`.
    pub(super) fn since(&self, then: &Replaced) -> Vec<Change> {
        match (&self.unknown, then) {
            (Some(_), _) => Vec::new(),
            (None, Replaced::Known(commands)) => changes(commands, &self.commands),
            (None, Replaced::Unknown(_)) => changes(&Commands::new(), &self.commands),
        }
    }
}

fn commands_in(file: &[u8]) -> Result<Commands, String> {
    let launched: Launched = serde_json::from_slice(file).map_err(|error| error.to_string())?;
    if launched.supervision == SYSTEMD { Err(BY_SYSTEMD.to_owned()) } else { Ok(launched.replaced) }
}

fn changes(before: &Commands, now: &Commands) -> Vec<Change> {
    let replaced = now.iter().filter(|(process, command)| before.get(*process) != Some(*command));
    let replaced = replaced.map(|(process, command)| Change {
        kind: EventKind::ProcessReplaced,
        severity: Severity::Warning,
        text: event_text(process, &in_words(command)),
    });
    let restored = before.keys().filter(|process| !now.contains_key(*process));
    let restored = restored.map(|process| Change {
        kind: EventKind::ProcessRestored,
        severity: Severity::Info,
        text: process.clone(),
    });
    replaced.chain(restored).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(changes: &[Change]) -> Vec<(EventKind, &str)> {
        changes.iter().map(|change| (change.kind, change.text.as_str())).collect()
    }

    #[test]
    fn what_the_launcher_writes_is_told_once() {
        use EventKind::{ProcessReplaced, ProcessRestored};
        let folder = tempfile::tempdir().unwrap();
        let write = |text: &str| fs::write(folder.path().join(FILE), text).unwrap();
        // As older launchers wrote it; all that is not asked for is passed over.
        write(r#"{"rig_name": "bench", "units": [{"name": "control"}]}"#);
        let mut replacements = Replacements::new(folder.path());
        let none = Replaced::Known(Commands::new());
        assert_eq!(replacements.now(), none);
        assert!(replacements.look().is_empty());

        write(r#"{"supervision": "launcher", "replaced": {"control": ["/bin/a", "-x"]}}"#);
        let changes = replacements.look();
        assert_eq!(told(&changes), [(ProcessReplaced, "control: /bin/a -x")]);
        assert!(replacements.look().is_empty());
        assert_eq!(replacements.now().to_text(), r#"{"control":["/bin/a","-x"]}"#);
        // Where another program takes its place, and one process more is replaced.
        write(r#"{"replaced": {"control": ["/bin/b"], "monitor": ["/bin/c"]}}"#);
        let changes = replacements.look();
        let expected = [(ProcessReplaced, "control: /bin/b"), (ProcessReplaced, "monitor: /bin/c")];
        assert_eq!(told(&changes), expected);
        write(r#"{"replaced": {"monitor": ["/bin/c"]}}"#);
        let changes = replacements.look();
        assert_eq!(told(&changes), [(ProcessRestored, "control")]);
        assert_eq!(changes[0].severity, Severity::Info);

        // What a logger tells that goes on with a recording.
        assert_eq!(told(&replacements.since(&none)), [(ProcessReplaced, "monitor: /bin/c")]);
        assert!(replacements.since(&replacements.now()).is_empty());
        let then = Replaced::Unknown("no launcher".to_owned());
        assert_eq!(told(&replacements.since(&then)), [(ProcessReplaced, "monitor: /bin/c")]);
    }

    #[test]
    fn what_cannot_be_read_is_not_known() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join(FILE);
        let mut replacements = Replacements::new(folder.path());
        let why = |replacements: &Replacements| match replacements.now() {
            Replaced::Unknown(reason) => reason,
            Replaced::Known(commands) => panic!("{commands:?}"),
        };
        assert!(why(&replacements).contains(FILE), "{}", why(&replacements));
        fs::write(&file, r#"{"replaced": {"control": ["/bin/a"]}}"#).unwrap();
        assert_eq!(replacements.look().len(), 1);
        for broken in ["", "{", "1", r#"{"replaced": {"control": 1}}"#] {
            fs::write(&file, broken).unwrap();
            assert!(replacements.look().is_empty(), "{broken}");
            assert!(why(&replacements).contains(FILE), "{broken}: {}", why(&replacements));
            assert!(replacements.since(&Replaced::Known(Commands::new())).is_empty(), "{broken}");
        }
        // Known again, and as it was: nothing has changed.
        fs::write(&file, r#"{"replaced": {"control": ["/bin/a"]}}"#).unwrap();
        assert!(replacements.look().is_empty());
        assert!(matches!(replacements.now(), Replaced::Known(_)));
        fs::write(&file, r#"{"supervision": "systemd", "replaced": {}}"#).unwrap();
        assert!(replacements.look().is_empty());
        assert_eq!(why(&replacements), BY_SYSTEMD);
    }
}
