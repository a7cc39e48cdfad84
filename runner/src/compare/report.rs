//! `report.html`: everything on one page, which needs no other file.

use super::charts::{Cost, chart, pareto};
use super::heat;
use super::metrics::Errors;
use super::reference::{BOUND, BOUND_DEGREES, Reason, Residual, Summary};
use super::results::{Measurement, Results, ResultsError, Store};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use std::fmt::Display;

/// Writes the page and the charts beside the results.
pub fn write(store: &Store) -> Result<(), ResultsError> {
    for cost in [Cost::Time, Cost::Memory] {
        // What cannot be drawn, as numbers out of an axis' range, is left out of the page too.
        if let Ok(svg) = chart(&store.results, cost) {
            store.write(cost.file(), &svg)?;
        }
    }
    store.write("report.html", &page(store))
}

/// The page. Every element is closed, so that it reads as XML too.
fn page(store: &Store) -> String {
    let results = &store.results;
    let title = "Relief methods compared";
    let mut body = format!("<h1>{title}</h1>\n");
    body += &facts(results);
    body += "<h2>Error against cost</h2>\n<p>Lower left is better. The line joins what no other beats.</p>\n<div \
        class=\"charts\">\n";
    for cost in [Cost::Time, Cost::Memory] {
        body += &chart(results, cost).unwrap_or_default();
    }
    body += "</div>\n<h2>Numbers</h2>\n";
    body += &table(results);
    body += &skipped(results);
    body += TERMS;
    body += "<h2>Pictures</h2>\n";
    body += &legend();
    let views = results.configurations.first().map_or(&[][..], |measured| &measured.views);
    for view in views {
        body += &gallery(store, &view.view);
    }
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\"/>\n<title>{title}</title>\n\
         <style>{STYLE}</style>\n</head>\n<body>\n{body}</body>\n</html>\n"
    )
}

const STYLE: &str = "body{font:15px/1.4 sans-serif;margin:2em auto;max-width:1400px;padding:0 1em;color:#222}\
table{border-collapse:collapse;font-size:13px}td,th{padding:3px 8px;border-bottom:1px solid #ddd;text-align:right}\
td:first-child,th:first-child{text-align:left}tr.best td{background:#eef6e8}.facts th{text-align:left}.facts \
td{text-align:left}\
.charts{display:flex;flex-wrap:wrap;gap:1em}.gallery{display:flex;flex-wrap:wrap;gap:1em}figure{margin:0}\
figcaption{font-size:13px}img{display:block;max-width:320px;height:auto}\
.legend{width:320px;height:16px}.scale{width:320px;display:flex;justify-content:space-between;font-size:12px}";

/// What the numbers mean.
const TERMS: &str = "<dl>\n\
<dt>FLIP</dt><dd>How different two pictures look, from 0 to 1: Andersson and others 2020, 67 pixels a degree; the \
mean.</dd>\n\
<dt>PSNR</dt><dd>Of sRGB values, over a grey where nothing is hit.</dd>\n\
<dt>depth, normal</dt><dd>Of the nearest hits through the pixels' centres, where both hit; depths in edge lengths of \
the base mesh. p99.9: what 99.9 % do not exceed.</dd>\n\
<dt>silhouette, missing</dt><dd>Pixels on the wrong side of the outline, and holes within it.</dd>\n\
<dt>flicker</dt><dd>Mean difference of FLIP between neighbouring pictures of a path from that of the reference.</dd>\n\
<dt>frame, rays</dt><dd>Median over interleaved rounds, by the device's clock where it has one; rays to lights \
included.</dd>\n\
<dt>prepare</dt><dd>From the scene to what rays can be traced in, once pipelines are made.</dd>\n\
<dt>trees</dt><dd>Min/max pyramids of the height maps, and distance maps.</dd>\n\
<dt>pipeline</dt><dd>SPIR-V of the kernel that makes pictures, specialised: the code of the one method and of what the \
scene uses. - where the CPU renders: there the code for all is in the program.</dd>\n\
<dt>edit</dt><dd>From other heights to the first frame, of one sample a pixel.</dd>\n\
</dl>\n";

