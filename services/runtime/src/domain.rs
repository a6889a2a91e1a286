//! The shared-memory domain of one rig, and the keeper that founds it.
//!
//! A domain is a directory of mode 0700 on tmpfs with a generated iceoryx2 configuration, two lock files and
//! the library's own files; the segments beside it bear a prefix that is drawn anew at each cold start.
//! Several rigs on one machine never meet. The first keeper, when nothing of the rig is alive, wipes what an
//! earlier one left; a keeper that comes back while others live joins them and keeps their session.

use std::fs;
use std::io;
use std::os::unix::fs::{DirBuilderExt, MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::{Duration, Instant};

use iceoryx2::prelude::*;
use ipc_types::{COMMAND_SERVICES, Profile, TOPICS};
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::identity::random_u64;
use crate::locks::LockFile;
use crate::{ports, realtime, request, sweep};

/// Where POSIX shared memory lives on Linux.
pub(crate) const SHARED_MEMORY: &str = "/dev/shm";
const CONFIGURATION: &str = "iceoryx2.toml";
const SESSION: &str = "session.toml";
const KEEPER_LOCK: &str = "keeper.lock";
const ALIVE_LOCK: &str = "alive.lock";
const LIBRARY_ROOT: &str = "iox";
const RUN: &str = "run";
const MEBIBYTE: u64 = 1 << 20;
/// How long a start waits for the keeper.
const OPEN_LIMIT: Duration = Duration::from_secs(5);

/// Why a domain could not be founded or joined.
#[derive(Debug, Error)]
pub enum DomainError {
    /// The name breaks the rules.
    #[error("rig name {0:?}: expected 1 to 32 lower-case letters, digits or '-', beginning with a letter")]
    Name(String),
    /// A file operation failed.
    #[error("{action} {path}: {source}{}", hint(.source))]
    Io {
        /// What was tried.
        action: &'static str,
        /// On which path.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The directory is not ours alone.
    #[error("{path} is not a directory of this user with mode 0700 ({found}); remove it or choose another rig name")]
    NotOurs {
        /// The directory.
        path: PathBuf,
        /// What was found instead.
        found: String,
    },
    /// A keeper of that rig runs.
    #[error("rig {0} has a keeper already; is it up? (`farreach status`, `farreach down`)")]
    AlreadyKept(String),
    /// No keeper.
    #[error("rig {0} has no keeper: start it first (`farreach up`, or `farreach service keeper`)")]
    NoKeeper(String),
    /// The keeper did not get ready in time.
    #[error("the keeper of rig {0} did not get ready within {1:?}")]
    KeeperNotReady(String, Duration),
    /// Processes live on in a domain whose founding never ended.
    #[error("rig {0}: processes of a broken start are still alive; stop them (`farreach down`) and start again")]
    BrokenStart(String),
    /// The file with the session cannot be read.
    #[error("{path}: {reason}; stop the rig (`farreach down`) and start it again")]
    Session {
        /// The file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// This process already belongs to another rig.
    #[error("this process already belongs to the domain {found}, not to {wanted}")]
    OtherRig {
        /// The domain it belongs to.
        found: String,
        /// The one that was asked for.
        wanted: String,
    },
    /// Too little is free. A page that cannot be had later on kills the process that touches it (SIGBUS).
    #[error(
        "shared memory is full: a rig needs {} MiB in {SHARED_MEMORY}, found {} MiB free; remove what is not needed there \
         (`ls -l {SHARED_MEMORY}`) or make it larger (containers: --shm-size)", needed.div_ceil(MEBIBYTE), found / MEBIBYTE
    )]
    NoRoom {
        /// What a rig needs (bytes).
        needed: u64,
        /// What is free (bytes).
        found: u64,
    },
    /// iceoryx2 refused.
    #[error("shared memory: {action}: {reason}")]
    Library {
        /// What was tried.
        action: String,
        /// What the library said.
        reason: String,
    },
}

fn hint(error: &io::Error) -> &'static str {
    match error.kind() {
        io::ErrorKind::StorageFull => "; shared memory is full: free space in /dev/shm (`df -h /dev/shm`)",
        io::ErrorKind::PermissionDenied | io::ErrorKind::ReadOnlyFilesystem => "; is /dev/shm writable for this user?",
        _ => "",
    }
}

fn at(action: &'static str, path: &Path) -> impl FnOnce(io::Error) -> DomainError {
    move |source| DomainError::Io { action, path: path.to_path_buf(), source }
}

