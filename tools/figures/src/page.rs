//! The page: the calibration, then every figure.

use anyhow::Result;
use plant::hydrostatic::compliance::Explanations;
use report::{Page, Table, Tone};

use crate::calibration::alternatives::{Alternative, held_rows};
use crate::calibration::cable::{CableCell, cut_off_range_hz};
use crate::calibration::sensitivity::Friction;
use crate::guided;
use crate::published::published;
use crate::study::Study;
use crate::table_row::{Row, short};

/// Under each table of values.
const VALUES: &str = "Published value, the model with the printed constants, the model with the \
    traced line, and the traced line's error. Rows of kind \"own\" are not in the thesis.";

/// The page of a study; `json` is what `--json` prints.
///
/// # Errors
/// Where a published value is missing from the table.
pub fn page(study: &Study, json: &str) -> Result<Page> {
    let (sentence, detail) = verdict(study)?;
    let mut page = Page::new("The thesis's figures from the models")
        .subtitle(
            "Published values beside ours, with the printed constants and with the traced line.",
        )
        .verdict(Tone::Warning, &sentence, &detail);
    page = calibration(page, study)?;
    for figure in &study.plots {
        page = page
            .heading(&format!("Figure {}  {}", figure.number, figure.title))
            .panels(&figure.panels.clone().columns(2), &figure.caption)
            .table(values(&figure.rows), VALUES);
    }
    page = guided::on_page(page, &study.common.guided);
    Ok(page
        .details("All values as written by --json", json)
        .footer(concat!("farreach figures ", env!("CARGO_PKG_VERSION"))))
}

/// The result in two sentences.
///
/// # Errors
/// Where a published value is missing from the table.
pub fn verdict(study: &Study) -> Result<(String, String)> {
    let calibration = &study.common.calibration;
    let (p, t) = (&calibration.printed, &calibration.traced);
    let measured = published("hydrostatic.frequency_response_measured.resonance_hz")?.value;
    let sentence = format!(
        "The printed constants peak at {} Hz; the rig peaked at {measured} Hz. A line {} times \
            softer peaks there.",
        short(p.peak_hz),
        short(1.0 / calibration.factor)
    );
    let holds = study.conclusions.iter().filter(|conclusion| conclusion.survives()).count();
    let detail = format!(
        "Fitted to that one number, it predicts a cut-off of {} Hz (measured 12), a lag of {} ms \
            at 1 Hz (measured about 30) and, at 1 m, a peak of {} Hz (eq. 3.3.2: 49.2). Amplitude \
            and friction of the measurement are not known: of {} statements tried over both, \
            {holds} hold everywhere.",
        short(t.cut_off_hz),
        short(t.lag_1hz_s.map(|lag| 1e3 * lag)),
        short(t.short_peak_hz),
        study.conclusions.len()
    );
    Ok((sentence, detail))
}

fn calibration(page: Page, study: &Study) -> Result<Page> {
    let share = |friction: Friction| short(friction.factor());
    Ok(page
        .heading("Calibration against published measurements")
        .paragraph(
            "One parameter, the stiffness of the line, was fitted to one number, the measured \
                resonance. Everything else is predicted. Each alternative to a softer line was \
                fitted so that it, too, peaks at 8 Hz, and then had to predict the same values.",
        )
        .table(
            explanations(study)?,
            "Explanations of the measured 8 Hz. The miss is the root mean square of \
                ln(predicted/published), over the two rows measured on the rig, and over all five. \
                A dash: no size gives 8 Hz. None: there is no such cut-off or peak within five \
                times the resonance; an explanation with such a row is not ranked.",
        )
        .paragraph(&alternatives_text(study)?)
        .paragraph(&softening_words(study))
        .table(
            statements(study),
            "Statements tested in every cell of the grid below. A statement holds only where no \
                cell contradicts it.",
        )
        .table(
            grid_cells(study),
            &format!(
                "The same fit over what the thesis leaves open. Friction as printed (2.74 N·m at \
                    the motor), as measured (0.95 N·m, {} times the printed), and half-way ({} \
                    times). Gain and lag at 1 Hz.",
                share(Friction::Measured),
                share(Friction::Between)
            ),
        )
        .paragraph(&cable_words(study)?)
        .table(
            cable_cells(&study.cable),
            "The cable's stiffness, fitted separately for each amplitude and each damping of half \
                a cable. The thesis prints neither.",
        ))
}

