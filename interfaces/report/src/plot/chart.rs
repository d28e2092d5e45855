//! Charts with lines and marks over two axes.

use super::scale::AxisScale;
use super::{escaped, page, px};
use std::fmt::Write;

/// Style of a series.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SeriesStyle {
    /// Solid line.
    Line,
    /// Steps: each value holds until the next point.
    Steps,
    /// Points, joined by a line.
    Points,
    /// Unconnected points.
    Dots,
    /// Dashed line of expected values.
    Expected,
    /// Dashed line on top of another one.
    Dashed,
}

impl SeriesStyle {
    fn is_dashed(self) -> bool {
        matches!(self, SeriesStyle::Expected | SeriesStyle::Dashed)
    }
}

/// Series of a chart.
#[derive(Debug, Clone, PartialEq)]
pub struct ChartSeries {
    /// Name in the legend.
    pub name: String,
    /// Points (x, y).
    pub points: Vec<[f64; 2]>,
    /// Length of the error bar of each point, up and down; empty for none.
    pub reach: Vec<f64>,
    /// Style.
    pub style: SeriesStyle,
}

impl ChartSeries {
    /// Returns the values that the vertical axis must show.
    fn heights(&self) -> impl Iterator<Item = f64> {
        let reach = self.reach.iter().copied().chain(std::iter::repeat(0.0));
        self.points.iter().zip(reach).flat_map(|(p, reach)| [p[1] - reach, p[1] + reach])
    }
}

/// Named interval of the horizontal axis, such as a phase.
#[derive(Debug, Clone, PartialEq)]
pub struct ChartBand {
    /// Start of the interval.
    pub from: f64,
    /// End of the interval.
    pub to: f64,
    /// Name above the interval.
    pub name: String,
}

/// Chart with two axes; labels include units.
#[derive(Debug, Clone, PartialEq)]
pub struct Chart {
    /// Title.
    pub title: String,
    /// Label of the horizontal axis.
    pub x: String,
    /// Label of the vertical axis.
    pub y: String,
    /// True for a logarithmic horizontal axis.
    pub log_x: bool,
    /// True for a logarithmic vertical axis.
    pub log_y: bool,
    /// True if the vertical axis starts at zero.
    pub starting_at_zero: bool,
    /// Series.
    pub series: Vec<ChartSeries>,
    /// Bands of the horizontal axis.
    pub bands: Vec<ChartBand>,
    /// Names along the horizontal axis at 0, 1, 2, ... instead of numbers.
    pub names: Vec<String>,
}

const WIDTH: f64 = 720.0;
const HEIGHT: f64 = 300.0;
/// Margins around the axes: left, right, above, below.
const MARGINS: [f64; 4] = [64.0, 16.0, 30.0, 44.0];
/// Height of a line of the legend and of the names of bands.
const LINE_HEIGHT: f64 = 17.0;
/// Width of a letter of the small texts.
const LETTER_WIDTH: f64 = 6.7;
/// Maximum number of intervals of a series; longer ones are drawn by the extremes of this number of intervals.
const MAX_INTERVALS: usize = 640;

impl Chart {
    /// Creates a chart with linear axes.
    pub fn new(title: &str, x: &str, y: &str) -> Self {
        Self {
            title: title.into(),
            x: x.into(),
            y: y.into(),
            log_x: false,
            log_y: false,
            starting_at_zero: false,
            series: vec![],
            bands: vec![],
            names: vec![],
        }
    }

    /// Creates a chart with names along the horizontal axis.
    pub fn with_names<S: Into<String>>(
        title: &str,
        y: &str,
        names: impl IntoIterator<Item = S>,
    ) -> Self {
        let names = names.into_iter().map(Into::into).collect();
        Self { names, ..Self::new(title, "", y) }
    }

    /// Makes the horizontal axis logarithmic.
    pub fn log_x(self) -> Self {
        Self { log_x: true, ..self }
    }

    /// Makes the vertical axis logarithmic.
    pub fn log_y(self) -> Self {
        Self { log_y: true, ..self }
    }

    /// Makes the vertical axis start at zero.
    pub fn starting_at_zero(self) -> Self {
        Self { starting_at_zero: true, ..self }
    }

    /// Adds bands.
    pub fn bands(self, bands: &[ChartBand]) -> Self {
        Self { bands: bands.to_vec(), ..self }
    }

    /// Adds a series.
    pub fn with(mut self, name: &str, points: Vec<[f64; 2]>, style: SeriesStyle) -> Self {
        self.series.push(ChartSeries { name: name.into(), points, reach: vec![], style });
        self
    }

