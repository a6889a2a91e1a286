use super::*;
use crate::scope::capture::Capturer;
use crate::scope::trigger::Condition;

fn view(recorded: bool) -> View {
    let settings = Settings {
        mode: Mode::Normal,
        window_ns: 1_000_000_000,
        pre_ns: 200_000_000,
        auto_ns: 1_000_000_000,
        channel: (0, 0),
        condition: Condition::Rising(0.0),
        hysteresis: 0.0,
    };
    let channel = |name: &str, column| Channel {
        name: name.to_owned(),
        unit: "V".to_owned(),
        place: (0, column),
    };
    View::new(vec![channel("a", 0), channel("b", 1)], settings, recorded)
}

fn press(view: &mut View, keys: &[KeyCode]) -> Action {
    keys.iter().fold(Action::Nothing, |_, key| view.key(KeyEvent::new(*key, KeyModifiers::NONE)))
}

fn typed(view: &mut View, letters: &str) -> Action {
    press(view, &letters.chars().map(KeyCode::Char).collect::<Vec<_>>())
}

fn window(values: &[(f64, f64)]) -> Capture {
    let mut capturer = Capturer::new(view(false).settings, &[2], 1000);
    for (at, (a, b)) in (0..).zip(values) {
        capturer.take(0, at * 1_000_000, None, &[*a, *b]);
        capturer.advance(at * 1_000_000);
    }
    capturer.newest()
}

#[test]
fn a_scale_shows_all_values_in_round_steps() {
    for (low, high) in [(-1.0, 1.0), (0.0, 0.7), (3.2, 3.3), (-2e-6, 9e-6), (5.0, 5.0), (0.0, 0.0)]
    {
        let scale = Scale::of(low, high);
        let half = VERTICAL / 2.0 * scale.per_division * (1.0 + 1e-9);
        assert!(low >= scale.centre - half && high <= scale.centre + half, "{low} {high}");
        let step = scale.per_division;
        assert!((step_at_least(step) / step - 1.0).abs() < 1e-9, "{step}");
    }
    assert_eq!(Scale::of(-1.0, 1.0), Scale { per_division: 0.5, centre: 0.0 });
}

#[test]
fn a_scale_follows_the_values_until_a_key_changes_it() {
    let mut view = view(false);
    view.fit(&window(&[(0.0, 10.0), (1.0, 20.0)]));
    assert_eq!(view.channels[0].scale.per_division, 0.2);
    assert_eq!(view.channels[1].scale.per_division, 2.0);
    // A window that it suits does not change it, so that the picture stands still.
    view.fit(&window(&[(0.1, 10.0), (0.8, 20.0)]));
    assert_eq!(view.channels[0].scale.per_division, 0.2);
    view.fit(&window(&[(0.0, 10.0), (3.0, 20.0)]));
    assert_eq!(view.channels[0].scale.per_division, 0.5);
    press(&mut view, &[KeyCode::Tab]);
    typed(&mut view, "V");
    press(&mut view, &[KeyCode::Up]);
    let own = view.channels[1].scale;
    assert_eq!(own.per_division, 5.0);
    view.fit(&window(&[(0.0, -1.0), (0.1, 1.0)]));
    assert_eq!(view.channels[1].scale, own);
    typed(&mut view, "a");
    view.fit(&window(&[(0.0, -1.0), (0.1, 1.0)]));
    assert_eq!(view.channels[1].scale, Scale { per_division: 0.5, centre: 0.0 });
}

#[test]
fn keys_set_trigger_time_base_and_mode() {
    let mut view = view(false);
    view.fit(&window(&[(0.0, 10.0), (1.0, 20.0)]));
    assert_eq!(typed(&mut view, "++"), Action::Set);
    let Condition::Rising(level) = view.settings.condition else { panic!() };
    assert!((level - 0.04).abs() < 1e-12, "{level}");
    press(&mut view, &[KeyCode::Tab]);
    assert_eq!(typed(&mut view, "g"), Action::Set);
    assert_eq!(view.settings.channel, (0, 1));
    assert_eq!(typed(&mut view, "e"), Action::Set);
    assert!(matches!(view.settings.condition, Condition::Falling(_)));
    typed(&mut view, "t");
    assert_eq!((view.settings.window_ns, view.settings.pre_ns), (500_000_000, 100_000_000));
    typed(&mut view, "TT");
    assert_eq!((view.settings.window_ns, view.settings.pre_ns), (2_000_000_000, 400_000_000));
    assert_eq!(view.settings.auto_ns, 2_000_000_000);
    typed(&mut view, "PPPPPPPPPPp");
    assert_eq!(view.settings.pre_ns, 1_800_000_000);
    for _ in 0..40 {
        typed(&mut view, "t");
    }
    assert_eq!(view.settings.window_ns, 1_000_000);
    let modes = [Mode::Single, Mode::Roll, Mode::Auto, Mode::Normal];
    for mode in modes {
        typed(&mut view, "m");
        assert_eq!(view.settings.mode, mode);
    }
}

#[test]
fn a_recording_goes_from_window_to_window() {
    let mut view = view(true);
    assert_eq!(typed(&mut view, " "), Action::Run);
    assert_eq!(typed(&mut view, " "), Action::Run);
    assert_eq!(typed(&mut view, "f"), Action::Nothing);
    typed(&mut view, "mm");
    assert_eq!(view.settings.mode, Mode::Auto, "nothing rolls");
}

#[test]
fn space_stops_and_goes_on_and_q_ends() {
    let mut view = view(false);
    assert_eq!(typed(&mut view, " "), Action::Nothing);
    assert!(!view.running);
    assert_eq!(typed(&mut view, " "), Action::Run);
    assert!(view.running);
    assert_eq!(typed(&mut view, "f"), Action::Force);
    for key in [KeyCode::Char('q'), KeyCode::Esc] {
        assert_eq!(press(&mut view, &[key]), Action::Quit);
    }
    let interrupt = KeyEvent::new(KeyCode::Char('c'), KeyModifiers::CONTROL);
    assert_eq!(view.key(interrupt), Action::Quit);
}

#[test]
fn cursors_come_move_and_go() {
    let mut view = view(false);
    press(&mut view, &[KeyCode::Right]);
    assert_eq!(view.cursors, [None, None]);
    typed(&mut view, "c");
    press(&mut view, &[KeyCode::Left, KeyCode::Left]);
    typed(&mut view, "c");
    view.key(KeyEvent::new(KeyCode::Right, KeyModifiers::SHIFT));
    let [a, b] = view.cursors.map(Option::unwrap);
    assert!((a - 0.24).abs() < 1e-12 && (b - 0.8).abs() < 1e-12, "{a} {b}");
    typed(&mut view, "c");
    assert_eq!(view.cursors, [None, None]);
}
