//! The reference of the command line, generated from clap: shell completions, man pages and
//! `docs/cli.md`.

use std::path::Path;

use anyhow::Context as _;
use clap::Command;

/// Prints a completion script to standard output.
pub(crate) fn completions(
    mut command: Command,
    shell: clap_complete::Shell,
) -> anyhow::Result<i32> {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut command, "farreach", &mut script);
    std::io::Write::write_all(&mut std::io::stdout(), &script)?;
    Ok(operator::DONE)
}

/// Writes `farreach.1`, `farreach-up.1` and so on into `directory`.
pub(crate) fn man(command: Command, directory: &Path) -> anyhow::Result<i32> {
    clap_mangen::generate_to(command, directory).with_context(|| {
        format!("{}: expected an existing, writable folder", directory.display())
    })?;
    Ok(operator::DONE)
}
