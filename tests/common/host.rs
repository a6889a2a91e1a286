//! This host: the load that a test puts on it, and the timing profile that it can keep. A host that
//! shares its processors may stall for longer than a realtime rig tolerates; such a rig then trips,
//! rightly, in any test.

use std::hint::black_box;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::thread::JoinHandle;

use ipc_types::Profile;
use runtime::{HostStall, MEASURED_FOR};

/// The host's stalls, measured once for each test program.
pub fn stall() -> HostStall {
    static STALL: OnceLock<HostStall> = OnceLock::new();
    *STALL.get_or_init(|| HostStall::measure(MEASURED_FOR))
}

/// Threads that compute at normal priority until they are dropped.
#[derive(Debug)]
pub struct Hogs {
    stop: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

impl Hogs {
    pub fn start(number: usize) -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let threads = (0..number)
            .map(|_| {
                let stop = Arc::clone(&stop);
                std::thread::spawn(move || {
                    let mut state = 1u64;
                    while !stop.load(Ordering::Relaxed) {
                        for _ in 0..10_000 {
                            state = black_box(
                                state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1),
                            );
                        }
                    }
                })
            })
            .collect();
        Self { stop, threads }
    }

    /// The same beside a rig of the real-time profile, whose scheduling class must keep other
    /// programs from delaying it; none beside others.
    pub fn in_realtime(number: usize, profile: Profile) -> Option<Self> {
        (profile == Profile::Realtime).then(|| Self::start(number))
    }
}

impl Drop for Hogs {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            let _ended = thread.join();
        }
    }
}
