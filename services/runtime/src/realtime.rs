//! What timing the machine grants, and asking for it.

use std::ffi::CString;
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::num::NonZeroU64;

use ipc_types::{Process, Profile};
use rustix::mm::{MlockAllFlags, mlockall};
use rustix::process::{Resource, getrlimit};
use rustix::thread::{CapabilitySet, capabilities, set_current_timer_slack, set_name};

/// What the machine granted a loop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Grants {
    /// Real-time scheduling, or not.
    pub profile: Profile,
    /// Whether the process's memory is locked ([`lock_memory`]).
    pub memory_locked: bool,
    /// Whether idle processors are kept awake ([`stay_awake`]).
    pub kept_awake: bool,
}

/// Environment variable by which a person chooses the profile (`realtime`, `best-effort`) instead
/// of the keeper's measurement.
pub const PROFILE_VARIABLE: &str = "FARREACH_PROFILE";

/// The profile that a person chose, if any.
pub fn chosen_profile() -> Option<Profile> {
    let value = std::env::var(PROFILE_VARIABLE).ok()?;
    Profile::ALL.iter().copied().find(|profile| value == profile.text())
}

fn set_scheduler(policy: libc::c_int, priority: libc::c_int) -> bool {
    let parameters = libc::sched_param { sched_priority: priority };
    // SAFETY: 0 means the calling thread; the parameters live through the call.
    unsafe {
        libc::sched_setscheduler(0, policy | libc::SCHED_RESET_ON_FORK, &raw const parameters) == 0
    }
}

/// Asks for `SCHED_FIFO` at `priority` (1..=99) for the calling thread.
pub fn request_fifo(priority: i32) -> Profile {
    if set_scheduler(libc::SCHED_FIFO, priority) {
        Profile::Realtime
    } else {
        // A launcher may have set FIFO before: a loop that calls itself best-effort must not
        // preempt the others.
        request_normal();
        Profile::BestEffort
    }
}

/// Puts the calling thread back to normal scheduling.
pub fn request_normal() {
    set_scheduler(libc::SCHED_OTHER, 0);
}

/// Asks for normal scheduling in slices of 0.1 ms instead of the usual 3 ms or so, for the calling
/// thread: the scheduler lets a short slice that wakes go before longer ones (EEVDF, Linux 6.12 and
/// later; before, it is ignored or refused). Needs no privilege. Returns whether the kernel took
/// it.
pub fn request_short_slices() -> bool {
    // SAFETY: all zeros is a valid value of this plain structure.
    let mut attributes: libc::sched_attr = unsafe { std::mem::zeroed() };
    attributes.size = size_of::<libc::sched_attr>() as u32;
    attributes.sched_policy = libc::SCHED_OTHER as u32;
    attributes.sched_runtime = 100_000;
    // SAFETY: 0 means the calling thread; the attributes live through the call, and give their own
    // size.
    unsafe { libc::syscall(libc::SYS_sched_setattr, 0, &raw const attributes, 0) == 0 }
}

/// Priority of a process that starts (the unit files set it), and of the helper threads of one that
/// runs: below every loop, so that the start of one does not hold up another; above everything that
/// is not of the rig.
pub const HELPER_PRIORITY: i32 = 10;

/// Priority of a process's loop; a process without a real-time loop has the helpers'.
pub fn loop_priority(process: Process) -> i32 {
    process.real_time().map_or(HELPER_PRIORITY, |real_time| real_time.priority)
}

/// Sets the scheduling of a thread beside a loop in the same process (readiness, the operator's
/// verbs): `fifo` where the rig's loops run in `SCHED_FIFO`. The thread shares the loop's address
/// space; were it preempted by ordinary load while it maps memory, the loop would wait for it.
pub fn request_helper(fifo: bool) {
    if fifo {
        request_fifo(HELPER_PRIORITY);
    } else {
        request_normal();
    }
}

/// Stack of a thread beside a loop, in bytes. [`lock_memory`] makes the whole of it resident, and
/// the 2 MiB that a thread has otherwise are most of a process's memory.
const BESIDE_LOOP_STACK: usize = 512 * 1024;

/// A thread named `name` that shall run beside a loop in the same process (readiness, the
/// operator's verbs, files), with a small stack.
pub fn beside_loop(name: &str) -> std::thread::Builder {
    std::thread::Builder::new().name(name.to_owned()).stack_size(BESIDE_LOOP_STACK)
}

/// Holds the processors awake while it lives; see [`stay_awake`].
#[derive(Debug)]
pub struct Awake(
    #[expect(dead_code, reason = "the kernel listens for as long as the file is open")] File,
);

/// Asks the kernel for a wake latency of 0 µs (PM QoS): idle processors poll instead of sleeping,
/// so that a timer finds one awake. A core that sleeps deeply, or a virtual one that its host has
/// to schedule again, wakes late by hundreds of microseconds, now and then by milliseconds. `None`
/// where the device may not be written: root's only, unless a udev rule says otherwise.
pub fn stay_awake() -> Option<Awake> {
    let mut device = OpenOptions::new().write(true).open("/dev/cpu_dma_latency").ok()?;
    device.write_all(&0_i32.to_ne_bytes()).ok()?;
    Some(Awake(device))
}

/// Asks the kernel not to round this thread's timers (the default rounds by 50 µs).
pub fn tighten_timer_slack() {
    // Refused, the timers stay as they are.
    let _set = set_current_timer_slack(Some(NonZeroU64::MIN));
}

/// Names the calling thread (the main thread's name is what `ps` and `top` show; 15 characters).
pub fn name_thread(name: &str) {
    // Without a name it has its parent's.
    let _named = CString::new(name).map(|name| set_name(&name));
}

/// Locks the process's memory if that is allowed without limit: with a limited `RLIMIT_MEMLOCK`
/// later maps of shared memory would fail. Returns whether it is locked.
pub fn lock_memory() -> bool {
    let unlimited = getrlimit(Resource::Memlock).current.is_none();
    let privileged =
        || capabilities(None).is_ok_and(|sets| sets.effective.contains(CapabilitySet::IPC_LOCK));
    if !unlimited && !privileged() {
        return false;
    }
    // What is mapped now is brought in and stays. What is mapped later (the segments of a peer that
    // joins) is locked page by page as it is touched: to bring in ten megabytes at once would hold
    // the loop up for milliseconds.
    mlockall(MlockAllFlags::CURRENT)
        .and_then(|()| mlockall(MlockAllFlags::FUTURE | MlockAllFlags::ONFAULT))
        .is_ok()
}

/// Touches the stack ahead of the loop so that it does not fault in it.
pub fn prefault_stack() {
    let mut block = [0u8; 256 * 1024];
    std::hint::black_box(&mut block);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn priorities_go_watchdog_acquisition_simulator_control_experiment_helpers() {
        let order = [
            Process::Watchdog,
            Process::Acquisition,
            Process::Simulator,
            Process::Control,
            Process::Experiment,
        ];
        let mut order = order.map(loop_priority).to_vec();
        order.push(HELPER_PRIORITY);
        assert!(order.windows(2).all(|pair| pair[0] > pair[1]), "{order:?}");
        // LimitRTPRIO of the unit files.
        assert!(order.iter().all(|priority| (1..=90).contains(priority)), "{order:?}");
    }
}
