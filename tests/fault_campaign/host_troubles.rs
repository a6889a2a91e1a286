//! What the computer may lack while the rig runs: processor time, memory, shared memory, a disk.

use std::fs::{File, remove_file};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

use ipc_types::Profile;

use crate::common::host::Hogs;
use crate::common::monitor::Monitor;
use crate::common::{TestRig, told, wait_for};
use crate::expected::Expected;

/// What the computer lacks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HostTrouble {
    ProcessorHogs,
    MemoryPressure,
    DiskBusy,
    DiskFull,
    DiskReadOnly,
    SharedMemoryFull,
    AnotherUser,
}

/// For so long the trouble lasts.
const LASTS: Duration = Duration::from_millis(700);
/// Hogs on each processor.
const HOGS: usize = 3;
/// What memory pressure takes (bytes): touched page by page, from the page cache if need be.
const TAKEN: usize = 2 << 30;
const PAGE: usize = 4096;

/// Where the private file systems of this test are.
#[derive(Debug)]
pub struct PrivateDisks {
    /// Of 256 KiB.
    pub tiny: PathBuf,
    pub read_only: PathBuf,
}

impl HostTrouble {
    pub const ALL: [Self; 7] = [
        Self::ProcessorHogs,
        Self::MemoryPressure,
        Self::DiskBusy,
        Self::DiskFull,
        Self::DiskReadOnly,
        Self::SharedMemoryFull,
        Self::AnotherUser,
    ];

    /// Those that can be made where no rig runs.
    pub const WITHOUT_RIG: [Self; 3] = [Self::ProcessorHogs, Self::MemoryPressure, Self::DiskBusy];

    pub const fn name(self) -> &'static str {
        match self {
            Self::ProcessorHogs => "host: processors hogged by other programs",
            Self::MemoryPressure => "host: 2 GiB of memory taken at once",
            Self::DiskBusy => "host: disk of the recording written and synced by others",
            Self::DiskFull => "host: disk of the recording full",
            Self::DiskReadOnly => "host: disk of the recording read-only",
            Self::SharedMemoryFull => "host: shared memory full for 0.3 s",
            Self::AnotherUser => "host: another user reaches for the rig's files",
        }
    }

    /// Whether it can be made here.
    pub fn is_possible(self, disks: Option<&PrivateDisks>) -> bool {
        match self {
            Self::ProcessorHogs | Self::MemoryPressure | Self::DiskBusy => true,
            Self::DiskFull | Self::DiskReadOnly | Self::SharedMemoryFull => disks.is_some(),
            // In a name space of its own even root may have no second user.
            Self::AnotherUser => {
                another_user().arg("true").output().is_ok_and(|output| output.status.success())
            }
        }
    }

    /// What must become of the motor.
    pub const fn expected(self, profile: Profile) -> Expected {
        match (self, profile) {
            // A page that is touched for the first time is not to be had.
            (Self::SharedMemoryFull, _) => Expected::Either,
            // Real-time scheduling and locked memory are there to keep it.
            (Self::DiskFull | Self::DiskReadOnly | Self::AnotherUser, _)
            | (_, Profile::Realtime) => Expected::Stays,
            (_, Profile::BestEffort) => Expected::Either,
        }
    }

    /// Makes the trouble, and ends it.
    pub fn make(self, rig: &TestRig, monitor: &Monitor, disks: Option<&PrivateDisks>) {
        let mounted = || disks.expect("left out without");
        match self {
            Self::ProcessorHogs | Self::MemoryPressure | Self::DiskBusy => {
                self.make_without_rig(&rig.path("."));
            }
            Self::DiskFull => record_to_full_disk(rig, mounted()),
            Self::DiskReadOnly => {
                let output = record_to(rig, mounted().read_only.join("run.mcap"));
                assert!(!output.status.success(), "{}", told(&output));
            }
            Self::SharedMemoryFull => fill_shared_memory(monitor),
            Self::AnotherUser => reach_as_another_user(rig),
        }
    }

    /// Makes one of [`HostTrouble::WITHOUT_RIG`], and ends it; what is written goes to this folder.
    pub fn make_without_rig(self, folder: &Path) {
        match self {
            Self::ProcessorHogs => hog_processors(),
            Self::MemoryPressure => take_memory(),
            Self::DiskBusy => write_and_sync(folder.join("busy")),
            Self::DiskFull | Self::DiskReadOnly | Self::SharedMemoryFull | Self::AnotherUser => {
                panic!("{self:?} needs a rig")
            }
        }
    }
}

fn hog_processors() {
    let _hogs = Hogs::start(HOGS * runtime::own_processors().len());
    std::thread::sleep(LASTS);
}

fn take_memory() {
    let mut taken = vec![0u8; TAKEN];
    taken.iter_mut().step_by(PAGE).for_each(|byte| *byte = 1);
    assert_eq!(std::hint::black_box(&taken)[PAGE], 1);
}

fn write_and_sync(path: PathBuf) {
    let mut file = File::create(&path).unwrap();
    let block = vec![0x55; 4 << 20];
    for _ in 0..16 {
        file.write_all(&block).unwrap();
        file.sync_data().unwrap();
    }
    remove_file(path).unwrap();
}

/// Ends the recording, and begins another one there.
fn record_to(rig: &TestRig, path: PathBuf) -> std::process::Output {
    rig.run(["rec", "stop"]);
    rig.run(["rec", "start", path.to_str().unwrap()])
}

/// Until the logger says that the disk is full.
fn record_to_full_disk(rig: &TestRig, disks: &PrivateDisks) {
    let path = disks.tiny.join("run.mcap");
    let output = record_to(rig, path.clone());
    let is_full =
        || String::from_utf8_lossy(&rig.run(["status", "--json"]).stdout).contains("full");
    if output.status.success() {
        assert!(wait_for(Duration::from_secs(20), is_full), "{}", rig.ok(["status"]));
    } else {
        assert!(told(&output).contains("full"), "{}", told(&output));
    }
    rig.run(["rec", "stop"]);
    for entry in std::fs::read_dir(&disks.tiny).unwrap() {
        remove_file(entry.unwrap().path()).unwrap();
    }
}

fn fill_shared_memory(monitor: &Monitor) {
    let path = "/dev/shm/filler";
    let mut file = File::create(path).unwrap();
    let block = vec![1; 64 << 10];
    // Until nothing more fits, to the page.
    while file.write_all(&block).is_ok() {}
    while file.write_all(&block[..PAGE]).is_ok() {}
    monitor.pass_or_time(600);
    drop(file);
    remove_file(path).unwrap();
}

/// As user 65534: neither written, nor read, nor listed.
fn reach_as_another_user(rig: &TestRig) {
    let script = r#"
        for file in $(find "$1" "$2" 2>/dev/null) "$1"/* "$2"/*; do
            (: >>"$file") 2>/dev/null && echo "written: $file"
            cat "$file" >/dev/null 2>&1 && echo "read: $file"
        done
        exit 0"#;
    let output = another_user()
        .args(["sh", "-c", script, "sh"])
        .args([rig.name().directory(), rig.run_directory()])
        .output()
        .unwrap();
    assert!(output.status.success() && output.stdout.is_empty(), "{}", told(&output));
}

/// Runs a command as user 65534.
fn another_user() -> Command {
    let mut command = Command::new("setpriv");
    command.args(["--reuid", "65534", "--regid", "65534", "--clear-groups"]).stdin(Stdio::null());
    command
}
