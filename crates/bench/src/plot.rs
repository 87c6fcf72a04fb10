//! Curves in an SVG, both axes logarithmic.
//!
//! Lines, marks and words are drawn by plotters' SVG backend; words need no font library there.

use anyhow::Result;
use plotters::prelude::{
    ChartBuilder, Circle, IntoDrawingArea, IntoLogRange, LineSeries, PathElement, RGBColor, SVGBackend,
    SeriesLabelPosition, ShapeStyle, WHITE,
};

/// The words at an axis.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Axis<'a>(pub(crate) &'a str);

/// The first eight differ in brightness too.
const COLORS: [RGBColor; 12] = [
    RGBColor(0x1b, 0x5f, 0x9e),
    RGBColor(0xd9, 0x6b, 0x0b),
    RGBColor(0x2a, 0x8c, 0x3c),
    RGBColor(0xa0, 0x2b, 0x7a),
    RGBColor(0x55, 0x55, 0x55),
    RGBColor(0xc2, 0xa0, 0x05),
    RGBColor(0x0f, 0x9d, 0xa8),
    RGBColor(0xd1, 0x1f, 0x2d),
    RGBColor(0x8d, 0x6e, 0x54),
    RGBColor(0x9a, 0xc4, 0x4c),
    RGBColor(0xb9, 0x9a, 0xe0),
    RGBColor(0x10, 0x10, 0x10),
];

/// Draws named curves; points that have no logarithm are moved to a tenth of the smallest value that has one.
pub(crate) fn curves(
    title: &str,
    x: Axis<'_>,
    y: Axis<'_>,
    curves: &[(String, Vec<(f64, f64)>)],
) -> Result<String> {
    let all = || curves.iter().flat_map(|(_, points)| points);
    let (x_low, x_high) = range(all().map(|p| p.0));
    let (y_low, top) = range(all().map(|p| p.1));
    // Room above the curves for their names, a line of which takes about a twentieth of the height.
    let names = (0.03 + 0.05 * curves.len() as f64).min(0.7);
    let y_high = top * (top / y_low).powf(names / (1.0 - names));
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, (760, 460)).into_drawing_area();
        area.fill(&WHITE)?;
        let mut chart = ChartBuilder::on(&area)
            .caption(title, ("sans-serif", 17))
            .margin(14)
            .x_label_area_size(42)
            .y_label_area_size(68)
            .build_cartesian_2d((x_low..x_high).log_scale(), (y_low..y_high).log_scale())?;
        let mut mesh = chart.configure_mesh();
        mesh.x_desc(x.0)
            .y_desc(y.0)
            .x_labels(6)
            .x_label_formatter(&number)
            .y_label_formatter(&number)
            .draw()?;
        for (i, (name, points)) in curves.iter().enumerate() {
            let style = ShapeStyle::from(COLORS[i % COLORS.len()]).stroke_width(2);
            let place = |p: &(f64, f64)| (p.0.max(x_low), p.1.max(y_low));
            chart
                .draw_series(LineSeries::new(points.iter().map(place), style))?
                .label(name.as_str())
                .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], style));
            chart.draw_series(points.iter().map(|p| Circle::new(place(p), 3, style.filled())))?;
        }
        chart
            .configure_series_labels()
            .position(SeriesLabelPosition::UpperLeft)
            .background_style(WHITE)
            .draw()?;
        area.present()?;
    }
    Ok(svg)
}

/// A number at an axis, without what rounding adds to it.
fn number(value: &f64) -> String {
    let decimals = (3.0 - value.abs().log10()).clamp(0.0, 12.0) as usize;
    let text = format!("{value:.decimals$}");
    let short = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    short.to_owned()
}

/// A range around the positive finite values, with room at both ends.
fn range(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let (mut low, mut high, mut zero) = (f64::INFINITY, 0.0_f64, false);
    for value in values {
        if value > 0.0 && value.is_finite() {
            low = low.min(value);
            high = high.max(value);
        } else {
            zero = true;
        }
    }
    if high == 0.0 {
        return (0.1, 10.0);
    }
    (low * if zero { 0.1 } else { 0.7 }, high * 1.4)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_hold_zero_and_single_values() {
        assert_eq!(range([].into_iter()), (0.1, 10.0));
        assert_eq!(range([0.0].into_iter()), (0.1, 10.0));
        let (low, high) = range([2.0, 0.0, f64::NAN].into_iter());
        assert!(low < 0.21 && high > 2.0, "{low} {high}");
    }

    #[test]
    fn numbers_at_axes_are_short() {
        let cases = [
            (0.1 + 0.2, "0.3"),
            (100.0, "100"),
            (2000.0, "2000"),
            (0.01, "0.01"),
            (1.0, "1"),
            (3e-7, "0.0000003"),
            (0.0, "0"),
        ];
        for (value, text) in cases {
            assert_eq!(number(&value), text);
        }
    }

    #[test]
    fn every_curve_and_its_name_is_drawn() {
        let data =
            vec![("ours".to_owned(), vec![(1.0, 0.0), (10.0, 2.0)]), ("naive".to_owned(), vec![(1.0, 5.0)])];
        let svg = curves("a title", Axis("size"), Axis("time"), &data).expect("a plot");
        for word in ["a title", "ours", "naive", "size", "time"] {
            assert!(svg.contains(word), "{word}");
        }
        assert_eq!(svg.matches("<circle").count(), 3);
    }
}
