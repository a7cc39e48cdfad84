//! `emboss compare` and `--quality` as a user meets them: the binary in a folder of its own, on the CPU backend, with
//! pictures of a few pixels.

use serde_json::Value;
use std::path::PathBuf;
use std::process::{Command, Output};
use tempfile::TempDir;

/// The quickest comparison: the quilt, small.
const QUICK: [&str; 8] = [
    "compare",
    "builtin:quilt",
    "--size=24x18",
    "--samples=1",
    "--backend=cpu",
    "--time=0",
    "--n=2,8",
    "--reference=8",
];

struct Place(TempDir);

impl Place {
    fn new() -> Place {
        Place(tempfile::tempdir().expect("a temporary folder"))
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_emboss"));
        command.args(arguments).current_dir(self.0.path());
        command
    }

    fn run(&self, arguments: &[&str]) -> Output {
        self.command(arguments).output().expect("the program starts")
    }

    fn compare(&self, arguments: &[&str]) -> Output {
        self.run(&[&QUICK, arguments].concat())
    }

    fn read(&self, name: &str) -> String {
        std::fs::read_to_string(self.path(name)).expect("the file was written")
    }

    fn json(&self, name: &str) -> Value {
        serde_json::from_str(&self.read(name)).expect("JSON")
    }
}

fn stdout(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// The measurement of a method with an N in results.
fn measured<'a>(results: &'a Value, method: &str, n: Option<u32>) -> &'a Value {
    let all = results["configurations"].as_array().expect("measurements");
    let n = n.map_or(Value::Null, Value::from);
    all.iter().find(|m| m["method"] == method && m["N"] == n).expect("it was measured")
}

/// Asserts that every element is closed, in the order in which they were opened.
fn assert_well_formed(html: &str) {
    let mut open = Vec::new();
    for tag in html.split('<').skip(1) {
        let tag = tag.split('>').next().expect("a tag ends");
        let name = tag.trim_start_matches('/').split([' ', '/', '\n']).next().expect("a tag has a name");
        if tag.starts_with('!') || tag.ends_with('/') {
        } else if tag.starts_with('/') {
            assert_eq!(open.pop(), Some(name), "</{name}>");
        } else {
            open.push(name);
        }
    }
    assert!(open.is_empty(), "{open:?}");
}

/// Files are there and say the same; equal surfaces have no error, others have some.
#[test]
fn a_comparison_writes_its_results() {
    let place = Place::new();
    let run = place.compare(&["--output=out", "--methods=quadtree,brute-force,grid-walk,none"]);
    assert_eq!(run.status.code(), Some(0), "{}", stderr(&run));
    let results = place.json("out/results.json");
    assert_eq!(results["complete"], true);
    assert_eq!(
        (results["reference"]["N"].as_u64(), results["reference"]["reason"].as_str()),
        (Some(8), Some("given"))
    );
    assert!(results["reference"]["residual"]["pixels"].as_f64().is_some_and(|pixels| pixels > 0.0));
    assert_eq!(results["configurations"].as_array().map(Vec::len), Some(7));
    for method in ["quadtree", "brute-force"] {
        let exact = measured(&results, method, Some(8));
        assert_eq!(
            (exact["views"].as_array().map(Vec::len), exact["flicker"].as_f64()),
            (Some(2), Some(0.0))
        );
        for view in exact["views"].as_array().expect("views") {
            assert_eq!((view["flip"].as_f64(), view["psnr_db"].is_null()), (Some(0.0), true), "{view}");
            for error in ["depth_p999", "normal_p999_degrees", "silhouette_pixels", "missing_pixels"] {
                assert_eq!(view[error].as_f64(), Some(0.0), "{error} of {method}");
            }
        }
    }
    for (method, n) in [("quadtree", Some(2)), ("none", None)] {
        let rough = measured(&results, method, n);
        let own = &rough["views"][0];
        assert!(own["flip"].as_f64().is_some_and(|flip| flip > 0.001), "{rough}");
        assert!(own["depth_mean"].as_f64().is_some_and(|depth| depth > 0.0 && depth < 1.0), "{rough}");
        assert!(own["psnr_db"].as_f64().is_some_and(|db| db > 5.0 && db < 60.0), "{rough}");
    }
    for field in ["frame_ms", "rays_per_second", "preparation_ms", "edit_ms"] {
        let walk = measured(&results, "grid-walk", Some(8));
        assert!(walk[field].as_f64().is_some_and(|value| value > 0.0), "{field}: {walk}");
    }
    let csv = place.read("out/results.csv");
    let columns: Vec<usize> = csv.lines().map(|line| line.split(',').count()).collect();
    assert_eq!((columns.len(), columns.iter().min()), (8, columns.iter().max()));
    let html = place.read("out/report.html");
    assert_well_formed(&html);
    // Two views of a reference, and two pictures of each configuration in each.
    assert_eq!(html.matches("src=\"data:image/png;base64,iVBOR").count(), 2 + 2 * 2 * 7);
    assert_eq!(html.matches("src=").count(), html.matches("src=\"data:").count());
    for chart in ["error-time.svg", "error-memory.svg"] {
        assert_well_formed(&place.read(&format!("out/{chart}")));
    }
}

