//! The tracking error of a protocol in recordings: `tracking_error PROTOCOL KEY=VALUE FILE...`

use anyhow::{Context as _, Result};
use rig::load_protocol;
use tune::recorded::passes;

fn main() -> Result<()> {
    let mut arguments = std::env::args().skip(1);
    let name = arguments.next().context("expected a protocol")?;
    let set = arguments.next().context("expected an override of it")?;
    let protocol = load_protocol(name.as_ref(), &[set])?;
    for file in arguments {
        let last = passes(file.as_ref(), protocol.identity(), None)?.pop().unwrap_or_default();
        let error = last.error().with_context(|| format!("{file}: no such movement"))?;
        println!(
            "{file}: rms {:.3}°, peak {:.3}°, lag {:.1} ms",
            error.rms.to_degrees(),
            error.peak.to_degrees(),
            1e3 * error.lag_s
        );
    }
    Ok(())
}
