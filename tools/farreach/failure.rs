//! From errors to what a person reads and a script tests.

use std::io::ErrorKind;
use std::process::ExitCode;

/// Ends the program: an error goes to standard error, its kind into the exit code.
pub(crate) fn exit(result: anyhow::Result<i32>) -> ExitCode {
    let code = match result {
        Ok(code) => code,
        // `farreach ... | head` closes our output: that is how it is meant to end.
        Err(error) if is_closed_pipe(&error) => operator::DONE,
        Err(error) => {
            eprintln!("farreach: {error:#}");
            code_of(&error)
        }
    };
    ExitCode::from(u8::try_from(code).unwrap_or(1))
}

/// An error with an exit code of its own.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub(crate) struct Usage(pub(crate) String);

fn code_of(error: &anyhow::Error) -> i32 {
    if let Some(error) = error.downcast_ref::<operator::Error>() {
        return error.exit_code();
    }
    if error.is::<Usage>() { operator::USAGE } else { operator::FAILED }
}

fn is_closed_pipe(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| {
        cause.downcast_ref::<std::io::Error>().is_some_and(|error| error.kind() == ErrorKind::BrokenPipe)
            || cause
                .downcast_ref::<serde_json::Error>()
                .is_some_and(|error| error.io_error_kind() == Some(ErrorKind::BrokenPipe))
    })
}
