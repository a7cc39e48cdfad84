//! `docs/METHODS.md`: a row for each method, from the results of comparisons.

use super::about::{ABOUT, About};
use super::charts::{Cost, pareto};
use super::report::described;
use super::results::{Measurement, Results, Skipped};
use crate::settings::Method;
use clap::ValueEnum;
use std::fmt::Write;

/// The page. `results` are those of one comparison for each scene, all of one device.
pub fn page(results: &[Results]) -> String {
    let mut text = HEAD.to_owned();
    text += "## The methods\n\n| Method | Idea | Paper | N | Cost | Outline | Vectors | Choose it |\n\
             |---|---|---|---|---|---|---|---|\n";
    for About { name, idea, paper, cost, choose } in &ABOUT {
        let method = Method::from_str(name, false).ok();
        let parameter = method.and_then(Method::parameter).unwrap_or("none");
        let outline = if method.is_some_and(Method::changes_silhouette) { "displaced" } else { "flat" };
        let vectors = if method.is_some_and(Method::takes_vectors) { "yes" } else { "no" };
        line(
            &mut text,
            format_args!(
                "| `{name}` | {idea} | {paper} | {parameter} | {cost} | {outline} | {vectors} | {choose} |"
            ),
        );
    }
    text += VECTORS;
    text += "\n## What they get wrong, and what they take\n\n";
    for results in results {
        scene(&mut text, results);
    }
    text += TERMS;
    text
}

const HEAD: &str = "# Methods\n\n\
<!-- Written by `cargo xtask methods`, which measures everything anew. Change runner/src/compare, not this file. \
-->\n\n\
Every method that `--method` names, what it costs and what it gets wrong. All numbers are measured by `emboss \
compare`, with \
the commands given below. `emboss render --quality 0.02` chooses by such measurements of your own scene.\n\n";

const VECTORS: &str = "\n**Outline**: whether the relief shows in the model's outline, or that of the base mesh stays. \
    **Vectors**: \
whether the method takes vector displacement, P + s [t b n] (d - o) (Volovar 2016, formula (4)), where the map is a \
vector map \
(`--displacement tangent` or `object`): the micro-triangles are the same, moved in any direction, so that the surface \
may hang over. \
`builtin:mushroom` below is such a scene, by the methods that can show it; `none` leaves vectors out as it does \
heights.\n";

const TERMS: &str = "Errors are those of the scene's own camera; **flip** is mean ꟻLIP (Andersson and others 2020, 0 \
    to 1), \
**depth** the mean difference of hit distances in edge lengths of the base mesh, **normal** the mean angle between \
normals, \
**outline** the pixels on the wrong side of the silhouette and those missing within it, as shares of the model's \
pixels, \
**grazing** mean ꟻLIP from a camera that looks along the surface at 10 degrees, **flicker** the change from picture to \
picture of a path that the reference does not have. **Time** is a frame's, as a ratio to the quadtree's with the \
greatest N of the table, **memory** all but film and colour maps, \
**pipeline** the instructions of SPIR-V from which a driver makes the pipeline that renders: those of the one method \
and of what \
the scene uses (- where the CPU renders). Bold names: no other has less error in less time.\n";

/// A scene's table.
fn scene(text: &mut String, results: &Results) {
    let identity = &results.identity;
    line(text, format_args!("```sh\n{}\n```\n", identity.command));
    let reference = results.reference.map_or_else(String::new, described);
    line(
        text,
        format_args!(
            "On {} ({}, {}). Reference: {reference}.\n",
            identity.device, identity.backend, identity.details
        ),
    );
    text.push_str(
        "| Method | Time | Memory KiB | Pipeline | flip | depth | normal ° | outline | grazing | flicker |\n\
         |---|---|---|---|---|---|---|---|---|---|\n",
    );
    let mut quadtrees = results.configurations.iter().filter(|m| m.configuration.method_name() == "quadtree");
    let unit = quadtrees.next_back().map_or(1.0, |m| m.frame_ms);
    let best = pareto(&results.configurations, Cost::Time);
    for (i, measured) in results.configurations.iter().enumerate() {
        row(text, measured, unit, best.contains(&i));
    }
    for (names, reason) in left_out(&results.skipped) {
        let verb = if names.len() > 1 { "are" } else { "is" };
        line(text, format_args!("\n{} {verb} left out: {reason}", names.join(", ")));
    }
    text.push('\n');
}

