//! Scheduling class and limits: requested between fork and exec, then read back from
//! the kernel.

use std::fs;

use rustix::process::{Pid, Resource, Rlimit, getrlimit, setrlimit};
use rustix::thread::{CpuSet, sched_getaffinity};
use serde::{Deserialize, Serialize};

use crate::units::{SchedulingPolicy, Unit};

/// Scheduling requested and granted.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Scheduling {
    /// The unit's class and priority.
    pub asked: SchedulingPolicy,
    /// What the process has; `None` if it could not be read.
    pub granted: Option<SchedulingPolicy>,
    /// Processors on which it may run.
    pub cores: Vec<usize>,
    /// What was refused, as text; empty if all was granted.
    pub refused: Vec<String>,
}

/// What the child sets for itself between fork and exec, where it may neither allocate nor lock:
/// requests everything and continues without what is refused. System calls only.
pub(crate) fn request(unit: &Unit) {
    if unit.locks_memory {
        raise(Resource::Memlock, None);
    }
    if unit.limit_rtprio.is_some() {
        raise(Resource::Rtprio, unit.limit_rtprio);
    }
    match unit.scheduling {
        SchedulingPolicy::Other => {}
        SchedulingPolicy::Fifo(priority) => set_scheduler(libc::SCHED_FIFO, priority),
        SchedulingPolicy::Rr(priority) => set_scheduler(libc::SCHED_RR, priority),
    }
}

/// Sets a limit (`None`: unlimited), or as much of it as this user is allowed.
fn raise(resource: Resource, wanted: Option<u64>) {
    if setrlimit(resource, Rlimit { current: wanted, maximum: wanted }).is_err() {
        let maximum = getrlimit(resource).maximum;
        let current = match (wanted, maximum) {
            (Some(wanted), Some(maximum)) => Some(wanted.min(maximum)),
            (None, maximum) => maximum,
            (wanted, None) => wanted,
        };
        let _ = setrlimit(resource, Rlimit { current, maximum });
    }
}

fn set_scheduler(policy: libc::c_int, priority: libc::c_int) {
    let parameters = libc::sched_param { sched_priority: priority };
    // SAFETY: the pointer is to a live, initialised sched_param that the kernel only reads; pid 0
    // is the caller.
    unsafe { libc::sched_setscheduler(0, policy, &raw const parameters) };
}

/// Scheduling of a process. The caller ensures that the pid is still that of the process.
fn granted(pid: i32) -> Option<SchedulingPolicy> {
    let mut parameters = libc::sched_param { sched_priority: 0 };
    // SAFETY: the pointer is to a live sched_param that the kernel writes; a pid that is gone gives
    // an error.
    let policy = unsafe {
        if libc::sched_getparam(pid, &raw mut parameters) != 0 {
            return None;
        }
        libc::sched_getscheduler(pid)
    };
    match policy & !libc::SCHED_RESET_ON_FORK {
        libc::SCHED_FIFO => Some(SchedulingPolicy::Fifo(parameters.sched_priority)),
        libc::SCHED_RR => Some(SchedulingPolicy::Rr(parameters.sched_priority)),
        policy if policy >= 0 => Some(SchedulingPolicy::Other),
        _ => None,
    }
}

fn cores(pid: i32) -> Vec<usize> {
    let Some(pid) = Pid::from_raw(pid) else { return Vec::new() };
    let Ok(set) = sched_getaffinity(Some(pid)) else { return Vec::new() };
    (0..CpuSet::MAX_CPU).filter(|&core| set.is_set(core)).collect()
}

/// The soft limit in a line of `/proc/PID/limits`, or `None` if it is not there.
fn soft_limit<'a>(limits: &'a str, name: &str) -> Option<&'a str> {
    limits.lines().find_map(|line| line.strip_prefix(name))?.split_whitespace().next()
}

impl Scheduling {
    /// Reads back what a process of this unit has.
    pub(crate) fn read(unit: &Unit, pid: i32) -> Self {
        let mut refused = Vec::new();
        let granted = granted(pid);
        if unit.scheduling.is_realtime()
            && granted.is_none_or(|granted| granted.rank() < unit.scheduling.rank())
        {
            let has = granted.map_or_else(|| "unknown".to_owned(), |granted| granted.to_string());
            refused.push(format!("CPUSchedulingPolicy={}: it has {has}", unit.scheduling));
        }
        let limits = fs::read_to_string(format!("/proc/{pid}/limits")).unwrap_or_default();
        for (key, name, wanted) in [
            (
                "LimitMEMLOCK",
                "Max locked memory",
                unit.locks_memory.then(|| "unlimited".to_owned()),
            ),
            (
                "LimitRTPRIO",
                "Max realtime priority",
                unit.limit_rtprio.map(|limit| limit.to_string()),
            ),
        ] {
            let (Some(wanted), Some(has)) = (wanted, soft_limit(&limits, name)) else { continue };
            if has != wanted {
                refused.push(format!("{key}={wanted}: it has {has}"));
            }
        }
        if let Some(wanted) = unit.oom_score_adjust {
            let has = fs::read_to_string(format!("/proc/{pid}/oom_score_adj")).unwrap_or_default();
            if has.trim() != wanted.to_string() {
                refused.push(format!("OOMScoreAdjust={wanted}: it has {}", has.trim()));
            }
        }
        Self { asked: unit.scheduling, granted, cores: cores(pid), refused }
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn limits_of_proc() {
        let text = "Limit                     Soft Limit     Hard Limit     Units\n\
                    Max locked memory         8388608        unlimited      bytes\n\
                    Max realtime priority     0              0\n";
        assert_eq!(super::soft_limit(text, "Max locked memory"), Some("8388608"));
        assert_eq!(super::soft_limit(text, "Max realtime priority"), Some("0"));
        assert_eq!(super::soft_limit(text, "Max nonsense"), None);
    }
}
