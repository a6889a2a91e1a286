//! A rig of three small processes, a <- b <- c, which ends everything it started even if a test
//! fails.
//!
//! The processes and the launcher are this test binary itself: a script enters it at the test
//! `child_process`.

use std::fs::{self, OpenOptions};
use std::io::Write;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::thread::sleep;
use std::time::{Duration, Instant};

use launch::units::{SchedulingPolicy, Unit};
use launch::{Config, ProcessIdentity, Running, Status, StopReport, UnitState};
use rustix::process::Signal;
use sd_notify::NotifyState;

pub(crate) struct Rig {
    directory: tempfile::TempDir,
    pub(crate) config: Config,
}

/// The script that enters this binary. It must be written before any test starts a process: a child
/// forked meanwhile would hold it open for writing, and it could not be executed.
fn script() -> &'static Path {
    static SCRIPT: OnceLock<PathBuf> = OnceLock::new();
    SCRIPT.get_or_init(|| {
        let directory = Path::new(env!("CARGO_TARGET_TMPDIR"));
        let script = directory.join("launch-supervise-child");
        let text = format!(
            "#!/bin/sh\nLAUNCH_TEST_ARGUMENTS=\"$*\" \
             exec '{}' child_process --exact --ignored --nocapture\n",
            std::env::current_exe().unwrap().display()
        );
        let temporary = directory.join(format!("launch-supervise-child.{}", std::process::id()));
        let mut options = OpenOptions::new();
        options.create(true).write(true).truncate(true).mode(0o755);
        let mut file = options.open(&temporary).unwrap();
        file.write_all(text.as_bytes()).unwrap();
        drop(file);
        fs::rename(&temporary, &script).unwrap();
        script
    })
}

/// A unit that starts after others, and needs the first of them.
fn unit(name: &str, after: &[&str]) -> Unit {
    let names = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect();
    Unit {
        name: name.to_owned(),
        after: names(after),
        gates: names(&after[..after.len().min(1)]),
        timeout_start: Duration::from_secs(60),
        timeout_stop: Duration::from_secs(30),
        watchdog: Duration::from_secs(30),
        scheduling: SchedulingPolicy::Other,
        limit_rtprio: None,
        locks_memory: false,
        oom_score_adjust: None,
    }
}

impl Rig {
    pub(crate) fn new() -> Self {
        let directory = tempfile::tempdir().unwrap();
        let journal = directory.path().join("journal");
        let mut config = Config::new("test", directory.path().join("run"), script())
            .with_environment("LAUNCH_TEST_JOURNAL", journal.to_str().unwrap());
        config.units = vec![unit("c", &["a", "b"]), unit("b", &["a"]), unit("a", &[])];
        Self { directory, config }
    }

    /// A unit, to be changed.
    pub(crate) fn unit(&mut self, name: &str) -> &mut Unit {
        self.config.units.iter_mut().find(|unit| unit.name == name).unwrap()
    }

    /// Tells a process how to behave; see [`child`].
    pub(crate) fn behave(&mut self, name: &str, how: &str) {
        self.config.environment.insert(format!("BEHAVE_{name}"), how.to_owned());
    }

    pub(crate) fn run_dir(&self) -> &Path {
        &self.config.run_dir
    }

    pub(crate) fn start(&self) -> Result<Running, launch::Error> {
        launch::start(self.config.clone())
    }

    pub(crate) fn stop(&self) -> Result<StopReport, launch::Error> {
        launch::stop(self.run_dir())
    }

    pub(crate) fn status(&self) -> Status {
        launch::status(self.run_dir()).unwrap()
    }

    pub(crate) fn process(&self, name: &str) -> ProcessIdentity {
        self.status().unit(name).unwrap().process.unwrap()
    }

    /// Kills the launcher alone, as `kill -9` does.
    pub(crate) fn kill_launcher(&self) {
        let launcher = self.status().launcher;
        assert!(launcher.signal(Signal::KILL));
        until("the launcher is dead", || !launcher.is_alive());
    }

    /// Waits until the unit is ready in another process than `earlier`.
    pub(crate) fn until_replaced(&self, name: &str, earlier: ProcessIdentity) -> ProcessIdentity {
        until(&format!("{name} is ready again"), || {
            let status = self.status();
            let unit = status.unit(name).unwrap();
            unit.state == UnitState::Ready && unit.process != Some(earlier)
        });
        self.process(name)
    }

    /// The entries of the journal: (name, event, process).
    pub(crate) fn journal(&self) -> Vec<(String, String, ProcessIdentity)> {
        read_journal(&self.directory.path().join("journal"))
    }

    /// `NAME EVENT` of the requested events.
    pub(crate) fn events(&self, wanted: &[&str]) -> Vec<String> {
        let journal =
            self.journal().into_iter().filter(|(_, event, _)| wanted.contains(&event.as_str()));
        journal.map(|(name, event, _)| format!("{name} {event}")).collect()
    }

