//! A rig of real processes for one test, with its own name and directory, taken down in any case.
//!
//! Whole-system tests take turns through a file lock, because two cores run one rig in real time,
//! but not several. A test process can join only one rig (the library's configuration is
//! process-wide), so a test that subscribes or publishes has a test binary of its own.
#![allow(dead_code, unreachable_pub, clippy::unwrap_used, clippy::expect_used)]

pub mod host;
pub mod monitor;
pub mod mutated;
pub mod playing;
pub mod third_party;

use std::fs::{File, OpenOptions};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use ipc_types::{CardKind, PROCESSES, ProcessEntry, Profile, processes_with, pulse_topic};
use runtime::RigName;
pub use rustix::process::Signal;
use rustix::process::{Pid, kill_process};

/// The units of a simulated rig.
pub fn workers() -> Vec<&'static str> {
    processes_with(CardKind::Simulated).map(ProcessEntry::name).collect()
}

/// What a process publishes all the time, as its pulse.
pub fn pulse_of(process: &str) -> Option<&'static str> {
    let entry = PROCESSES.iter().find(|entry| entry.name() == process)?;
    pulse_topic(entry.process).map(|topic| topic.name)
}

/// A rig under test.
pub struct TestRig {
    name: RigName,
    profile: Profile,
    directory: tempfile::TempDir,
    _turn: File,
}

impl TestRig {
    /// Creates a rig once it is this test's turn. The rig's name is `tag` with the process id. On a
    /// host that cannot run a rig in real time ([`host::stall`]) it uses the best-effort profile,
    /// and prints that.
    pub fn new(tag: &str) -> Self {
        let mut rig = Self::patient(tag);
        let stall = host::stall();
        eprintln!("host stalls {stall}: {} profile", stall.profile());
        rig.profile = stall.profile();
        rig
    }

    /// The same in this profile, whatever the host can keep.
    pub fn of_profile(tag: &str, profile: Profile) -> Self {
        let mut rig = Self::patient(tag);
        rig.profile = profile;
        rig
    }

    /// The same in the best-effort profile, for tests that do not concern timing: stalls of some
    /// milliseconds then do not trip the rig, so the host's need not be measured.
    pub fn patient(tag: &str) -> Self {
        let user = rustix::process::geteuid().as_raw();
        let path = std::env::temp_dir().join(format!("farreach-tests-{user}.lock"));
        let turn = OpenOptions::new().create(true).truncate(false).write(true).open(path).unwrap();
        turn.lock().unwrap();
        let name = format!("{tag}-{}", std::process::id()).parse().unwrap();
        let directory = tempfile::tempdir().unwrap();
        Self { name, profile: Profile::BestEffort, directory, _turn: turn }
    }

    pub fn name(&self) -> &RigName {
        &self.name
    }

    /// The timing profile that its processes are given.
    pub const fn profile(&self) -> Profile {
        self.profile
    }

    /// A directory that lives as long as the rig.
    pub fn path(&self, file: &str) -> PathBuf {
        self.directory.path().join(file)
    }

    /// Folder of what the rig keeps beyond its own life.
    pub fn learnt(&self) -> PathBuf {
        self.path("learnt")
    }

    /// The binary, with the rig's name in its environment.
    pub fn farreach<I: AsRef<std::ffi::OsStr>>(
        &self,
        arguments: impl IntoIterator<Item = I>,
    ) -> Command {
        let mut command = farreach();
        command.env("FARREACH_RIG_NAME", self.name.as_str()).args(arguments).stdin(Stdio::null());
        // What outlasts a rig shall not outlast its test.
        command.env("FARREACH_LEARNT", self.learnt());
        command.env("FARREACH_DOCTOR", self.path("doctor"));
        // Set here, so that the keeper of each rig need not measure.
        command.env("FARREACH_PROFILE", self.profile.text());
        command
    }

