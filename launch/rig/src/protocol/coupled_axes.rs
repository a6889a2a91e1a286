//! Coupled axes: several axes in one segment, by `axes` with `phases_deg` and `scales`.

use ipc_types::AXES;

use super::movement::Movement;
use crate::checked_toml::{Section, bounds};

/// The movement of a coupled axis.
#[derive(Clone, Debug, PartialEq)]
pub struct Companion {
    /// The axis.
    pub axis: usize,
    /// Its movement, of the same duration as the segment's own.
    pub movement: Movement,
}

/// Reads `axis`, or `axes` with their phases and scales; returns the first axis, its movement, and
/// the others.
pub(super) fn read(section: &Section<'_>, movement: Movement) -> (usize, Movement, Vec<Companion>) {
    let phase = bounds(-360.0, 360.0, "in degrees, ahead of the segment's own movement");
    let phases = section.numbers_or_none("phases_deg", phase).unwrap_or_default();
    let scale = bounds(-1.0, 1.0, "a part of the segment's own amplitude");
    let scales = section.numbers_or_none("scales", scale).unwrap_or_default();
    let index = bounds(0.0, AXES as f64 - 1.0, "indices of the rig's axes, from 0");
    let Some(listed) = section.numbers_or_none("axes", index) else {
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
    };
    section.misplaced("axis", "either one axis, or `axes`", "take one out");
    let axes: Vec<usize> = listed.iter().map(|&axis| axis as usize).collect();
    let whole = listed.iter().all(|axis| axis.fract() == 0.0);
    let apart = axes.iter().enumerate().all(|(at, axis)| !axes[..at].contains(axis));
    if !whole || !apart {
        let advice = "write it as [0, 1]";
        section.problem("axes", "whole indices, each once", format!("{listed:?}"), advice);
    }
    for (key, values) in [("phases_deg", &phases), ("scales", &scales)] {
        if !values.is_empty() && values.len() != axes.len() {
            let expected = format!("one for each of the {} axes", axes.len());
            section.problem(key, expected, values.len(), "give as many as there are axes");
        }
    }
    if movement.single_axis() && axes.len() > 1 {
        let expected = format!("one axis in a segment of kind {}", movement.kind());
        section.problem("axes", expected, axes.len(), "give each axis a segment of its own");
        return (axes[0], movement, Vec::new());
    }
    let mut movements = axes.iter().enumerate().map(|(at, &axis)| {
        let mut movement = movement.clone();
        let phase = phases.get(at).copied().unwrap_or(0.0).to_radians();
        let scale = scales.get(at).copied().unwrap_or(1.0);
        if phase != 0.0 && !movement.advance_phase(phase) {
            let expected = "a guided_sine or a multisine";
            section.problem("phases_deg", expected, movement.kind(), "take it out");
        }
        if scale != 1.0
            && let Err((expected, advice)) = movement.scale(scale)
        {
            let found = format!("{} with {scale}", movement.kind());
            section.problem("scales", expected, found, advice);
        }
        Companion { axis, movement }
    });
    let first = movements.next().unwrap_or(Companion { axis: 0, movement: movement.clone() });
    (first.axis, first.movement, movements.collect())
}