    /// Processes of this rig that are alive.
    pub(crate) fn living(&self) -> Vec<ProcessIdentity> {
        let mut living: Vec<ProcessIdentity> = self
            .journal()
            .into_iter()
            .map(|(_, _, process)| process)
            .filter(ProcessIdentity::is_alive)
            .collect();
        living.dedup();
        living
    }

    /// Files left in the run directory.
    pub(crate) fn left_behind(&self) -> Vec<String> {
        let mut names: Vec<String> = fs::read_dir(self.run_dir())
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .filter(|name| !name.ends_with(".log"))
            .collect();
        names.sort();
        names
    }
}

impl Drop for Rig {
    fn drop(&mut self) {
        if std::thread::panicking() {
            let log = fs::read_to_string(self.run_dir().join("launcher.log")).unwrap_or_default();
            eprintln!("launcher.log:\n{log}");
        }
        // The launcher first, since it would restart the processes killed here.
        let launcher = fs::read_to_string(self.run_dir().join("launcher.pid")).unwrap_or_default();
        let numbers: Vec<u64> =
            launcher.split_whitespace().filter_map(|word| word.parse().ok()).collect();
        if let [pid, start_time] = numbers[..] {
            ProcessIdentity { pid: pid as i32, start_time }.signal(Signal::KILL);
        }
        // After a test that passed there is nothing to stop.
        let _ = self.stop();
        for (_, _, process) in self.journal() {
            process.signal(Signal::KILL);
        }
    }
}

/// Waits until a condition holds; the limit of a minute is reached only by a hang.
pub(crate) fn until(what: &str, mut is_so: impl FnMut() -> bool) {
    let give_up = Instant::now() + Duration::from_secs(60);
    while !is_so() {
        assert!(Instant::now() < give_up, "hung while waiting until {what}");
        sleep(Duration::from_millis(5));
    }
}

fn read_journal(path: &Path) -> Vec<(String, String, ProcessIdentity)> {
    let text = fs::read_to_string(path).unwrap_or_default();
    text.lines()
        .map(|line| {
            let words: Vec<&str> = line.split(' ').collect();
            let process = ProcessIdentity {
                pid: words[2].parse().unwrap(),
                start_time: words[3].parse().unwrap(),
            };
            (words[0].to_owned(), words[1].to_owned(), process)
        })
        .collect()
}

/// Body of the processes, and of the launcher.
///
/// `BEHAVE_NAME` may hold: `hang` (never ready), `hang-once`, `mute-once` (no `WATCHDOG=1` the
/// first time), `ignore-sigterm`, `fail` (prints and ends with 1), `usage` (ends with 2).
pub(crate) fn child(arguments: &str) -> ! {
    let words: Vec<&str> = arguments.split(' ').collect();
    if let ["service", "launcher", "--run-dir", run_dir] = words[..] {
        std::process::exit(i32::from(launch::launcher_main(Path::new(run_dir)).is_err()));
    }
    let name = words[1];
    let journal = PathBuf::from(std::env::var_os("LAUNCH_TEST_JOURNAL").unwrap());
    let first = !read_journal(&journal).iter().any(|(other, _, _)| other == name);
    let own = ProcessIdentity::own().unwrap();
    let write = |event: &str| {
        let mut file = OpenOptions::new().create(true).append(true).open(&journal).unwrap();
        file.write_all(format!("{name} {event} {} {}\n", own.pid, own.start_time).as_bytes())
            .unwrap();
    };
    let stop = Arc::new(AtomicBool::new(false));
    signal_hook::flag::register(signal_hook::consts::SIGTERM, Arc::clone(&stop)).unwrap();
    write("start");
    let behaviour = std::env::var(format!("BEHAVE_{name}")).unwrap_or_default();
    let behaves = |how: &str| behaviour == how || (first && behaviour == format!("{how}-once"));
    if behaves("fail") {
        eprintln!("the rig file has no [axis]");
        std::process::exit(1);
    }
    if behaves("usage") {
        std::process::exit(2);
    }
    if !behaves("hang") {
        // Written before the notification, so that units which wait for it write later.
        write("ready");
        sd_notify::notify(&[NotifyState::Ready, NotifyState::Status(&format!("{name} at work"))])
            .unwrap();
    }
    assert!(sd_notify::watchdog_enabled().is_some());
    while !stop.load(Ordering::Relaxed) || behaves("ignore-sigterm") {
        if !behaves("mute") {
            let _ = sd_notify::notify(&[NotifyState::Watchdog]);
        }
        sleep(Duration::from_millis(10));
    }
    write("stop");
    std::process::exit(0);
}
