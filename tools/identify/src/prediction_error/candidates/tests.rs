use super::*;

/// Features of records in which every effect of the list can show.
fn features() -> RecordFeatures {
    RecordFeatures {
        volts: 10.0,
        lines_hz: [vec![7.0], vec![7.0]],
        hum_hz: vec![50.0],
        torque: true,
        hand: true,
        slave: true,
        ..RecordFeatures::default()
    }
}

#[test]
fn every_listed_effect_is_searched_at_each_of_its_sites() {
    let searched = candidates(&features());
    let listed = LIST.iter().flat_map(|entry| entry.sites.iter().map(move |at| (entry, at)));
    for (entry, place) in listed {
        let own = searched.iter().find(|own| (own.id, own.site) == (entry.id, place.site));
        let own = own.unwrap_or_else(|| {
            panic!("identify does not search {} at {}", entry.id, place.site);
        });
        for start in &own.starts {
            assert!(start.effect().is_some(), "{start:?} is no valid effect");
        }
        let names = |name: &str| own.starts[0].effect().unwrap().get(name).is_some();
        assert!(own.free.iter().all(|free| names(free.name)), "{own:?}");
    }
}

/// The default search of an effect whose size has this range.
fn by_size(size: f64, minimum: f64, maximum: f64) -> (SearchRange, Vec<(f64, bool)>) {
    let (unit, source) = ("1", "assumed");
    let info = ParameterInfo { name: "size", unit, minimum, maximum, printed: size, source };
    let search = Search { id: "example", site: Site::Slave, size, features: &features() };
    let space = search.by_size(&info);
    let starts = space.starts.iter().map(|start| (start.values[0].1, space.signed));
    (space.free[0], starts.collect())
}

#[test]
fn without_an_arm_an_effect_is_searched_by_its_size_within_its_range() {
    let (range, starts) = by_size(0.5, 0.0, 100.0);
    assert_eq!((range.low, range.high), (0.0, 10.0));
    assert_eq!(starts, [(0.15, false), (0.5, false), (1.5, false)]);

    let (range, starts) = by_size(0.5, -1.0, 1.0);
    assert_eq!((range.low, range.high), (-1.0, 1.0));
    let [small, large] = [0.15, 1.0];
    assert_eq!(
        starts,
        [small, -small, 0.5, -0.5, large, -large].map(|start| (start, true)),
        "both signs, the largest held within the range"
    );

    let (range, starts) = by_size(-0.5, -100.0, 0.0);
    assert_eq!((range.low, range.high), (-10.0, 0.0));
    assert_eq!(starts, [(-0.15, false), (-0.5, false), (-1.5, false)]);
}
