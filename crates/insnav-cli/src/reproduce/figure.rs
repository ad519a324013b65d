//! A drawing of lines with bands, as SVG.

use std::fmt::Write as _;

/// Values against time, three side by side and the next below.
pub(super) struct Figure {
    pub(super) title: String,
    pub(super) about: &'static str,
    pub(super) panels: Vec<Panel>,
}

/// One pair of axes; the vertical one fits what is drawn.
pub(super) struct Panel {
    pub(super) title: &'static str,
    /// What the vertical axis shows, with its unit.
    pub(super) axis: &'static str,
    pub(super) series: Vec<Series>,
}

/// A line: time in seconds, value and half width of its band in the unit of the axis.
pub(super) struct Series {
    pub(super) name: &'static str,
    pub(super) points: Vec<[f64; 3]>,
}

/// Colours that people of all kinds of sight tell apart (Okabe and Ito).
const COLOURS: [&str; 6] = [
    "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9",
];
const PANEL_WIDTH: f64 = 460.0;
const PER_ROW: usize = 3;
const HEIGHT: f64 = 420.0;
const LEFT: f64 = 60.0;
const TOP: f64 = 84.0;
const RIGHT: f64 = 16.0;
const BOTTOM: f64 = 52.0;

impl Figure {
    /// The document.
    pub(super) fn svg(&self) -> String {
        let width = PANEL_WIDTH * self.panels.len().min(PER_ROW) as f64;
        // The first row is lower by what stands above it.
        let row_height = HEIGHT - TOP + 40.0;
        let rows = self.panels.len().div_ceil(PER_ROW).max(1);
        let height = HEIGHT + row_height * (rows - 1) as f64;
        let mut out = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" height=\"{height}\" \
             font-family=\"sans-serif\" font-size=\"12\">\n<title>{}</title>\n<desc>{}</desc>\n\
             <rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n\
             <text x=\"{LEFT}\" y=\"24\" font-size=\"15\">{}</text>\n<text x=\"{LEFT}\" y=\"42\" fill=\"#555\">{}</text>\n",
            escaped(&self.title),
            escaped(self.about),
            escaped(&self.title),
            escaped(self.about),
        );
        let mut drawn = 0;
        for (i, panel) in self.panels.iter().enumerate() {
            let (row, column) = (i / PER_ROW, i % PER_ROW);
            let _ = writeln!(
                out,
                "<g transform=\"translate(0 {})\">",
                row_height * row as f64
            );
            panel.draw(&mut out, PANEL_WIDTH * column as f64, drawn);
            out.push_str("</g>\n");
            drawn += panel.series.len();
        }
        out.push_str("</svg>\n");
        out
    }
}

/// From values to places on the paper.
struct Axes {
    left: f64,
    x: [f64; 2],
    y: [f64; 2],
}

impl Axes {
    fn place(&self, x: f64, y: f64) -> (f64, f64) {
        let share = |v: f64, [low, high]: [f64; 2]| (v - low) / (high - low);
        (
            self.left + share(x, self.x) * (PANEL_WIDTH - LEFT - RIGHT),
            HEIGHT - BOTTOM - share(y, self.y) * (HEIGHT - TOP - BOTTOM),
        )
    }
}

impl Panel {
    /// All of the lines, and zero, are inside.
    fn range(&self) -> ([f64; 2], [f64; 2]) {
        let points = || self.series.iter().flat_map(|s| &s.points);
        let end = points().map(|p| p[0]).fold(1.0, f64::max);
        let reach = points()
            .map(|p| p[1].abs() + p[2])
            .filter(|v| v.is_finite())
            .fold(1e-3, f64::max);
        ([0.0, end], [-1.05 * reach, 1.05 * reach])
    }

    /// `drawn`: so many series are in the panels before, and have had their colours.
    fn draw(&self, out: &mut String, offset: f64, drawn: usize) {
        let colours = || COLOURS.iter().cycle().skip(drawn);
        let (x, y) = self.range();
        let axes = Axes {
            left: offset + LEFT,
            x,
            y,
        };
        self.frame(out, &axes);
        for (series, colour) in self.series.iter().zip(colours()) {
            series.draw(out, &axes, colour);
        }
        for (i, (series, colour)) in self.series.iter().zip(colours()).enumerate() {
            let (x, y) = (axes.left + 10.0, TOP + 16.0 + 16.0 * i as f64);
            let _ = writeln!(
                out,
                "<path d=\"M{x} {}h18\" stroke=\"{colour}\" stroke-width=\"2\"/><text x=\"{}\" y=\"{y}\">{}</text>",
                y - 4.0,
                x + 24.0,
                escaped(series.name)
            );
        }
    }