/// What was left out, once for each reason: a configuration by itself, all of a method by its name.
fn left_out(skipped: &[Skipped]) -> Vec<(Vec<String>, String)> {
    let mut all: Vec<(Vec<String>, String)> = Vec::new();
    for Skipped { configuration, reason } in skipped {
        let of_method = skipped.iter().filter(|other| other.configuration.method == configuration.method);
        let is_whole =
            of_method.clone().count() > 1 && of_method.clone().all(|other| other.reason == *reason);
        let method = configuration.method_name();
        let name = if is_whole { format!("`{method}`") } else { format!("`{configuration}`") };
        // Reasons name the method: what is left without that may be the reason of others.
        let reason = reason.replace(&format!("--method {method} "), "");
        match all.iter_mut().find(|(_, other)| *other == reason) {
            Some((names, _)) if names.contains(&name) => {}
            Some((names, _)) => names.push(name),
            None => all.push((vec![name], reason)),
        }
    }
    all
}

fn row(text: &mut String, m: &Measurement, unit: f64, is_best: bool) {
    let own = m.own();
    let wrong = (own.silhouette_pixels + own.missing_pixels) as f64 / own.reference_pixels.max(1) as f64;
    let grazing = m.views.get(1).map_or_else(|| "-".to_owned(), |view| format!("{:.4}", view.errors.flip));
    let code = m.pipeline.map_or_else(|| "-".to_owned(), |code| code.instructions.to_string());
    let name = if is_best { format!("**{}**", m.configuration) } else { m.configuration.to_string() };
    line(
        text,
        format_args!(
            "| {name} | {} | {:.0} | {code} | {:.4} | {:.4} | {:.2} | {:.2} % | {grazing} | {:.4} |",
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
    use crate::compare::subject::{Code, Configuration, Memory};
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
    fn what_is_left_out_is_said_once() {
        let skipped = |method, n: Option<u32>, reason: &str| Skipped {
            configuration: Configuration { method, n: n.map(Subdivisions::Fixed) },
            reason: reason.to_owned(),
        };
        let all = [
            skipped(Method::Steep, Some(4), "--method steep takes no vectors"),
            skipped(Method::Steep, Some(16), "--method steep takes no vectors"),
            skipped(Method::Bump, None, "--method bump takes no vectors"),
            skipped(Method::Tessellate, Some(256), "too many"),
        ];
        let expected = [
            (vec!["`steep`".to_owned(), "`bump`".to_owned()], "takes no vectors".to_owned()),
            (vec!["`tessellate N=256`".to_owned()], "too many".to_owned()),
        ];
        assert_eq!(left_out(&all), expected);
    }

    #[test]
    fn small_ratios_have_digits() {
        let texts = [2.0, 0.5, 0.051, 0.00123, 0.0].map(ratio);
        assert_eq!(texts, ["2.00", "0.50", "0.051", "0.0012", "0.00"]);
    }

    /// Half of ten pixels are on the wrong side; the other configuration is exact and takes twice as long.
    #[test]
    fn rows_have_what_was_measured() {
        let command = "emboss compare builtin:cube".to_owned();
        let mut results = Results::new(Identity { command, ..Identity::default() }, 4, 3, 1);
        let measured = |method, n, errors, frame_ms| Measurement {
            frame_ms,
            memory: Memory { all: 2048, ..Memory::default() },
            ..Measurement::new(
                Configuration { method, n },
                vec![ViewErrors { view: "own".into(), errors }],
                0.0,
                Memory::default(),
                Some(Code { instructions: 77, bytes: 1 }),
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
            page.contains("| **none** | 0.50 | 2 | 77 | 0.2500 | 0.0000 | 0.00 | 50.00 % | - | 0.0000 |"),
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
