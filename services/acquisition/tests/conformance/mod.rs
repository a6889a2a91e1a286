//! One suite for all cards: what holds for the simulator, the replay, and a card to come.
//!
//! A test writes a [`Bench`] for its card and calls [`check`].

use runtime::daq::{Daq, DaqError};

/// A card on the test bench, whose time the suite drives.
pub(crate) trait Bench {
    /// A new card, at its beginning.
    fn reset(&mut self);
    /// Lets `ticks` periods pass on the card.
    fn advance(&mut self, ticks: u64);
    /// The card's time now (ns).
    fn now_ns(&self) -> u64;
    /// The card.
    fn daq(&mut self) -> &mut dyn Daq;
    /// Whether the motor has power on this bench.
    fn has_power(&self) -> bool {
        false
    }
    /// Volts between two codes of its outputs (V): what was written comes back to within half.
    fn resolution_v(&self) -> f64 {
        0.0
    }
}

/// What did not hold.
#[derive(Debug, thiserror::Error)]
#[error("{rule}: {found}")]
pub(crate) struct Violation {
    rule: &'static str,
    found: String,
}

fn ensure(
    holds: bool,
    rule: &'static str,
    found: impl FnOnce() -> String,
) -> Result<(), Violation> {
    if holds { Ok(()) } else { Err(Violation { rule, found: found() }) }
}

/// Whether the newest volts are those that were written.
fn is_newest(bench: &dyn Bench, volts: &[f64], written: f64) -> bool {
    let half = 0.5 * bench.resolution_v() * (1.0 + 1e-9);
    volts.last().is_some_and(|newest| (newest - written).abs() <= half)
}

fn ticks(bench: &mut dyn Bench, rule: &'static str) -> Result<Vec<u64>, Violation> {
    let now = bench.now_ns();
    match bench.daq().read_due(now) {
        Ok(scans) => Ok(scans.iter().map(|scan| scan.tick).collect()),
        Err(error) => Err(Violation { rule, found: error.to_string() }),
    }
}

/// Runs the whole suite.
pub(crate) fn check(bench: &mut dyn Bench) -> Result<(), Violation> {
    nothing_twice_and_nothing_missing(bench)?;
    a_late_reader_gets_all(bench)?;
    an_overflow_is_counted(bench)?;
    outputs_do_as_declared(bench)?;
    digital_outputs_do_as_declared(bench)?;
    motor_power_is_reported_as_declared(bench)?;
    not_finite_is_refused(bench)
}

/// Regular reading: each tick once, in order.
fn nothing_twice_and_nothing_missing(bench: &mut dyn Bench) -> Result<(), Violation> {
    const RULE: &str = "each tick comes once, in order";
    bench.reset();
    let mut seen: Vec<u64> = Vec::new();
    for _ in 0..20 {
        bench.advance(1);
        seen.extend(ticks(bench, RULE)?);
        let again = ticks(bench, RULE)?;
        ensure(again.is_empty(), "nothing is due twice", || format!("{again:?} came again"))?;
    }
    ensure(seen.len() >= 18, RULE, || format!("20 periods gave {} scans", seen.len()))?;
    ensure(seen.windows(2).all(|pair| pair[1] == pair[0] + 1), RULE, || format!("{seen:?}"))?;
    let missed = bench.daq().scans_missed();
    ensure(missed == 0, "nothing is missed in regular reading", || format!("{missed} missed"))
}

/// A reader that comes late, but within the FIFO's depth, gets everything.
fn a_late_reader_gets_all(bench: &mut dyn Bench) -> Result<(), Violation> {
    const RULE: &str = "a late wake yields late samples, not holes";
    bench.reset();
    bench.advance(1);
    let mut seen = ticks(bench, RULE)?;
    let pause = (bench.daq().capabilities().fifo_depth as u64 / 2).clamp(1, 100);
    bench.advance(pause);
    let late = ticks(bench, RULE)?;
    ensure(late.len() as u64 >= pause, RULE, || {
        format!("{} scans after {pause} periods", late.len())
    })?;
    seen.extend(late);
    ensure(seen.windows(2).all(|pair| pair[1] == pair[0] + 1), RULE, || format!("{seen:?}"))?;
    ensure(bench.daq().scans_missed() == 0, RULE, || "scans were missed".to_owned())
}

/// A reader that comes later than the FIFO is deep loses the oldest, and the loss is counted.
fn an_overflow_is_counted(bench: &mut dyn Bench) -> Result<(), Violation> {
    const RULE: &str = "what the FIFO drops is counted";
    bench.reset();
    bench.advance(1);
    let mut seen = ticks(bench, RULE)?;
    let depth = bench.daq().capabilities().fifo_depth as u64;
    bench.advance(depth + 50);
    loop {
        let more = ticks(bench, RULE)?;
        if more.is_empty() {
            break;
        }
        seen.extend(more);
    }
    let (Some(first), Some(last)) = (seen.first(), seen.last()) else {
        return Err(Violation { rule: RULE, found: "no scans at all".to_owned() });
    };
    let holes = (last - first + 1) - seen.len() as u64;
    ensure(seen.windows(2).all(|pair| pair[1] > pair[0]), "ticks rise", || format!("{seen:?}"))?;
    let missed = bench.daq().scans_missed();
    ensure(missed == holes, RULE, || format!("{holes} holes, {missed} counted"))
}

