//! What a rig file with several axes has of one of them: its own parameters and effects, and its
//! products of inertia with the others.

use plant::coupled_axes::HandleCoupling;
use plant::effects::handle_coupling;
use rig::RigFile;
use toml_edit::{Array, ArrayOfTables, DocumentMut, Item, Table, TableLike, Value};

use super::values::{number, replace};
use crate::outcome::Outcome;
use crate::prediction_error::other_axes::{HANDLE_COUPLING, OtherAxis};

/// One axis's own table of a document.
fn axis_of(document: &mut DocumentMut, axis: usize) -> Option<&mut Table> {
    document.get_mut("axes")?.as_array_of_tables_mut()?.get_mut(axis)
}

/// The table `[axes.model]` of an axis, with an entry for the parameter: a copy of the common one
/// where the axis has none of its own.
pub(super) fn parameters<'d>(
    document: &'d mut DocumentMut,
    axis: usize,
    name: &str,
) -> Option<&'d mut dyn TableLike> {
    let common = |document: &DocumentMut| -> Option<Item> {
        let model = document.get("model")?.as_table_like()?;
        model.get("parameters")?.as_table_like()?.get(name).cloned()
    };
    let common = common(document);
    let own = axis_of(document, axis)?.entry("model").or_insert(Item::Table(Table::new()));
    let own = own.as_table_like_mut()?;
    if let Some(common) = common.filter(|_| own.get(name).is_none()) {
        own.insert(name, common);
    }
    Some(own)
}

/// Gives an axis a list of effects in place of its own and of those of every axis, which the other
/// axes keep.
pub(super) fn put_effects(document: &mut DocumentMut, axis: usize, list: Option<ArrayOfTables>) {
    let model = document.get_mut("model").and_then(Item::as_table_like_mut);
    let of_all = model.and_then(|model| model.remove("effects"));
    let of_all = of_all.and_then(|item| item.into_array_of_tables().ok());
    let axes = document.get_mut("axes").and_then(Item::as_array_of_tables_mut);
    for (at, own) in axes.into_iter().flat_map(ArrayOfTables::iter_mut).enumerate() {
        let effects = match (at == axis, &of_all) {
            (true, _) => {
                own.remove("effects");
                list.clone()
            }
            (false, None) => continue,
            (false, Some(of_all)) => {
                let before =
                    own.remove("effects").and_then(|item| item.into_array_of_tables().ok());
                let all = of_all.iter().chain(before.iter().flat_map(ArrayOfTables::iter));
                Some(all.map(|effect| Table::from_iter(effect.clone())).collect())
            }
        };
        if let Some(effects) = effects {
            own.insert("effects", Item::ArrayOfTables(effects));
        }
    }
}

/// Writes the products of inertia of an axis with the others, where they were fitted or an effect
/// adds to them; returns how many.
pub(super) fn put_coupling(
    document: &mut DocumentMut,
    rig: &RigFile,
    axis: usize,
    outcome: &Outcome,
) -> usize {
    let axes = rig.axes.len();
    let handle = HandleCoupling::of_pairs(axes, &rig.model.handle_coupling);
    let (mut handle, mut written) = (handle.unwrap_or_default(), 0);
    for other in OtherAxis::beside(rig, axis) {
        let name = other.parameter();
        let fitted = outcome.parameters.iter().find(|own| own.name == name);
        let beyond = outcome.effects.iter().filter(|effect| is_coupling(&effect.id));
        let mut beyond = beyond.flat_map(|effect| &effect.parameters);
        let beyond = handle_coupling::with_axis(other.index)
            .and_then(|with| beyond.find(|own| own.name == with));
        if fitted.is_some() || beyond.is_some() {
            let product = fitted.map_or(other.coupling_kg_m2, |own| own.fitted);
            handle.set((axis, other.index), product + beyond.map_or(0.0, |own| own.value));
            written += 1;
        }
    }
    if written > 0
        && let Some(model) = document.get_mut("model").and_then(Item::as_table_like_mut)
    {
        let list: Array = handle.pairs(axes).into_iter().map(number).collect();
        replace(model, HANDLE_COUPLING, Value::Array(list));
    }
    written
}

/// Whether an effect is the coupling of the handle, which a rig file declares as a constant.
pub(super) fn is_coupling(id: &str) -> bool {
    id == handle_coupling::ENTRY.id
}