/// What a rig takes in shared memory once every page of it is in use, as it is at once where memory is locked (bytes).
fn room_needed() -> u64 {
    // The library's header in front of each message, and its alignment.
    const HEADER: usize = 64;
    // Connections and tables of the library, the launcher's files.
    const REST: u64 = 4 * MEBIBYTE;
    let topics: usize = TOPICS.iter().map(|topic| ports::messages_in_segment(topic) * (topic.size + HEADER)).sum();
    let servers: usize =
        COMMAND_SERVICES.iter().map(|service| request::ANSWERS_IN_SEGMENT * (service.bytes + HEADER)).sum();
    let all = (topics + servers) as u64 + REST;
    // The segments of a process that was killed a moment ago stay while its successor makes its own.
    all + all / 4
}

/// Refuses to found a domain that would not fit.
fn check_room() -> Result<(), DomainError> {
    let found = rustix::fs::statvfs(SHARED_MEMORY)
        .map_err(|error| at("looking for free space in", Path::new(SHARED_MEMORY))(error.into()))?;
    // A tmpfs without a limit says that it has no blocks at all.
    let free = if found.f_blocks == 0 { u64::MAX } else { found.f_bavail.saturating_mul(found.f_frsize) };
    fits(room_needed(), free)
}

fn fits(needed: u64, found: u64) -> Result<(), DomainError> {
    if found < needed { Err(DomainError::NoRoom { needed, found }) } else { Ok(()) }
}

/// The name of a rig: 1 to 32 lower-case letters, digits or '-', beginning with a letter.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct RigName(String);

impl FromStr for RigName {
    type Err = DomainError;

    fn from_str(name: &str) -> Result<Self, DomainError> {
        let allowed = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
        if (1..=32).contains(&name.len())
            && name.starts_with(|c: char| c.is_ascii_lowercase())
            && name.chars().all(allowed)
        {
            Ok(Self(name.to_owned()))
        } else {
            Err(DomainError::Name(name.to_owned()))
        }
    }
}

impl RigName {
    /// As text.
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// The rig's directory on tmpfs.
    pub fn directory(&self) -> PathBuf {
        // SAFETY: takes nothing, cannot fail.
        let user = unsafe { libc::geteuid() };
        Path::new(SHARED_MEMORY).join(format!("farreach-{user}-{}", self.0))
    }

    /// Where the launcher keeps its files (pid, status, logs).
    pub fn run_directory(&self) -> PathBuf {
        self.directory().join(RUN)
    }

    /// What the names of all of the rig's segments begin with. A '.' ends it: no rig name holds one.
    pub(crate) fn segment_prefix(&self) -> String {
        // SAFETY: takes nothing, cannot fail.
        let user = unsafe { libc::geteuid() };
        format!("farreach-{user}-{}.", self.0)
    }

    /// Makes the rig's directory, or checks that an existing one is ours alone.
    pub fn make_directory(&self) -> Result<PathBuf, DomainError> {
        let path = self.directory();
        if !path.exists() {
            check_room()?;
        }
        match fs::DirBuilder::new().mode(0o700).create(&path) {
            Ok(()) => {}
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
            Err(error) => return Err(at("making", &path)(error)),
        }
        let found = fs::symlink_metadata(&path).map_err(at("looking at", &path))?;
        // SAFETY: takes nothing, cannot fail.
        let user = unsafe { libc::geteuid() };
        if !found.is_dir() || found.uid() != user || found.permissions().mode() & 0o077 != 0 {
            let found = format!("mode {:o}, owner {}", found.permissions().mode(), found.uid());
            return Err(DomainError::NotOurs { path, found });
        }
        Ok(path)
    }

    /// Removes everything of the rig if nothing of it is alive. Returns whether it did.
    pub fn remove(&self) -> Result<bool, DomainError> {
        let directory = self.directory();
        if !directory.exists() {
            return sweep::segments(&self.segment_prefix()).map(|()| true).map_err(at("cleaning", &directory));
        }
        let keeper_path = directory.join(KEEPER_LOCK);
        let keeper = LockFile::open(&keeper_path).map_err(at("opening", &keeper_path))?;
        let alive_path = directory.join(ALIVE_LOCK);
        let alive = LockFile::open(&alive_path).map_err(at("opening", &alive_path))?;
        let free = keeper.try_exclusive().map_err(at("locking", &keeper_path))?
            && alive.try_exclusive().map_err(at("locking", &alive_path))?;
        if free {
            sweep::segments(&self.segment_prefix()).map_err(at("cleaning", &directory))?;
            fs::remove_dir_all(&directory).map_err(at("removing", &directory))?;
        }
        Ok(free)
    }
}

