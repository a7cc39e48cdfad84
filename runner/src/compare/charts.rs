//! Charts of error against cost.

use super::results::{Measurement, Results};
use plotters::coord::ranged1d::{AsRangedCoord, ValueFormatter};
use plotters::prelude::*;

/// What costs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cost {
    /// Milliseconds of a frame.
    Time,
    /// Bytes.
    Memory,
}

impl Cost {
    /// Of a measurement.
    fn of(self, measurement: &Measurement) -> f64 {
        match self {
            Cost::Time => measurement.frame_ms,
            Cost::Memory => measurement.memory.all as f64 / 1024.0,
        }
    }

    fn title(self) -> &'static str {
        match self {
            Cost::Time => "milliseconds of a frame",
            Cost::Memory => "KiB",
        }
    }

    /// The chart's file.
    pub fn file(self) -> &'static str {
        match self {
            Cost::Time => "error-time.svg",
            Cost::Memory => "error-memory.svg",
        }
    }
}

/// Errors below this are drawn at it: a logarithmic axis has no 0.
const LEAST_ERROR: f64 = 1e-5;

/// Which measurements no other beats: none has less error at no more cost, or as little error at less cost.
pub fn pareto(measurements: &[Measurement], cost: Cost) -> Vec<usize> {
    let point = |m: &Measurement| (cost.of(m), m.own().flip);
    let beats = |a: (f64, f64), b: (f64, f64)| a.0 <= b.0 && a.1 <= b.1 && a != b;
    let is_best = |&i: &usize| !measurements.iter().any(|m| beats(point(m), point(&measurements[i])));
    let mut best: Vec<usize> = (0..measurements.len()).filter(is_best).collect();
    best.sort_by(|&a, &b| cost.of(&measurements[a]).total_cmp(&cost.of(&measurements[b])));
    best
}

/// A chart as SVG: mean ꟻLIP of the user's camera against a cost, both logarithmic. A line joins what no other beats.
pub fn chart(results: &Results, cost: Cost) -> Result<String, String> {
    let points: Vec<(f64, f64)> = results
        .configurations
        .iter()
        .map(|m| (cost.of(m).max(1e-6), m.own().flip.max(LEAST_ERROR)))
        .collect();
    let range = |values: &mut dyn Iterator<Item = f64>| {
        let (low, high) = values.fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(v), h.max(v)));
        if low > high { 0.5..2.0 } else { low / 1.5..high * 1.5 }
    };
    let x = range(&mut points.iter().map(|p| p.0));
    let y = range(&mut points.iter().map(|p| p.1));
    let mut svg = String::new();
    draw(&mut svg, results, cost, &points, (x.log_scale(), y.log_scale())).map_err(|e| e.to_string())?;
    Ok(svg)
}

fn draw<X, Y>(
    svg: &mut String,
    results: &Results,
    cost: Cost,
    points: &[(f64, f64)],
    axes: (X, Y),
) -> Result<(), Box<dyn std::error::Error>>
where
    X: AsRangedCoord<Value = f64>,
    Y: AsRangedCoord<Value = f64>,
    X::CoordDescType: ValueFormatter<f64>,
    Y::CoordDescType: ValueFormatter<f64>,
{
    let area = SVGBackend::with_string(svg, (640, 440)).into_drawing_area();
    area.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&area)
        .margin(12)
        .x_label_area_size(40)
        .y_label_area_size(64)
        .build_cartesian_2d(axes.0, axes.1)?;
    chart
        .configure_mesh()
        .x_desc(cost.title())
        .y_desc("mean FLIP, own camera (0 is drawn as 1e-5)")
        .x_label_formatter(&|value| short(*value))
        .y_label_formatter(&|value| short(*value))
        .light_line_style(WHITE)
        .draw()?;
    let best = pareto(&results.configurations, cost);
    chart.draw_series(LineSeries::new(best.iter().map(|&i| points[i]), BLACK.mix(0.4)))?;
    let mut methods: Vec<_> = results.configurations.iter().map(|m| m.configuration.method).collect();
    methods.dedup();
    for (index, method) in methods.into_iter().enumerate() {
        let color = Palette99::pick(index).to_rgba();
        let own = || {
            results.configurations.iter().zip(points).filter(move |(m, _)| m.configuration.method == method)
        };
        let dots = own().map(|(_, &point)| Circle::new(point, 4, color.filled()));
        let name = own().next().map_or_else(String::new, |(m, _)| m.configuration.method_name());
        let legend = move |(x, y)| Circle::new((x, y), 4, color.filled());
        chart.draw_series(dots)?.label(name).legend(legend);
        let labels = own().filter_map(|(m, &point)| Some((m.configuration.n?, point)));
        let style = ("sans-serif", 11).into_font().color(&color);
        chart.draw_series(
            labels.map(|(n, point)| {
                EmptyElement::at(point) + Text::new(n.to_string(), (6, -12), style.clone())
            }),
        )?;
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperRight)
        .background_style(WHITE.mix(0.8))
        .border_style(BLACK.mix(0.3))
        .draw()?;
    area.present()?;
    Ok(())
}

/// A number with as many digits as an axis has room for.
fn short(value: f64) -> String {
    if !(1e-3..1e5).contains(&value) {
        format!("{value:.0e}")
    } else {
        format!("{}", (value * 1e4).round() / 1e4)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compare::metrics::Errors;
    use crate::compare::results::{Identity, Rounds, ViewErrors};
    use crate::compare::subject::{Configuration, Memory};
    use crate::settings::Method;

    fn measured(frame_ms: f64, flip: f64) -> Measurement {
        Measurement {
            configuration: Configuration { method: Method::None, n: None },
            frame_ms,
            rays_per_second: 1.0,
            preparation_ms: 1.0,
            edit_ms: 1.0,
            memory: Memory { all: 2048, ..Memory::default() },
            pipeline: None,
            views: vec![ViewErrors { view: "own".into(), errors: Errors { flip, ..Errors::default() } }],
            flicker: 0.0,
            rays: 1,
            rounds: Rounds::default(),
        }
    }

    /// The third is slower than the first and worse, the fourth is as good as the second and slower.
    #[test]
    fn what_another_beats_is_not_on_the_line() {
        let all = [
            measured(1.0, 0.5),
            measured(4.0, 0.0),
            measured(2.0, 0.6),
            measured(5.0, 0.0),
            measured(2.0, 0.2),
        ];
        assert_eq!(pareto(&all, Cost::Time), [0, 4, 1]);
        // All take the same memory.
        assert_eq!(pareto(&all, Cost::Memory), [1, 3]);
    }

    #[test]
    fn charts_of_one_and_of_nothing_can_be_drawn() {
        let mut results = Results::new(Identity::default(), 1, 1, 1);
        for _ in 0..2 {
            for cost in [Cost::Time, Cost::Memory] {
                let svg = chart(&results, cost).expect("drawn");
                assert!(svg.starts_with("<svg") && svg.contains(cost.title()), "{svg}");
                let is_finite = ["inf", "NaN"].iter().all(|number| !svg.contains(number));
                assert!(is_finite, "axes have numbers: {svg}");
                // Beside what axes are of: at least one number at each.
                assert!(svg.matches("<text").count() >= 4, "{svg}");
            }
            results.configurations.push(measured(1.0, 0.0));
        }
    }
}
