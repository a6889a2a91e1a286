use ratatui::Terminal;
use ratatui::backend::TestBackend;
use ratatui::crossterm::event::{KeyCode, KeyEvent, KeyModifiers};

use super::*;
use crate::scope::capture::{Capturer, Mode, Settings};
use crate::scope::channel::Channel;
use crate::scope::trigger::Condition;

const WIDTH: u16 = 61;
const HEIGHT: u16 = 25;
/// Lines of the plot with two channels.
const PLOT: u16 = HEIGHT - 9;

fn settings() -> Settings {
    Settings {
        mode: Mode::Normal,
        window_ns: 120_000_000,
        pre_ns: 60_000_000,
        auto_ns: 1_000_000_000,
        channel: (0, 0),
        condition: Condition::Rising(2.0),
        hysteresis: 0.0,
    }
}

fn view() -> View {
    let channel = |name: &str, unit: &str, column| Channel {
        name: name.to_owned(),
        unit: unit.to_owned(),
        place: (0, column),
    };
    View::new(vec![channel("torque", "N·m", 0), channel("volts", "V", 1)], settings(), false)
}

/// Samples of 1 kHz: a step from 0 to 4 at 200, with a spike of one sample at 230; the second
/// channel is -1. Samples are missing from 160 on, for `missing`.
fn capture(missing: u64) -> Capture {
    let mut capturer = Capturer::new(settings(), &[2], 1000);
    let mut found = None;
    for at in (0..400u64).filter(|at| !(160..160 + missing).contains(at)) {
        let gap = (missing > 0 && at == 160 + missing).then_some(missing);
        let step = if at < 200 { 0.0 } else { 4.0 };
        let value = if at == 230 { 8.0 } else { step };
        capturer.take(0, at * 1_000_000, gap, &[value, -1.0]);
        found = found.or(capturer.advance(at * 1_000_000));
    }
    found.unwrap()
}

fn drawn(view: &View, capture: Option<&Capture>, counts: Counts) -> Vec<String> {
    let scene = Scene { place: "rig demo", view, capture, doing: "waiting", counts };
    let mut terminal = Terminal::new(TestBackend::new(WIDTH, HEIGHT)).unwrap();
    terminal.draw(|frame| draw(&scene, frame.area(), frame.buffer_mut())).unwrap();
    let buffer = terminal.backend().buffer();
    let cells = |y| (0..WIDTH).map(move |x| buffer[(x, y)].symbol());
    (0..HEIGHT).map(|y| cells(y).collect::<String>().trim_end().to_owned()).collect()
}

/// The bits of a Braille character; 0 for any other.
fn bits(symbol: char) -> u32 {
    u32::from(symbol).checked_sub(0x2800).filter(|bits| *bits < 0x100).unwrap_or(0)
}

/// Whether there are dots in a column of the plot, line by line.
fn dots(lines: &[String], column: usize) -> Vec<bool> {
    let plot = &lines[2..2 + usize::from(PLOT)];
    plot.iter().map(|line| line.chars().nth(column).is_some_and(|cell| bits(cell) > 0)).collect()
}

#[test]
fn the_screen_tells_trigger_scales_and_counts() {
    let (mut view, capture) = (view(), capture(0));
    view.fit(&capture);
    let counts = Counts { received: 400, ..Counts::default() };
    let lines = drawn(&view, Some(&capture), counts);
    assert_eq!(lines[0], "rig demo | normal, waiting | torque rises to 2 N·m | 12 ms/di");
    assert_eq!(lines[1].trim_start(), "▼");
    assert_eq!(lines[1].chars().position(|symbol| symbol == '▼'), Some(30));
    let below = usize::from(2 + PLOT);
    assert_eq!(lines[below], "", "nothing is missing");
    assert!(lines[below + 1].starts_with("-60 ms") && lines[below + 1].ends_with("60 ms"));
    assert_eq!(lines[below + 2], ">torque  2 N·m/div  min 0  max 8");
    assert_eq!(lines[below + 3], " volts   0.2 V/div  min -1  max -1");
    assert_eq!(lines[below + 5], "400 messages, 0 lost; none in this window");
    assert!(lines[below + 6].starts_with("h keys  space stop/go"));
    // The level of the trigger stands at the right, where its channel has it.
    let marked: Vec<_> = (2..below).filter(|y| lines[*y].ends_with('◀')).collect();
    let level = 2 + usize::from(dot(2.0, view.channels[0].scale, PLOT) / 4);
    assert_eq!(marked, [level]);
}