/// The softening expressed as a property of hose, oil or belts.
fn softening_words(study: &Study) -> String {
    let by = study.common.calibration.softening_as();
    format!(
        "Possible causes of such a softening, each taken alone: a hose wall of {} GPa (2 mm thick, \
            assumed; polyamide has 1 to 3 GPa), {} % of gas in the oil by volume (badly bled oil \
            holds as much), belts of {} kN/m (a toothed belt of 10 mm is ten times stiffer), or a \
            bulk modulus of {} GPa where 1.86 is printed. Within the usual range: {}. The \
            published numbers cannot tell compliance from a misprinted bulk modulus: the gains \
            simulated with the one and with the other differ by at most {}.",
        short(1e-9 * by.wall_modulus_pa),
        short(1e2 * by.gas_fraction),
        short(1e-3 * by.belt_stiffness_n_per_m),
        short(1e-9 * by.bulk_modulus_pa),
        plausible(&by),
        short(study.common.calibration.misprint_difference),
    )
}

/// Every statement, and in how many cells of the grid it fails.
fn statements(study: &Study) -> Table {
    Table::new(["holds", "statement", "over the grid"]).rows(study.conclusions.iter().map(|of| {
        let holds = match of.against.len() {
            0 => "yes".to_owned(),
            against => format!("no ({against} of {} cells against)", study.cells.len()),
        };
        let range = of.range.map_or_else(String::new, |(low, high, unit)| {
            format!("{} to {} {}", short(low), short(high), if unit == "1" { "" } else { unit })
        });
        [holds, of.statement.clone(), range]
    }))
}

/// The fit in each cell of the grid over friction and amplitude.
fn grid_cells(study: &Study) -> Table {
    let head = "friction | amplitude / ° | times softer | cut-off / Hz | lag / ms | gain | \
        1 m: peak / Hz | 1 m: cut-off / Hz";
    Table::new(head.split(" | ")).rows(study.cells.iter().map(|cell| {
        let t = &cell.traced;
        [
            cell.friction.name().to_owned(),
            format!("{:.0}", cell.amplitude_deg),
            short(cell.factor.map(|factor| 1.0 / factor)),
            short(t.cut_off_hz),
            short(t.lag_1hz_s.map(|lag| 1e3 * lag)),
            short(t.low_frequency_gain),
            short(t.short_peak_hz),
            short(t.short_cut_off_hz),
        ]
    }))
}

/// Result of the cable's fit over its own grid.
fn cable_words(study: &Study) -> Result<String> {
    let measured = published("cable.cutoff_hz")?.value;
    Ok(match cut_off_range_hz(&study.cable) {
        Some((low, high)) => {
            let off = |cut_off: f64| format!("{:+.0} %", 100.0 * (cut_off / measured - 1.0));
            format!(
                "The cable transmission too has one number fitted, the stiffness of its cables, to \
                    the same 8 Hz. It then cuts off at {} to {} Hz, by amplitude and damping, \
                    where {measured} Hz were measured ({} to {}).",
                short(low),
                short(high),
                off(low),
                off(high)
            )
        }
        None => {
            "The cable transmission too has one number fitted, the stiffness of its cables, to the \
                same 8 Hz; not every amplitude and damping below has such a stiffness and a \
                cut-off."
                .to_owned()
        }
    })
}

fn cable_cells(cells: &[CableCell]) -> Table {
    let head = "amplitude of the slave / ° | damping / (N·s/m) | times softer | gain at the peak | \
        cut-off / Hz";
    Table::new(head.split(" | ")).rows(cells.iter().map(|cell| {
        [
            format!("{:.0}", cell.amplitude_deg),
            format!("{:.1}", cell.damping_n_s_per_m),
            short(cell.factor.map(|factor| 1.0 / factor)),
            short(cell.peak_gain),
            short(cell.cut_off_hz),
        ]
    }))
}

