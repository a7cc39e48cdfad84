//! `docs/METHODS.md`: a row for each method, from the results of comparisons.

use super::about::{ABOUT, About};
use super::charts::{Cost, pareto};
use super::report::described;
use super::results::{Measurement, Results};
use crate::settings::Method;
use clap::ValueEnum;
use std::fmt::Write;

/// The page. `results` are those of one comparison for each scene, all of one device.
pub fn page(results: &[Results]) -> String {
    let mut text = HEAD.to_owned();
    text += "## The methods\n\n| Method | Idea | Paper | N | Cost | Choose it |\n|---|---|---|---|---|---|\n";
    for About { name, idea, paper, cost, choose } in &ABOUT {
        let method = Method::from_str(name, false).ok();
        let parameter = method.and_then(Method::parameter).unwrap_or("none");
        line(&mut text, format_args!("| `{name}` | {idea} | {paper} | {parameter} | {cost} | {choose} |"));
    }
    text += "\n## What they get wrong, and what they take\n\n";
    for results in results {
        scene(&mut text, results);
    }
    text += TERMS;
    text
}

const HEAD: &str = "# Methods\n\n\
<!-- Written by `cargo xtask methods`, which measures everything anew. Change runner/src/compare, not this file. -->\n\n\
Every method that `--method` names, what it costs and what it gets wrong. All numbers are measured by `emboss compare`, with \
the commands given below. `emboss render --quality 0.02` chooses by such measurements of your own scene.\n\n";

const TERMS: &str = "Errors are those of the scene's own camera; **flip** is mean ꟻLIP (Andersson and others 2020, 0 to 1), \
**depth** the mean difference of hit distances in edge lengths of the base mesh, **normal** the mean angle between normals, \
**outline** the pixels on the wrong side of the silhouette and those missing within it, as shares of the model's pixels, \
**grazing** mean ꟻLIP from a camera that looks along the surface at 10 degrees, **flicker** the change from picture to \
picture of a path that the reference does not have. **Time** is a frame's, as a ratio to the quadtree's with the \
greatest N of the table, **memory** all but film and colour maps. Bold names: no other has less error in less time.\n";

/// A scene's table.
fn scene(text: &mut String, results: &Results) {
    let identity = &results.identity;
    line(text, format_args!("```sh\n{}\n```\n", identity.command));
    let reference = results.reference.map_or_else(String::new, described);
    line(text, format_args!("On {} ({}). Reference: {reference}.\n", identity.device, identity.backend));
    text.push_str(
        "| Method | Time | Memory KiB | flip | depth | normal ° | outline | grazing | flicker |\n|---|---|---|---|---|---|---|---|---|\n",
    );
    let mut quadtrees = results.configurations.iter().filter(|m| m.configuration.method_name() == "quadtree");
    let unit = quadtrees.next_back().map_or(1.0, |m| m.frame_ms);
    let best = pareto(&results.configurations, Cost::Time);
    for (i, measured) in results.configurations.iter().enumerate() {
        row(text, measured, unit, best.contains(&i));
    }
    for skipped in &results.skipped {
        line(text, format_args!("\n`{}` is left out: {}", skipped.configuration, skipped.reason));
    }
    text.push('\n');
}

fn row(text: &mut String, m: &Measurement, unit: f64, is_best: bool) {
    let own = m.own();
    let wrong = (own.silhouette_pixels + own.missing_pixels) as f64 / own.reference_pixels.max(1) as f64;
    let grazing = m.views.get(1).map_or_else(|| "-".to_owned(), |view| format!("{:.4}", view.errors.flip));
    let name = if is_best { format!("**{}**", m.configuration) } else { m.configuration.to_string() };
    line(
        text,
        format_args!(
            "| {name} | {} | {:.0} | {:.4} | {:.4} | {:.2} | {:.2} % | {grazing} | {:.4} |",
            ratio(m.frame_ms / unit),
            m.memory.all as f64 / 1024.0,
            own.flip,
            own.depth_mean,
            own.normal_mean_degrees,
            100.0 * wrong,
            m.flicker
        ),
    );
}

/// A ratio with two digits at the least: methods are up to thousands of times as fast as others.
fn ratio(x: f64) -> String {
    let zeros = (0..4).filter(|&zeros| x > 0.0 && x < 0.1_f64.powi(zeros + 1)).count();
    format!("{x:.0$}", (zeros + 2).min(6))
}

fn line(text: &mut String, line: std::fmt::Arguments<'_>) {
    // A string takes everything.
    let _ = writeln!(text, "{line}");
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compare::metrics::Errors;
    use crate::compare::results::{Identity, ViewErrors};
    use crate::compare::subject::{Configuration, Memory};
    use crate::settings::Subdivisions;

    /// The page in the repository was written when there was each of the methods.
    #[test]
    fn the_written_page_has_all_methods() {
        let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/METHODS.md");
        let page = std::fs::read_to_string(file).expect("it is in the repository");
        for method in Method::value_variants() {
            let value = method.to_possible_value().expect("named");
            let row = format!("| `{}` |", value.get_name());
            assert!(page.contains(&row), "{row} is not in docs/METHODS.md: run `cargo xtask methods`");
        }
    }

    #[test]
    fn small_ratios_have_digits() {
        let texts = [2.0, 0.5, 0.051, 0.00123, 0.0].map(ratio);
        assert_eq!(texts, ["2.00", "0.50", "0.051", "0.0012", "0.00"]);
    }

    /// Half of ten pixels are on the wrong side; the other configuration is exact and takes twice as long.
    #[test]
    fn rows_have_what_was_measured() {
        let [version, backend] = ["0.1.0", "cpu"].map(str::to_owned);
        let (command, device) = ("emboss compare builtin:cube".to_owned(), "a processor".to_owned());
        let mut results =
            Results::new(Identity { version, command, backend, device, files: vec![] }, 4, 3, 1);
        let measured = |method, n, errors, frame_ms| Measurement {
            frame_ms,
            memory: Memory { all: 2048, ..Memory::default() },
            ..Measurement::new(
                Configuration { method, n },
                vec![ViewErrors { view: "own".into(), errors }],
                0.0,
                Memory::default(),
                1,
            )
        };
        let rough = Errors {
            flip: 0.25,
            reference_pixels: 10,
            silhouette_pixels: 3,
            missing_pixels: 2,
            ..Errors::default()
        };
        results.configurations = vec![
            measured(Method::None, None, rough, 3.0),
            measured(Method::Quadtree, Some(Subdivisions::Fixed(64)), Errors::default(), 6.0),
            measured(Method::BruteForce, Some(Subdivisions::Fixed(64)), Errors::default(), 9.0),
        ];
        let page = page(&[results]);
        assert!(page.contains("```sh\nemboss compare builtin:cube\n```"), "{page}");
        assert!(
            page.contains("| **none** | 0.50 | 2 | 0.2500 | 0.0000 | 0.00 | 50.00 % | - | 0.0000 |"),
            "{page}"
        );
        assert!(
            page.contains("| **quadtree N=64** | 1.00 |") && page.contains("| brute-force N=64 | 1.50 |"),
            "{page}"
        );
        // A description of each method there is, and of no other.
        let described = page.lines().filter(|line| line.starts_with("| `")).count();
        assert_eq!(described, Method::value_variants().len());
    }
}