/// What a method cannot take is no error.
#[test]
fn what_cannot_be_is_listed_with_its_reason() {
    let place = Place::new();
    let quick = ["compare", "builtin:mushroom", "--size=16x12", "--samples=1", "--backend=cpu", "--time=0"];
    let more = ["--n=2", "--reference=2", "--methods=grid-walk,none", "--output=out"];
    let run = place.run(&[&quick[..], &more].concat());
    assert_eq!(run.status.code(), Some(0), "{}", stderr(&run));
    let results = place.json("out/results.json");
    let skipped = &results["skipped"][0];
    assert!(skipped["reason"].as_str().is_some_and(|reason| reason.contains("vectors")), "{skipped}");
    assert!(stdout(&run).contains("left out") && place.read("out/report.html").contains("Left out"));
}

/// The knot at N = 256 has more micro-triangles than a BVH holds: the others are compared all the same.
#[test]
fn what_has_too_many_micro_triangles_is_left_out() {
    let place = Place::new();
    let quick = ["compare", "builtin:knot", "--size=8x6", "--samples=1", "--backend=cpu", "--time=0"];
    let more = ["--methods=tessellate,none", "--n=256", "--reference=2", "--output=out"];
    let run = place.run(&[&quick[..], &more].concat());
    assert_eq!(run.status.code(), Some(0), "{}", stderr(&run));
    let skipped = &place.json("out/results.json")["skipped"][0];
    assert_eq!(skipped["method"], "tessellate");
    assert!(skipped["reason"].as_str().is_some_and(|reason| reason.contains("micro-triangles")), "{skipped}");
}

/// One method reads the map, the others do without.
#[test]
fn a_normal_map_is_compared() {
    let place = Place::new();
    let map = image::RgbImage::from_pixel(2, 2, image::Rgb([128, 128, 255]));
    map.save(place.path("n.png")).expect("writable");
    let run = place.compare(&["--methods=normal-map,none", "--normal-map=n.png", "--output=out"]);
    assert_eq!(run.status.code(), Some(0), "{}", stderr(&run));
    let results = place.json("out/results.json");
    measured(&results, "normal-map", None);
    assert_eq!(results["identity"]["files"][0]["path"], "n.png");
}

/// A folder whose results lack the last measurement is what a comparison leaves that was broken off there.
#[test]
fn the_same_command_goes_on_and_another_is_refused() {
    let place = Place::new();
    let arguments = ["--output=out", "--methods=grid-walk,none"];
    assert_eq!(place.compare(&arguments).status.code(), Some(0));
    let mut results = place.json("out/results.json");
    let kept = measured(&results, "grid-walk", Some(2)).clone();
    results["configurations"].as_array_mut().expect("measurements").truncate(1);
    results["complete"] = false.into();
    std::fs::write(place.path("out/results.json"), results.to_string()).expect("writable");
    let run = place.compare(&arguments);
    assert!(stdout(&run).contains("Going on in out: 1 of 3"), "{}", stdout(&run));
    let again = place.json("out/results.json");
    assert_eq!(again["configurations"].as_array().map(Vec::len), Some(3));
    assert_eq!(measured(&again, "grid-walk", Some(2)), &kept);
    let other = place.compare(&["--output=out", "--methods=grid-walk"]);
    assert_eq!(other.status.code(), Some(1));
    assert!(
        stderr(&other).contains("another comparison") && stderr(&other).contains("choose another --output")
    );
}

/// A file that the model names is changed, as long as before.
#[test]
fn changed_materials_are_another_comparison() {
    let place = Place::new();
    let square = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nusemtl a\nf 1/1 2/2 3/3\n";
    std::fs::write(place.path("m.obj"), square).expect("writable");
    let with_color = |kd: &str| {
        std::fs::write(place.path("m.mtl"), format!("newmtl a\nKd {kd}\n")).expect("writable");
        let small = ["--size=8x6", "--samples=1", "--backend=cpu", "--time=0"];
        let only = ["--methods=none", "--reference=1", "--output=out"];
        place.run(&[&["compare", "m.obj"][..], &small, &only].concat())
    };
    assert_eq!(with_color("1 0 0").status.code(), Some(0));
    assert!(stdout(&with_color("1 0 0")).contains("Going on in out: 1 of 1"));
    let files = place.json("out/results.json")["identity"]["files"].clone();
    let names: Vec<_> = files.as_array().expect("files").iter().map(|file| file["path"].clone()).collect();
    assert_eq!(names, ["m.obj", "m.mtl"]);
    let other = with_color("0 1 0");
    assert_eq!(other.status.code(), Some(1));
    assert!(stderr(&other).contains("a file of the scene was") && stderr(&other).contains("m.mtl"));
}

