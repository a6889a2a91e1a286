//! up, down, status, the operator's verbs, run.
