//! The one list of checks: report, page, tests and progress walk it.

use crate::bench::Bench;
use crate::live::{enable_line, movement, rest};
use crate::machine::{
    clock, disk, memory_lock, processors, scheduling, shared_memory, units, wake,
};
use crate::outcome::Outcome;

/// What must be there for a check to be made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Needs {
    /// Nothing.
    Nothing,
    /// It loads the machine: no rig of this name may be armed or play a protocol.
    Rest,
    /// A rig that is up.
    Rig,
    /// A rig that is up and at rest, and a person's consent that the motor gets power.
    Movement,
}

impl Needs {
    /// In words, for the page.
    pub(crate) const fn text(self) -> &'static str {
        match self {
            Self::Nothing => "nothing",
            Self::Rest => "no armed rig of this name",
            Self::Rig => "a rig that is up",
            Self::Movement => "a rig that is up, `--move`",
        }
    }
}

/// One check.
#[derive(Clone, Copy)]
pub(crate) struct Check {
    /// Its id, in `--json` and in the text.
    pub(crate) id: &'static str,
    /// What is examined.
    pub(crate) title: &'static str,
    /// What is done.
    pub(crate) does: &'static str,
    /// When it passes, warns and fails.
    pub(crate) limits: &'static str,
    /// Where these limits come from.
    pub(crate) source: &'static str,
    /// What to do where it does not pass, unless the outcome says otherwise.
    pub(crate) remedy: &'static str,
    /// What it needs.
    pub(crate) needs: Needs,
    /// Makes it.
    pub(crate) examine: fn(&mut Bench<'_>) -> anyhow::Result<Outcome>,
}

/// The checks, in the order in which they are made: those that power the motor come last.
pub(crate) const CHECKS: &[Check] = &[
    Check {
        id: "scheduling",
        title: "real-time scheduling",
        does: "a thread asks for SCHED_FIFO, reads its class back from the kernel, and computes \
               for 0.1 s beside an ordinary thread on the same processor",
        limits: "fail: refused, or less than 90 % of the processor; warn: the kernel leaves less \
                 than half of the time to real-time threads",
        source: "with equal rights it would get 50 %; decision 0008",
        remedy: "without systemd in /etc/security/limits.d/farreach.conf: `@farreach - rtprio 90`, \
                 then log in again; under systemd the units have it (launch/README.md)",
        needs: Needs::Rest,
        examine: scheduling::examine,
    },
    Check {
        id: "memory-lock",
        title: "locked memory",
        does: "locks its memory as a loop does, and reads from the kernel what is locked",
        limits: "fail: refused, or nothing is locked",
        source: "a page that must be read from the disk holds a loop up by milliseconds",
        remedy: "without systemd in /etc/security/limits.d/farreach.conf: `@farreach - memlock \
                 unlimited`, then log in again",
        needs: Needs::Nothing,
        examine: memory_lock::examine,
    },
    Check {
        id: "wake-idle",
        title: "wake-up latency, idle",
        does: "bare 1 kHz loops at acquisition's priority, one on each processor, for 2 s; \
               histogram in `measured`",
        limits: "pass: p99 ≤ 120 µs and max ≤ 1.25 ms; fail: p99 > 500 µs or max > 2.5 ms",
        source: "120 µs lie between the phases of acquisition and control, 500 µs are \
                 acquisition's period; a stall of 2.5 ms trips a rig in real time \
                 (`Timeouts::stall_ns`), and a short measurement misses the longest",
        remedy: "a kernel with PREEMPT_RT, isolated processors (see isolation), no other programs, \
                 power saving off in the firmware",
        needs: Needs::Nothing,
        examine: wake::examine_idle,
    },
    Check {
        id: "wake-load",
        title: "wake-up latency, under load",
        does: "the same beside a load of its own: on each processor one ordinary thread that \
               computes and one that moves memory",
        limits: "as wake-idle",
        source: "as wake-idle",
        remedy: "a kernel with PREEMPT_RT, isolated processors (see isolation), power saving off \
                 in the firmware",
        needs: Needs::Rest,
        examine: wake::examine_loaded,
    },
    Check {
        id: "stalls",
        title: "stalls of the host",
        does: "bare 1 kHz loops above every loop of a rig, one on each processor, for 2 s, and \
               the time that a hypervisor has given to other guests since boot",
        limits: "fail: longer than 1.25 ms, or more than 100 ppm stolen: the keeper would not \
                 choose the real-time profile; warn: so without SCHED_FIFO",
        source: "decision 0008; `HostStall::exceeds`, the keeper's own measurement",
        remedy: "a machine of its own; as a virtual machine: processors pinned by the host, no \
                 other guests on them",
        needs: Needs::Nothing,
        examine: wake::examine_stalls,
    },
    Check {
        id: "idle-states",
        title: "sleep states of the processors",
        does: "holds /dev/cpu_dma_latency at 0 as a rig does, and counts for 0.3 s how often \
               states that take time to wake are entered",
        limits: "pass: none deeper than 10 µs, or none entered while held; warn: entered, or the \
                 device is not open to this user; fail: so, and one takes 500 µs or more to wake",
        source: "500 µs are acquisition's period; decision 0019 has what sleep costs",
        remedy: "/etc/udev/rules.d/90-farreach.rules: `KERNEL==\"cpu_dma_latency\", \
                 GROUP=\"farreach\", MODE=\"0660\"`",
        needs: Needs::Nothing,
        examine: processors::examine_idle_states,
    },
    Check {
        id: "governor",
        title: "governor of the processors' frequency",
        does: "reads it for every processor that the rig may run on",
        limits: "warn: another than `performance`",
        source: "a change of frequency takes tens to hundreds of µs, and a slow processor longer \
                 for each cycle (Documentation/admin-guide/pm/cpufreq.rst)",
        remedy: "cpupower frequency-set -g performance, at each boot",
        needs: Needs::Nothing,
        examine: processors::examine_governor,
    },
    Check {
        id: "isolation",
        title: "isolated processors",
        does: "reads from the kernel which processors are kept free of other work",
        limits: "fail: the rig has less than two processors; warn: less than two are isolated",
        source: "acquisition and control shall not wait for each other (decision 0050)",
        remedy: "with four processors or more boot with `isolcpus=2,3 nohz_full=2,3 \
                 rcu_nocbs=2,3`; then `farreach up --place`",
        needs: Needs::Nothing,
        examine: processors::examine_isolation,
    },
    Check {
        id: "shared-memory",
        title: "shared memory",
        does: "writes as much as a rig needs to /dev/shm, reads it back and removes it",
        limits: "fail: too little is free, it cannot be written, or it is no tmpfs; warn: not free \
                 twice",
        source: "sizes of all segments from the table of topics; a second rig, or a logger that \
                 starts again, needs as much again",
        remedy: "mount -o remount,size=1G /dev/shm; in a container: --shm-size=1g",
        needs: Needs::Rest,
        examine: shared_memory::examine,
    },
    Check {
        id: "disk-write",
        title: "sustained write of the disk",
        does: "writes for 2 s, at most 256 MiB, to `--folder`, and syncs",
        limits: "pass: 10 times what a recording writes before compression; fail: less than twice",
        source: "all topics at the rates of the table of processes; exports and other programs use \
                 the disk, too",
        remedy: "record to a local disk (`--folder` of this command, `--record` of `up`), not to \
                 the network",
        needs: Needs::Rest,
        examine: disk::examine_write,
    },
    Check {
        id: "disk-sync",
        title: "stalls of the disk at a sync",
        does: "writes at the rate of a recording for 2 s to `--folder`, and syncs ten times a \
               second",
        limits: "pass: within a quarter of what the logger's queue holds; fail: beyond half of it",
        source: "what does not fit into the queue is lost; two seconds do not show the longest \
                 sync",
        remedy: "record to a solid-state disk with nothing else on it",
        needs: Needs::Rest,
        examine: disk::examine_sync,
    },
    Check {
        id: "clock",
        title: "clock source",
        does: "reads CLOCK_MONOTONIC 200,000 times in a row",
        limits: "pass: a processor's counter, at most 200 ns a reading; fail: it goes back, a \
                 resolution above 1 µs, or more than 2 µs a reading",
        source: "a reading by a system call takes several hundred ns; a loop reads it about ten \
                 times in its 500 µs",
        remedy: "boot with `clocksource=tsc tsc=reliable`, where the processor's counter is \
                 constant",
        needs: Needs::Nothing,
        examine: clock::examine,
    },
    Check {
        id: "units",
        title: "units of systemd",
        does: "looks for the unit files of every process, and has systemd-analyze verify them",
        limits: "fail: systemd-analyze complains, or a unit starts another process; warn: some are \
                 missing",
        source: "the table of processes; launch/README.md",
        remedy: "install -m 644 launch/units/* /etc/systemd/system/ && systemctl daemon-reload",
        needs: Needs::Nothing,
        examine: units::examine,
    },
    Check {
        id: "card",
        title: "card present and streaming",
        does: "counts the samples of a second",
        limits: "pass: the rig file's rate within 1 %, no scan missed; warn: within 10 %; fail: \
                 beyond",
        source: "the card's clock is better than 0.1 %; 1 % are the edges of the observation",
        remedy: "see the card's lamp and cable, `farreach status` and the log of acquisition",
        needs: Needs::Rig,
        examine: rest::examine_card,
    },
    Check {
        id: "torque-noise",
        title: "noise of the torque sensors",
        does: "takes mean and standard deviation over a second at rest",
        limits: "pass: the threshold of force control is 5 standard deviations or more, the mean \
                 within 5 % of the limit; fail: less than 2, saturated, or no number",
        source: "`torque_threshold_v` is to be ten times the noise (rig file); below it noise \
                 alone switches the compensation of friction (eq. 4.2.3)",
        remedy: "shield and ground the sensor's cable, or raise `torque_threshold_v` in \
                 [axes.control.force]",
        needs: Needs::Rig,
        examine: rest::examine_torque,
    },
    Check {
        id: "trigger",
        title: "scanner's trigger seen",
        does: "waits for a pulse for as long as `--trigger` says",
        limits: "fail: none came",
        source: "-",
        remedy: "check the cable from the scanner, and [scanner] in the rig file: channel, \
                 `active`, `threshold_v` (`farreach probe scope` shows the line)",
        needs: Needs::Rig,
        examine: rest::examine_trigger,
    },
    Check {
        id: "enable-line",
        title: "enable line drops the motor",
        does: "resets, arms and enables the motor for 0.2 s, at rest, disarms, and measures from \
               the line's last edge to the first scan without motor power",
        limits: "pass: within the profile's timeout of the line and 2 ms (7 ms in real time); \
                 fail: later, power does not come, or stays",
        source: "`Timeouts::enable_line_ns` (5 and 40 ms); periods of watchdog and acquisition; \
                 safety case",
        remedy: "set the relay's timer, or the card's watchdog, to the timeout of the real-time \
                 profile (5 ms)",
        needs: Needs::Movement,
        examine: enable_line::examine,
    },
    Check {
        id: "encoder-directions",
        title: "directions of the encoders",
        does: "moves each homed axis to and fro by 5 % of its range, within the rig file's limits, \
               and compares reference, master, handle and motor voltage",
        limits: "fail: master or handle follow by less than 5 %, or the other way round; the \
                 voltage reads back against the motion; the rig trips",
        source: "a master that counts against its motor makes the loop run away; friction and the \
                 windup of a line take most of so small a movement, and 5 % are more than play",
        remedy: "`inverted` in [axes.master] or [axes.slave]",
        needs: Needs::Movement,
        examine: movement::examine_encoders,
    },
    Check {
        id: "torque-sign",
        title: "sign of the torque sensors",
        does: "fits stiffness and damping to the torque along that movement",
        limits: "pass: a hand at the handle opposes the movement; fail: it drives it; skipped: \
                 within 3 standard deviations of the noise",
        source: "a relaxed hand is passive: it absorbs energy",
        remedy: "the sign of `volts_per_nm` (`volts_per_n`) in [axes.torque]",
        needs: Needs::Movement,
        examine: movement::examine_torque,
    },
];

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn every_check_is_told_whole_and_once() {
        let ids: BTreeSet<_> = CHECKS.iter().map(|check| check.id).collect();
        assert_eq!(ids.len(), CHECKS.len());
        for check in CHECKS {
            let lower = |c: char| c.is_ascii_lowercase() || c == '-';
            assert!(!check.id.is_empty() && check.id.chars().all(lower), "{}", check.id);
            for text in [check.title, check.does, check.limits, check.source, check.remedy] {
                assert!(!text.is_empty() && !text.contains("  "), "{}: {text}", check.id);
            }
        }
    }

    #[test]
    fn those_that_power_the_motor_come_last() {
        let powered = |check: &Check| check.needs == Needs::Movement;
        let first = CHECKS.iter().position(powered).unwrap();
        assert!(CHECKS[first..].iter().all(powered));
    }
}
