//! The shared-memory domain of one rig, and the keeper that founds it.
//!
//! A domain is a directory of mode 0700 on tmpfs with a generated iceoryx2 configuration, two lock
//! files and the library's own files; the segments beside it bear a prefix that is drawn anew at
//! each cold start. Several rigs on one machine never meet. The first keeper, when nothing of the
//! rig is alive, wipes what an earlier one left; a keeper that comes back while others live joins
//! them and keeps their session.

mod capacity;
mod error;
mod keeper;
mod name;

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

use iceoryx2::prelude::*;
use ipc_types::Profile;
use serde::{Deserialize, Serialize};

pub use capacity::shared_memory_room;
pub use error::DomainError;
pub(crate) use error::at;
use error::library;
pub use keeper::Keeper;
pub use name::RigName;

use crate::host_stall::HostStall;
use crate::locks::LockFile;

const CONFIGURATION: &str = "iceoryx2.toml";
const SESSION: &str = "session.toml";
const KEEPER_LOCK: &str = "keeper.lock";
const ALIVE_LOCK: &str = "alive.lock";
const LIBRARY_ROOT: &str = "iox";
const RUN: &str = "run";
/// Peers that have ended, whose unread messages a port still keeps. A reader has no more than
/// [`ipc_types::PUBLISHERS`] at a time and reads what is left of them first. Each takes 3.6 kB of
/// every subscriber, and is looked at by every reading: the library's default of 128 took a tenth
/// of a rig's memory.
const ENDED_PEERS: usize = 8;
/// How long a start waits for the keeper, which measures the host's stalls meanwhile.
const OPEN_LIMIT: Duration = Duration::from_secs(5);

/// What the keeper wrote when the domain was ready.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct SessionFile {
    session: String,
    profile: Profile,
    #[serde(default)]
    fifo: bool,
    prefix: String,
    stall: Option<HostStall>,
    /// Processor of each loop, by the name of its process.
    #[serde(default)]
    placement: BTreeMap<String, usize>,
}

/// A domain that this process has joined.
#[derive(Debug)]
pub struct Domain {
    name: RigName,
    session: u64,
    profile: Profile,
    fifo: bool,
    stall: Option<HostStall>,
    placement: BTreeMap<String, usize>,
    _alive: Option<LockFile>,
}

