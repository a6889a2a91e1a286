//! Writes a rig file with the fitted parameters and the effects found.
//!
//! The text of the original is kept, comments and all; only values, tolerances and the list
//! `[[model.effects]]` change. A tolerance becomes five standard deviations, between a third and
//! the whole of the declared one: a standard deviation describes one set of records, and fits to
//! another set differ by more. The tolerance of a parameter that is not identifiable, or beside an
//! unlisted effect, stays as declared.
//!
//! A parameter that an effect exceeds stays as declared, too, with the excess as the effect beside
//! it: identify, which ignores declared effects, will then test for the excess again.

mod entries;
mod several_axes;
mod values;

use rig::{Parameter, RigFile};
use toml_edit::{ArrayOfTables, DocumentMut, InlineTable, Item, Table, TableLike, Value};

use crate::outcome::{FittedParameter, FoundEffect, Outcome, Verdict};
use crate::prediction_error::other_axes::is_handle_coupling;
use crate::prediction_error::transmission_model::{SMOOTHING, SMOOTHING_SHAPE};
use entries::{Entries, entries};
use several_axes::{is_coupling, put_coupling};
use values::{number, replace, rounded_up};

/// Parameters without a declared value that are needed to reproduce the fitted plant.
const OWN: [(&str, &str); 2] = [
    (SMOOTHING, "smooths dry friction near zero speed"),
    (SMOOTHING_SHAPE, "shape of that smoothing"),
];

/// Width of a tolerance, in standard deviations.
const DEVIATIONS: f64 = 5.0;
/// Least share of the declared tolerance.
const LEAST: f64 = 1.0 / 3.0;

/// The text to be written, and what it leaves out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Written {
    /// The text of the rig file; `None` if nothing is to be written.
    pub text: Option<String>,
    /// Summary: parameters, effects.
    pub told: String,
    /// What is left out, and why.
    pub left_out: Vec<String>,
}

/// Why the rig file cannot be changed: with the file, the key, what was expected and found.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct WriteRigError(String);

/// Returns the text of the rig file `file` with the result of an identification.
///
/// # Errors
/// [`WriteRigError`]; the text that is returned can be read as a rig file.
pub fn fitted(
    text: &str,
    file: &str,
    outcome: &Outcome,
    provenance: &Provenance,
) -> Result<Written, WriteRigError> {
    if outcome.early {
        let what = "no rig file: the answer is early, and its parameters may not be those of the \
                    best fit; identify again with a larger --limit-s";
        return Ok(Written { text: None, told: String::new(), left_out: vec![what.to_owned()] });
    }
    if outcome.verdict == Verdict::Ambiguous {
        let (found, rivals) = (outcome.named().join(" or "), outcome.rivals().join(" or "));
        let what = format!(
            "no rig file: these records cannot distinguish {found} from {rivals}, and each would \
             come with its own parameters"
        );
        return Ok(Written { text: None, told: String::new(), left_out: vec![what] });
    }
    let mut document: DocumentMut = text.parse().map_err(|error: toml_edit::TomlError| {
        WriteRigError(format!("{file}: expected a rig file, found {error}"))
    })?;
    let read = |text: &str| {
        RigFile::parse_declaration(text, file).map_err(|problems| {
            WriteRigError(format!(
                "the rig file is not written, because it could not be used:\n{problems}\nmend \
                 these keys in {file} and run identify again"
            ))
        })
    };
    let rig = read(text)?;
    let Entries { mut effects, beside, mut left_out } = entries(outcome, &rig.model);
    effects.retain(|effect| !is_coupling(&effect.id));
    // Of a rig with several axes, the result is of one.
    let axis =
        outcome.axis.as_ref().and_then(|name| rig.axes.iter().position(|axis| axis.name == *name));
    let mut count = axis.map_or(0, |axis| put_coupling(&mut document, &rig, axis, outcome));
    for parameter in outcome.parameters.iter().filter(|p| is_of_file(p)) {
        // What an axis has in common with the others stays there.
        let stays = axis.is_some() && parameter.std.is_none() && is_as_declared(parameter);
        if !stays && !beside.contains(&parameter.name.as_str()) {
            put_parameter(&mut document, (file, axis), parameter, !outcome.remains)?;
            count += 1;
        }
    }
    put_effects(&mut document, &effects, axis);
    let text = with_provenance(&document.to_string(), outcome, provenance);
    read(&text)?;
    if outcome.remains {
        let of = outcome.unlisted.as_ref().map_or(String::new(), |unlisted| {
            let over = unlisted
                .variable()
                .map_or(String::new(), |on| format!(", over {}", on.replace('_', " ")));
            format!(" (at the {}{over})", unlisted.site)
        });
        left_out.push(format!(
            "the residual that no listed effect explains{of}; tolerances stay as declared, since \
             it may bias the parameters"
        ));
    }
    let counted = |count: usize, what: &str| match count {
        0 => format!("no {what}"),
        1 => format!("1 {what}"),
        many => format!("{many} {what}s"),
    };
    let (parameters, effects) = (counted(count, "parameter"), counted(effects.len(), "effect"));
    let told = format!("{parameters} as fitted, {effects}");
    Ok(Written { text: Some(text), told, left_out })
}