/// Text as XML has it.
fn escaped(text: impl Display) -> String {
    let text = text.to_string();
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

fn facts(results: &Results) -> String {
    let identity = &results.identity;
    let state = if results.complete { "" } else { "; not complete as yet" };
    let rows = [
        ("Command", format!("<code>{}</code>", escaped(&identity.command))),
        ("Version", escaped(format!("emboss {}", identity.version))),
        ("Device", escaped(format!("{} ({}, {})", identity.device, identity.backend, identity.details))),
        (
            "Picture",
            format!("{} x {} pixels, {} samples each", results.width, results.height, results.samples),
        ),
        ("Measured", format!("{:.0} s{state}", results.seconds)),
        ("Reference", results.reference.map_or_else(String::new, |summary| escaped(described(summary)))),
    ];
    let row = |(name, value): (&str, String)| format!("<tr><th>{name}</th><td>{value}</td></tr>\n");
    format!("<table class=\"facts\">\n{}</table>\n", rows.map(row).concat())
}

/// How good the reference is, in a sentence.
pub fn described(summary: Summary) -> String {
    let Summary { n, residual, reason, .. } = summary;
    let bounds = format!("{BOUND} pixels and {BOUND_DEGREES} degrees");
    let why = match reason {
        Reason::Converged => format!("converged: {bounds} at most"),
        Reason::Greatest => format!("the greatest N there is; {bounds} were asked for"),
        Reason::Time => format!("no time for more; {bounds} were asked for"),
        Reason::Given => "as given".to_owned(),
    };
    let moved = residual.map_or_else(String::new, |Residual { pixels, degrees }| {
        format!(
            "; from half of it, what pixels show moved by {pixels:.4} of their width, and normals turned by \
            {degrees:.2} degrees, in the mean"
        )
    });
    format!("quadtree with N = {n}{moved} ({why})")
}

fn table(results: &Results) -> String {
    let mut html = "<table>\n<tr><th>method</th><th>frame ms</th><th>Mrays/s</th><th>prepare ms</th><th>edit ms</th>\
        <th>BVH KiB</th><th>trees KiB</th><th>maps KiB</th><th>all KiB</th><th>pipeline KiB</th><th>instructions</th>\
        <th>view</th><th>FLIP</th><th>PSNR dB</th><th>depth</th><th>p99.9</th>\
        <th>normal °</th><th>p99.9</th><th>silhouette</th><th>missing</th><th>flicker</th></tr>\n"
        .to_owned();
    let best = pareto(&results.configurations, Cost::Time);
    for (i, m) in results.configurations.iter().enumerate() {
        for (v, view) in m.views.iter().enumerate() {
            let class = if v == 0 && best.contains(&i) { " class=\"best\"" } else { "" };
            let cost = if v == 0 { cost_cells(m) } else { "<td></td>".repeat(11) };
            let flicker = if v == 0 { format!("{:.5}", m.flicker) } else { String::new() };
            let errors = error_cells(&view.errors);
            html += &format!(
                "<tr{class}>{cost}<td>{}</td>{errors}<td>{flicker}</td></tr>\n",
                escaped(&view.view)
            );
        }
    }
    html + "</table>\n<p>Shaded: no other has less error in less time.</p>\n"
}

fn cost_cells(m: &Measurement) -> String {
    let kib = |bytes: u64| format!("{:.1}", bytes as f64 / 1024.0);
    let cells = [
        escaped(m.configuration),
        format!("{:.3}", m.frame_ms),
        format!("{:.2}", m.rays_per_second * 1e-6),
        format!("{:.2}", m.preparation_ms),
        format!("{:.2}", m.edit_ms),
        kib(m.memory.bvh),
        kib(m.memory.trees),
        kib(m.memory.maps),
        kib(m.memory.all),
        // On the CPU backend there are none.
        m.pipeline.map_or_else(|| "-".to_owned(), |code| kib(code.bytes)),
        m.pipeline.map_or_else(|| "-".to_owned(), |code| code.instructions.to_string()),
    ];
    cells.map(|cell| format!("<td>{cell}</td>")).concat()
}

fn error_cells(e: &Errors) -> String {
    let cells = [
        format!("{:.5}", e.flip),
        e.psnr_db.map_or_else(|| "equal".to_owned(), |db| format!("{db:.1}")),
        format!("{:.5}", e.depth_mean),
        format!("{:.4}", e.depth_p999),
        format!("{:.3}", e.normal_mean_degrees),
        format!("{:.2}", e.normal_p999_degrees),
        e.silhouette_pixels.to_string(),
        e.missing_pixels.to_string(),
    ];
    cells.map(|cell| format!("<td>{cell}</td>")).concat()
}

fn skipped(results: &Results) -> String {
    if results.skipped.is_empty() {
        return String::new();
    }
    let item = |s: &super::results::Skipped| {
        format!("<li>{}: {}</li>\n", escaped(s.configuration), escaped(&s.reason))
    };
    let items: String = results.skipped.iter().map(item).collect();
    format!("<h3>Left out</h3>\n<ul>\n{items}</ul>\n")
}

/// The colours of error maps.
fn legend() -> String {
    let stops = heat::STOPS.map(|[r, g, b]| format!("rgb({r},{g},{b})")).join(",");
    let most = heat::MOST;
    format!(
        "<div class=\"legend\" style=\"background:linear-gradient(to right,{stops})\"></div>\n\
         <div class=\"scale\"><span>FLIP 0</span><span>{:.1}</span><span>{most:.1} or more</span></div>\n",
        0.5 * most
    )
}

fn gallery(store: &Store, view: &str) -> String {
    let mut html = format!("<h3>{} camera</h3>\n<div class=\"gallery\">\n", escaped(view));
    html += &figure(store, &[format!("{view}-reference")], "reference");
    for measured in &store.results.configurations {
        let name = format!("{view}-{}", measured.configuration.file_name());
        let flip = format!("{name}-flip");
        html += &figure(store, &[name, flip], &measured.configuration.to_string());
    }
    html + "</div>\n"
}

/// Pictures with a caption; one that is gone is left out.
fn figure(store: &Store, names: &[String], caption: &str) -> String {
    let image = |name: &String| {
        let data = STANDARD.encode(std::fs::read(store.picture(name)).ok()?);
        Some(format!("<img alt=\"{}\" src=\"data:image/png;base64,{data}\"/>", escaped(name)))
    };
    let images: String = names.iter().filter_map(image).collect();
    format!("<figure>{images}<figcaption>{}</figcaption></figure>\n", escaped(caption))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compare::results::{Identity, ViewErrors};
    use crate::compare::subject::{Code, Configuration, Memory};
    use crate::settings::Method;

    /// One that someone deleted: its caption stays, and the page is whole.
    #[test]
    fn pictures_that_are_gone_are_left_out() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut store = Store::open(folder.path(), Results::new(Identity::default(), 4, 3, 1)).expect("new");
        let configuration = Configuration { method: Method::None, n: None };
        let views = vec![ViewErrors { view: "own".into(), errors: Errors::default() }];
        let memory = Memory::default();
        store.results.configurations = vec![Measurement::new(configuration, views, 0.0, memory, None, 1)];
        Store::check(folder.path()).expect("writable");
        let names = ["own-reference", "own-none", "own-none-flip"];
        names.iter().for_each(|name| std::fs::write(store.picture(name), name).expect("writable"));
        let embedded = |page: &str| {
            names.map(|name| {
                page.contains(&format!("src=\"data:image/png;base64,{}\"", STANDARD.encode(name)))
            })
        };
        assert_eq!(embedded(&page(&store)), [true; 3]);
        std::fs::remove_file(store.picture("own-none")).expect("it was there");
        let page = page(&store);
        assert_eq!(embedded(&page), [true, false, true]);
        assert!(
            page.contains("<figcaption>none</figcaption>") && page.matches("<img").count() == 2,
            "{page}"
        );
    }

    /// The pipeline's size in KiB and in instructions; none on the CPU backend.
    #[test]
    fn pipelines_are_told_where_there_are_any() {
        let configuration = Configuration { method: Method::None, n: None };
        let memory = Memory { trees: 3072, ..Memory::default() };
        let code = Some(Code { instructions: 4321, bytes: 2560 });
        let cells = |code| cost_cells(&Measurement::new(configuration, vec![], 0.0, memory, code, 1));
        assert!(cells(code).ends_with("<td>2.5</td><td>4321</td>"), "{}", cells(code));
        assert!(cells(None).ends_with("<td>-</td><td>-</td>") && cells(None).contains("<td>3.0</td>"));
        let heads = table(&Results::new(Identity::default(), 4, 3, 1)).matches("<th>").count();
        // The view, its eight errors, and flicker are not among them.
        assert_eq!(cells(code).matches("<td>").count() + 10, heads);
    }

    #[test]
    fn what_users_write_is_escaped() {
        assert_eq!(escaped("a<b> & \"c\""), "a&lt;b&gt; &amp; &quot;c&quot;");
    }

    #[test]
    fn the_reference_says_why_it_is_no_finer() {
        let residual = Some(Residual { pixels: 0.25, degrees: 3.0 });
        let summary = Summary { n: 128, residual, reason: Reason::Time, edge_length: 1.0 };
        let text = described(summary);
        assert!(text.contains("N = 128") && text.contains("0.2500") && text.contains("no time"), "{text}");
    }
}