/// Volts reach the motor and hold, if the card has outputs; else only 0 V is accepted.
fn outputs_do_as_declared(bench: &mut dyn Bench) -> Result<(), Violation> {
    const RULE: &str = "written volts reach the motor and hold";
    bench.reset();
    bench.advance(1);
    ticks(bench, RULE)?;
    let capabilities = bench.daq().capabilities();
    let written = bench.daq().write([1.25, 0.0, 0.0]);
    if !capabilities.accepts_output {
        ensure(written == Err(DaqError::NoOutput), "a card without outputs says so", || {
            format!("{written:?}")
        })?;
        let zero = bench.daq().write([0.0; 3]);
        return ensure(zero.is_ok(), "0 V is always accepted", || format!("{zero:?}"));
    }
    ensure(written.is_ok(), RULE, || format!("{written:?}"))?;
    bench.advance(3);
    let now = bench.now_ns();
    let volts: Vec<f64> = match bench.daq().read_due(now) {
        Ok(scans) => scans.iter().map(|scan| scan.motor_v[0]).collect(),
        Err(error) => return Err(Violation { rule: RULE, found: error.to_string() }),
    };
    ensure(is_newest(bench, &volts, 1.25), RULE, || format!("{volts:?}"))
}

/// Digital outputs show and hold, if the card has some; else none can be high.
fn digital_outputs_do_as_declared(bench: &mut dyn Bench) -> Result<(), Violation> {
    const RULE: &str = "digital outputs show in the scans and hold";
    bench.reset();
    bench.advance(1);
    ticks(bench, RULE)?;
    let outputs = bench.daq().capabilities().digital_outputs;
    let low = bench.daq().write_digital(0);
    ensure(low.is_ok(), "all outputs low is always accepted", || format!("{low:?}"))?;
    if outputs == 0 {
        let high = bench.daq().write_digital(1);
        return ensure(high == Err(DaqError::NoOutput), "a card without says so", || {
            format!("{high:?}")
        });
    }
    for output in 0..outputs {
        let levels = 1 << output;
        let written = bench.daq().write_digital(levels).and(bench.daq().write([0.0; 3]));
        ensure(written.is_ok(), RULE, || format!("{written:?}"))?;
        bench.advance(3);
        let now = bench.now_ns();
        let shown: Vec<u32> = match bench.daq().read_due(now) {
            Ok(scans) => scans.iter().map(|scan| scan.digital_out).collect(),
            Err(error) => return Err(Violation { rule: RULE, found: error.to_string() }),
        };
        ensure(shown.last() == Some(&levels), RULE, || format!("{levels}: {shown:?}"))?;
    }
    Ok(())
}

/// Motor power shows where the card reports it; another card never tells of any.
fn motor_power_is_reported_as_declared(bench: &mut dyn Bench) -> Result<(), Violation> {
    const RULE: &str = "motor power shows where it is reported, and nowhere else";
    bench.reset();
    bench.advance(3);
    let now = bench.now_ns();
    let shown: Vec<bool> = match bench.daq().read_due(now) {
        Ok(scans) => scans.iter().map(|scan| scan.motor_power).collect(),
        Err(error) => return Err(Violation { rule: RULE, found: error.to_string() }),
    };
    let reports = bench.daq().capabilities().reports_power;
    let expected = bench.has_power() && reports;
    ensure(shown.last() == Some(&expected), RULE, || format!("{shown:?}"))?;
    ensure(reports || !shown.contains(&true), RULE, || format!("{shown:?}"))
}

/// A value that is not finite never reaches the card.
fn not_finite_is_refused(bench: &mut dyn Bench) -> Result<(), Violation> {
    const RULE: &str = "volts that are not finite are refused and 0 V is written";
    bench.reset();
    bench.advance(1);
    ticks(bench, RULE)?;
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let written = bench.daq().write([bad, 0.0, 0.0]);
        ensure(written == Err(DaqError::NotFinite), RULE, || format!("{bad}: {written:?}"))?;
        bench.advance(3);
        let now = bench.now_ns();
        match bench.daq().read_due(now) {
            Ok(scans) => {
                let volts: Vec<f64> = scans.iter().map(|scan| scan.motor_v[0]).collect();
                let capable = bench.daq().capabilities().accepts_output;
                ensure(!capable || is_newest(bench, &volts, 0.0), RULE, || {
                    format!("{bad}: {volts:?}")
                })?;
            }
            Err(error) => return Err(Violation { rule: RULE, found: error.to_string() }),
        }
    }
    Ok(())
}