/// When and by what a rig file is written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Provenance {
    /// Date (UTC), `2026-11-23`.
    pub date: String,
    /// Revision of the program.
    pub revision: String,
}

impl Provenance {
    /// Written today (UTC) by a program of this revision.
    pub fn today(revision: &str) -> Self {
        let now = humantime::format_rfc3339_seconds(std::time::SystemTime::now()).to_string();
        let date = now.split('T').next().unwrap_or_default().to_owned();
        Self { date, revision: revision.to_owned() }
    }
}

/// First words of the lines at the top of a file that tell where its fitted values come from.
const PROVENANCE: [&str; 4] =
    ["# Fitted by `farreach identify`", "#   to fit: ", "#   to select: ", "#   to report: "];

/// The text under a header with date, revision and records, in place of an earlier one.
fn with_provenance(text: &str, outcome: &Outcome, provenance: &Provenance) -> String {
    let is_old = |line: &&str| PROVENANCE.iter().any(|start| line.starts_with(start));
    let Provenance { date, revision } = provenance;
    let roles = [&outcome.records.fit, &outcome.records.select, &outcome.records.report];
    let mut header = format!("{} on {date}, revision {revision}, to records\n", PROVENANCE[0]);
    for (start, names) in PROVENANCE[1..].iter().zip(roles) {
        let names: Vec<String> = names.iter().map(|name| name.replace(['\n', '\r'], " ")).collect();
        header += &format!("{start}{}\n", names.join(", "));
    }
    let kept = text.lines().skip_while(is_old).flat_map(|line| [line, "\n"]);
    header + &kept.collect::<String>()
}

/// Whether a parameter has a place among those of the rig file.
fn is_of_file(parameter: &FittedParameter) -> bool {
    !is_handle_coupling(&parameter.name)
        && (parameter.declared.is_some() || own(&parameter.name).is_some())
}

/// Describes a parameter without a declared value.
fn own(name: &str) -> Option<&'static str> {
    OWN.iter().find(|(own, _)| *own == name).map(|(_, what)| *what)
}

/// The table that holds a parameter: of several axes that of `axis`; of one axis its own if it has
/// the parameter, else that of the model.
fn table_of<'d>(
    document: &'d mut DocumentMut,
    name: &str,
    axis: Option<usize>,
) -> Option<&'d mut dyn TableLike> {
    if let Some(axis) = axis {
        return several_axes::parameters(document, axis, name);
    }
    let of_axis = |document: &DocumentMut| {
        document
            .get("axes")?
            .as_array_of_tables()?
            .get(0)?
            .get("model")?
            .as_table_like()?
            .get(name)
            .map(|_| ())
    };
    if of_axis(document).is_some() {
        return document
            .get_mut("axes")?
            .as_array_of_tables_mut()?
            .get_mut(0)?
            .get_mut("model")?
            .as_table_like_mut();
    }
    let model = document.entry("model").or_insert(Item::Table(Table::new())).as_table_like_mut()?;
    model.entry("parameters").or_insert(Item::Table(Table::new())).as_table_like_mut()
}

