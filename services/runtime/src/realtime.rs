//! What timing the machine grants, and asking for it.

use ipc_types::Profile;

use crate::clock::MILLISECOND_NS;

/// The lives and time-outs of a timing profile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lives {
    /// A token lives this long (ns).
    pub token_ns: u64,
    /// A command lives this long (ns).
    pub command_ns: u64,
    /// A peer that was silent for this long is lost (ns).
    pub peer_lost_ns: u64,
    /// The card drops the motor this long after the enable line's last toggle (ns).
    pub line_ns: u64,
}

/// The lives of a profile.
pub const fn lives(profile: Profile) -> Lives {
    match profile {
        Profile::Realtime => Lives {
            token_ns: 5 * MILLISECOND_NS,
            command_ns: 5 * MILLISECOND_NS,
            peer_lost_ns: 8 * MILLISECOND_NS,
            line_ns: 5 * MILLISECOND_NS,
        },
        Profile::BestEffort => Lives {
            token_ns: 40 * MILLISECOND_NS,
            command_ns: 40 * MILLISECOND_NS,
            peer_lost_ns: 60 * MILLISECOND_NS,
            line_ns: 40 * MILLISECOND_NS,
        },
    }
}

/// Environment variable that holds a rig in `best-effort` although the machine grants more.
pub const PROFILE_VARIABLE: &str = "FARREACH_PROFILE";

/// Whether a person asked for best-effort timing.
pub fn best_effort_wanted() -> bool {
    std::env::var(PROFILE_VARIABLE).is_ok_and(|value| value == Profile::BestEffort.text())
}

fn set_scheduler(policy: libc::c_int, priority: libc::c_int) -> bool {
    let parameters = libc::sched_param { sched_priority: priority };
    // SAFETY: 0 means the calling thread; the parameters live through the call.
    unsafe { libc::sched_setscheduler(0, policy | libc::SCHED_RESET_ON_FORK, &raw const parameters) == 0 }
}

/// Asks for `SCHED_FIFO` at `priority` (1..=99) for the calling thread.
pub fn request_fifo(priority: i32) -> Profile {
    if !best_effort_wanted() && set_scheduler(libc::SCHED_FIFO, priority) {
        Profile::Realtime
    } else {
        // A launcher may have set FIFO before: a loop that calls itself best-effort must not preempt the others.
        request_normal();
        Profile::BestEffort
    }
}

/// Puts the calling thread back to normal scheduling.
pub fn request_normal() {
    set_scheduler(libc::SCHED_OTHER, 0);
}

/// Priority of a real-time process's helper threads: below every loop, above everything that is not of the rig.
const HELPER_PRIORITY: i32 = 10;

/// For a thread beside a real-time loop in the same process (readiness, the operator's verbs). It shares the
/// loop's address space: were it preempted by ordinary load while it maps memory, the loop would wait for it.
pub fn request_helper(profile: Profile) {
    match profile {
        Profile::Realtime => {
            request_fifo(HELPER_PRIORITY);
        }
        Profile::BestEffort => request_normal(),
    }
}

/// Asks the kernel not to round this thread's timers (the default rounds by 50 µs).
pub fn tighten_timer_slack() {
    // SAFETY: PR_SET_TIMERSLACK takes one integer.
    unsafe {
        libc::prctl(libc::PR_SET_TIMERSLACK, 1 as libc::c_ulong, 0, 0, 0);
    }
}

/// Names the calling thread (the main thread's name is what `ps` and `top` show; 15 characters).
pub fn name_thread(name: &str) {
    let mut bytes = [0u8; 16];
    for (to, from) in bytes.iter_mut().take(15).zip(name.bytes()) {
        *to = from;
    }
    // SAFETY: the buffer is zero-terminated and lives through the call.
    unsafe {
        libc::prctl(libc::PR_SET_NAME, bytes.as_ptr(), 0, 0, 0);
    }
}

/// Locks the process's memory if that is allowed without limit: with a limited `RLIMIT_MEMLOCK` later maps
/// of shared memory would fail. Returns whether it is locked.
pub fn lock_memory() -> bool {
    let mut limit = libc::rlimit { rlim_cur: 0, rlim_max: 0 };
    // SAFETY: `limit` lives through the call.
    let unlimited =
        unsafe { libc::getrlimit(libc::RLIMIT_MEMLOCK, &raw mut limit) } == 0 && limit.rlim_cur == libc::RLIM_INFINITY;
    if !unlimited && !has_ipc_lock() {
        return false;
    }
    // What is mapped now is brought in and stays. What is mapped later (the segments of a peer that joins) is locked
    // page by page as it is touched: to bring in ten megabytes at once would hold the loop up for milliseconds.
    // SAFETY: takes flags only.
    unsafe { libc::mlockall(libc::MCL_CURRENT) == 0 && libc::mlockall(libc::MCL_FUTURE | libc::MCL_ONFAULT) == 0 }
}

/// Whether `CAP_IPC_LOCK` is in the effective set.
fn has_ipc_lock() -> bool {
    const CAP_IPC_LOCK: u64 = 14;
    let Ok(status) = std::fs::read_to_string("/proc/self/status") else { return false };
    status
        .lines()
        .find_map(|line| line.strip_prefix("CapEff:"))
        .and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok())
        .is_some_and(|mask| mask >> CAP_IPC_LOCK & 1 == 1)
}

/// Touches the stack ahead of the loop so that it does not fault in it.
pub fn prefault_stack() {
    let mut block = [0u8; 256 * 1024];
    std::hint::black_box(&mut block);
}
