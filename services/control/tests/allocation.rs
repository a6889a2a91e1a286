//! A step of the law allocates nothing, in every mode and with every option.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use control::law::{Law, LawConfig};
use ipc_types::{Mode, Sample, Setpoint};
use rig::{CompensationKind, RigFile};

thread_local! {
    static COUNT: Cell<usize> = const { Cell::new(0) };
}

struct Counting;

// SAFETY: hands everything to the system's allocator and only counts besides.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.with(|count| count.set(count.get() + 1));
        // SAFETY: the caller keeps the contract of `GlobalAlloc::alloc`.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the pointer came from `System` through `alloc`.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

const RIG: &str = include_str!("../../../launch/rigs/hydrostatic.toml");
const OPTIONS: &str = "[axes.control.observer]\n[axes.control.slave]\n\n# Force control";

fn rig(kind: CompensationKind, options: bool) -> RigFile {
    let text = if options { RIG.replacen("# Force control", OPTIONS, 1) } else { RIG.to_owned() };
    let mut rig = RigFile::parse(&text, "hydrostatic.toml").unwrap();
    rig.axes[0].control.options.compensation.kind = kind;
    assert_eq!(rig.axes[0].control.options.slave.is_some(), options);
    rig
}

#[test]
fn a_step_allocates_nothing_in_any_mode_with_any_option() {
    for kind in [CompensationKind::Printed, CompensationKind::Identified, CompensationKind::None] {
        for options in [false, true] {
            let mut law = Law::new(LawConfig::of_rig(&rig(kind, options)));
            let mut now = 1_000_000_000u64;
            let before = COUNT.with(Cell::get);
            assert!(before > 0, "the counter counts");
            let mut sum = 0.0;
            // Each mode twice, so that each change between neighbours happens; a lapsed lease and a
            // value that is none between.
            for mode in Mode::ALL.iter().chain(Mode::ALL.iter().rev()) {
                for cycle in 0..300 {
                    now += 2_000_000;
                    let time_s = now as f64 * 1e-9;
                    let mut sample = Sample {
                        scan_time_ns: now,
                        master_present: 1,
                        slave_present: 1,
                        torque_present: 1,
                        motor_present: 1,
                        axes: 1,
                        ..Sample::default()
                    };
                    sample.master_position[0] =
                        if cycle == 290 { f64::NAN } else { 0.3 * time_s.sin() };
                    sample.slave_position[0] = 0.28 * time_s.sin();
                    sample.slave_torque[0] = 2.0 * (3.0 * time_s).cos();
                    sample.motor_v[0] = sum % 1.0;
                    let mut setpoint = Setpoint {
                        incarnation: 1,
                        at_ns: now,
                        lease_until_ns: if cycle > 280 { now - 1 } else { now + 100_000_000 },
                        mode: mode.code(),
                        axes: 1,
                        ..Setpoint::default()
                    };
                    setpoint.position[0] = 0.4 * (2.0 * time_s).sin();
                    setpoint.velocity[0] = 0.8 * (2.0 * time_s).cos();
                    setpoint.acceleration[0] = -1.6 * (2.0 * time_s).sin();
                    setpoint.peak_speed[0] = 0.8;
                    setpoint.stiffness[0] = 0.5;
                    setpoint.damping[0] = 0.05;
                    (setpoint.wall_min[0], setpoint.wall_max[0], setpoint.wall_stiffness[0]) =
                        (-0.2, 0.2, 3.0);
                    let command = law.step(now, &sample, Some(&setpoint), cycle > 5);
                    sum += command.volts[0].abs();
                }
            }
            assert_eq!(COUNT.with(Cell::get), before, "{kind:?}, options {options}");
            assert!(sum > 0.0, "the law worked");
        }
    }
}
