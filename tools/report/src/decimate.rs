//! Fewer points, same picture.

/// Reduces a polyline of pixel coordinates to the first, lowest, highest and last point of each run
/// that falls into one column `column` units wide: the drawn envelope is the same and no peak is
/// lost. Runs are taken in the order of the data, so curves that go back and forth (hysteresis
/// loops) survive too.
pub(crate) fn envelope(points: &[(i32, i32)], column: i32) -> Vec<(i32, i32)> {
    let column = column.max(1);
    let mut kept = Vec::new();
    let mut rest = points;
    while let Some(&(x, _)) = rest.first() {
        let bin = x.div_euclid(column);
        let length = rest.iter().take_while(|p| p.0.div_euclid(column) == bin).count();
        let (run, tail) = rest.split_at(length);
        if length <= 4 {
            kept.extend_from_slice(run);
        } else {
            let mut picks = [0, length - 1, 0, 0];
            for (i, p) in run.iter().enumerate() {
                if p.1 < run[picks[2]].1 {
                    picks[2] = i;
                }
                if p.1 > run[picks[3]].1 {
                    picks[3] = i;
                }
            }
            picks.sort_unstable();
            let mut last = usize::MAX;
            for i in picks {
                if i != last {
                    kept.push(run[i]);
                }
                last = i;
            }
        }
        rest = tail;
    }
    kept.dedup();
    kept
}

/// Keeps one point per square cell `cell` units wide, in the order of the data.
pub(crate) fn thin(points: &[(i32, i32)], cell: i32) -> Vec<(i32, i32)> {
    let cell = cell.max(1);
    let mut seen = std::collections::HashSet::new();
    points
        .iter()
        .copied()
        .filter(|p| seen.insert((p.0.div_euclid(cell), p.1.div_euclid(cell))))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn envelope_keeps_every_extreme_of_every_column() {
        let points: Vec<_> = (0..100_000).map(|i| (i / 100, (i * 7919) % 1009)).collect();
        let kept = envelope(&points, 4);
        assert!(kept.len() <= 4 * 250 + 4, "{}", kept.len());
        for column in 0..250 {
            let range = |p: &[(i32, i32)]| {
                let inside = p.iter().filter(|p| p.0.div_euclid(4) == column).map(|p| p.1);
                (inside.clone().min(), inside.max())
            };
            assert_eq!(range(&points), range(&kept), "column {column}");
        }
    }

    #[test]
    fn envelope_of_a_short_line_is_the_line() {
        let points = [(0, 1), (50, 2), (20, 9), (20, 8)];
        assert_eq!(envelope(&points, 4), points);
    }

    #[test]
    fn thinning_leaves_one_point_per_cell() {
        let points: Vec<_> = (0..10_000).map(|i| (i % 100, (i / 100) % 100)).collect();
        assert_eq!(thin(&points, 10).len(), 100);
    }
}
