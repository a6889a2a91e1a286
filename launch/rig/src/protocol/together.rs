//! Axes that move together in one segment: `axes`, with `phases_deg` and `scales`.

use super::movement::{Line, Movement};
use crate::read::{Section, bounds};

/// What another axis does while the segment's own moves.
#[derive(Clone, Debug, PartialEq)]
pub struct Companion {
    /// The axis.
    pub axis: usize,
    /// Its movement, as long as the segment's own.
    pub movement: Movement,
}

/// Most axes that one segment moves.
const AXES: usize = 3;

/// Reads `axis`, or `axes` with what each does otherwise: the segment's own axis, its movement, and
/// the others.
pub(super) fn read(section: &Section<'_>, movement: Movement) -> (usize, Movement, Vec<Companion>) {
    let number = |key: &str, phases: bool| match (section.has(key), phases) {
        (true, true) => section
            .numbers(key, bounds(-360.0, 360.0, "in degrees, ahead of the segment's own movement")),
        (true, false) => {
            section.numbers(key, bounds(-1.0, 1.0, "a part of the segment's own amplitude"))
        }
        (false, _) => {
            section.known(key);
            Vec::new()
        }
    };
    let (phases, scales) = (number("phases_deg", true), number("scales", false));
    if !section.has("axes") {
        section.known("axes");
        for key in ["phases_deg", "scales"] {
            if section.has(key) {
                let advice = "list the axes that move together, or take it out";
                section.problem(key, "`axes` beside it", "none", advice);
            }
        }
        let axis =
            section.whole_or("axis", 0, 0, AXES as u64 - 1, "index of the rig's axis, from 0")
                as usize;
        return (axis, movement, Vec::new());
    }
    section.misplaced("axis", "either one axis, or `axes`", "take one out");
    let listed = section
        .numbers("axes", bounds(0.0, AXES as f64 - 1.0, "indices of the rig's axes, from 0"));
    let axes: Vec<usize> = listed.iter().map(|&axis| axis as usize).collect();
    let whole = listed.iter().all(|axis| axis.fract() == 0.0);
    let apart = axes.iter().enumerate().all(|(at, axis)| !axes[..at].contains(axis));
    if !whole || !apart {
        section.problem(
            "axes",
            "whole indices, each once",
            format!("{listed:?}"),
            "write it as [0, 1]",
        );
    }
    for (key, values) in [("phases_deg", &phases), ("scales", &scales)] {
        if !values.is_empty() && values.len() != axes.len() {
            let expected = format!("one for each of the {} axes", axes.len());
            section.problem(key, expected, values.len(), "give as many as there are axes");
        }
    }
    let given_away = matches!(movement, Movement::Rest { .. } | Movement::Free { .. });
    let sines = matches!(movement, Movement::GuidedSine { .. } | Movement::Multisine { .. });
    if !phases.is_empty() && !sines {
        section.problem(
            "phases_deg",
            "a guided_sine or a multisine",
            movement.kind().name(),
            "take it out",
        );
    }
    if !scales.is_empty() && given_away {
        section.problem(
            "scales",
            "a movement of the machine",
            movement.kind().name(),
            "take it out",
        );
    }
    let alone = matches!(
        movement,
        Movement::Initialise(_) | Movement::Rhythm(_) | Movement::File(_) | Movement::Learn(_)
    );
    if alone && axes.len() > 1 {
        let expected = format!("one axis in a segment of kind {}", movement.kind().name());
        section.problem("axes", expected, axes.len(), "give each axis a segment of its own");
    }
    if matches!(movement, Movement::Chirp(_)) && scales.iter().any(|scale| *scale < 0.0) {
        section.problem(
            "scales",
            "0 or more for a chirp",
            format!("{scales:?}"),
            "a chirp is not mirrored",
        );
    }
    let mut movements = axes.iter().enumerate().map(|(at, &axis)| Companion {
        axis,
        movement: movement
            .ahead(phases.get(at).copied().unwrap_or(0.0).to_radians())
            .scaled(scales.get(at).copied().unwrap_or(1.0)),
    });
    let first = movements.next().unwrap_or(Companion { axis: 0, movement: movement.clone() });
    (first.axis, first.movement, movements.collect())
}

impl Movement {
    /// The same movement that much ahead (rad of each sine); one that is no sine stays.
    fn ahead(&self, phase: f64) -> Self {
        if phase == 0.0 {
            return self.clone();
        }
        match self.clone() {
            Self::GuidedSine {
                amplitude,
                frequency_hz,
                duration_s,
                centre,
                fade_in_s,
                fade_out_s,
            } => {
                let lines = vec![Line { amplitude, frequency_hz, phase }];
                Self::Multisine { lines, duration_s, centre, fade_in_s, fade_out_s }
            }
            Self::Multisine { mut lines, duration_s, centre, fade_in_s, fade_out_s } => {
                lines.iter_mut().for_each(|line| line.phase += phase);
                Self::Multisine { lines, duration_s, centre, fade_in_s, fade_out_s }
            }
            other => other,
        }
    }

    /// The same movement with all amplitudes and positions that many times as large; a negative
    /// factor mirrors it.
    fn scaled(&self, factor: f64) -> Self {
        if factor == 1.0 {
            return self.clone();
        }
        let mut movement = match self.clone() {
            // An amplitude is positive: what is mirrored is half a period ahead.
            sine @ Self::GuidedSine { .. } if factor <= 0.0 => sine.ahead(std::f64::consts::PI),
            other => other,
        };
        match &mut movement {
            Self::GuidedSine { amplitude, centre, .. } => {
                *amplitude *= factor;
                *centre *= factor;
            }
            Self::Multisine { lines, centre, .. } => {
                for line in lines {
                    line.amplitude *= factor.abs();
                    if factor < 0.0 && !matches!(self, Self::GuidedSine { .. }) {
                        line.phase += std::f64::consts::PI;
                    }
                }
                *centre *= factor;
            }
            Self::Steps { positions, .. } => {
                positions.iter_mut().for_each(|position| *position *= factor)
            }
            Self::Hold { position: Some(position), .. } => *position *= factor,
            Self::Centre(centre) => centre.position *= factor,
            Self::Ramp(ramp) => ramp.position *= factor,
            Self::Chirp(chirp) => {
                chirp.amplitude *= factor.abs();
                chirp.centre *= factor;
            }
            // Neither depends on a size, or the reader has refused several axes.
            Self::Hold { position: None, .. }
            | Self::Rest { .. }
            | Self::Free { .. }
            | Self::Initialise(_)
            | Self::Rhythm(_)
            | Self::File(_)
            | Self::Learn(_) => {}
        }
        movement
    }
}