    /// Adds dots with error bars: x, y, and half the length of the bar.
    pub fn with_error_bars(mut self, name: &str, bars: &[[f64; 3]]) -> Self {
        let points = bars.iter().map(|b| [b[0], b[1]]).collect();
        let reach = bars.iter().map(|b| b[2]).collect();
        self.series.push(ChartSeries {
            name: name.into(),
            points,
            reach,
            style: SeriesStyle::Dots,
        });
        self
    }

    /// Returns the drawing.
    pub fn svg(&self) -> String {
        let mut out = String::new();
        let lines = self.legend(&mut out);
        // What stands between title and axes, however much it is, leaves the axes as high as they are.
        let named = if self.bands.is_empty() { 0.0 } else { 1.0 };
        let down = LINE_HEIGHT * (lines + named);
        let _ = write!(out, "<g transform=\"translate(0 {down})\">");
        let points = || self.series.iter().flat_map(|s| s.points.iter());
        let x = match (self.bands.first(), self.bands.last()) {
            // Time runs to its end, not to the next round number.
            (Some(first), Some(last)) => AxisScale::exactly(first.from, last.to),
            _ if !self.names.is_empty() => AxisScale::exactly(-0.5, self.names.len() as f64 - 0.5),
            _ => AxisScale::over(points().map(|p| p[0]), self.log_x, false),
        };
        let y = AxisScale::over(
            self.series.iter().flat_map(ChartSeries::heights),
            self.log_y,
            self.starting_at_zero,
        );
        self.frame(&x, &y, &mut out);
        for (k, series) in self.series.iter().enumerate() {
            draw(series, k, &x, &y, &mut out);
        }
        format!(
            "<svg viewBox=\"0 0 {WIDTH} {}\" role=\"img\" aria-label=\"{}\">\
             <text x=\"{}\" y=\"15\" class=\"title\">{}</text>{out}</g></svg>",
            px(HEIGHT + down),
            escaped(&self.description()),
            px(MARGINS[0]),
            escaped(&self.title),
        )
    }

    /// Returns the description for screen readers.
    fn description(&self) -> String {
        let names: Vec<&str> = self.series.iter().map(|s| s.name.as_str()).collect();
        let x = if self.names.is_empty() { self.x.clone() } else { self.names.join(", ") };
        format!("{}: {} over {x}; {}", self.title, self.y, names.join(", "))
    }

    fn frame(&self, x: &AxisScale, y: &AxisScale, out: &mut String) {
        let [left, right, above, below] = MARGINS;
        let (floor, edge) = (HEIGHT - below, WIDTH - right);
        for (k, band) in self.bands.iter().enumerate() {
            let at = |v: f64| x.place(v).map_or(left, |s| across(s.clamp(0.0, 1.0)));
            let (from, to) = (at(band.from), at(band.to));
            let shade = k % 2;
            let _ = write!(
                out,
                "<rect x=\"{}\" y=\"{above}\" width=\"{}\" height=\"{}\" class=\"band{shade}\"/>",
                px(from),
                px(to - from),
                px(floor - above)
            );
            // A name that is wider than its band would run into the next one.
            if to - from > LETTER_WIDTH * band.name.chars().count() as f64 {
                let _ = write!(
                    out,
                    "<text x=\"{}\" y=\"{}\" class=\"tick\" text-anchor=\"middle\">{}</text>",
                    px(0.5 * (from + to)),
                    px(above - 5.0),
                    escaped(&band.name)
                );
            }
        }
        let named = self.names.iter().enumerate().map(|(k, name)| (k as f64, escaped(name)));
        let ticks = if self.names.is_empty() { x.ticks() } else { named.collect() };
        for (value, label) in ticks {
            let Some(place) = x.place(value).map(across) else { continue };
            let _ = write!(
                out,
                "<path d=\"M{0} {1}V{2}\" class=\"grid\"/><text x=\"{0}\" y=\"{3}\" class=\"tick\" \
                 text-anchor=\"middle\">{label}</text>",
                px(place),
                px(above),
                px(floor),
                px(floor + 16.0)
            );
        }
        for (value, label) in y.ticks() {
            let Some(place) = y.place(value).map(up) else { continue };
            let _ = write!(
                out,
                "<path d=\"M{0} {2}H{1}\" class=\"grid\"/><text x=\"{3}\" y=\"{4}\" class=\"tick\" \
                 text-anchor=\"end\">{label}</text>",
                px(left),
                px(edge),
                px(place),
                px(left - 6.0),
                px(place + 4.0)
            );
        }
        let _ = write!(
            out,
            "<path d=\"M{0} {1}V{2}H{3}\" class=\"edge\"/>\
             <text x=\"{4}\" y=\"{5}\" class=\"axis\" text-anchor=\"middle\">{6}</text>\
             <text transform=\"translate(14 {7}) rotate(-90)\" class=\"axis\" text-anchor=\"middle\">{8}</text>",
            px(left),
            px(above),
            px(floor),
            px(edge),
            px(0.5 * (left + edge)),
            px(HEIGHT - 8.0),
            escaped(&self.x),
            px(0.5 * (above + floor)),
            escaped(&self.y),
        );
    }

