//! Turns errors into messages for people and exit codes for scripts.

use std::io::ErrorKind;
use std::process::ExitCode;

/// Ends the program: the message goes to standard error, the kind of error into the exit code.
pub(crate) fn exit(result: anyhow::Result<i32>) -> ExitCode {
    let code = match result {
        Ok(code) => code,
        // `farreach ... | head` closes our output: a normal end.
        Err(error) if is_closed_pipe(&error) => operator::DONE,
        Err(error) => {
            eprintln!("farreach: {}", in_words(&error));
            code_of(&error)
        }
    };
    ExitCode::from(u8::try_from(code).unwrap_or(1))
}

/// The error and its causes, except those that its own message already contains.
fn in_words(error: &anyhow::Error) -> String {
    error.chain().map(ToString::to_string).fold(String::new(), |text, cause| {
        if text.is_empty() {
            cause
        } else if text.contains(&cause) {
            text
        } else {
            format!("{text}: {cause}")
        }
    })
}

/// An error of usage, which has an exit code of its own.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub(crate) struct Usage(pub(crate) String);

fn code_of(error: &anyhow::Error) -> i32 {
    if let Some(error) = error.downcast_ref::<operator::Error>() {
        return error.exit_code();
    }
    if let Some(rig::FileError::NotShipped { .. }) = error.downcast_ref() {
        return operator::USAGE;
    }
    if error.is::<Usage>() { operator::USAGE } else { operator::FAILED }
}

fn is_closed_pipe(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| {
        cause
            .downcast_ref::<std::io::Error>()
            .is_some_and(|error| error.kind() == ErrorKind::BrokenPipe)
            || cause
                .downcast_ref::<serde_json::Error>()
                .is_some_and(|error| error.io_error_kind() == Some(ErrorKind::BrokenPipe))
    })
}

#[cfg(test)]
mod tests {
    use anyhow::Context as _;

    use super::*;

    #[test]
    fn a_cause_is_reported_once() {
        let full = || std::io::Error::from(ErrorKind::StorageFull);
        assert_eq!(
            in_words(&anyhow::Error::new(full()).context("out.json")),
            format!("out.json: {}", full())
        );
        let told = Err::<(), _>(full())
            .with_context(|| format!("out.json: {}; free space", full()))
            .unwrap_err();
        assert_eq!(in_words(&told), format!("out.json: {}; free space", full()));
    }
}
