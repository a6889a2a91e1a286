//! Reads a folder, writes the trend.

use std::path::Path;

use anyhow::Context as _;
use indicatif::{ProgressBar, ProgressStyle};
use rig::RigFile;

use super::assembly;
use super::fits::{Fitting, fit_all};
use super::folder::{LeftOut, recordings};
use super::page::page;
use super::result::Trend;
use super::text::text;
use crate::Args;
use crate::chosen_axis::chosen_axis;
use crate::result_files::{kind_of, print, refuse, save};

/// How often the spinner turns.
const TICK: std::time::Duration = std::time::Duration::from_millis(120);

/// A trend with what its page needs.
struct Whole {
    rig: RigFile,
    trend: Trend,
    began_s: Vec<Option<f64>>,
}

/// Runs `identify --trend`; exit codes as [`crate::run`].
///
/// # Errors
/// Where the page or the JSON file cannot be written.
pub(crate) fn run(args: &Args, folder: &Path) -> anyhow::Result<i32> {
    let json_file = args.json.as_deref();
    let Whole { rig, trend, began_s } = match whole(args, folder) {
        Ok(whole) => whole,
        Err(error) => return Ok(refuse(json_file, kind_of(&error), format!("{error:#}"))),
    };
    let json = serde_json::to_string_pretty(&trend)?;
    save(json_file, &json)?;
    let mut text = text(&trend);
    let mut failed = None;
    if let Some(folder) = &args.report {
        let path = folder.join("index.html");
        let written = page(&trend, rig.file_name(), &began_s)
            .details("The result as written by --json", &json)
            .footer(concat!("farreach identify ", env!("CARGO_PKG_VERSION")))
            .write(&path);
        match written {
            Ok(()) => text += &format!("page: {}\n", path.display()),
            Err(error) => failed = Some(error),
        }
    }
    print(json_file, &json, text.trim_end())?;
    failed.map_or(Ok(0), Err)
}

fn whole(args: &Args, folder: &Path) -> anyhow::Result<Whole> {
    let started = std::time::Instant::now();
    let rig = rig::load_declaration(&args.rig)?;
    let axis = chosen_axis(&rig, args.axis.as_deref())?;
    let paths = recordings(folder)?;
    let bar = ProgressBar::new(paths.len() as u64)
        .with_style(ProgressStyle::with_template("{spinner} {pos} of {len} {msg} {elapsed}")?);
    bar.enable_steady_tick(TICK);
    let fitting = Fitting { reading: args.reading(), how: args.study(axis), effects: args.effects };
    let fitted = fit_all(&rig, &paths, &fitting, &mut |index| {
        bar.set_position(index as u64);
        bar.set_message(paths[index].file_name().unwrap_or_default().display().to_string());
    });
    bar.finish_and_clear();
    let (fits, left_out): (Vec<_>, Vec<LeftOut>) = fitted?;
    let declared = rig.axes.get(axis).map_or_else(|| rig.model.clone(), |own| rig.axis_model(own));
    let threads = rayon::ThreadPoolBuilder::new()
        .num_threads(fitting.how.jobs)
        .build()
        .context("no threads")?;
    let mut trend = threads.install(|| assembly::trend(&declared, &fits, left_out));
    trend.seconds = started.elapsed().as_secs_f64();
    let began_s = fits.iter().map(|fit| fit.began_s).collect();
    Ok(Whole { rig, trend, began_s })
}