    /// Runs the binary and returns its output.
    pub fn run<I: AsRef<std::ffi::OsStr>>(&self, arguments: impl IntoIterator<Item = I>) -> Output {
        self.farreach(arguments).output().unwrap()
    }

    /// Runs the binary, which must succeed; its standard output.
    pub fn ok<I: AsRef<std::ffi::OsStr>>(&self, arguments: impl IntoIterator<Item = I>) -> String {
        let output = self.run(arguments);
        assert!(output.status.success(), "{}", told(&output));
        String::from_utf8(output.stdout).unwrap()
    }

    /// A shipped rig file whose encoders are absolute: for tests in which the search for the stops
    /// would only take time.
    pub fn absolute_rig(&self, name: &str) -> String {
        let shipped = rig::RIGS.iter().find(|shipped| shipped.name == name).unwrap();
        let path = self.path(&format!("{name}.toml"));
        std::fs::write(&path, absolute(shipped.text)).unwrap();
        path.to_str().unwrap().to_owned()
    }

    /// Brings the simulated rig up with absolute encoders.
    pub fn up_homed(&self) {
        self.ok(["up", "--simulate", "--rig", &self.absolute_rig("hydrostatic")]);
    }

    /// Brings the simulated rig up.
    pub fn up_simulated(&self) {
        self.ok(["up", "--simulate"]);
    }

    /// Repeats `reset`, `arm`, `enable` until all three succeed: a fault may still be active, the
    /// handle may still move, and on a loaded host the rig may trip in between, rightly.
    pub fn power_up(&self) {
        let mut last = String::new();
        let done = wait_for(Duration::from_secs(60), || {
            last.clear();
            let mut verb = |verb: &str| {
                let output = self.run([verb]);
                last += &format!("{verb}: {}\n", told(&output));
                output.status.success()
            };
            // Whether there was anything to reset or arm shows in the next command.
            verb("reset");
            verb("arm");
            verb("enable")
        });
        assert!(done, "{last}");
    }

    /// The launcher's view of the rig.
    pub fn launcher_status(&self) -> launch::Status {
        launch::status(&self.name.run_directory()).unwrap()
    }

    /// Why a unit was restarted, with the end of its log.
    pub fn why(&self, unit: &str) -> String {
        let status = self.launcher_status();
        let Some(unit) = status.unit(unit) else { return status.launcher.to_string() };
        let log = std::fs::read_to_string(&unit.log).unwrap_or_default();
        let tail: Vec<&str> = log.lines().rev().take(12).collect();
        format!(
            "{:?}, {:?}; its log, last line first: {tail:#?}",
            unit.restart_reason, unit.last_exit
        )
    }

    /// The launcher's directory.
    pub fn run_directory(&self) -> PathBuf {
        self.name.run_directory()
    }

    /// Everything of this rig in shared memory.
    pub fn remains(&self) -> Vec<PathBuf> {
        shared_memory_of(&self.name)
    }

    /// Processes of this rig (by their environment).
    pub fn processes(&self) -> Vec<i32> {
        processes_of(&self.name)
    }

    /// Takes the rig down and checks that nothing is left.
    pub fn down(&self) {
        self.ok(["down"]);
        assert_eq!(self.processes(), Vec::<i32>::new(), "processes are left");
        assert_eq!(self.remains(), Vec::<PathBuf>::new(), "shared memory is left");
    }
}

impl Drop for TestRig {
    fn drop(&mut self) {
        let _down = self.run(["down"]);
        for pid in self.processes() {
            kill(pid, Signal::KILL);
        }
        std::thread::sleep(Duration::from_millis(50));
        if let Some(folder) = std::env::var_os("FARREACH_KEPT_RECORDINGS") {
            keep_recordings(self.directory.path(), &Path::new(&folder).join(self.name.as_str()));
        }
        for path in self.remains() {
            let _removed = if path.is_dir() {
                std::fs::remove_dir_all(path)
            } else {
                std::fs::remove_file(path)
            };
        }
    }
}

