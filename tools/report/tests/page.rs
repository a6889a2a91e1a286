//! What a reader's browser gets.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use report::{Colour, Figure, Page, Panels, Table, Tone};

fn line() -> Figure {
    Figure::new("a < b & \"c\"", "time / s", "force / N").line(
        Colour::Blue,
        "x",
        &[0.0, 1.0],
        &[0.0, 1.0],
    )
}

#[test]
fn a_page_holds_everything_and_asks_for_nothing() {
    let html = Page::new("A <title>")
        .verdict(Tone::Bad, "x", "y")
        .figure(&line(), "caption")
        .render()
        .unwrap();
    for forbidden in ["http://", "https://", "<script ", "src=", "fetch", "@import", "url("] {
        let html = html.replace("http://www.w3.org/2000/svg", "");
        assert!(!html.contains(forbidden), "{forbidden}");
    }
    assert!(html.contains("<title>A &lt;title&gt;</title>"));
    assert!(html.contains("a &lt; b &amp; &quot;c&quot;"));
}

#[test]
fn long_series_become_small_drawings_that_keep_their_peak() {
    let x: Vec<f64> = (0..200_000).map(f64::from).collect();
    let mut y: Vec<f64> = x.iter().map(|x| (x * 0.37).sin()).collect();
    y[123_457] = 100.0;
    let svg = Figure::new("t", "x", "y").line(Colour::Blue, "s", &x, &y).render_svg().unwrap();
    assert!(svg.len() < 200_000, "{} bytes", svg.len());
    // The peak alone spans the axis: some polyline point lies near the top of the frame.
    let top = svg
        .split("points=\"")
        .skip(1)
        .flat_map(|s| s.split('"').next().unwrap_or("").split_whitespace())
        .filter_map(|p| {
            p.split_once(',')
                .and_then(|(x, y)| Some((x.parse::<i32>().ok()?, y.parse::<i32>().ok()?)))
        })
        .filter(|p| p.0 > 1000 && p.0 < 3000)
        .map(|p| p.1)
        .min()
        .unwrap();
    assert!(top < 400, "{top}");
}

#[test]
fn broken_input_is_named() {
    let error = Figure::new("t", "x", "y")
        .line(Colour::Blue, "force", &[0.0, 1.0], &[0.0])
        .render_svg()
        .unwrap_err();
    let error = error.to_string();
    assert!(error.contains("series `force`: 2 abscissae but 1 ordinates"), "{error}");
    let error = Figure::new("t", "x", "y")
        .line(Colour::Blue, "s", &[f64::NAN], &[1.0])
        .render_svg()
        .unwrap_err();
    assert!(error.to_string().contains("no finite point"), "{error}");
    let error = Figure::new("t", "x", "y")
        .log_y()
        .line(Colour::Blue, "s", &[1.0], &[-1.0])
        .render_svg()
        .unwrap_err();
    assert!(error.to_string().contains("no finite point"), "{error}");
    let table = Table::new(["a", "b"]).row(["1"]);
    let error = Page::new("p").table(table, "").render().unwrap_err();
    assert!(error.to_string().contains("1 cells, the header has 2"), "{error}");
}

#[test]
fn values_that_are_not_finite_break_the_line() {
    let x: Vec<f64> = (0..9).map(f64::from).collect();
    let mut y = x.clone();
    let whole = Figure::new("", "x", "y").line(Colour::Blue, "", &x, &y).render_svg().unwrap();
    y[4] = f64::NAN;
    let broken = Figure::new("", "x", "y").line(Colour::Blue, "", &x, &y).render_svg().unwrap();
    let lines = |svg: &str| svg.matches("<polyline").count();
    assert_eq!(lines(&broken), lines(&whole) + 1);
}

/// Corners of each shaded area (fine pixels).
fn areas(figure: &Figure) -> Vec<Vec<(i32, i32)>> {
    let html = Page::new("a").figure(figure, "").render().unwrap();
    let shapes =
        html.split("<polygon").skip(1).map(|shape| shape.split("points=\"").nth(1).unwrap());
    let corner = |text: &str| {
        text.split_once(',').map(|(x, y)| (x.parse().unwrap(), y.parse().unwrap())).unwrap()
    };
    shapes
        .map(|shape| shape.split('"').next().unwrap().split_whitespace().map(corner).collect())
        .collect()
}

#[test]
fn values_that_are_not_finite_break_the_shaded_area() {
    let (x, gap) = ([0.0, 1.0, f64::NAN, 3.0, 4.0], [1.0, 2.0, f64::NAN, 1.0, 2.0]);
    let areas = areas(&Figure::new("", "x", "y").band(Colour::Blue, "", &x, &[0.5; 5], &gap));
    assert_eq!(areas.len(), 2, "{areas:?}");
    assert!(areas[0].iter().all(|left| areas[1].iter().all(|right| left.0 < right.0)), "{areas:?}");
}

#[test]
fn a_shaded_area_that_reaches_below_zero_stays_within_logarithmic_axes() {
    let x = [1.0, 2.0, 3.0];
    let figure = Figure::new("", "x", "y").log_y().band(
        Colour::Blue,
        "",
        &x,
        &[0.5, -1.0, 0.5],
        &[2.0, 2.0, 2.0],
    );
    let areas = areas(&figure);
    assert_eq!(areas.len(), 1);
    assert!(areas[0].iter().all(|(x, y)| *x > 0 && *y > 0), "{areas:?}");
}

#[test]
fn what_lies_outside_a_fixed_range_is_cut_off() {
    let x: Vec<f64> = (0..1000).map(f64::from).collect();
    let svg = Figure::new("", "x", "y")
        .y_range(-1.0, 1.0)
        .line(Colour::Blue, "", &x, &x)
        .render_svg()
        .unwrap();
    let numbers = svg
        .split("points=\"")
        .skip(1)
        .flat_map(|s| s.split('"').next().unwrap_or("").split_whitespace());
    for y in numbers.filter_map(|p| p.split_once(',')).filter_map(|p| p.1.parse::<i32>().ok()) {
        assert!((0..=340 * 5).contains(&y), "{y}");
    }
}

#[test]
fn panels_of_a_sheet_stand_in_rows() {
    let panels = Panels::new("two")
        .columns(2)
        .panel(line().size(300, 200))
        .panel(line().size(300, 250))
        .panel(line());
    assert_eq!(panels.size(), (1360, 590));
    let svg = panels.render_svg().unwrap();
    assert_eq!(svg.matches("<svg").count(), 4);
    assert!(svg.contains("<svg x=\"680\" y=\"0\"") && svg.contains("<svg x=\"0\" y=\"250\""));
    let html = Page::new("p").panels(&panels, "caption").render().unwrap();
    assert!(html.contains("<figcaption>caption"));
}

#[cfg(feature = "png")]
#[test]
fn a_picture_has_the_width_that_was_asked_for() {
    let svg = Panels::new("one").panel(line()).render_svg().unwrap();
    let png = report::PngRenderer::new().unwrap().png("one", &svg, 500).unwrap();
    assert_eq!(&png[1..4], b"PNG");
    assert_eq!(u32::from_be_bytes(png[16..20].try_into().unwrap()), 500);
    assert!(png.len() > 2000, "{} bytes: nothing was drawn", png.len());
}
