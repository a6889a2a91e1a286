//! Generates `docs/rig-file.md` and `docs/protocols.md` from what the reader accepts, and fails
//! where the pages in the tree differ.
//!
//! After a change of a key: `UPDATE_PAGES=1 cargo test -p rig pages`, then commit the pages.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::fmt::Write;
use std::path::Path;

use toml::de::DeTable;

use crate::checked_toml::{Documented, Keys, Section, Source, stands_for};
use crate::protocol::{Protocol, WORDS};
use crate::rig_file::{Purpose, RigFile};

/// Every section that the reader knows; the values need not be valid.
const RIG: &str = r#"
[rates]
[phases_us]
[[axes]]
unit = "UNIT"
[axes.master]
[axes.slave]
[axes.torque]
[axes.limits]
position_max_deg = 40.0
position_max_m = 0.4
volts_max = 5.0
[axes.range_of_motion]
[axes.homing]
method = "stops"
upper_stop_deg = 40.0
upper_stop_m = 0.4
[axes.control.force]
[axes.control.feedforward]
friction_peak_v = 1.5
[axes.control.compensation]
[axes.control.observer]
[axes.control.slave]
[[axes.effects]]
[[channels]]
[emg]
[scanner]
[sync]
[comedi]
[[comedi.calibration]]
[[comedi.axes]]
[comedi.axes.master]
[comedi.axes.slave]
[comedi.axes.master_fault]
[comedi.enable_line]
[comedi.motor_power]
[comedi.digital.inputs]
[comedi.digital.outputs]
[model]
[model.parameters]
name = { value = 1.0 }
[[model.effects]]
[replay]
[simulation.hand]
"#;

/// Keys of all kinds of segments, in one unit and of one duration.
const SEGMENT: &str = r#"
[[segments]]
kind = "KIND"
law = "LAW"
duration_s = DURATION
amplitude_UNIT = 1.0
centre_UNIT = 0.0
position_UNIT = 0.0
positions_UNIT = [0.0]
speed_UNIT_s = 1.0
wall_min_UNIT = 0.0
wall_max_UNIT = 1.0
MORE
"#;

/// What the reader of some texts accepts.
#[derive(Default)]
struct Accepted {
    tables: Vec<(&'static str, Keys)>,
    keys: Vec<Documented>,
}

impl Accepted {
    fn read(&mut self, text: &str, read: impl Fn(Section<'_>, &str)) {
        let source = Source::new(text, "reference.toml");
        let table: toml::Spanned<DeTable<'_>> = source.parse().unwrap();
        read(source.root(table.get_ref()), text);
        for table in source.tables.borrow().iter() {
            if !self.tables.contains(table) {
                self.tables.push(*table);
            }
        }
        // A getter that calls another records a key twice: the first time is right.
        let mut keys: Vec<Documented> = Vec::new();
        for key in source.documented.borrow().iter() {
            if !keys.iter().any(|known| (known.section, &known.key) == (key.section, &key.key)) {
                keys.push(key.clone());
            }
        }
        self.keys.extend(keys);
    }

    fn page(&self, introduction: &str) -> String {
        let mut page = introduction.trim_start().to_owned();
        for (section, keys) in &self.tables {
            write!(page, "\n## {section}\n\n| Key | Value | Default | |\n|---|---|---|---|\n")
                .unwrap();
            for (name, description) in *keys {
                let read: Vec<_> = self
                    .keys
                    .iter()
                    .filter(|key| key.section == *section && stands_for(name, &key.key))
                    .collect();
                assert!(!read.is_empty(), "{section} {name}: documented, but never read");
                let key = name.replace('{', "(").replace(',', "\\|").replace('}', ")");
                let accepts = distinct(read.iter().map(|key| key.accepts.as_str())).join(" or ");
                let default = default(&read);
                writeln!(page, "| `{key}` | {accepts} | {default} | {description} |").unwrap();
            }
        }
        page
    }
}

fn distinct<'a>(texts: impl Iterator<Item = &'a str>) -> Vec<&'a str> {
    texts.fold(Vec::new(), |mut known, text| {
        if !known.contains(&text) {
            known.push(text);
        }
        known
    })
}

/// The default of a key; one that differs between texts for the same unit is computed.
fn default(read: &[&Documented]) -> String {
    let differs = |key: &Documented| {
        let mut same = read.iter().filter(|other| other.key == key.key);
        same.any(|other| other.default != key.default && other.default.parse::<f64>().is_ok())
    };
    if read.iter().any(|key| key.default.parse::<f64>().is_ok() && differs(key)) {
        return "computed from other keys".to_owned();
    }
    distinct(read.iter().map(|key| key.default.as_str())).join(" or ")
}

fn check(name: &str, page: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs").join(name);
    if std::env::var_os("UPDATE_PAGES").is_some_and(|value| value == "1") {
        std::fs::write(&path, page).unwrap();
    }
    let found = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(found == page, "{name} is stale: UPDATE_PAGES=1 cargo test -p rig pages");
}

#[test]
fn the_page_of_the_rig_file_is_what_the_reader_accepts() {
    let mut accepted = Accepted::default();
    for unit in ["rad", "m"] {
        accepted.read(&RIG.replace("UNIT", unit), |root, text| {
            RigFile::read(root, text, "reference.toml", Purpose::Run);
        });
    }
    check("rig-file.md", &accepted.page(include_str!("generated_pages/rig-file.md")));
}

#[test]
fn the_page_of_protocols_is_what_the_reader_accepts() {
    let mut accepted = Accepted::default();
    for (kind, _) in WORDS {
        for (unit, duration, law, more) in [
            ("deg", "100.0", "published", "axes = [0]"),
            ("m", "1.0", "model-based", ""),
            ("deg", "1.0", "none", "amplitudes_deg = [1.0]"),
            ("m", "1.0", "none", "amplitudes_m = [1.0]\nposition_table_m = []"),
        ] {
            let more = if unit == "m" {
                format!("{more}\nvelocity_table_m_s = []")
            } else {
                more.to_owned()
            };
            let segment = SEGMENT
                .replace("KIND", kind)
                .replace("UNIT", unit)
                .replace("DURATION", duration)
                .replace("LAW", law)
                .replace("MORE", &more);
            accepted.read(
                &format!("[protocol]\n[scanner]\n[matching]\n{segment}"),
                |root, text| {
                    Protocol::read(root, text, "reference.toml");
                },
            );
        }
    }
    check("protocols.md", &accepted.page(include_str!("generated_pages/protocols.md")));
}