/// Which of the explanations of a softer line lie in the usual range of such parts.
fn plausible(by: &Explanations) -> String {
    let judged = [
        // Polyurethane to polyamide; gas in a badly bled line; a toothed belt of 5 mm or wider on
        // half a metre.
        ("the hose wall", (5e7..=4e9).contains(&by.wall_modulus_pa)),
        ("the gas", by.gas_fraction <= 0.01),
        ("the belts", by.belt_stiffness_n_per_m >= 5e4),
    ];
    let names: Vec<&str> = judged.iter().filter(|judged| judged.1).map(|judged| judged.0).collect();
    if names.is_empty() { "none".to_owned() } else { names.join(", ") }
}

/// What each explanation of the measured resonance predicts, in a column of its own.
fn explanations(study: &Study) -> Result<Table> {
    let dash = || "–".to_owned();
    let row = |[name, published, printed]: [String; 3], cell: &dyn Fn(&Alternative) -> String| {
        let cells = study.alternatives.iter().map(cell);
        [name, published, printed].into_iter().chain(cells).collect::<Vec<String>>()
    };
    let printed = &study.common.calibration.printed;
    let resonance = published("hydrostatic.frequency_response_measured.resonance_hz")?;
    let name = format!("resonance / Hz, {}, fitted", resonance.kind.name());
    let header = ["row", "published", "as printed"].map(str::to_owned);
    let mut table = Table::new(row(header, &|of| of.short.to_owned()))
        .row(row(["size, fitted".to_owned(), dash(), dash()], &|of| match of.size {
            Some(size) if of.unit == "1" => short(size),
            Some(size) => format!("{} {}", short(size), of.unit),
            None => dash(),
        }))
        .row(row([name, short(resonance.value), short(printed.peak_hz)], &|of| {
            short(of.prediction.peak_hz)
        }));
    let names = "cut-off / Hz | lag at 1 Hz / s | low-frequency gain | peak at 1 m / Hz | \
        cut-off at 1 m / Hz";
    for (name, (published, read)) in names.split(" | ").zip(held_rows()?) {
        let name = format!("{name}, {}, predicted", published.kind.name());
        let head = [name, short(published.value), short(read(printed))];
        table = table.row(row(head, &|of| match read(&of.prediction) {
            None if of.size.is_some() => "none".to_owned(),
            value => short(value),
        }));
    }
    for (name, only_measured) in [("miss, measured / %", true), ("miss, all / %", false)] {
        let miss = |of: &Alternative| of.miss_percent(only_measured);
        let misses = study.alternatives.iter().map(miss).collect::<Result<Vec<_>>>()?;
        let head = [name.to_owned(), dash(), dash()];
        table =
            table.row(head.into_iter().chain(misses.into_iter().map(short)).collect::<Vec<_>>());
    }
    Ok(table)
}

/// What the explanations are, and which of them misses least.
fn alternatives_text(study: &Study) -> Result<String> {
    let all = &study.alternatives;
    let mut words: Vec<String> =
        all.iter().map(|of| format!("{}: {}.", capital(of.short), of.what)).collect();
    let without: Vec<&str> = all.iter().filter(|of| of.size.is_none()).map(|of| of.short).collect();
    if !without.is_empty() {
        words.push(format!("No size gives 8 Hz: {}.", without.join(", ")));
    }
    for (rows, only_measured) in [("the rows measured on the rig", true), ("all five rows", false)]
    {
        let mut misses = Vec::new();
        for of in all {
            misses.extend(of.miss_percent(only_measured)?.map(|miss| (miss, of.short)));
        }
        if let Some((miss, name)) = misses.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)) {
            words.push(format!("On {rows} \"{name}\" misses least, by {} %.", short(miss)));
        }
    }
    Ok(words.join(" "))
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

/// The table under a figure.
fn values(rows: &[Row]) -> Table {
    let head = "value | unit | role | kind | published | as printed | traced | error / %";
    Table::new(head.split(" | ")).rows(rows.iter().map(|row| {
        [
            row.id.replace("hydrostatic.", "").replace("own.", "").replace('_', " "),
            row.unit.clone(),
            row.role.name().to_owned(),
            row.kind.unwrap_or("own").to_owned(),
            short(row.published),
            short(row.printed_constants),
            short(row.traced),
            row.traced_error_percent.map_or("–".to_owned(), |error| format!("{error:+.0}")),
        ]
    }))
}