    fn frame(&self, out: &mut String, axes: &Axes) {
        let (left, bottom) = axes.place(axes.x[0], axes.y[0]);
        let (right, top) = axes.place(axes.x[1], axes.y[1]);
        for v in ticks(axes.y) {
            let (_, y) = axes.place(0.0, v);
            let colour = if v == 0.0 { "#888" } else { "#ddd" };
            let _ = writeln!(
                out,
                "<path d=\"M{left:.1} {y:.1}H{right:.1}\" stroke=\"{colour}\"/><text x=\"{:.1}\" y=\"{:.1}\" \
                 text-anchor=\"end\">{}</text>",
                left - 6.0,
                y + 4.0,
                label(v)
            );
        }
        for v in ticks(axes.x) {
            let (x, _) = axes.place(v, 0.0);
            let _ = writeln!(
                out,
                "<path d=\"M{x:.1} {bottom:.1}v5\" stroke=\"black\"/><text x=\"{x:.1}\" y=\"{:.1}\" \
                 text-anchor=\"middle\">{}</text>",
                bottom + 18.0,
                label(v)
            );
        }
        let middle = 0.5 * (left + right);
        let (text_x, text_y) = (left - 42.0, 0.5 * (top + bottom));
        let _ = writeln!(
            out,
            "<rect x=\"{left:.1}\" y=\"{top:.1}\" width=\"{:.1}\" height=\"{:.1}\" fill=\"none\" stroke=\"black\"/>\n\
             <text x=\"{middle:.1}\" y=\"{:.1}\" text-anchor=\"middle\">time, s</text>\n\
             <text x=\"{middle:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>\n\
             <text transform=\"translate({text_x:.1} {text_y:.1}) rotate(-90)\" text-anchor=\"middle\">{}</text>",
            right - left,
            bottom - top,
            bottom + 38.0,
            top - 10.0,
            escaped(self.title),
            escaped(self.axis)
        );
    }
}

impl Series {
    fn draw(&self, out: &mut String, axes: &Axes, colour: &str) {
        let path = |values: &mut dyn Iterator<Item = (f64, f64)>| {
            let mut text = String::new();
            for (x, y) in values {
                let (x, y) = axes.place(x, y);
                let _ = write!(
                    text,
                    "{}{x:.1} {y:.1}",
                    if text.is_empty() { "M" } else { "L" }
                );
            }
            text
        };
        let good = || {
            self.points
                .iter()
                .filter(|p| p.iter().all(|v| v.is_finite()))
        };
        let upper = good().map(|p| (p[0], p[1] + p[2]));
        let lower = good().rev().map(|p| (p[0], p[1] - p[2]));
        let band = path(&mut upper.chain(lower));
        let line = path(&mut good().map(|p| (p[0], p[1])));
        if line.is_empty() {
            return;
        }
        let _ = writeln!(
            out,
            "<path d=\"{band}Z\" fill=\"{colour}\" fill-opacity=\"0.13\"/>\n\
             <path d=\"{line}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.6\"/>"
        );
    }
}

/// Round numbers inside a range, five to ten of them.
fn ticks([low, high]: [f64; 2]) -> Vec<f64> {
    let rough = (high - low) / 8.0;
    let power = 10f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0]
        .map(|m| m * power)
        .into_iter()
        .find(|s| *s >= rough)
        .unwrap_or(10.0 * power);
    let first = (low / step).ceil() as i64;
    let last = (high / step).floor() as i64;
    (first..=last).map(|i| i as f64 * step).collect()
}

fn label(v: f64) -> String {
    let text = format!("{v:.4}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    text.replace('-', "−")
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        assert_eq!(
            ticks([0.0, 300.0]),
            [0.0, 50.0, 100.0, 150.0, 200.0, 250.0, 300.0]
        );
        let t = ticks([-1.26, 1.26]);
        assert!(
            t.contains(&0.0) && t.len() >= 5 && t.iter().all(|v| v.abs() <= 1.26),
            "{t:?}"
        );
        assert_eq!(
            (label(-0.5), label(20.0), label(0.0)),
            ("−0.5".into(), "20".into(), "0".into())
        );
    }

    #[test]
    fn lines_and_bands_lie_inside_their_panel() {
        let points = (0..=300).map(|t| [f64::from(t), 0.01 * f64::from(t), 0.5]);
        let figure = Figure {
            title: "a < b".into(),
            about: "",
            panels: vec![Panel {
                title: "one",
                axis: "heading error, °",
                series: vec![
                    Series {
                        name: "rising",
                        points: points.collect(),
                    },
                    Series {
                        name: "unknown",
                        points: vec![[0.0, f64::NAN, 1.0]],
                    },
                ],
            }],
        };
        let svg = figure.svg();
        assert!(svg.contains("a &lt; b") && !svg.contains("NaN"));
        let line = svg
            .lines()
            .find(|l| l.contains("stroke-width=\"1.6\""))
            .expect("a line");
        let d = line.split('"').nth(1).expect("its path");
        let numbers: Vec<f64> = d
            .split(|c: char| !(c.is_ascii_digit() || c == '.' || c == '-'))
            .filter_map(|t| t.parse().ok())
            .collect();
        assert_eq!(numbers.len(), 2 * 301);
        for at in numbers.chunks(2) {
            assert!(
                (LEFT..=PANEL_WIDTH - RIGHT).contains(&at[0])
                    && (TOP..=HEIGHT - BOTTOM).contains(&at[1])
            );
        }
        // Upwards is up: the last point is higher than the first.
        assert!(numbers[601] < numbers[1]);
    }
}
