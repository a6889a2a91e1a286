//! The report as text.

use runtime::{CheckResult, MachineReport, Verdict};

/// Column at which the value begins: verdict, blank, longest id, two blanks.
const VALUE: usize = 28;

/// What is examined, and by whom.
pub(crate) fn headline(report: &MachineReport) -> String {
    let rig = match &report.rig {
        Some(rig) => {
            format!("rig {} ({}, card {}, {})", report.rig_name, rig.name, rig.card, rig.profile)
        }
        None => format!("rig {} is not up", report.rig_name),
    };
    format!("{}, user {}, {rig}", report.host, report.user)
}

/// One check: verdict, id and value, and what to do below it, in at most `width` columns.
pub(crate) fn row(check: &CheckResult, width: usize) -> String {
    let verdict = match check.verdict {
        Verdict::Pass => "pass",
        Verdict::Warn => "WARN",
        Verdict::Fail => "FAIL",
        Verdict::Skipped => "skip",
    };
    let indent = " ".repeat(VALUE);
    let wrap = |text: &str, first: &str| {
        let options = textwrap::Options::new(width.max(VALUE + 20))
            .initial_indent(first)
            .subsequent_indent(&indent)
            .break_words(false);
        textwrap::fill(text, options)
    };
    let mut text = wrap(&check.value, &format!("{verdict}  {:<22}", check.id));
    if !check.remedy.is_empty() {
        text.push('\n');
        text += &wrap(&check.remedy, &format!("{indent}-> "));
    }
    text
}

/// How many checks have which verdict.
pub(crate) fn totals(report: &MachineReport) -> String {
    let counts = Verdict::ALL.map(|it| format!("{} {}", report.count(it), it.text()));
    counts.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn value_and_remedy_stand_in_one_column() {
        let check = CheckResult {
            id: "encoder-directions".to_owned(),
            title: String::new(),
            verdict: Verdict::Fail,
            value: "axis 0: master 0.99, handle -0.90 of the reference".to_owned(),
            remedy: "`inverted` in [axes.master] or [axes.slave]".to_owned(),
            measured: serde_json::Value::Null,
        };
        let text = row(&check, 70);
        let expected = "\
FAIL  encoder-directions    axis 0: master 0.99, handle -0.90 of the
                            reference
                            -> `inverted` in [axes.master] or
                            [axes.slave]";
        assert_eq!(text, expected);
    }

    #[test]
    fn no_id_outgrows_its_column() {
        for check in crate::checks::CHECKS {
            assert!(check.id.len() <= 20, "{}", check.id);
        }
    }
}