/// What was measured before Ctrl-C is there, and the exit code says what happened.
#[cfg(unix)]
#[test]
fn ctrl_c_keeps_what_is_measured() {
    let place = Place::new();
    // An hour: without the signal it would not end.
    let mut command = place.command(
        &[&QUICK[..5], &["--methods=none", "--reference=2", "--time=3600", "--output=out"]].concat(),
    );
    let mut child = command.spawn().expect("the program starts");
    let measured =
        || std::fs::read_to_string(place.path("out/results.json")).is_ok_and(|json| json.contains("rounds"));
    for _ in 0..600 {
        if measured() {
            break;
        }
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
    let interrupt = Command::new("kill").args(["-INT", &child.id().to_string()]).status().expect("kill");
    assert!(interrupt.success());
    assert_eq!(child.wait().expect("it ends").code(), Some(130));
    let results = place.json("out/results.json");
    assert_eq!(
        (&results["complete"], results["configurations"].as_array().map(Vec::len)),
        (&false.into(), Some(1))
    );
    assert!(place.read("out/report.html").contains("not complete as yet"));
}

#[test]
fn wrong_usage_is_told() {
    let place = Place::new();
    let cases: [(&[&str], i32, &str); 7] = [
        (&["compare", "--shade", "error"], 2, "--shade error is not for"),
        (&["compare", "--methods", "quadtre"], 2, "quadtre"),
        (&["compare", "--n", "0"], 2, "from 1 to 4096"),
        (&["compare", "--method", "none"], 2, "--methods"),
        (&["compare", "--reference", "auto"], 2, "whole number"),
        (&["render", "--quality", "2"], 2, "from 0 (exact) to 1"),
        (&["render", "--quality", "0.1", "--method", "none"], 2, "leave --method and N out"),
    ];
    for (arguments, code, told) in cases {
        let run = place.run(arguments);
        assert_eq!(run.status.code(), Some(code), "{arguments:?}: {}", stderr(&run));
        assert!(stderr(&run).contains(told), "{arguments:?}: {}", stderr(&run));
    }
    std::fs::write(place.path("file"), "").expect("writable");
    let run = place.compare(&["--output=file"]);
    assert_eq!(run.status.code(), Some(1));
    assert!(stderr(&run).contains("choose another --output"), "{}", stderr(&run));
}

/// Nothing but the exact method has no error, and where errors do not matter, or where there is no relief, others are
/// several times as quick. Which of these is the quickest depends on what else the machine does.
#[test]
fn budgets_choose_a_method() {
    let place = Place::new();
    let chosen = |arguments: &[&str]| {
        // So many samples that they take longer than preparation, which is alike for most methods.
        let render = ["render", "builtin:cube", "--size=48x36", "--samples=64", "--backend=cpu"];
        let run = place.run(&[&render[..], arguments].concat());
        assert_eq!(run.status.code(), Some(0), "{}", stderr(&run));
        let line = stdout(&run).lines().find(|line| line.starts_with("Chose ")).map(str::to_owned);
        line.unwrap_or_else(|| panic!("nothing was chosen: {}", stdout(&run)))
    };
    let is_quick = |line: &str| line.contains(" times as quick as quadtree N=");
    assert!(is_quick(&chosen(&["--quality=1"])));
    let exact = chosen(&["--quality=0"]);
    assert!(exact.starts_with("Chose quadtree N=") && exact.contains("nothing else is both"), "{exact}");
    // A flat relief.
    assert!(is_quick(&chosen(&["--quality=0", "--exaggerate=0"])));
}

/// A scene file may ask for adaptive N, which most methods cannot have: the chosen one gets an N that it can.
#[test]
fn budgets_go_before_what_a_scene_file_says() {
    let place = Place::new();
    let scene = "[render]\nmethod = \"quadtree\"\nn = \"auto\"\n[[model]]\nbuiltin = \"cube\"\n";
    std::fs::write(place.path("s.toml"), scene).expect("writable");
    let run =
        place.run(&["render", "s.toml", "--size=24x18", "--samples=16", "--backend=cpu", "--quality=1"]);
    assert_eq!(run.status.code(), Some(0), "{}", stderr(&run));
    let said = stdout(&run);
    let line = said.lines().find(|line| line.starts_with("Chose ")).expect("a choice");
    assert!(!line.starts_with("Chose quadtree") && line.contains("times as quick as quadtree"), "{said}");
    assert!(said.contains("->"), "{said}");
}
