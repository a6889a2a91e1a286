//! The loop allocates and frees nothing: in a learning run references and records come from the
//! worker thread and return to it, and a scan is followed in memory that is there.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::Arc;

use experiment::ilc_trial::{IlcResult, Returned};
use experiment::ilc_update::IlcUpdater;
use experiment::matching_bar::{Effort, Matched};
use experiment::player::{IlcJob, Player, Program};
use experiment::session_state::{SessionState, SessionStep};
use experiment::session_tracker::{PlayedSegment, SessionPlan, SessionTracker};
use ipc_types::{AXES, LineEvent, SessionOutcome};
use rig::RigFile;
use rig::protocol::{Protocol, Signal};

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
        COUNT.with(|count| count.set(count.get() + 1));
        // SAFETY: the pointer came from `System` through `alloc`.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// What the loop does, counted.
fn counted<T>(total: &mut usize, work: impl FnOnce() -> T) -> T {
    let before = COUNT.with(Cell::get);
    let result = work();
    *total += COUNT.with(Cell::get) - before;
    result
}

#[test]
fn a_learning_run_allocates_and_frees_nothing_in_the_loop() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../launch/rigs/hydrostatic.toml");
    let rig = RigFile::load(path).unwrap();
    let text = "\
        [protocol]\nname = \"two\"\n\
        [[segments]]\nkind = \"learn\"\namplitude_deg = 20\nfrequency_hz = 2\nblocks = 6\n\
        law = \"published\"\n\
        [[segments]]\nkind = \"learn\"\namplitude_deg = 20\nfrequency_hz = 2\nblocks = 4\n\
        law = \"model-based\"\nharmonics = 3\n";
    let program =
        Arc::new(Program::new(&Protocol::parse(text, "two.toml").unwrap(), &rig).unwrap());
    let mut player = Player::default();
    player.start(Arc::clone(&program), 1);
    let mut updater: Option<IlcUpdater> = None;
    let (mut total, mut now_ns, mut blocks, mut ends) = (0, 1_000_000_000u64, 0, 0);
    let mut lag = [0.0; 15];
    while player.is_running() || now_ns == 1_000_000_000 {
        let scan_ns = now_ns;
        let setpoint =
            counted(&mut total, || player.step(scan_ns + 420_000, &[0.0; AXES]).setpoint.unwrap());
        // A slave that follows by four fifths, 30 ms late.
        lag.rotate_right(1);
        lag[0] = 0.8 * setpoint.position[0];
        counted(&mut total, || player.record(scan_ns, &[lag[14], 0.0, 0.0], true));
        while let Some(job) = counted(&mut total, || player.job()) {
            let result = match job {
                IlcJob::Begin { run_id, program, segment, .. } => {
                    let plan = program.plan(segment as usize).unwrap().as_ref().clone();
                    let made = IlcUpdater::new(plan, segment, None, None).unwrap();
                    updater.insert(made).ready(run_id)
                }
                IlcJob::Returned(Returned::Record(record)) => {
                    let updated = updater.as_mut().unwrap().update(&record);
                    assert!(!updated.failed);
                    blocks += usize::from(record.block > 0);
                    IlcResult::updated(record, updated.reference)
                }
                IlcJob::Returned(Returned::Reference(_)) => continue,
                IlcJob::End(_) => {
                    ends += 1;
                    continue;
                }
            };
            counted(&mut total, || player.receive(result));
        }
        now_ns += 2_000_000;
    }
    assert_eq!((blocks, ends), (10, 2), "both learning runs took place");
    assert_eq!(total, 0, "the loop allocated or freed");
    assert!(COUNT.with(Cell::get) > 0, "the counter counts");
}

#[test]
fn a_protocol_in_the_scanner_allocates_and_frees_nothing_in_the_loop() {
    let rig = rig::load_rig("hydrostatic".as_ref()).unwrap();
    let protocol = rig::load_protocol("block-design".as_ref(), &[]).unwrap();
    let program = Arc::new(Program::new(&protocol, &rig).unwrap());
    let mut player = Player::default();
    let (mut total, mut reports) = (0, 0);
    // The second run begins with what the first has left.
    for run in 0..2_u64 {
        let begun_ns = 1_000_000_000 * (1 + 1_000 * run);
        counted(&mut total, || player.start(Arc::clone(&program), 1));
        for step in 0..20_000 {
            let now_ns = begun_ns + 2_000_000 * step;
            // Of the volumes of 2 s every second has a pulse; some pulses belong to none.
            if step % 2_000 == 500 || step % 7_000 == 999 {
                counted(&mut total, || player.see_scanner(LineEvent::Pulse, now_ns));
            }
            counted(&mut total, || player.step(now_ns, &[0.0; AXES]));
            while counted(&mut total, || player.take_scan_report()).is_some() {
                reports += 1;
            }
            counted(&mut total, || player.scan_state());
        }
        counted(&mut total, || player.stop());
    }
    assert!(reports > 40, "{reports}");
    assert_eq!(total, 0, "the loop allocated or freed");
}

#[test]
fn sessions_allocate_and_free_nothing_in_the_loop() {
    let plan = SessionPlan { sessions: 2, matched: Some(Matched { signal: Signal::Emg, axis: 0 }) };
    let mut tracker = SessionTracker::new(2000.0);
    let mut state = SessionState::with_capacity();
    for step in [SessionStep::Begun, SessionStep::Update([0.5; 2]), SessionStep::Over(1, [1.0; 2])]
    {
        state.take(step);
    }
    let segment = |at: u64, session: Option<u32>| PlayedSegment {
        segment: at as u32,
        begun_ns: 600_000_000_000 * at,
        planned_s: 600.0,
        session,
        rest: session.is_none(),
        contraction: if session.is_some() { 0x3f } else { 0 },
    };
    let (mut total, mut reports) = (0, 0);
    counted(&mut total, || tracker.begin(1, plan, Some(&state)));
    for (at, session) in [(0, Some(1)), (1, None), (2, Some(2)), (3, None)] {
        let next = segment(at, session);
        let outcome = SessionOutcome::Whole;
        counted(&mut total, || tracker.pass_edge(next.begun_ns, outcome, Some(next)));
        // The longest session that there can be, at a low rate of samples.
        for k in 0..60_000 {
            let at_ns = next.begun_ns + k * 10_000_000;
            let effort = Effort { at_ns, tick: at * 60_000 + k, ..Effort::default() };
            counted(&mut total, || {
                tracker.see(effort);
                tracker.advance(at_ns);
            });
            while counted(&mut total, || tracker.take_report()).is_some() {
                reports += 1;
            }
        }
    }
    assert!(reports > 4 * 29_000 && tracker.dropped() == 0, "{reports}");
    assert_eq!(total, 0, "{total} allocations and deallocations");
}
