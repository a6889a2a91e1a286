//! Campaigns with a program that answers what it is told: what is gone on after, what is not, and
//! what is printed.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::{Value, json};

/// Arguments: identify --rig RIG --json FILE --jobs N --limit-s SECONDS RECORDS...
const ALARM: &str = concat!(
    r#"[ "$1" = identify ] && [ "$8" = --limit-s ] && [ -f "${10}" ] && "#,
    r#"echo '{"verdict":"unlisted"}' > "$5""#
);
const FAILING: &str = "[ \"$1\" = --version ] && echo 'farreach 9' && exit; echo 'kind \
    hydrostatic: known: drive' >&2; exit 1";

fn program(folder: &Path, text: &str) -> PathBuf {
    let path = folder.join("answers");
    fs::write(&path, format!("#!/bin/sh\n{text}\n")).unwrap();
    fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
    path
}

/// Standard output and standard error of a campaign in a folder; what it said where it failed.
fn campaign(folder: &Path, arguments: &[&str]) -> Result<(String, String), String> {
    let output = Command::new(env!("CARGO_BIN_EXE_campaign"))
        .current_dir(folder)
        .args(arguments)
        .output()
        .unwrap();
    let [out, said] = [output.stdout, output.stderr].map(|text| String::from_utf8(text).unwrap());
    if output.status.success() { Ok((out, said)) } else { Err(said) }
}

/// A campaign of clean cases that ends well.
fn clean(folder: &Path, cases: usize, more: &[&str]) -> (String, String) {
    try_clean(folder, cases, more).unwrap()
}

/// A campaign of clean cases.
fn try_clean(folder: &Path, cases: usize, more: &[&str]) -> Result<(String, String), String> {
    let cases = cases.to_string();
    let rig = folder.join("rig.toml");
    if !rig.exists() {
        fs::copy(concat!(env!("CARGO_MANIFEST_DIR"), "/../../launch/rigs/hydrostatic.toml"), &rig)
            .unwrap();
    }
    let arguments = [
        "--listed",
        "0",
        "--unlisted",
        "0",
        "--pairs",
        "0",
        "--clean",
        &cases,
        "--farreach",
        "./answers",
    ];
    campaign(folder, &[&arguments[..], &["--rig", "rig.toml"], more].concat())
}