    /// Returns the legend and its number of lines.
    fn legend(&self, out: &mut String) -> f64 {
        if self.series.len() < 2 {
            return 0.0;
        }
        let (mut x, mut lines) = (MARGINS[0], 1.0);
        for (k, series) in self.series.iter().enumerate() {
            let width = 34.0 + LETTER_WIDTH * series.name.chars().count() as f64;
            if x + width > WIDTH && x > MARGINS[0] {
                (x, lines) = (MARGINS[0], lines + 1.0);
            }
            let y = 15.0 + LINE_HEIGHT * lines;
            let (left, middle, colour) = (px(x), px(y - 4.0), k % page::COLOUR_COUNT);
            let dash = dash(series, k);
            let _ = match series.style {
                SeriesStyle::Dots => {
                    dot(&px(x + 8.0), &middle, k, out);
                    Ok(())
                }
                _ => {
                    write!(out, "<path d=\"M{left} {middle}h16\" class=\"line c{colour}{dash}\"/>")
                }
            };
            let _ = write!(
                out,
                "<text x=\"{}\" y=\"{}\" class=\"tick\">{}</text>",
                px(x + 20.0),
                px(y),
                escaped(&series.name)
            );
            x += width;
        }
        lines
    }
}

fn across(share: f64) -> f64 {
    MARGINS[0] + share * (WIDTH - MARGINS[0] - MARGINS[1])
}

fn up(share: f64) -> f64 {
    HEIGHT - MARGINS[3] - share * (HEIGHT - MARGINS[2] - MARGINS[3])
}

/// Draws a dot; every second series has squares, so that series differ not only in colour.
fn dot(x: &str, y: &str, number: usize, out: &mut String) {
    let colour = number % page::COLOUR_COUNT;
    let _ = match number % 2 {
        0 => write!(out, "<circle cx=\"{x}\" cy=\"{y}\" r=\"3\" class=\"dot f{colour}\"/>"),
        _ => write!(out, "<path d=\"M{x} {y}m-3.5 -3.5h7v7h-7z\" class=\"dot f{colour}\"/>"),
    };
}

/// Returns the class of dashed lines; series whose colour repeats that of another are dashed as well.
fn dash(series: &ChartSeries, number: usize) -> &'static str {
    if series.style.is_dashed() || number >= page::COLOUR_COUNT { " dash" } else { "" }
}

fn draw(series: &ChartSeries, number: usize, x: &AxisScale, y: &AxisScale, out: &mut String) {
    let colour = number % page::COLOUR_COUNT;
    let dash = dash(series, number);
    for ([a, b], reach) in series.points.iter().zip(&series.reach) {
        let ends = [b - reach, b + reach].map(|end| y.place(end).map(up));
        let (Some(a), [Some(low), Some(high)]) = (x.place(*a).map(across), ends) else { continue };
        let _ = write!(
            out,
            "<path d=\"M{0} {1}h8m-4 0V{2}m-4 0h8\" class=\"line c{colour}\"/>",
            px(a - 4.0),
            px(low),
            px(high)
        );
    }
    let mut path = String::new();
    let mut pen_down = false;
    for [a, b] in thinned(&series.points, |b| y.place(b).is_some()) {
        let (Some(a), Some(b)) = (x.place(a), y.place(b)) else {
            pen_down = false;
            continue;
        };
        let (a, b) = (px(across(a.clamp(-0.01, 1.01))), px(up(b.clamp(-0.01, 1.01))));
        let _ = match (pen_down, series.style) {
            (_, SeriesStyle::Dots) => Ok(()),
            (false, _) => write!(path, "M{a} {b}"),
            (true, SeriesStyle::Steps) => write!(path, "H{a}V{b}"),
            (true, _) => write!(path, "L{a} {b}"),
        };
        pen_down = true;
        if matches!(series.style, SeriesStyle::Points | SeriesStyle::Dots) {
            dot(&a, &b, number, out);
        }
    }
    if !path.is_empty() {
        let _ = write!(out, "<path d=\"{path}\" class=\"line c{colour}{dash}\"/>");
    }
}

