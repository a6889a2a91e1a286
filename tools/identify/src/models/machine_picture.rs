//! The machine as a drawing, with the places of effects marked.

use plant::effects::Site;

use crate::outcome::Outcome;

/// Size of the drawing, CSS pixels.
const WIDTH: u32 = 680;
const HEIGHT: u32 = 178;
/// Colours of the palette: ink, and the mark.
const INK: &str = "#222222";
const MARK: &str = "#D55E00";
const PLAIN: &str = "#ffffff";
const TINT: &str = "#FBE9DF";

/// A part of the machine: its site, what is written in it, left edge and width (CSS pixels).
type Part = (Site, [&'static str; 2], u32, u32);

/// The chain from the amplifier to the handle.
const CHAIN: [Part; 4] = [
    (Site::Drive, ["amplifier", "and motor"], 20, 110),
    (Site::Master, ["master", "pulley, piston"], 165, 120),
    (Site::Line, ["line", "to the scanner"], 320, 150),
    (Site::Slave, ["slave", "piston, handle"], 505, 150),
];
/// Instruments, each below the part that it reads.
const INSTRUMENTS: [(&str, u32); 3] = [("encoder", 225), ("encoder", 545), ("torque cell", 620)];

/// Draws a transmission as SVG, with the places of the effects that were found and of what is
/// unlisted; `None` where there are none.
pub fn machine_picture(outcome: &Outcome) -> Option<String> {
    let mut marks: Vec<(Site, String)> = outcome
        .effects
        .iter()
        .filter_map(|effect| Some((Site::from_name(&effect.site)?, effect.id.replace('_', " "))))
        .collect();
    let unlisted = outcome.unlisted.as_ref().and_then(|own| Site::from_name(&own.site));
    marks.extend(unlisted.map(|site| (site, "unlisted".to_owned())));
    (!marks.is_empty()).then(|| draw(&marks))
}

/// Draws the machine with the places and names of effects.
fn draw(marks: &[(Site, String)]) -> String {
    let told = |site: Site| -> Vec<&str> {
        marks.iter().filter(|(own, _)| *own == site).map(|(_, id)| id.as_str()).collect()
    };
    let mut body = String::new();
    for pair in CHAIN.windows(2) {
        let (from, to) = (pair[0].2 + pair[0].3, pair[1].2);
        body += &format!(
            "<line x1=\"{from}\" y1=\"62\" x2=\"{to}\" y2=\"62\" stroke=\"{INK}\" \
             stroke-width=\"2\"/>"
        );
    }
    for (site, lines, left, width) in CHAIN {
        let names = told(site);
        let (fill, edge) = if names.is_empty() { (PLAIN, INK) } else { (TINT, MARK) };
        let thick = if names.is_empty() { 1 } else { 3 };
        let middle = left + width / 2;
        body += &format!(
            "<rect x=\"{left}\" y=\"34\" width=\"{width}\" height=\"56\" rx=\"6\" fill=\"{fill}\" \
             stroke=\"{edge}\" stroke-width=\"{thick}\"/>"
        );
        body += &text(middle, 58, "bold", INK, lines[0]);
        body += &text(middle, 76, "normal", INK, lines[1]);
        body += &text(middle, 22, "bold", MARK, &names.join(", "));
    }
    let names = told(Site::Sensor);
    for (name, middle) in INSTRUMENTS {
        let colour = if names.is_empty() { INK } else { MARK };
        body += &format!(
            "<line x1=\"{middle}\" y1=\"90\" x2=\"{middle}\" y2=\"112\" stroke=\"{colour}\" \
             stroke-dasharray=\"3 3\"/>"
        );
        body += &text(middle, 127, "normal", colour, name);
    }
    body += &text(WIDTH / 2, 156, "bold", MARK, &names.join(", "));
    let title = marks.iter().map(|(site, id)| format!("{id} at the {site}")).collect::<Vec<_>>();
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{WIDTH}\" height=\"{HEIGHT}\" \
         viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"{}\"><rect width=\"{WIDTH}\" \
         height=\"{HEIGHT}\" fill=\"#ffffff\"/>{body}</svg>",
        title.join(", ")
    )
}

/// A centred line of text.
fn text(middle: u32, baseline: u32, weight: &str, colour: &str, text: &str) -> String {
    if text.is_empty() {
        return String::new();
    }
    // Ids of effects and the words above need no escaping.
    format!(
        "<text x=\"{middle}\" y=\"{baseline}\" text-anchor=\"middle\" font-family=\"Helvetica \
         Neue, Helvetica, Arial, Liberation Sans, sans-serif\" font-size=\"13\" \
         font-weight=\"{weight}\" fill=\"{colour}\">{text}</text>"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_site_has_a_place() {
        for site in Site::ALL {
            let svg = draw(&[(site, "some effect".to_owned())]);
            assert_eq!(svg.matches(">some effect<").count(), 1, "{site}");
            assert!(svg.matches(MARK).count() > 1, "{site}: the place itself is marked");
        }
        let both = [(Site::Slave, "one".to_owned()), (Site::Slave, "two".to_owned())];
        assert!(draw(&both).contains(">one, two<"));
    }
}
