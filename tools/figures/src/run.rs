//! Runs the command: computes, then prints and writes.

use std::path::PathBuf;

use anyhow::Result;
use indicatif::{ProgressBar, ProgressStyle};
use rayon::prelude::*;

use crate::args::Args;
use crate::folder::ERRORS_CSV;
use crate::study::{STEPS, Study, study};
use crate::{folder, measured, page};

/// Default folder.
const FOLDER: &str = "farreach-figures";
/// Width of a PNG per column, pixels: 85 mm at 600 dots per inch.
#[cfg(feature = "png")]
const PNG_WIDTH: u32 = 2008;

/// Runs the command; 0 when done.
///
/// # Errors
/// Where the folder cannot be written, or a figure cannot be computed or drawn.
pub fn run(args: &Args) -> Result<i32> {
    let out = args.out.clone().or_else(|| (!args.json).then(|| PathBuf::from(FOLDER)));
    if let Some(recording) = &args.from {
        return measured::run(recording, args.axis, out, args.json);
    }
    let out = out.map(|out| folder::check(&out)).transpose()?;
    let bar = ProgressBar::new(STEPS as u64)
        .with_style(
            ProgressStyle::with_template("{msg} [{bar:40}] {percent} %")?.progress_chars("=> "),
        )
        .with_message("simulating");
    let study = study(|| bar.inc(1))?;
    let json = serde_json::to_string_pretty(&study.rows)?;
    if let Some(out) = &out {
        bar.set_message("drawing");
        folder::write(out, &files(&study, &json)?)?;
    }
    bar.finish_and_clear();
    if args.json {
        println!("{json}");
        return Ok(0);
    }
    let (sentence, detail) = page::verdict(&study)?;
    println!("{sentence}\n{detail}");
    for conclusion in &study.conclusions {
        println!(
            "  {:3}  {}",
            if conclusion.survives() { "yes" } else { "no" },
            conclusion.statement
        );
    }
    if let Some(out) = out {
        println!("page: {}", out.join("index.html").display());
    }
    Ok(0)
}

/// The content of every file.
fn files(study: &Study, json: &str) -> Result<Vec<(String, Vec<u8>)>> {
    #[cfg(feature = "png")]
    let painter = report::PngRenderer::new()?;
    let mut files = vec![
        ("index.html".to_owned(), page::page(study, json)?.render()?.into_bytes()),
        ("figures.json".to_owned(), format!("{json}\n").into_bytes()),
        (ERRORS_CSV.to_owned(), study.common.learning.csv().into_bytes()),
    ];
    // Rendering a figure takes as long as its simulations: on all cores.
    let drawn: Result<Vec<_>> = study
        .plots
        .par_iter()
        .map(|figure| {
            // Up to three panels stand in one column of a journal, more of them in two.
            let columns = if figure.panels.count() > 3 { 2 } else { 1 };
            let svg = figure.panels.clone().columns(columns).render_svg()?;
            let name = |extension| format!("figure-{}.{extension}", figure.number);
            #[cfg(feature = "png")]
            let png = (name("png"), painter.png(figure.title, &svg, PNG_WIDTH * columns as u32)?);
            let svg = (name("svg"), svg.into_bytes());
            Ok(vec![
                svg,
                #[cfg(feature = "png")]
                png,
            ])
        })
        .collect();
    files.extend(drawn?.into_iter().flatten());
    Ok(files)
}