fn put_parameter(
    document: &mut DocumentMut,
    (file, axis): (&str, Option<usize>),
    parameter: &FittedParameter,
    narrow: bool,
) -> Result<(), WriteRigError> {
    let name = parameter.name.as_str();
    let wrong = |found| {
        WriteRigError(format!(
            "{file}: model.parameters.{name}: expected a number or a table with `value`, found \
             {found}"
        ))
    };
    let table = table_of(document, name, axis).ok_or_else(|| wrong("no table of parameters"))?;
    if table.get(name).is_none() {
        let comment = own(name).map_or(String::new(), |what| format!("     # estimated: {what}"));
        table.insert(name, Item::Value(number(parameter.fitted).decorated(" ", comment)));
        return Ok(());
    }
    let item = table.get_mut(name).ok_or_else(|| wrong("nothing"))?;
    if let Item::Value(value) = item
        && (value.is_float() || value.is_integer())
    {
        // A bare number has the default tolerance.
        let decor = value.decor().clone();
        let mut entry = InlineTable::new();
        entry.insert("value", value.clone());
        *value = Value::InlineTable(entry);
        *value.decor_mut() = decor;
    }
    let entry = item.as_table_like_mut().ok_or_else(|| wrong("something else"))?;
    let unchanged = number_of(entry, "value").is_some_and(|value| is_same(value, parameter));
    if !unchanged {
        replace(entry, "value", number(parameter.fitted));
    }
    let std = parameter.std.filter(|_| narrow && parameter.identifiable);
    if let Some(std) = std {
        let (key, most, std) = match number_of(entry, "tolerance_absolute") {
            Some(absolute) => ("tolerance_absolute", absolute, std),
            None => {
                let share = std / parameter.fitted.abs().max(f64::MIN_POSITIVE);
                (
                    "tolerance",
                    number_of(entry, "tolerance").unwrap_or(Parameter::DEFAULT_TOLERANCE),
                    share,
                )
            }
        };
        let tolerance = rounded_up((DEVIATIONS * std).clamp(LEAST * most, most)).min(most);
        replace(entry, key, Value::from(tolerance));
    }
    if !unchanged || std.is_some() {
        replace(entry, "source", Value::from("fitted"));
    }
    if let Item::Value(Value::InlineTable(entry)) = item {
        entry.fmt();
    }
    Ok(())
}

/// Whether a value is that which was fitted.
fn is_same(value: f64, parameter: &FittedParameter) -> bool {
    (value - parameter.fitted).abs() <= 1e-9 * value.abs()
}

/// Whether a parameter was fitted to its declared value.
fn is_as_declared(parameter: &FittedParameter) -> bool {
    parameter.declared.is_some_and(|declared| is_same(declared, parameter))
}

/// A number of an entry.
fn number_of(entry: &dyn TableLike, key: &str) -> Option<f64> {
    let item = entry.get(key)?;
    item.as_float().or(item.as_integer().map(|whole| whole as f64))
}

/// Replaces the list of effects: of one axis where there are several.
fn put_effects(document: &mut DocumentMut, effects: &[FoundEffect], axis: Option<usize>) {
    let list = (!effects.is_empty()).then(|| effect_tables(effects));
    if let Some(axis) = axis {
        return several_axes::put_effects(document, axis, list);
    }
    let Some(model) = document.get_mut("model").and_then(Item::as_table_like_mut) else { return };
    model.remove("effects");
    if let Some(list) = list {
        model.insert("effects", Item::ArrayOfTables(list));
    }
}

/// Effects as entries of a list.
fn effect_tables(effects: &[FoundEffect]) -> ArrayOfTables {
    let mut list = ArrayOfTables::new();
    for (at, effect) in effects.iter().enumerate() {
        let mut entry = Table::new();
        let before =
            if at == 0 { "\n# Found in measured records by `farreach identify`.\n" } else { "\n" };
        entry.decor_mut().set_prefix(before);
        entry.insert("id", toml_edit::value(effect.id.as_str()));
        entry.insert("site", toml_edit::value(effect.site.as_str()));
        let mut parameters = InlineTable::new();
        for parameter in &effect.parameters {
            parameters.insert(&parameter.name, number(parameter.value));
        }
        entry.insert("parameters", toml_edit::value(parameters));
        list.push(entry);
    }
    list
}