/// Returns the points, or the extremes of their intervals if there are more than [`MAX_INTERVALS`]; points with a place on
/// the axis have priority.
fn thinned(points: &[[f64; 2]], has_place: impl Fn(f64) -> bool) -> Vec<[f64; 2]> {
    if points.len() <= 2 * MAX_INTERVALS {
        return points.to_vec();
    }
    let stretch = points.len().div_ceil(MAX_INTERVALS);
    let mut out = Vec::with_capacity(2 * MAX_INTERVALS + 2);
    for part in points.chunks(stretch) {
        let by_height = |a: &&[f64; 2], b: &&[f64; 2]| a[1].total_cmp(&b[1]);
        let placed = || part.iter().filter(|point| has_place(point[1]));
        let ends = match placed().next() {
            Some(_) => [placed().min_by(by_height), placed().max_by(by_height)],
            None => [part.first(), None],
        };
        let mut ends: Vec<[f64; 2]> = ends.into_iter().flatten().copied().collect();
        ends.sort_by(|a, b| a[0].total_cmp(&b[0]));
        out.extend(ends);
    }
    out.extend(points.last());
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_chart_says_what_it_shows_and_keeps_peaks() {
        let mut points: Vec<[f64; 2]> = (0..20_000).map(|k| [k as f64, 1.0]).collect();
        points[12_345][1] = 99.0;
        assert!(thinned(&points, f64::is_finite).contains(&[12_345.0, 99.0]));
        assert!(thinned(&points, f64::is_finite).len() <= 2 * MAX_INTERVALS + 2);
        // Beside numbers that are none, or have no logarithm, too; a stretch of these alone is a gap.
        points[12_346][1] = f64::NAN;
        points[12_344][1] = 0.0;
        points[300..400].iter_mut().for_each(|point| point[1] = 0.0);
        let on_log = thinned(&points, |b| b > 0.0);
        assert!(on_log.contains(&[12_345.0, 99.0]));
        let gaps: Vec<f64> = on_log.iter().filter(|p| !(p[1] > 0.0)).map(|p| p[0]).collect();
        assert!(gaps.len() >= 2 && gaps.iter().all(|at| (300.0..400.0).contains(at)), "{gaps:?}");
        points[12_344..=12_346].iter_mut().for_each(|point| point[1] = 1.0);
        points[12_345][1] = 99.0;
        let chart = Chart::new("a < b", "time (s)", "force (N)")
            .with("left", points, SeriesStyle::Line)
            .with("law", vec![[0.0, 1.0], [1.0, f64::NAN], [2.0, 3.0]], SeriesStyle::Expected);
        let svg = chart.svg();
        assert!(svg.contains("aria-label=\"a &lt; b: force (N) over time (s); left, law\""));
        assert!(svg.contains("dash") && !svg.contains("NaN"), "{svg}");
        assert_eq!(svg, chart.svg());
    }

    #[test]
    fn dots_are_not_joined_and_bars_are_inside_the_axes() {
        let chart = Chart::with_names("t", "fraction", ["cubes", "dice"])
            .with("measured", vec![[0.0, 0.5], [0.0, 0.6], [1.0, 0.55]], SeriesStyle::Dots)
            .with_error_bars("published", &[[0.0, 0.5, 0.2], [1.0, 0.5, 0.2]]);
        let svg = chart.svg();
        assert!(!svg.contains('L'), "nothing is joined: {svg}");
        assert!(
            svg.contains(">cubes</text>") && svg.contains("fraction over cubes, dice"),
            "{svg}"
        );
        // Three and the mark in the legend; two bars.
        assert_eq!((svg.matches("<circle").count(), svg.matches("m-4 0h8").count()), (4, 2));
        assert!(svg.contains(">0.3</text>") && svg.contains(">0.7</text>"), "{svg}");
    }

    #[test]
    fn time_within_a_single_phase_runs_to_its_end_too() {
        let band = ChartBand { from: 0.0, to: 0.013, name: "lift".into() };
        let chart = Chart::new("t", "time (s)", "y").bands(&[band]);
        let svg = chart.with("y", vec![[0.0, 1.0], [0.013, 2.0]], SeriesStyle::Line).svg();
        assert!(svg.contains("L704 "), "{svg}");
    }
}