#[test]
fn a_spike_of_one_sample_is_drawn() {
    let (mut view, capture) = (view(), capture(0));
    view.fit(&capture);
    let lines = drawn(&view, Some(&capture), Counts::default());
    let top = usize::from(dot(8.0, view.channels[0].scale, PLOT) / 4);
    let columns = 0..usize::from(WIDTH - 1);
    let high: Vec<_> = columns.filter(|column| dots(&lines, *column)[top]).collect();
    // 230 is 30 ms after the trigger: a quarter of the screen behind the middle.
    assert_eq!(high, [45]);
    // The step at the trigger is joined from 0 to 4.
    let scale = view.channels[0].scale;
    let [low, middle] = [0.0, 4.0].map(|value| usize::from(dot(value, scale, PLOT) / 4));
    let step = [29, 30].map(|column| dots(&lines, column));
    assert!((middle..=low).all(|line| step[0][line] || step[1][line]), "{lines:#?}");
}

#[test]
fn a_gap_is_left_open_marked_and_counted() {
    let (mut view, capture) = (view(), capture(20));
    view.fit(&capture);
    let counts = Counts { received: 380, lost: 20, out_of_order: 2, early: 0 };
    let lines = drawn(&view, Some(&capture), counts);
    // Samples are missing from 20 to 39 ms after the beginning of the window: columns 10 to 19.
    for column in 11..19 {
        assert_eq!(dots(&lines, column), [false; PLOT as usize], "column {column}: {lines:#?}");
    }
    assert!(dots(&lines, 8).contains(&true) && dots(&lines, 21).contains(&true));
    let below = usize::from(2 + PLOT);
    assert_eq!(lines[below].trim_start(), "×");
    assert_eq!(lines[below].chars().position(|symbol| symbol == '×'), Some(20));
    let told = "380 messages, 20 lost, 2 out of order, not shown; 20 of them ";
    assert_eq!(lines[below + 5], told.trim_end());
}

#[test]
fn cursors_give_values_times_and_differences() {
    let (mut view, capture) = (view(), capture(0));
    view.fit(&capture);
    for _ in 0..2 {
        view.key(KeyEvent::new(KeyCode::Char('c'), KeyModifiers::NONE));
    }
    let lines = drawn(&view, Some(&capture), Counts::default());
    let below = usize::from(2 + PLOT);
    assert_eq!(lines[below + 2], ">torque  2 N·m/div  A 0  B 8  B−A 8");
    assert_eq!(lines[below + 3], " volts   0.2 V/div  A -1  B -1  B−A 0");
    assert_eq!(lines[below + 4], "A -30 ms  B 30 ms  B−A 60 ms  (16.67 Hz)");
    assert_eq!(lines[1].chars().position(|symbol| symbol == 'A'), Some(15));
    assert_eq!(lines[1].chars().position(|symbol| symbol == 'B'), Some(45));
}

#[test]
fn help_lists_the_keys_and_a_small_window_says_so() {
    let mut view = view();
    view.key(KeyEvent::new(KeyCode::Char('h'), KeyModifiers::NONE));
    let lines = drawn(&view, None, Counts::default());
    assert_eq!(lines[2], "space    stop and go on; of a recording, the next window");
    assert!(lines[2 + KEYS.len() - 1].starts_with("q        end"), "{lines:#?}");
    let scene =
        Scene { place: "x", view: &view, capture: None, doing: "", counts: Counts::default() };
    let mut terminal = Terminal::new(TestBackend::new(60, 6)).unwrap();
    terminal.draw(|frame| draw(&scene, frame.area(), frame.buffer_mut())).unwrap();
    let text: String = terminal.backend().buffer().content().iter().map(|c| c.symbol()).collect();
    assert!(text.starts_with("the window is too small: 40 columns, 13 lines"), "{text}");
}

#[test]
fn a_line_of_dots_has_no_holes() {
    for (from, to) in [((0, 0), (5, 40)), ((3, 9), (3, 2)), ((0, 7), (30, 0)), ((1, 1), (1, 1))] {
        let line: Vec<(usize, usize)> = between(from, to).collect();
        assert_eq!((line[0], line[line.len() - 1]), (from, to));
        let apart = |a: (usize, usize), b: (usize, usize)| a.0.abs_diff(b.0).max(a.1.abs_diff(b.1));
        assert!(line.windows(2).all(|pair| apart(pair[0], pair[1]) <= 1), "{line:?}");
    }
}