/// Keeps the recordings of a rig beyond its test, so that they can be run again. Those in folders
/// below it are altered ones.
fn keep_recordings(from: &Path, to: &Path) {
    let files = std::fs::read_dir(from).unwrap().map(|entry| entry.unwrap().path());
    let recordings: Vec<_> = files
        .filter(|path| path.is_file() && path.extension().is_some_and(|it| it == "mcap"))
        .collect();
    if recordings.is_empty() {
        return;
    }
    // A test may have several rigs, one after another.
    let folder = (1..).map(|count| to.join(count.to_string())).find(|path| !path.exists()).unwrap();
    std::fs::create_dir_all(&folder).unwrap();
    for path in recordings {
        let kept = folder.join(path.file_name().unwrap());
        // The folder may lie on another file system.
        std::fs::hard_link(&path, &kept)
            .or_else(|_| std::fs::copy(&path, &kept).map(drop))
            .unwrap();
    }
}

/// A rig file's text with absolute encoders in place of those that must be homed.
pub fn absolute(text: &str) -> String {
    let mut within = false;
    let mut kept = String::new();
    for line in text.lines() {
        within &= !line.trim().is_empty();
        if line.trim() == "[axes.homing]" {
            within = true;
            kept += "[axes.homing]\nmethod = \"absolute\"\n";
        } else if !within {
            kept += line;
            kept.push('\n');
        }
    }
    kept
}

/// The binary under test.
pub fn farreach() -> Command {
    Command::new(env!("CARGO_BIN_EXE_farreach"))
}

/// Exit status and both streams, for messages.
pub fn told(output: &Output) -> String {
    format!(
        "{}\n--- stdout\n{}\n--- stderr\n{}",
        output.status,
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    )
}

/// Asserts that the command failed with that exit code and an error that contains all `parts`, and
/// that nothing of the rig is left.
pub fn assert_refused(rig: &TestRig, output: &Output, code: i32, parts: &[&str]) {
    assert_eq!(output.status.code(), Some(code), "{}", told(output));
    assert!(output.stdout.is_empty(), "diagnosis goes to stderr: {}", told(output));
    assert_told(output, parts);
    assert_eq!(rig.processes(), Vec::<i32>::new(), "processes are left: {}", told(output));
    assert_eq!(rig.remains(), Vec::<PathBuf>::new(), "shared memory is left: {}", told(output));
}

/// Asserts that standard error contains all `parts` and is not a crash.
pub fn assert_told(output: &Output, parts: &[&str]) {
    let text = String::from_utf8_lossy(&output.stderr);
    for part in parts {
        assert!(text.contains(part), "expected `{part}` in: {}", told(output));
    }
    for crash in ["panicked", "SIGBUS", "SIGSEGV", "SIGABRT", "core dumped"] {
        assert!(!text.contains(crash), "`{crash}`: {}", told(output));
    }
}

/// Everything of a rig in shared memory.
pub fn shared_memory_of(name: &RigName) -> Vec<PathBuf> {
    let directory = name.directory();
    let mark = format!("{}.", directory.file_name().unwrap().to_string_lossy());
    let mut found: Vec<PathBuf> = std::fs::read_dir("/dev/shm")
        .unwrap()
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| {
            *path == directory || path.file_name().unwrap().to_string_lossy().starts_with(&mark)
        })
        .collect();
    found.sort();
    found
}

/// Files of a rig in shared memory, without its run directory (logs and status).
#[derive(Clone, Debug, Default)]
pub struct Footprint {
    /// Each file and folder, with its size in bytes.
    pub entries: std::collections::BTreeMap<PathBuf, u64>,
}

impl Footprint {
    /// The present footprint.
    pub fn of(name: &RigName) -> Self {
        let mut now = Self::default();
        for path in shared_memory_of(name) {
            now.walk(&path, &name.run_directory());
        }
        now
    }