impl std::fmt::Display for RigName {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(&self.0)
    }
}

/// What the keeper wrote when the domain was ready.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct SessionFile {
    session: String,
    profile: Profile,
    prefix: String,
}

/// A domain that this process has joined.
#[derive(Debug)]
pub struct Domain {
    name: RigName,
    session: u64,
    profile: Profile,
    _alive: LockFile,
}

impl Domain {
    /// Joins the domain of a rig. Waits up to 5 s for a keeper that is just founding it.
    pub fn open(name: &RigName) -> Result<Self, DomainError> {
        let directory = name.directory();
        if !directory.join(KEEPER_LOCK).exists() {
            return Err(DomainError::NoKeeper(name.to_string()));
        }
        let alive_path = directory.join(ALIVE_LOCK);
        let keeper_path = directory.join(KEEPER_LOCK);
        let started = Instant::now();
        loop {
            let alive = LockFile::open(&alive_path).map_err(at("opening", &alive_path))?;
            if alive.try_shared().map_err(at("locking", &alive_path))? {
                // The keeper holds its lock exclusively for as long as it lives.
                let keeper = LockFile::open(&keeper_path).map_err(at("opening", &keeper_path))?;
                if keeper.try_shared().map_err(at("locking", &keeper_path))? {
                    return Err(DomainError::NoKeeper(name.to_string()));
                }
                if directory.join(SESSION).exists() {
                    let file = read_session(&directory)?;
                    join_configuration(&directory)?;
                    return Ok(Self {
                        name: name.clone(),
                        session: parse_session(&directory, &file)?,
                        profile: file.profile,
                        _alive: alive,
                    });
                }
            }
            if started.elapsed() > OPEN_LIMIT {
                return Err(DomainError::KeeperNotReady(name.to_string(), OPEN_LIMIT));
            }
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// The rig's name.
    pub fn name(&self) -> &RigName {
        &self.name
    }

    /// The session, drawn at the cold start.
    pub fn session(&self) -> u64 {
        self.session
    }

    /// The profile that the keeper found the machine to grant.
    pub fn profile(&self) -> Profile {
        self.profile
    }

    /// Whether the keeper lives, found out through its lock. Not for a real-time loop.
    pub fn keeper_lives(&self) -> bool {
        LockFile::open(&self.name.directory().join(KEEPER_LOCK))
            .and_then(|lock| lock.try_shared())
            .is_ok_and(|free| !free)
    }

    /// A node of this process in the domain; ports are made from it. Nodes and ports stay in their thread.
    pub fn node(&self, name: &str) -> Result<Node<ipc::Service>, DomainError> {
        make_node(name)
    }
}

fn library(action: impl Into<String>) -> impl FnOnce(String) -> DomainError {
    let action = action.into();
    move |reason| DomainError::Library { action, reason }
}

fn make_node(name: &str) -> Result<Node<ipc::Service>, DomainError> {
    let node_name: NodeName = name.try_into().map_err(|e| library(format!("naming node {name}"))(format!("{e:?}")))?;
    NodeBuilder::new()
        .name(&node_name)
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create::<ipc::Service>()
        .map_err(|e| library(format!("creating node {name}"))(format!("{e:?}")))
}

fn read_session(directory: &Path) -> Result<SessionFile, DomainError> {
    let path = directory.join(SESSION);
    let text = fs::read_to_string(&path).map_err(at("reading", &path))?;
    toml::from_str(&text).map_err(|error| DomainError::Session { path, reason: error.to_string() })
}

fn parse_session(directory: &Path, file: &SessionFile) -> Result<u64, DomainError> {
    u64::from_str_radix(&file.session, 16).map_err(|error| DomainError::Session {
        path: directory.join(SESSION),
        reason: format!("session {:?}: {error}", file.session),
    })
}

/// Loads the domain's configuration as the process-wide one: a configuration given to the node alone is
/// not enough, because the library then counts dead nodes as cleaned and never cleans them.
fn join_configuration(directory: &Path) -> Result<(), DomainError> {
    set_log_level(LogLevel::Error);
    let path = directory.join(CONFIGURATION);
    let text = path.to_string_lossy().into_owned();
    let file: FilePath =
        text.as_str().try_into().map_err(|e| library("configuration path")(format!("{text}: {e:?}")))?;
    let config = Config::setup_global_config_from_file(&file)
        .map_err(|e| library("reading configuration")(format!("{text}: {e:?}")))?;
    let wanted = directory.join(LIBRARY_ROOT).to_string_lossy().into_owned();
    let found = config.global.root_path().to_string();
    if found.trim_end_matches('/') != wanted {
        return Err(DomainError::OtherRig { found, wanted });
    }
    Ok(())
}

fn write_configuration(directory: &Path, prefix: &str) -> Result<(), DomainError> {
    let mut config = Config::default();
    let root = directory.join(LIBRARY_ROOT).to_string_lossy().into_owned();
    let root = root.as_str().try_into().map_err(|e| library("root path")(format!("{root}: {e:?}")))?;
    config.global.set_root_path(&root);
    config.global.prefix = prefix.try_into().map_err(|e| library("prefix")(format!("{prefix}: {e:?}")))?;
    // Cleaning up is the keeper's: a worker must not spend its start, or its end, on somebody else's remains.
    config.global.node.cleanup_dead_nodes_on_creation = false;
    config.global.node.cleanup_dead_nodes_on_destruction = false;
    config.global.service.cleanup_dead_nodes_on_open = false;
    let text = toml::to_string(&config).map_err(|e| library("writing configuration")(e.to_string()))?;
    let path = directory.join(CONFIGURATION);
    fs::write(&path, text).map_err(at("writing", &path))
}

/// The founder of a domain: holds every service open and cleans up after the dead; has no ports.
#[derive(Debug)]
pub struct Keeper {
    // Field order is drop order: services before node, node before locks.
    services: Vec<Box<dyn std::any::Any>>,
    node: Node<ipc::Service>,
    orphans: sweep::Orphans,
    name: RigName,
    session: u64,
    profile: Profile,
    cold: bool,
    alive: LockFile,
    _keeper: LockFile,
}

impl Keeper {
    /// Founds the domain of a rig, or rejoins it if processes of it live on.
    pub fn start(name: &RigName) -> Result<Self, DomainError> {
        let directory = name.make_directory()?;
        let keeper_path = directory.join(KEEPER_LOCK);
        let keeper = LockFile::open(&keeper_path).map_err(at("opening", &keeper_path))?;
        // A worker that looks whether a keeper lives holds this lock for a moment.
        let started = Instant::now();
        while !keeper.try_exclusive().map_err(at("locking", &keeper_path))? {
            if started.elapsed() > Duration::from_millis(300) {
                return Err(DomainError::AlreadyKept(name.to_string()));
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        let alive_path = directory.join(ALIVE_LOCK);
        let alive = LockFile::open(&alive_path).map_err(at("opening", &alive_path))?;
        let cold = alive.try_exclusive().map_err(at("locking", &alive_path))?;
        let session_path = directory.join(SESSION);
        if cold {
            match fs::remove_file(&session_path) {
                Err(error) if error.kind() != io::ErrorKind::NotFound => {
                    return Err(at("removing", &session_path)(error));
                }
                _ => {}
            }
            sweep::domain(&directory.join(LIBRARY_ROOT), &name.segment_prefix()).map_err(at("cleaning", &directory))?;
            check_room()?;
            let prefix = format!("{}{:016x}_", name.segment_prefix(), random_u64());
            write_configuration(&directory, &prefix)?;
            let file = SessionFile { session: format!("{:016x}", random_u64()), profile: granted_profile(), prefix };
            Self::found(name, &directory, file, true, alive, keeper)
        } else if session_path.exists() {
            if !alive.try_shared().map_err(at("locking", &alive_path))? {
                return Err(DomainError::BrokenStart(name.to_string()));
            }
            let file = read_session(&directory)?;
            Self::found(name, &directory, file, false, alive, keeper)
        } else {
            Err(DomainError::BrokenStart(name.to_string()))
        }
    }

    fn found(
        name: &RigName,
        directory: &Path,
        file: SessionFile,
        cold: bool,
        alive: LockFile,
        keeper: LockFile,
    ) -> Result<Self, DomainError> {
        join_configuration(directory)?;
        let node = make_node("keeper")?;
        let mut services: Vec<Box<dyn std::any::Any>> = Vec::new();
        for topic in TOPICS {
            services.push(ports::hold(&node, topic)?);
        }
        for service in COMMAND_SERVICES {
            services.push(request::hold(&node, service)?);
        }
        // The library makes one of its segments world-writable; the rest of the machine has no business with it.
        sweep::close_to_others(&name.segment_prefix())
            .map_err(at("closing to other users", Path::new(SHARED_MEMORY)))?;
        let kept = Self {
            services,
            node,
            orphans: sweep::Orphans::new(&directory.join(LIBRARY_ROOT), &file.prefix),
            name: name.clone(),
            session: parse_session(directory, &file)?,
            profile: file.profile,
            cold,
            alive,
            _keeper: keeper,
        };
        if cold {
            // Written last, and in one step: its presence is what tells the workers that the domain is ready.
            let text = toml::to_string(&file).map_err(|e| library("writing the session")(e.to_string()))?;
            let temporary = directory.join("session.new");
            let path = directory.join(SESSION);
            fs::write(&temporary, text).map_err(at("writing", &temporary))?;
            fs::rename(&temporary, &path).map_err(at("writing", &path))?;
            kept.alive.try_shared().map_err(at("locking", &path))?;
        }
        Ok(kept)
    }

    /// The rig's name.
    pub fn name(&self) -> &RigName {
        &self.name
    }

    /// The session.
    pub fn session(&self) -> u64 {
        self.session
    }

    /// The profile that the machine grants.
    pub fn profile(&self) -> Profile {
        self.profile
    }

    /// Whether nothing was alive, so that a new session began.
    pub fn is_cold(&self) -> bool {
        self.cold
    }

    /// Services held open.
    pub fn services(&self) -> usize {
        self.services.len()
    }

    /// Cleans up after processes that died: call every 20 to 50 ms.
    pub fn clean(&mut self) {
        self.node.try_cleanup_dead_nodes();
        self.orphans.sweep();
    }

    /// Ends in good order: wipes the domain if nothing else of it is alive. Returns whether it did.
    pub fn end(self) -> Result<bool, DomainError> {
        let Self { services, node, orphans: _, name, alive, _keeper, .. } = self;
        drop(services);
        drop(node);
        let directory = name.directory();
        let alone = alive.try_exclusive().map_err(at("locking", &directory.join(ALIVE_LOCK)))?;
        if alone {
            let session = directory.join(SESSION);
            fs::remove_file(&session).map_err(at("removing", &session))?;
            sweep::domain(&directory.join(LIBRARY_ROOT), &name.segment_prefix()).map_err(at("cleaning", &directory))?;
        }
        Ok(alone)
    }
}

/// Whether this machine grants `SCHED_FIFO` to the user, tried on a thread that ends at once.
fn granted_profile() -> Profile {
    std::thread::spawn(|| realtime::request_fifo(1)).join().unwrap_or(Profile::BestEffort)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names() {
        for good in ["demo", "a", "rig-2", "x234567890123456789012345678901"] {
            assert!(good.parse::<RigName>().is_ok(), "{good}");
        }
        for bad in ["", "2rig", "Demo", "a_b", "a.b", "../x", "x2345678901234567890123456789012345", "a b"] {
            assert!(matches!(bad.parse::<RigName>(), Err(DomainError::Name(_))), "{bad}");
        }
    }

    #[test]
    fn joining_without_a_keeper_says_so() {
        let name: RigName = format!("none-{}", std::process::id()).parse().unwrap();
        let error = Domain::open(&name).unwrap_err();
        assert!(matches!(error, DomainError::NoKeeper(_)), "{error}");
        assert!(error.to_string().contains("farreach up"), "{error}");
    }

    #[test]
    fn a_rig_fits_into_what_containers_have_and_says_what_it_lacks() {
        let needed = room_needed();
        // What the segments of a running rig were measured to be, and the usual size in a container.
        assert!((30 * MEBIBYTE..60 * MEBIBYTE).contains(&needed), "{needed}");
        assert!(fits(needed, needed).is_ok());
        let error = fits(needed, 3 * MEBIBYTE).unwrap_err().to_string();
        assert!(error.contains("/dev/shm, found 3 MiB free"), "{error}");
    }

    #[test]
    fn a_directory_that_others_can_read_is_refused() {
        let name: RigName = format!("open-{}", std::process::id()).parse().unwrap();
        fs::create_dir(name.directory()).unwrap();
        fs::set_permissions(name.directory(), fs::Permissions::from_mode(0o755)).unwrap();
        let error = name.make_directory().unwrap_err();
        fs::remove_dir(name.directory()).unwrap();
        assert!(matches!(error, DomainError::NotOurs { .. }), "{error}");
    }
}
