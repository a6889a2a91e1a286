//! Texts that are broken on purpose, the same each time.
#![allow(dead_code)]

/// Numbers that look random and are the same each time (a linear congruential generator).
pub struct Numbers(pub u64);

impl Numbers {
    /// A number from 0 to below `bound`, which is not 0.
    pub fn below(&mut self, bound: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (self.0 >> 33) as usize % bound
    }

    fn one_of<'a, T: ?Sized>(&mut self, of: &[&'a T]) -> &'a T {
        of[self.below(of.len())]
    }
}

/// Values in place of those in a file.
const VALUES: &[&str] = &[
    "0",
    "-1",
    "1",
    "0.5",
    "-0.0",
    "1e308",
    "-1e308",
    "5e-324",
    "inf",
    "-inf",
    "nan",
    "40",
    "300",
    "1000000",
    "9223372036854775807",
    "-9223372036854775808",
    "99999999999999999999",
    "0xffffffff",
    "\"torque\"",
    "\"\"",
    "\"rest\"",
    "\"learn\"",
    "\"file\"",
    "[]",
    "[1, 2, 3]",
    "[[[]]]",
    "{}",
    "{ a = 1 }",
    "true",
    "2026-11-26",
    "'''",
    "\"\\u0000\"",
];
/// Lines that no file has.
const LINES: &[&str] = &[
    "[[segments]]",
    "[segments]",
    "[matching]",
    "[scanner]",
    "[protocol]",
    "[[protocol]]",
    "kind = \"guided_sine\"",
    "kind = \"wait_for_scanner\"",
    "repeat = 1000",
    "repeat = 4294967296",
    "duration_s = 1e9",
    "axis = 2",
    "axes = [0, 1, 2]",
    "session = true",
    "label = \"\u{1f980}\\n\"",
    "x.y.z = 1",
    "= 1",
    "\u{feff}",
    "file = \"/dev/zero\"",
    "file = \"/etc/passwd\"",
];

/// A text with one to three changes such as a user, a broken editor or an enemy makes.
pub fn mutated(text: &str, others: &[&str], numbers: &mut Numbers) -> String {
    let mut text = text.to_owned();
    for _ in 0..=numbers.below(3) {
        let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
        if lines.is_empty() {
            return text;
        }
        let at = numbers.below(lines.len());
        match numbers.below(9) {
            // Most often a value: what is otherwise right goes furthest.
            0..=3 => {
                let with_values: Vec<usize> =
                    (0..lines.len()).filter(|line| lines[*line].contains(" = ")).collect();
                if !with_values.is_empty() {
                    let line = with_values[numbers.below(with_values.len())];
                    let key = lines[line].split(" = ").next().unwrap_or_default().to_owned();
                    lines[line] = format!("{key} = {}", numbers.one_of(VALUES));
                }
            }
            4 => drop(lines.remove(at)),
            5 => lines.insert(at, numbers.one_of(LINES).to_owned()),
            6 => {
                let other = numbers.below(lines.len());
                lines.swap(at, other);
            }
            7 => {
                let other: Vec<&str> = numbers.one_of(others).lines().collect();
                let from = numbers.below(other.len().max(1));
                let part = other.iter().skip(from).take(1 + numbers.below(8));
                lines.splice(at..at, part.map(|line| (*line).to_owned()));
            }
            _ => {
                let mut characters: Vec<char> = lines[at].chars().collect();
                let place = numbers.below(characters.len() + 1);
                match numbers.below(3) {
                    0 => characters.truncate(place),
                    1 => characters.insert(
                        place,
                        numbers
                            .one_of(&["[", "\"", "{", "\0", "é", "#"])
                            .chars()
                            .next()
                            .unwrap_or('['),
                    ),
                    _ => characters.reverse(),
                }
                lines[at] = characters.into_iter().collect();
            }
        }
        text = lines.join("\n");
    }
    // Now and then the file ends too early.
    if numbers.below(20) == 0 {
        text = text.chars().take(numbers.below(1 + text.chars().count())).collect();
    }
    text
}