    fn walk(&mut self, path: &Path, run: &Path) {
        // Files that vanish meanwhile are skipped.
        let Ok(found) = std::fs::symlink_metadata(path) else { return };
        if path == run {
            return;
        }
        self.entries.insert(path.to_owned(), if found.is_dir() { 0 } else { found.len() });
        if found.is_dir() {
            for entry in std::fs::read_dir(path).into_iter().flatten().flatten() {
                self.walk(&entry.path(), run);
            }
        }
    }

    /// Number of entries, and their total bytes without `.details`, a text that contains process
    /// ids and so varies in length.
    pub fn size(&self) -> (usize, u64) {
        let counts = |path: &Path| path.extension().is_none_or(|kind| kind != "details");
        (
            self.entries.len(),
            self.entries.iter().filter(|(path, _)| counts(path)).map(|(_, bytes)| bytes).sum(),
        )
    }

    /// Number of entries of each kind (the extension).
    pub fn kinds(&self) -> std::collections::BTreeMap<String, usize> {
        let mut kinds = std::collections::BTreeMap::new();
        for path in self.entries.keys() {
            let kind = path
                .extension()
                .map_or_else(|| "folder or plain".into(), |kind| kind.to_string_lossy());
            *kinds.entry(kind.into_owned()).or_default() += 1;
        }
        kinds
    }

    /// Entries of dead processes: the library's identifiers contain the process id in bits 64 to
    /// 95.
    pub fn of_the_dead(&self) -> Vec<String> {
        let dead = |digits: &str| {
            digits.len() >= 20
                && digits
                    .parse::<u128>()
                    .is_ok_and(|id| !Path::new(&format!("/proc/{}", (id >> 64) as u32)).exists())
        };
        self.entries
            .keys()
            .filter_map(|path| Some(path.file_name()?.to_string_lossy().into_owned()))
            .filter(|name| name.split(|c: char| !c.is_ascii_digit()).any(dead))
            .collect()
    }
}

/// Living processes whose environment names the rig (zombies have none).
pub fn processes_of(name: &RigName) -> Vec<i32> {
    let mark = format!("FARREACH_RIG_NAME={name}");
    let own = std::process::id() as i32;
    std::fs::read_dir("/proc")
        .unwrap()
        .filter_map(|entry| entry.ok()?.file_name().to_str()?.parse::<i32>().ok())
        .filter(|pid| *pid != own)
        .filter(|pid| {
            std::fs::read(format!("/proc/{pid}/environ")).is_ok_and(|text| {
                text.split(|byte| *byte == 0).any(|entry| entry == mark.as_bytes())
            })
        })
        .collect()
}

/// Sends a signal.
pub fn kill(pid: i32, signal: Signal) {
    // It may have ended by itself.
    let _sent = Pid::from_raw(pid).map(|pid| kill_process(pid, signal));
}

/// Waits until a condition holds; `false` if it never did. The limit only ends a test that has
/// failed.
pub fn wait_for(limit: Duration, mut holds: impl FnMut() -> bool) -> bool {
    let started = Instant::now();
    loop {
        if holds() {
            return true;
        }
        if started.elapsed() > limit {
            return false;
        }
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// A measured record beside the project, if it is there. A test that gets `None` must skip, and
/// print that.
pub fn measured(file: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data").join(file);
    if path.exists() {
        return Some(path);
    }
    eprintln!("SKIPPED: {} is not there; this test holds farreach against it", path.display());
    None
}

/// A command with private mounts, tried out; `None`, with a message, if the host does not allow
/// them.
pub fn private_mounts() -> Option<Command> {
    for arguments in [&["-m"][..], &["-rm"]] {
        let mut command = Command::new("unshare");
        command.args(arguments).stdin(Stdio::null());
        let mut trial = Command::new("unshare");
        trial.args(arguments).args(["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", "/dev/shm"]);
        if trial.output().is_ok_and(|output| output.status.success()) {
            return Some(command);
        }
    }
    eprintln!(
        "SKIPPED: neither root nor user namespaces; full disks and shared memory are not tested"
    );
    None
}
