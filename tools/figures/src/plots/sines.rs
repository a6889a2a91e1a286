//! Fig. 3.3: master and slave over time.

use anyhow::Result;
use report::Panels;

use super::{Common, Plot, over_cycle};
use crate::simulated_line::Line;
use crate::simulated_response::cycle;
use crate::table_row::{Role, Row};

/// Fig. 3.3.
///
/// # Errors
/// Where a constant is out of range.
pub fn movement(common: &Common) -> Result<Plot> {
    let printed = Line::printed();
    let traced = &common.calibration.line;
    let (printed_cycle, traced_cycle) = (cycle(&printed, 1.0)?, cycle(traced, 1.0)?);
    let (slow, fast) = (cycle(traced, 0.2)?, cycle(traced, 2.0)?);
    let panels = Panels::new("Fig. 3.3, master and slave along a sine")
        .panel(over_cycle("1 Hz, printed constants", &printed_cycle, ("master", 1.0)))
        .panel(over_cycle("1 Hz, traced line", &traced_cycle, ("master", 1.0)))
        .panel(over_cycle("0.2 Hz, traced line", &slow, ("master", 1.0)))
        .panel(over_cycle("2 Hz, traced line", &fast, ("master", 1.0)));
    let caption = format!(
        "Master (full) and slave (dashed) over one settled cycle; the master is moved along a sine \
            of ±{:.0}° (the thesis prints no amplitude). The slave's flat tops are its friction: \
            it stands still until the line has been wound up to break it loose, for up to {:.0} ms \
            with the printed constants and {:.0} ms with the traced line. The lag of the slave's \
            fundamental at 1 Hz is {:.1} and {:.1} ms; about 30 ms were measured. The small kink \
            in the thesis's master curve is absent: a given path has none, it comes with the \
            controller.",
        printed.amplitude_deg,
        1e3 * printed_cycle.flat_top_s(),
        1e3 * traced_cycle.flat_top_s(),
        1e3 * printed_cycle.response.lag_s(),
        1e3 * traced_cycle.response.lag_s(),
    );
    let cycles = [&printed_cycle, &traced_cycle];
    let lags = cycles.map(|cycle| Some(cycle.response.lag_s()));
    let flat_tops = cycles.map(|cycle| Some(cycle.flat_top_s()));
    let rows = vec![
        Row::beside("hydrostatic.delay_measured.delay_s", Role::Predicted, lags)?
            .note("lag of the slave's fundamental at 1 Hz, ±30°"),
        Row::own("own.flat_top_1hz_s", "3.3", "s", flat_tops)
            .note("longest time for which the slave stands still, 1 Hz, ±30°"),
    ];
    Ok(Plot { number: "3.3", title: "Movement along a sine", caption, panels, rows })
}
