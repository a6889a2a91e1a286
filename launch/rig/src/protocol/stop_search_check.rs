//! What may stand beside a search for the stops, on a rig whose axes have a range of motion.
//!
//! The search leaves the range on purpose, and the watchdog lets it, with all axes, until the
//! handles are back. So nobody may hold a handle, and the protocol does nothing else but to bring
//! them back.

use super::movement::Movement;
use super::segment::Segment;
use crate::checked_toml::Source;
use crate::rig_file::RigFile;

/// Whether a segment is one of a protocol that is played with nobody at the handle: a search, or a
/// movement to a position, and no session.
const fn is_for_nobody(segment: &Segment) -> bool {
    let comes_back = matches!(
        segment.movement,
        Movement::Initialise(_) | Movement::Centre(_) | Movement::Hold(_)
    );
    comes_back && !segment.session
}

/// Reports every segment that a person would take part in, where another one searches for the stops
/// and an axis of the rig has a range of motion.
pub(super) fn check_stop_search(segments: &[Segment], rig: &RigFile, source: &Source<'_>) {
    let mut with_range = rig.axes.iter().enumerate().filter(|(_, of)| of.range_of_motion.is_some());
    let Some((index, axis)) = with_range.next() else { return };
    let searches = |segment: &Segment| matches!(segment.movement, Movement::Initialise(_));
    if !segments.iter().any(searches) {
        return;
    }
    for segment in segments.iter().filter(|segment| !is_for_nobody(segment)) {
        let expected = format!(
            "only initialise, centre and hold, and no session, beside a search for the stops: it \
             leaves the range of motion of axis {index} (\"{}\"), with nobody at the handle",
            axis.name
        );
        let what = if segment.session { "session" } else { segment.movement.kind() };
        let found = format!("a {what} (\"{}\")", segment.label);
        let advice = "home the rig first, with nobody at the handle, and take the search out here";
        source.problem(&format!("{}.kind", segment.section), expected, found, advice);
    }
}
