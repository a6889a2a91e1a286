//! An axis against the channels, the rates and its own sections.

use crate::axis::Axis;
use crate::axis_unit::{AxisUnit, KeyNames};
use crate::channel::{Channel, ChannelKind};
use crate::checked_toml::Source;
use crate::homing::{LOWER_STOP, UPPER_STOP};
use crate::limits::{POSITION_MAX, POSITION_MIN, TORQUE_MAX};
use crate::range_of_motion::{MAX, MIN};
use crate::rates::Rates;

/// Narrowest plausible range of a rotary axis (degrees).
const NARROWEST_DEG: f64 = 5.0;

/// Checks the axis with index `at`.
pub(super) fn check(
    axis: &Axis,
    at: usize,
    channels: &[Channel],
    rates: &Rates,
    source: &Source<'_>,
) {
    let path = |key: &str| format!("axes.{at}.{key}");
    check_range(axis, &path, source);
    let limits = &axis.limits;
    // The watchdog applies the same threshold to both encoders.
    let slave_counts = axis.slave.as_ref().map_or(0.0, |slave| slave.counts_per_unit);
    let finest = axis.master.counts_per_unit.max(slave_counts);
    let per_scan = limits.speed_max * finest / f64::from(rates.acquisition_hz);
    if (limits.encoder_jump_counts as f64) < 2.0 * per_scan {
        let least = (2.0 * per_scan).ceil();
        let expected =
            format!("at least {least:.0}, twice what the speed limit allows in one scan");
        let advice = "with a lower value a fast movement counts as a broken encoder";
        let key = path("limits.encoder_jump_counts");
        source.problem(&key, expected, limits.encoder_jump_counts, advice);
    }
    let output_limit_v = axis.control.output_limit_v;
    if output_limit_v > limits.volts_max {
        let expected = format!("at most limits.volts_max ({} V)", limits.volts_max);
        let advice = "control must stay below the voltage at which the watchdog trips";
        source.problem(&path("control.output_limit_v"), expected, output_limit_v, advice);
    }
    check_torque(axis, channels, &path, source);
    // Limits that are wrong themselves say nothing about the stops.
    if source.is_clean() {
        check_stops(axis, &path, source);
        check_range_of_motion(axis, &path, source);
    }
}

/// The position limits: in order, and plausible in degrees.
fn check_range(axis: &Axis, path: &impl Fn(&str) -> String, source: &Source<'_>) {
    let limits = &axis.limits;
    let file = |si: f64| si / axis.unit.si_per_file_unit();
    let key = path(&format!("limits.{}", POSITION_MAX.of(axis.unit)));
    let (least, most) = (file(limits.position_min), file(limits.position_max));
    if least >= most {
        let expected = format!("more than {} ({})", POSITION_MIN.of(axis.unit), least.round());
        let found = format!("limits the wrong way round: {}", most.round());
        source.problem(&key, expected, found, "swap the two");
    } else if axis.unit == AxisUnit::Radian && most - least < NARROWEST_DEG {
        let expected = format!("a range of at least {NARROWEST_DEG} degrees");
        let found = format!("{:.2} degrees", most - least);
        let advice = "limits this close look like radians; the values are in degrees";
        source.problem(&key, expected, found, advice);
    }
}

/// The stops lie within the position limits: a homed axis begins at one of them.
fn check_stops(axis: &Axis, path: &impl Fn(&str) -> String, source: &Source<'_>) {
    let Some(search) = axis.stop_search() else { return };
    let (limits, scale) = (&axis.limits, axis.unit.si_per_file_unit());
    for (stop, key) in [(search.lower, LOWER_STOP), (search.upper, UPPER_STOP)] {
        if !(limits.position_min..=limits.position_max).contains(&stop) {
            let (least, most) = (limits.position_min / scale, limits.position_max / scale);
            let expected = format!("within the position limits ({least:.4} to {most:.4})");
            let advice = "the axis is homed at its stops: widen the limits";
            let key = path(&format!("homing.{}", key.of(axis.unit)));
            source.problem(&key, expected, stop / scale, advice);
        }
    }
}

/// The range of motion: in order, within the position limits, and about the position at which a
/// search for the stops ends.
fn check_range_of_motion(axis: &Axis, path: &impl Fn(&str) -> String, source: &Source<'_>) {
    let Some(range) = axis.range_of_motion else { return };
    let limits = &axis.limits;
    // Without the last digits of the conversion.
    let file = |si: f64| (si / axis.unit.si_per_file_unit() * 1e6).round() / 1e6;
    let key = |names: KeyNames| path(&format!("range_of_motion.{}", names.of(axis.unit)));
    if range.min >= range.max {
        let expected = format!("more than {} ({})", MIN.of(axis.unit), file(range.min));
        source.problem(&key(MAX), expected, file(range.max), "swap the two");
        return;
    }
    for (end, names) in [(range.min, MIN), (range.max, MAX)] {
        if !(limits.position_min..=limits.position_max).contains(&end) {
            let (least, most) = (file(limits.position_min), file(limits.position_max));
            let expected = format!("within the position limits ({least} to {most})");
            let advice = "a range of motion is smaller than the limits of the machine";
            source.problem(&key(names), expected, file(end), advice);
        }
    }
    let advice = "shift the zero with the positions of the stops, or widen the range";
    if axis.stop_search().is_some() && range.min > 0.0 {
        let expected = "at most 0, where the handle is once its stops were found";
        source.problem(&key(MIN), expected, file(range.min), advice);
    }
    if axis.stop_search().is_some() && range.max < 0.0 {
        let expected = "at least 0, where the handle is once its stops were found";
        source.problem(&key(MAX), expected, file(range.max), advice);
    }
}

/// The torque channel: present, of the right kind, and not saturated below the torque limit.
fn check_torque(
    axis: &Axis,
    channels: &[Channel],
    path: &impl Fn(&str) -> String,
    source: &Source<'_>,
) {
    let Some(torque) = &axis.torque else { return };
    let key = path("torque.channel");
    let Some((index, channel)) =
        channels.iter().enumerate().find(|(_, channel)| channel.index == torque.channel)
    else {
        let present: Vec<_> = channels.iter().map(|channel| channel.index.to_string()).collect();
        let expected = format!("the index of one of [[channels]] ({})", present.join(", "));
        let found = format!("the missing channel {}", torque.channel);
        let advice = format!("add [[channels]] with index = {}", torque.channel);
        source.problem(&key, expected, found, advice);
        return;
    };
    if channel.kind != ChannelKind::Torque {
        let found = format!("channels.{index} (\"{}\") of another kind", channel.name);
        let advice = "give the index of the torque sensor, or correct the channel's kind";
        source.problem(&key, "a channel of kind \"torque\"", found, advice);
    }
    let full_scale = (channel.range_v - torque.offset_v.abs()) / torque.volts_per_unit.abs();
    if let Some(most) = axis.limits.torque_max.filter(|most| *most > full_scale) {
        let expected =
            format!("at most {full_scale:.2}, where the channel's ±{} V end", channel.range_v);
        let key = path(&format!("limits.{}", TORQUE_MAX.of(axis.unit)));
        source.problem(&key, expected, most, "the sensor saturates before the limit acts");
    }
}
