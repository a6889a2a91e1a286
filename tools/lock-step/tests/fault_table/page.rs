//! `docs/faults.md`, from the list of faults and the figures of this test.

use std::fmt::Write as _;
use std::path::Path;

use simulator::faults::{FaultKind, LIST, Promise};

use crate::{Outcome, Row};

const TEMPLATE: &str = include_str!("faults.txt");

/// Compares the page in the tree with list and figures; with `UPDATE_PAGES=1` writes it.
pub(crate) fn check(rows: &[Row]) {
    let page = TEMPLATE.replace("{kinds}\n", &kinds()).replace("{figures}\n", &figures(rows));
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/faults.md");
    if std::env::var_os("UPDATE_PAGES").is_some_and(|value| value == "1") {
        std::fs::write(&path, &page).unwrap();
    }
    let found = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(
        found == page,
        "faults.md is stale: UPDATE_PAGES=1 cargo test -p lock-step --test fault_table\n{page}"
    );
}

fn kinds() -> String {
    let mut text = String::from(
        "| fault | acts in | size | what it does | once cleared |\n|---|---|---|---|---|\n",
    );
    for kind in LIST {
        let FaultKind { acts, what, after, .. } = kind;
        let (name, size) = (name(kind), size(kind));
        writeln!(text, "| {name} | {acts} | {size} | {what} | {after} |").unwrap();
    }
    text
}

fn name(kind: &FaultKind) -> String {
    let places: Vec<_> = kind.places.iter().map(|place| place.word()).collect();
    let places = if places.is_empty() { String::new() } else { format!("@{}", places.join("\\|")) };
    let only = kind.only.map_or_else(String::new, |only| format!(" ({})", only.name()));
    format!("`{}{places}`{only}", kind.name)
}

fn size(kind: &FaultKind) -> String {
    let Some(size) = kind.size else { return "–".to_owned() };
    format!("{} {} ({})", size.default, size.unit, size.what)
}

fn figures(rows: &[Row]) -> String {
    let mut text = String::from(
        "| fault | promised | hydrostatic: noticed by | ticks to 0 V | cable: noticed by \
         | ticks to 0 V |\n|---|---|---|---|---|---|\n",
    );
    for Row { text: fault, promise, outcomes } in rows {
        write!(text, "| `{fault}` | {} |", promised(promise)).unwrap();
        for outcome in outcomes {
            write!(text, " {} |", cells(outcome.as_ref())).unwrap();
        }
        text.push('\n');
    }
    text
}

fn promised(promise: &Promise) -> String {
    let causes = |causes: &[ipc_types::TripCause]| {
        causes.iter().map(|cause| cause.text()).collect::<Vec<_>>().join(" or ")
    };
    match promise {
        Promise::Trips(by, within) => format!("{}, {within} ticks", causes(by)),
        Promise::AtALimit(_) => "only what passes a limit".to_owned(),
        Promise::NotNoticed => "nothing".to_owned(),
    }
}

fn cells(outcome: Option<&Outcome>) -> String {
    let Some(outcome) = outcome else { return "– | –".to_owned() };
    let by = outcome.trip.map_or("not noticed", |cause| cause.text());
    let ticks = outcome.to_zero.map_or_else(|| "never".to_owned(), |ticks| ticks.to_string());
    format!("{by} | {ticks}")
}
