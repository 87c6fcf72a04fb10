//! The course of a fit: loss and held-out quality against steps, as SVG.

use crate::FitError;
use crate::simplify::HistoryPoint;
use plotters::prelude::{
    ChartBuilder, Circle, IntoDrawingArea, LineSeries, RGBColor, SVGBackend, ShapeStyle, WHITE,
};

/// A title, and the value of a point of the history.
type Axis = (&'static str, fn(&HistoryPoint) -> Option<f64>);

const LOSS: RGBColor = RGBColor(0xc0, 0x5a, 0x10);
const QUALITY: RGBColor = RGBColor(0x1b, 0x5f, 0x9e);

/// The section of the two curves; empty when the fit made no step. `quality` names that of the evaluations.
pub(super) fn section(history: &[HistoryPoint], quality: &'static str) -> Result<String, FitError> {
    if history.len() < 2 {
        return Ok(String::new());
    }
    let value: [Axis; 2] = [
        (quality, |h| Some(h.quality)),
        // An evaluation before the first step has no loss.
        ("training loss", |h| h.training_loss().filter(|l| *l > 0.0)),
    ];
    let mut plots = String::new();
    for ((title, y), color) in value.into_iter().zip([QUALITY, LOSS]) {
        let points = history.iter().filter_map(|h| Some((h.step as f64, y(h)?)));
        let points: Vec<(f64, f64)> = points.filter(|p| p.1.is_finite()).collect();
        plots += &format!("<div>{}</div>\n", curve(title, "steps", color, &points)?);
    }
    Ok(format!("<h3>Course of the fit</h3>\n<div class=plots>\n{plots}</div>\n"))
}

fn curve(title: &str, x: &str, color: RGBColor, points: &[(f64, f64)]) -> Result<String, FitError> {
    let mut svg = String::new();
    draw(&mut svg, title, x, color, points)
        .map_err(|e| FitError::Io { path: title.into(), source: std::io::Error::other(e.to_string()) })?;
    // Scales with its column.
    Ok(svg.replacen("<svg width=\"600\" height=\"320\"", "<svg", 1))
}

fn draw(
    svg: &mut String,
    title: &str,
    x: &str,
    color: RGBColor,
    points: &[(f64, f64)],
) -> Result<(), Box<dyn std::error::Error>> {
    let (x_low, x_high) = range(points.iter().map(|p| p.0).chain([0.0]), 0.0);
    let (y_low, y_high) = range(points.iter().map(|p| p.1), 0.06);
    let area = SVGBackend::with_string(svg, (600, 320)).into_drawing_area();
    area.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&area)
        .caption(title, ("sans-serif", 16))
        .margin(10)
        // The last label stands half outside of the axis.
        .margin_right(24)
        .x_label_area_size(36)
        .y_label_area_size(56)
        .build_cartesian_2d(x_low..x_high, y_low..y_high)?;
    chart
        .configure_mesh()
        .x_desc(x)
        .x_labels(8)
        .y_labels(7)
        .x_label_formatter(&label)
        .y_label_formatter(&label)
        .light_line_style(WHITE)
        .bold_line_style(RGBColor(0xe6, 0xe6, 0xe2))
        .draw()?;
    let style = ShapeStyle::from(color).stroke_width(2);
    chart.draw_series(LineSeries::new(points.iter().copied(), style))?;
    chart.draw_series(points.iter().map(|p| Circle::new(*p, 2, style.filled())))?;
    area.present()?;
    Ok(())
}

/// A tick without the digits that binary fractions add.
fn label(tick: &f64) -> String {
    format!("{}", (tick * 1e6).round() / 1e6)
}

/// A range around the values, with a share of it as room at both ends.
fn range(values: impl Iterator<Item = f64>, room: f64) -> (f64, f64) {
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    if low > high {
        return (0.0, 1.0);
    }
    let size = if high > low { high - low } else { low.abs().max(1.0) * 0.1 };
    (low - room * size, high.max(low + size) + room * size)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_never_empty() {
        assert_eq!(range([].into_iter(), 0.1), (0.0, 1.0));
        assert_eq!(range([2.0, 4.0].into_iter(), 0.5), (1.0, 5.0));
        let (low, high) = range([3.0].into_iter(), 0.0);
        assert!(low < high);
    }

    #[test]
    fn ticks_are_short() {
        assert_eq!([100.0, 0.1 + 0.2, 24.25].map(|t| label(&t)), ["100", "0.3", "24.25"]);
    }

    #[test]
    fn curves_are_scalable_svg() {
        let svg = curve("a <b>", "x", LOSS, &[(0.0, 1.0), (5.0, 2.0)]).unwrap();
        assert!(svg.starts_with("<svg viewBox"), "{}", &svg[..80]);
        assert!(svg.contains("a &lt;b&gt;"), "text is escaped");
    }
}
