//! `plot`.

use std::io::Write;
use std::process::{Command, Stdio};

use anyhow::bail;
use operator::ConsoleAddress;
use runtime::RigName;

use crate::args::PlotArgs;

/// Variables of which one is set where windows can be opened.
const DISPLAYS: [&str; 2] = ["WAYLAND_DISPLAY", "DISPLAY"];

/// Prints the address of the console's live plots, and opens it where there is a display.
pub(crate) fn plot(args: &PlotArgs, rig: &RigName, out: &mut dyn Write) -> anyhow::Result<i32> {
    let Some(console) = ConsoleAddress::read(rig)? else {
        return Err(operator::Error::NoConsole { rig: rig.to_string() }.into());
    };
    if !args.channels.is_empty() {
        let signals = recorder::signals(&operator::rig_of(rig)?);
        let names: Vec<_> = signals.iter().map(|signal| signal.name.as_str()).collect();
        if let Some(name) = args.channels.iter().find(|name| !names.contains(&name.as_str())) {
            bail!("channel {name}: expected one of {}", names.join(", "));
        }
    }
    let address = console.watching(&args.channels);
    writeln!(out, "{address}")?;
    out.flush()?;
    let is_set = |name: &str| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    if DISPLAYS.into_iter().any(is_set) {
        open(&address);
    }
    Ok(recorder::DONE)
}

/// Asks the desktop to open an address in its browser.
fn open(address: &str) {
    let mut command = Command::new("xdg-open");
    command.arg(address).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    let told = match command.status() {
        Ok(status) if status.success() => return,
        Ok(status) => status.to_string(),
        Err(error) => error.to_string(),
    };
    eprintln!("xdg-open: {told}; open the address in a browser yourself");
}