impl Domain {
    /// Joins the domain of a rig as one of its processes, and keeps the domain alive: as long as
    /// one of them lives, a new keeper rejoins the session. Waits up to 5 s for a keeper that is
    /// just founding it.
    pub fn open(name: &RigName) -> Result<Self, DomainError> {
        let directory = name.directory();
        let keeper_path = directory.join(KEEPER_LOCK);
        if !keeper_path.exists() {
            return Err(DomainError::NoKeeper(name.to_string()));
        }
        let started = Instant::now();
        loop {
            let alive = LockFile::open(directory.join(ALIVE_LOCK))?;
            if alive.try_shared()? {
                // The keeper holds its lock exclusively for as long as it lives.
                if LockFile::open(keeper_path.clone())?.try_shared()? {
                    return Err(DomainError::NoKeeper(name.to_string()));
                }
                if directory.join(SESSION).exists() {
                    let file = read_session(&directory)?;
                    join_configuration(&directory)?;
                    return Ok(Self {
                        name: name.clone(),
                        session: parse_session(&directory, &file)?,
                        profile: file.profile,
                        fifo: file.fifo,
                        stall: file.stall,
                        placement: file.placement,
                        _alive: Some(alive),
                    });
                }
            }
            if started.elapsed() > OPEN_LIMIT {
                return Err(DomainError::KeeperNotReady(name.to_string(), OPEN_LIMIT));
            }
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// Joins the domain of a rig as an observer (a probe, a person's command), which does not keep
    /// the domain alive: the rig can go down, and up again with a new session, while the observer
    /// still runs. It must end, or join again, once [`Domain::is_current`] is false. Waits like
    /// [`Domain::open`].
    pub fn observe(name: &RigName) -> Result<Self, DomainError> {
        Ok(Self { _alive: None, ..Self::open(name)? })
    }

    /// The rig's name.
    pub fn name(&self) -> &RigName {
        &self.name
    }

    /// The session, drawn at the cold start.
    pub fn session(&self) -> u64 {
        self.session
    }

    /// The timing profile of the session, chosen by the keeper at the cold start.
    pub fn profile(&self) -> Profile {
        self.profile
    }

    /// Whether the session that was joined still runs: false once its keeper has ended it or a new
    /// one has begun. Reads a file: not for a real-time loop.
    pub fn is_current(&self) -> bool {
        let directory = self.name.directory();
        read_session(&directory)
            .and_then(|file| parse_session(&directory, &file))
            .is_ok_and(|session| session == self.session)
    }

    /// Whether the session's loops run in `SCHED_FIFO`: in the realtime profile always, in the
    /// best-effort profile where it is granted and only the host's stalls forbid the other one.
    pub fn fifo(&self) -> bool {
        self.fifo
    }

    /// What the keeper measured at the cold start; `None` where a person chose the profile
    /// ([`crate::realtime::PROFILE_VARIABLE`]), so that nothing was measured.
    pub fn host_stall(&self) -> Option<HostStall> {
        self.stall
    }

    /// Processor of each loop, by the name of its process; empty where the loops are not placed.
    pub fn placement(&self) -> &BTreeMap<String, usize> {
        &self.placement
    }

    /// Whether the keeper lives, found out through its lock. Not for a real-time loop.
    pub fn keeper_lives(&self) -> bool {
        LockFile::open(self.name.directory().join(KEEPER_LOCK))
            .and_then(|lock| lock.try_shared())
            .is_ok_and(|free| !free)
    }

    /// A node of this process in the domain; ports are made from it. Nodes and ports stay in their
    /// thread.
    pub fn node(&self, name: &str) -> Result<Node<ipc::Service>, DomainError> {
        make_node(name)
    }
}

fn make_node(name: &str) -> Result<Node<ipc::Service>, DomainError> {
    let node_name: NodeName =
        name.try_into().map_err(|e| library(format!("naming node {name}"))(format!("{e:?}")))?;
    NodeBuilder::new()
        .name(&node_name)
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create::<ipc::Service>()
        .map_err(|e| library(format!("creating node {name}"))(format!("{e:?}")))
}

fn read_session(directory: &Path) -> Result<SessionFile, DomainError> {
    let path = directory.join(SESSION);
    let text = fs::read_to_string(&path).map_err(at("reading", &path))?;
    session_of(&text, &path)
}

fn session_of(text: &str, path: &Path) -> Result<SessionFile, DomainError> {
    toml::from_str(text)
        .map_err(|error| DomainError::Session { path: path.to_owned(), reason: error.to_string() })
}

/// The session in a text as the keeper writes it; for the fuzz targets.
///
/// # Errors
/// [`DomainError::Session`].
#[doc(hidden)]
pub fn check_session(text: &str) -> Result<u64, DomainError> {
    let directory = Path::new("");
    session_of(text, &directory.join(SESSION)).and_then(|file| parse_session(directory, &file))
}

fn parse_session(directory: &Path, file: &SessionFile) -> Result<u64, DomainError> {
    u64::from_str_radix(&file.session, 16).map_err(|error| DomainError::Session {
        path: directory.join(SESSION),
        reason: format!("session {:?}: {error}", file.session),
    })
}

/// Loads the domain's configuration as the process-wide one: a configuration given to the node
/// alone is not enough, because the library then counts dead nodes as cleaned and never cleans
/// them.
fn join_configuration(directory: &Path) -> Result<(), DomainError> {
    set_log_level(LogLevel::Error);
    let path = directory.join(CONFIGURATION);
    let text = path.to_string_lossy().into_owned();
    let file: FilePath = text
        .as_str()
        .try_into()
        .map_err(|e| library("configuration path")(format!("{text}: {e:?}")))?;
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
    let root =
        root.as_str().try_into().map_err(|e| library("root path")(format!("{root}: {e:?}")))?;
    config.global.set_root_path(&root);
    config.global.prefix =
        prefix.try_into().map_err(|e| library("prefix")(format!("{prefix}: {e:?}")))?;
    // Cleaning up is the keeper's: a worker must not spend its start, or its end, on somebody
    // else's remains.
    config.global.node.cleanup_dead_nodes_on_creation = false;
    config.global.node.cleanup_dead_nodes_on_destruction = false;
    config.global.service.cleanup_dead_nodes_on_open = false;
    config.defaults.publish_subscribe.subscriber_expired_connection_buffer = ENDED_PEERS;
    config.defaults.request_response.client_expired_connection_buffer = ENDED_PEERS;
    config.defaults.request_response.server_expired_connection_buffer = ENDED_PEERS;
    let text =
        toml::to_string(&config).map_err(|e| library("writing configuration")(e.to_string()))?;
    let path = directory.join(CONFIGURATION);
    fs::write(&path, text).map_err(at("writing", &path))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn joining_without_a_keeper_says_so() {
        let name: RigName = format!("none-{}", std::process::id()).parse().unwrap();
        let error = Domain::open(&name).unwrap_err();
        assert!(matches!(error, DomainError::NoKeeper(_)), "{error}");
        assert!(error.to_string().contains("farreach up"), "{error}");
    }
}
