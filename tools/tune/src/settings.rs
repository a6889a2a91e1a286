//! What tuning may change of the control of an axis, listed once.

use toml_edit::{DocumentMut, Item, Table, value};

/// A choice among the options of position control.
#[derive(Clone, Copy, Debug)]
pub struct Setting {
    /// What it is, for people.
    pub name: &'static str,
    /// Values of [`SlaveLoop::lead_s`] that are tried (s); none for a choice without that loop.
    ///
    /// [`SlaveLoop::lead_s`]: rig::SlaveLoop::lead_s
    pub leads_s: &'static [f64],
    change: fn(&mut Table),
}

/// Tried lags of line and loop: around the 30 ms of the thesis's line (fig. 3.10).
const LEADS_S: &[f64] = &[0.01, 0.02, 0.03, 0.04, 0.05, 0.06];

/// The choices, from the simplest to that with the most parts.
pub const SETTINGS: &[Setting] = &[
    Setting { name: "control as it is", leads_s: &[], change: |_| {} },
    Setting {
        name: "feed-forward of the model's friction and inertia",
        leads_s: &[],
        change: identified,
    },
    Setting {
        name: "the same and a disturbance observer",
        leads_s: &[],
        change: |control| {
            identified(control);
            section(control, "observer");
        },
    },
    Setting {
        name: "feed-forward of the model and an outer loop on the slave",
        leads_s: LEADS_S,
        change: |control| {
            identified(control);
            section(control, "slave");
        },
    },
    Setting {
        name: "feed-forward of the model, outer loop and disturbance observer",
        leads_s: LEADS_S,
        change: |control| {
            identified(control);
            section(control, "observer");
            section(control, "slave");
        },
    },
];

fn identified(control: &mut Table) {
    if let Some(compensation) = section(control, "compensation") {
        compensation["kind"] = value("identified");
    }
}

/// The section, made if it is absent.
fn section<'t>(control: &'t mut Table, name: &str) -> Option<&'t mut Table> {
    let entry = control.entry(name).or_insert_with(|| Item::Table(Table::new()));
    let table = entry.as_table_mut()?;
    // A section without keys would not be written otherwise.
    table.set_implicit(false);
    Some(table)
}

impl Setting {
    /// The text of a rig file with this choice for an axis (from 0), and the lead of its outer loop
    /// where it has one (s); `None` where the text has no such axis.
    pub fn of(&self, text: &str, axis: usize, lead_s: Option<f64>) -> Option<String> {
        let mut document: DocumentMut = text.parse().ok()?;
        let axes = document.get_mut("axes")?.as_array_of_tables_mut()?;
        let control = section(axes.get_mut(axis)?, "control")?;
        (self.change)(control);
        if let Some(lead_s) = lead_s {
            section(control, "slave")?["lead_s"] = value(lead_s);
        }
        Some(document.to_string())
    }
}

#[cfg(test)]
mod tests {
    use rig::RigFile;

    use super::*;

    #[test]
    fn every_choice_makes_a_rig_file_that_differs_in_the_control_alone() {
        for shipped in ["hydrostatic", "cable"] {
            let rig = rig::load_rig(shipped.as_ref()).unwrap();
            for setting in SETTINGS {
                let lead_s = setting.leads_s.first().copied();
                let text = setting.of(rig.text(), 0, lead_s).unwrap();
                let changed = RigFile::parse(&text, "tuned.toml").unwrap();
                let options = changed.axes[0].control.options;
                assert_eq!(options.slave.map(|slave| slave.lead_s), lead_s, "{}", setting.name);
                assert!(changed.model == rig.model && changed.channels == rig.channels);
                let gains = |rig: &RigFile| rig.axes[0].control.position_gain;
                assert_eq!(gains(&changed), gains(&rig));
            }
        }
    }

    #[test]
    fn comments_and_other_keys_stay() {
        let text = "[[axes]]\n[axes.control] # gains\np = 1 # keep\n";
        let changed = SETTINGS[3].of(text, 0, Some(0.03)).unwrap();
        assert!(changed.contains("[axes.control] # gains\np = 1 # keep\n"), "{changed}");
        assert!(changed.contains("[axes.control.compensation]\nkind = \"identified\"\n"));
        assert!(changed.contains("[axes.control.slave]\nlead_s = 0.03\n"));
        assert!(SETTINGS[0].of("[model]\n", 0, None).is_none());
    }
}