fn lines(folder: &Path) -> Vec<Value> {
    let text = fs::read_to_string(folder.join("campaign.jsonl")).unwrap();
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

fn write_lines(folder: &Path, lines: &[Value]) {
    let text: Vec<String> = lines.iter().map(ToString::to_string).collect();
    fs::write(folder.join("campaign.jsonl"), text.join("\n") + "\n").unwrap();
}

fn table(folder: &Path) -> Value {
    serde_json::from_str(&fs::read_to_string(folder.join("table.json")).unwrap()).unwrap()
}

#[test]
fn a_case_whose_program_was_ended_from_outside_is_not_counted_and_a_crash_is() {
    let ended_by = |signal: &str| {
        format!("[ \"$1\" = --version ] && echo 'farreach 9' && exit; kill -{signal} $$")
    };
    let folder = tempfile::tempdir().unwrap();
    program(folder.path(), &ended_by("KILL"));
    let said = try_clean(folder.path(), 1, &[]).unwrap_err();
    assert!(said.contains("signal 9") && said.contains("not counted"), "{said}");
    assert!(lines(folder.path()).is_empty());
    program(folder.path(), &ended_by("ABRT"));
    let (text, _) = clean(folder.path(), 1, &[]);
    assert!(text.contains("a verdict at all") && text.contains("0 of 1"), "{text}");
}

#[test]
fn a_campaign_resumes_after_the_cases_done() {
    let folder = tempfile::tempdir().unwrap();
    program(folder.path(), ALARM);
    let (text, _) = clean(folder.path(), 1, &[]);
    assert!(text.contains("a verdict at all") && text.contains("1 of 1 = 100.0 %"), "{text}");
    let (text, said) = clean(folder.path(), 2, &["--json", "table.json"]);
    assert!(text.contains("2 of 2 = 100.0 %") && said.starts_with("1/1 clean-002"), "{text}{said}");
    let found = table(folder.path());
    assert_eq!(found["cases"].as_array().unwrap().len(), 2);
    assert_eq!(found["configuration"]["program_hash"].as_str().unwrap().len(), 32);
    let lines = lines(folder.path());
    assert_eq!(lines.len(), 2);
    assert_eq!((&lines[1]["limit_s"], &lines[1]["jobs"]), (&json!(300), &json!(2)));
    assert_eq!(lines[1]["unlisted_kinds"], json!("all"));
}

#[test]
fn a_campaign_survives_a_program_that_fails() {
    let folder = tempfile::tempdir().unwrap();
    program(folder.path(), FAILING);
    clean(folder.path(), 1, &["--json", "table.json"]);
    let case = &table(folder.path())["cases"][0];
    assert_eq!((&case["end"], &case["code"]), (&json!("failed"), &json!(1)));
    assert_eq!(case["message"], json!("kind hydrostatic: known: drive"));
}

/// Another build, limit, number of jobs, rig or choice of effects begins anew in the same file, and
/// it is said what was another.
#[test]
fn a_changed_configuration_is_not_resumed() {
    let folder = tempfile::tempdir().unwrap();
    program(folder.path(), ALARM);
    clean(folder.path(), 1, &[]);
    let anew = |more: &[&str], what: &str, count: usize| {
        let (text, said) = clean(folder.path(), 1, more);
        assert!(
            said.contains(&format!(
                "1 lines of seed 1 are not gone on after, the {what} was another"
            )),
            "{said}"
        );
        assert!(text.contains("seed 1, 1 cases"), "{text}");
        assert_eq!(lines(folder.path()).len(), count);
    };
    anew(&["--limit-s", "299"], "--limit-s", 2);
    anew(&["--jobs", "1"], "--jobs", 3);
    anew(&["--unlisted-kinds", "new"], "--unlisted-kinds", 4);
    // The same version, other contents.
    program(folder.path(), &format!("{ALARM} # another build"));
    anew(&[], "program file", 5);
    program(folder.path(), ALARM);
    let rig = folder.path().join("rig.toml");
    let text = fs::read_to_string(&rig).unwrap();
    fs::write(&rig, format!("{text}# another rig\n")).unwrap();
    anew(&[], "rig file", 6);
    fs::write(&rig, text).unwrap();
    clean(folder.path(), 1, &[]);
    assert_eq!(lines(folder.path()).len(), 6, "the first is gone on after again");
}

#[test]
fn one_table_per_program() {
    let folder = tempfile::tempdir().unwrap();
    program(folder.path(), ALARM);
    clean(folder.path(), 2, &[]);
    // An older file has a name and no more; one of long ago not even that.
    let mut all = lines(folder.path());
    for (program, count) in [(Some("farreach 1 (older)"), 2), (None, 1)] {
        for index in 0..count {
            let mut line = all[index].clone();
            let fields = line.as_object_mut().unwrap();
            for name in ["program", "program_hash", "rig_hash", "limit_s", "jobs", "unlisted_kinds"]
            {
                fields.remove(name);
            }
            if let Some(program) = program {
                fields.insert("program".to_owned(), json!(program));
            }
            all.push(line);
        }
    }
    write_lines(folder.path(), &all);
    let (text, _) = campaign(folder.path(), &["--only-print"]).unwrap();
    assert_eq!(text.matches("a verdict at all").count(), 3, "{text}");
    assert_eq!(text.matches("seed 1, 2 cases").count(), 2, "{text}");
    assert!(!text.contains("seed 1, 5 cases") && text.contains("limit-s not recorded"), "{text}");
    let (text, _) =
        campaign(folder.path(), &["--only-print", "--program", "(older)", "--json", "table.json"])
            .unwrap();
    assert!(
        text.starts_with("farreach 1 (older);") && text.matches("a verdict at all").count() == 1,
        "{text}"
    );
    assert_eq!(table(folder.path())["programs"], json!(["farreach 1 (older)"]));
    let said = campaign(folder.path(), &["--only-print", "--json", "table.json"]).unwrap_err();
    assert!(said.contains("has 3; choose with --program"), "{said}");
    let said = campaign(folder.path(), &["--only-print", "--program", "farreach 2"]).unwrap_err();
    assert!(
        said.contains("no such lines of seed 1") && said.contains("farreach 1 (older)"),
        "{said}"
    );
}

#[test]
fn a_case_counts_once() {
    let folder = tempfile::tempdir().unwrap();
    program(folder.path(), ALARM);
    clean(folder.path(), 2, &[]);
    let mut all = lines(folder.path());
    all.push(all[0].clone());
    let duplicate = "campaign.jsonl, line 3: case clean-001 of seed 1 again";
    write_lines(folder.path(), &all);
    let said = campaign(folder.path(), &["--only-print"]).unwrap_err();
    assert!(said.contains(duplicate) && said.contains("on line 1 already"), "{said}");
    let said =
        campaign(folder.path(), &["--farreach", "./answers", "--rig", "rig.toml"]).unwrap_err();
    assert!(said.contains(duplicate), "nor is it gone on after: {said}");
    // Another seed is another case.
    all[2]["seed"] = json!(2);
    write_lines(folder.path(), &all);
    assert!(campaign(folder.path(), &["--only-print"]).unwrap().0.contains("seed 1, 2 cases"));
}

/// A program that is built anew while the campaign runs: whose answer it was, nobody knows.
#[test]
fn a_program_that_changes_during_the_campaign_is_not_counted() {
    let folder = tempfile::tempdir().unwrap();
    program(folder.path(), &format!(r#"[ "$1" = identify ] && echo '# newer' >> "$0"; {ALARM}"#));
    fs::copy(
        concat!(env!("CARGO_MANIFEST_DIR"), "/../../launch/rigs/hydrostatic.toml"),
        folder.path().join("rig.toml"),
    )
    .unwrap();
    let arguments =
        ["--listed", "0", "--unlisted", "0", "--pairs", "0", "--clean", "1", "--rig", "rig.toml"];
    let said = campaign(folder.path(), &[&arguments[..], &["--farreach", "./answers"]].concat())
        .unwrap_err();
    assert!(
        said.contains("clean-001 is not counted: the program file changed while the campaign ran"),
        "{said}"
    );
    assert!(lines(folder.path()).is_empty());
}
