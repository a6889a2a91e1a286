//! A page with every kind of figure, to be looked at after a change of style:
//! `SPECIMEN=/tmp/specimen.html cargo test -p report --test specimen`
#![allow(clippy::unwrap_used)]

use report::Colour::{Black, Blue, Green, Grey, Vermillion};
use report::{Figure, Page, Table, Tone};

#[test]
fn every_kind_of_figure_and_table_is_drawn() {
    let time: Vec<f64> = (0..25_000).map(|i| f64::from(i) * 1e-3).collect();
    let noise = |i: usize| ((i * 7919 % 1013) as f64 / 1013.0 - 0.5) * 8.0;
    let model: Vec<f64> = time.iter().map(|t| 80.0 * (1.3 * t).sin() * (0.11 * t).cos()).collect();
    let measured: Vec<f64> = model.iter().enumerate().map(|(i, m)| m + noise(i)).collect();
    let residual: Vec<f64> = measured.iter().zip(&model).map(|(a, b)| a - b).collect();
    let force = Figure::new("Force, measured against model", "time / s", "force / N")
        .line(Black, "measured", &time, &measured)
        .dashed(Blue, "model", &time, &model);
    let coarse: Vec<f64> = (0..25).map(f64::from).collect();
    let low: Vec<f64> = coarse.iter().map(|t| -3.0 + (0.4 * t).sin()).collect();
    let high: Vec<f64> = coarse.iter().map(|t| 3.0 + (0.4 * t).sin()).collect();
    let scatter = Figure::new("Residual against time", "time / s", "residual / N")
        .scatter(Grey, "samples", &time, &residual)
        .band(Blue, "± one standard deviation", &coarse, &low, &high)
        .horizontal(Grey, "", 0.0);
    let frequency: Vec<f64> = (0..400).map(|i| 0.2 * 10f64.powf(f64::from(i) / 200.0)).collect();
    let gain = |f0: f64, damping: f64| -> Vec<f64> {
        frequency
            .iter()
            .map(|f| 1.0 / (1.0 - (f / f0).powi(2)).hypot(2.0 * damping * f / f0))
            .collect()
    };
    let bode = Figure::new("Frequency response", "frequency / Hz", "slave over master")
        .log_x()
        .log_y()
        .line(Blue, "10 m", &frequency, &gain(8.0, 0.1))
        .line(Vermillion, "1 m", &frequency, &gain(18.0, 0.05))
        .errors(
            Green,
            "measured",
            &[1.0, 2.0, 4.0, 8.0],
            &[1.0, 1.05, 1.3, 4.6],
            &[0.1, 0.1, 0.15, 0.8],
        )
        .vertical(Grey, "resonance", 8.0);
    let page = Page::new("Specimen of the style")
        .subtitle("Every kind of figure and table, with made-up numbers.")
        .verdict(
            Tone::Good,
            "Nothing is missing.",
            "The declared model explains the record to its noise.",
        )
        .verdict(Tone::Warning, "Something is missing.", "A second sentence says how far it holds.")
        .paragraph("Text is set in a serif face, numbers and headings without serifs.")
        .figure(&force, "Fig. 1. A long series, reduced to its envelope.")
        .figure(&scatter, "Fig. 2. Points and a band.")
        .figure(&bode, "Fig. 3. Logarithmic axes, error bars, a rule.")
        .heading("Numbers")
        .table(
            Table::new(["parameter", "declared", "fitted", "unit"])
                .row(["mass", "95.1", "95.13 ± 0.05", "kg"])
                .row(["offset", "−3.2", "−3.17 ± 0.12", "N"]),
            "Table 1. Parameters.",
        )
        .footer("farreach report specimen")
        .render()
        .unwrap();
    assert_eq!(page.matches("<svg").count(), 3);
    assert_eq!(page.matches("<table").count(), 1);
    if let Some(path) = std::env::var_os("SPECIMEN") {
        std::fs::write(path, page).unwrap();
    }
}
