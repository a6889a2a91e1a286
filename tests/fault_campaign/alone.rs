//! What a trouble of the host does to bare loops where no rig runs. Where they alone stall for
//! longer than a rig may, an injection tells nothing about the rig.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Duration;

use ipc_types::Profile;
use runtime::Timeouts;
use runtime::clock::now_ns;

use crate::common::host::Hogs;
use crate::expected::Expected;
use crate::host_stalls::{HostStalls, SLICE};
use crate::host_troubles::HostTrouble;
use crate::strike::LOAD;
use crate::table::sorted;

/// How often each trouble comes.
const TIMES: usize = 10;
/// Before each, about as much as lies between two injections.
const PAUSE: Duration = Duration::from_secs(3);

/// The longest stall of bare loops in each of [`TIMES`] times that a trouble came without a rig.
#[derive(Debug)]
pub struct Alone {
    /// In order (ms).
    longest_ms: Vec<f64>,
    /// Stall from which on the watchdog of an enabled rig pauses the enable line (ms).
    allowed_ms: f64,
}

impl Alone {
    /// Measures every trouble that must leave the motor its power and needs no rig. None may run.
    /// Those whose names do not contain `only` are left out. `folder` is on the disk of the
    /// recordings.
    pub fn measure_all(
        profile: Profile,
        folder: &Path,
        only: &str,
    ) -> BTreeMap<&'static str, Self> {
        let mut found = BTreeMap::new();
        for trouble in HostTrouble::WITHOUT_RIG {
            if trouble.name().contains(only) && trouble.expected(profile) == Expected::Stays {
                let alone = Self::measure(trouble, profile, folder);
                eprintln!("{}: {}", trouble.name(), alone.text());
                found.insert(trouble.name(), alone);
            }
        }
        found
    }

    fn measure(trouble: HostTrouble, profile: Profile, folder: &Path) -> Self {
        let stalls = HostStalls::watch();
        // As in the campaign.
        let _hogs = Hogs::in_realtime(LOAD, profile);
        let once = |_| {
            std::thread::sleep(PAUSE);
            let began_ns = now_ns();
            trouble.make_without_rig(folder);
            // The measurement that has seen its end is complete.
            std::thread::sleep(SLICE + Duration::from_millis(20));
            stalls.longest_ms(began_ns)
        };
        let longest_ms = sorted((0..TIMES).map(once).collect());
        let allowed_ms = Timeouts::of(profile).enable_line_pause_ns as f64 * 1e-6;
        Self { longest_ms, allowed_ms }
    }

    /// Whether the host alone takes the power more often than not.
    pub fn takes_power(&self) -> bool {
        self.median_ms() > self.allowed_ms
    }

    fn median_ms(&self) -> f64 {
        self.longest_ms[self.longest_ms.len() / 2]
    }

    pub fn text(&self) -> String {
        format!(
            "bare loops without a rig stalled for {:.1} to {:.1} ms in {} times, median {:.1} ms, \
             where {:.1} ms make the watchdog pause the enable line",
            self.longest_ms[0],
            self.longest_ms[self.longest_ms.len() - 1],
            self.longest_ms.len(),
            self.median_ms(),
            self.allowed_ms,
        )
    }
}
