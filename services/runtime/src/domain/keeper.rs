//! The keeper's side of a domain.

use std::fs;
use std::io;
use std::path::Path;
use std::time::{Duration, Instant};

use iceoryx2::prelude::*;
use ipc_types::{COMMAND_SERVICES, Profile, TOPICS};

use super::capacity::check_capacity;
use super::error::{at, library};
use super::{
    ALIVE_LOCK, DomainError, KEEPER_LOCK, LIBRARY_ROOT, RigName, SESSION, SessionFile,
    join_configuration, make_node, parse_session, read_session, write_configuration,
};
use crate::clock::now_ns;
use crate::host_stall::{HostStall, MEASURED_FOR};
use crate::identity::random_u64;
use crate::locks::LockFile;
use crate::process_watch::ProcessWatch;
use crate::shared_memory::SHARED_MEMORY;
use crate::{placement, ports, realtime, request, stale_cleanup};

/// The founder of a domain: holds every service open and cleans up after the dead; has no ports.
#[derive(Debug)]
pub struct Keeper {
    // Field order is drop order: services before node, node before locks.
    services: Vec<Box<dyn std::any::Any>>,
    node: Node<ipc::Service>,
    nodes: stale_cleanup::NodeFolder,
    processes: ProcessWatch,
    schedule: stale_cleanup::CleanupSchedule,
    orphans: stale_cleanup::Orphans,
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
        let keeper = LockFile::open(directory.join(KEEPER_LOCK))?;
        // A worker that looks whether a keeper lives holds this lock for a moment.
        let started = Instant::now();
        while !keeper.try_exclusive()? {
            if started.elapsed() > Duration::from_millis(300) {
                return Err(DomainError::AlreadyKept(name.to_string()));
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        let alive = LockFile::open(directory.join(ALIVE_LOCK))?;
        let cold = alive.try_exclusive()?;
        let session_path = directory.join(SESSION);
        if cold {
            match fs::remove_file(&session_path) {
                Err(error) if error.kind() != io::ErrorKind::NotFound => {
                    return Err(at("removing", &session_path)(error));
                }
                _ => {}
            }
            stale_cleanup::domain(&directory.join(LIBRARY_ROOT), &name.segment_prefix())
                .map_err(at("cleaning", &directory))?;
            check_capacity()?;
            let prefix = format!("{}{:016x}_", name.segment_prefix(), random_u64());
            write_configuration(&directory, &prefix)?;
            let file = new_session(prefix);
            Self::found(name, &directory, file, true, alive, keeper)
        } else if session_path.exists() {
            if !alive.try_shared()? {
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
            let held = ports::hold(&node, topic);
            services.push(held.map_err(|e| library("creating a topic")(e.to_string()))?);
        }
        for service in COMMAND_SERVICES {
            let held = request::hold(&node, service);
            services.push(held.map_err(|e| library("creating a command service")(e.to_string()))?);
        }
        // The library makes one of its segments world-writable; the rest of the machine has no
        // business with it.
        stale_cleanup::close_to_others(&name.segment_prefix())
            .map_err(at("closing to other users", Path::new(SHARED_MEMORY)))?;
        let nodes = stale_cleanup::NodeFolder::new(&directory.join(LIBRARY_ROOT), &file.prefix);
        let kept = Self {
            services,
            node,
            processes: ProcessWatch::new(&nodes),
            nodes,
            schedule: stale_cleanup::CleanupSchedule::new(now_ns()),
            orphans: stale_cleanup::Orphans::default(),
            name: name.clone(),
            session: parse_session(directory, &file)?,
            profile: file.profile,
            cold,
            alive,
            _keeper: keeper,
        };
        if cold {
            // Written last, and in one step: its presence is what tells the workers that the domain
            // is ready.
            let text = toml::to_string(&file)
                .map_err(|e| library("writing the session")(e.to_string()))?;
            let path = directory.join(SESSION);
            files::replace(&path, text).map_err(at("writing", &path))?;
            kept.alive.try_shared()?;
        }
        Ok(kept)
    }

    /// The session.
    pub fn session(&self) -> u64 {
        self.session
    }

    /// The timing profile of the session.
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

    /// Waits until a process of the rig dies, a signal arrives or `limit` has passed, and cleans up
    /// after the dead. Call again and again: what cannot be removed at once is tried again.
    pub fn clean(&mut self, limit: Duration) {
        let due = Duration::from_nanos(self.schedule.due_in_ns(now_ns()));
        let changed = self.processes.wait(due.min(limit));
        let now = now_ns();
        if changed {
            self.schedule.changed(now);
        }
        if self.schedule.due_in_ns(now) == 0 {
            self.schedule.begin(now);
            self.node.try_cleanup_dead_nodes();
            if let Ok(nodes) = self.nodes.list() {
                self.orphans.clean(&self.nodes, &nodes);
                self.processes.refresh(&nodes);
            }
        }
    }

    /// Ends in good order: wipes the domain if nothing else of it is alive. Returns whether it did.
    pub fn end(self) -> Result<bool, DomainError> {
        let Self { services, node, name, alive, _keeper, .. } = self;
        drop(services);
        drop(node);
        let directory = name.directory();
        let alone = alive.try_exclusive()?;
        if alone {
            let session = directory.join(SESSION);
            fs::remove_file(&session).map_err(at("removing", &session))?;
            stale_cleanup::domain(&directory.join(LIBRARY_ROOT), &name.segment_prefix())
                .map_err(at("cleaning", &directory))?;
        }
        Ok(alone)
    }
}

/// Draws a session and chooses its profile: the one that a person chose, or else the one that the
/// host can keep; realtime in no case where `SCHED_FIFO` is not granted. Places the loops where a
/// person wants it.
fn new_session(prefix: String) -> SessionFile {
    let chosen = realtime::chosen_profile();
    // Tried on a thread of its own, so that the keeper's own scheduling stays as it is.
    let granted = || realtime::request_fifo(1) == Profile::Realtime;
    let fifo =
        chosen != Some(Profile::BestEffort) && std::thread::spawn(granted).join().unwrap_or(false);
    let stall = chosen.is_none().then(|| HostStall::measure(MEASURED_FOR));
    let kept = chosen.or_else(|| stall.map(|stall| stall.profile()));
    let placed = placement::placement_is_on()
        .then(|| placement::place(&placement::observe_processors(), &placement::loops()));
    let placement = placed
        .unwrap_or_default()
        .into_iter()
        .map(|(process, number)| (process.text().to_owned(), number))
        .collect();
    SessionFile {
        session: format!("{:016x}", random_u64()),
        profile: kept.filter(|_| fifo).unwrap_or(Profile::BestEffort),
        fifo,
        prefix,
        stall,
        placement,
    }
}
