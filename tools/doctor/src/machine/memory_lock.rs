//! Memory: whether a process may lock it.

use runtime::{Verdict, realtime};
use rustix::mm::munlockall;
use rustix::process::{Resource, getrlimit};
use serde::Serialize;

use crate::bench::Bench;
use crate::outcome::Outcome;

/// What was found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct MemoryLock {
    /// Whether the kernel took it.
    locked: bool,
    /// What the kernel then called locked (KiB).
    locked_kib: u64,
    /// The limit (bytes); `None` for none.
    limit_bytes: Option<u64>,
}

pub(crate) fn examine(_bench: &mut Bench<'_>) -> anyhow::Result<Outcome> {
    let locked = realtime::lock_memory();
    let status = std::fs::read_to_string("/proc/self/status")?;
    // What the doctor needs no longer; a refusal changes nothing for the rig.
    let _unlocked = munlockall();
    let limit_bytes = getrlimit(Resource::Memlock).current;
    let found = MemoryLock { locked, locked_kib: locked_kib(&status), limit_bytes };
    Ok(judge(&found).measured(&found))
}

/// `VmLck` in the text of `/proc/PID/status` (KiB); 0 where it is not there.
fn locked_kib(status: &str) -> u64 {
    let line = status.lines().find_map(|line| line.strip_prefix("VmLck:"));
    let number = line.and_then(|line| line.split_whitespace().next());
    number.and_then(|number| number.parse().ok()).unwrap_or(0)
}

fn judge(found: &MemoryLock) -> Outcome {
    let MemoryLock { locked, locked_kib, limit_bytes } = found;
    let limit = match limit_bytes {
        None => "no limit".to_owned(),
        // What the limit does not hold back has the capability.
        Some(_) if *locked => "not limited (CAP_IPC_LOCK)".to_owned(),
        Some(bytes) => format!("limit {} KiB", bytes / 1024),
    };
    match (locked, locked_kib) {
        (true, 1..) => Outcome::new(Verdict::Pass, format!("{locked_kib} KiB locked, {limit}")),
        (true, 0) => {
            let text = format!("granted, but nothing is locked; {limit}");
            Outcome::new(Verdict::Fail, text)
        }
        (false, _) => Outcome::new(Verdict::Fail, format!("refused, {limit}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_counts_is_what_is_locked() {
        let found = |locked, locked_kib| {
            judge(&MemoryLock { locked, locked_kib, limit_bytes: None }).verdict
        };
        assert_eq!(found(true, 1), Verdict::Pass);
        assert_eq!(found(true, 0), Verdict::Fail);
        assert_eq!(found(false, 0), Verdict::Fail);
        let told = judge(&MemoryLock { locked: false, locked_kib: 0, limit_bytes: Some(8 << 20) });
        assert_eq!(told.value, "refused, limit 8192 KiB");
        assert_eq!(locked_kib("VmPin:\t 0 kB\nVmLck:\t    1234 kB\n"), 1234);
        assert_eq!(locked_kib(""), 0);
    }
}
