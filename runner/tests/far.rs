//! Models that stand far from the origin, as a user meets them: docs/EXACTNESS.md, section 9.

use serde_json::Value;
use std::fmt::Write;
use std::path::Path;
use std::process::Command;

/// A patch of 8 by 8 squares of 1/4, from (x, y, z) on, lengths times `factor`; its relief is in a map.
fn patch([x, y, z]: [f64; 3], factor: f64) -> String {
    let mut text = String::new();
    for i in 0..81 {
        let (a, b) = (f64::from(i % 9) / 4.0, f64::from(i / 9) / 4.0);
        let y = y + f64::from(i * i % 7) / 16.0;
        // All digits: neither the file nor the test rounds.
        let position = [x + a, y, z + b].map(|x| x * factor);
        writeln!(text, "v {} {} {}\nvt {a} {b}", position[0], position[1], position[2]).expect("a string");
    }
    for a in (1..73).filter(|a| a % 9 != 0) {
        let corner = |v: u32| format!("{v}/{v}");
        let corners = [a, a + 9, a + 10, a + 1].map(corner).join(" ");
        writeln!(text, "f {corners}").expect("a string");
    }
    text
}

/// Runs `emboss render` in a folder; what it says. The map of heights is there.
fn render(folder: &Path, arguments: &[&str]) -> (Option<i32>, String) {
    let map = image::GrayImage::from_fn(16, 16, |x, y| image::Luma([(x * 37 + y * 101).to_le_bytes()[0]]));
    map.save(folder.join("h.png")).expect("the folder is writable");
    let output = Command::new(env!("CARGO_BIN_EXE_emboss"))
        .current_dir(folder)
        .args(["render", "--size=40x30", "--samples=1", "--backend=cpu", "--stats=stats.json"])
        .args(arguments)
        .output()
        .expect("the program starts");
    let said = [output.stdout, output.stderr].concat();
    (output.status.code(), String::from_utf8_lossy(&said).into_owned())
}

/// The picture and the work of a run.
fn rendered(folder: &Path, arguments: &[&str]) -> (Vec<u8>, Value) {
    let (code, said) = render(folder, &[arguments, &["--output=out.png"]].concat());
    assert_eq!(code, Some(0), "{said}");
    assert!(!said.contains("left out"), "{said}");
    let picture = image::open(folder.join("out.png")).expect("a picture").into_bytes();
    let stats = std::fs::read(folder.join("stats.json")).expect("statistics");
    (picture, serde_json::from_slice::<Value>(&stats).expect("JSON")["work"].clone())
}

/// The same patch at the origin and in UTM coordinates: in the file, by a scene file's transform and as an instance,
/// with camera and light there; and in units of 2^-30 and 2^30.
#[test]
fn pictures_are_the_same_wherever_and_however_large() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let folder = folder.path();
    let write = |name: &str, text: &str| std::fs::write(folder.join(name), text).expect("writable");
    // Multiples of the grid of origins, 4.
    let far = [412_344.0, 0.0, -5_123_456.0];
    let vector = |[x, y, z]: [f64; 3], factor: f64| format!("{},{},{}", x * factor, y * factor, z * factor);
    let beside = |to: [f64; 3], by: [f64; 3]| [0, 1, 2].map(|i| to[i] + by[i]);
    let given = |place: [f64; 3], factor: f64| {
        let eye = vector(beside(place, [2.5, 2.0, 3.0]), factor);
        let target = vector(beside(place, [1.0, 0.0, 1.0]), factor);
        let light = vector(beside(place, [-1.0, 4.0, 2.0]), factor);
        [
            format!("--eye={eye}"),
            format!("--target={target}"),
            format!("--light={light}:1,1,1:{}", 20.0 * factor * factor),
        ]
    };
    let shown = |model: &str, place: [f64; 3], factor: f64| {
        let (given, scale) = (given(place, factor), (0.25 * factor).to_string());
        let options: Vec<&str> = given.iter().map(String::as_str).collect();
        rendered(folder, &[&[model, "none", "h.png", "0.5", &scale, "8"], &options[..]].concat())
    };
    write("near.obj", &patch([0.0; 3], 1.0));
    let near = shown("near.obj", [0.0; 3], 1.0);
    assert!(near.1["hits"].as_u64() > Some(400), "{}", near.1);
    write("far.obj", &patch(far, 1.0));
    assert_eq!(shown("far.obj", far, 1.0), near);
    let translate = format!("translate = {far:?}\n");
    write("moved.toml", &format!("[[model]]\npath = \"near.obj\"\n{translate}"));
    assert_eq!(shown("moved.toml", far, 1.0), near);
    let back = far.map(|x| -x);
    write("back.toml", &format!("[[model]]\npath = \"far.obj\"\ntranslate = {back:?}\n"));
    assert_eq!(shown("back.toml", [0.0; 3], 1.0), near);
    let instance = |translate: &str| {
        format!("[[model]]\nname = \"a\"\npath = \"near.obj\"\n[[instance]]\nmodel = \"a\"\n{translate}")
    };
    write("here.toml", &instance(""));
    write("there.toml", &instance(&translate));
    assert_eq!(shown("there.toml", far, 1.0), shown("here.toml", [0.0; 3], 1.0));
    for factor in [2_f64.powi(-30), 2_f64.powi(30)] {
        write("scaled.obj", &patch([0.0; 3], factor));
        assert_eq!(shown("scaled.obj", [0.0; 3], factor), near);
    }
}

/// By the camera that shows all, in a place that is no multiple of anything, with the digits that exporters write: as
/// much work, and nothing lost.
#[test]
fn work_is_the_same_with_the_digits_of_exporters() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let at = |x: f64, z: f64| {
        std::fs::write(folder.path().join("m.obj"), patch([x, 0.0, z], 1.0)).expect("writable");
        rendered(folder.path(), &["m.obj", "none", "h.png", "0.5", "0.25", "8"]).1
    };
    let (near, far) = (at(0.0, 0.0), at(500_000.123, -4_649_776.456));
    for what in ["boxes", "prisms", "sub_triangles", "triangles", "hits"] {
        let [a, b] = [&near, &far].map(|work| work[what].as_f64().expect("a number"));
        assert!((a - b).abs() <= 0.02 * a, "{what}: {a} becomes {b}");
    }
}

/// A marker that was left at the origin does not cost the patch its digits.
#[test]
fn parts_of_a_file_may_stand_far_apart() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let far = [412_344.0, 0.0, -5_123_456.0];
    let shown = |text: String, options: &[&str]| {
        std::fs::write(folder.path().join("m.obj"), text).expect("writable");
        rendered(folder.path(), &[&["m.obj", "none", "h.png", "0.5", "0.25", "8"], options].concat()).1
    };
    // Instances have no stored bounds, and the work is compared.
    let camera = [
        "--eye=412346.5,2,-5123453",
        "--target=412345,0,-5123455",
        "--light=412343,4,-5123454",
        "--bounds=none",
    ];
    let marker = "v 0 0 0\nv 1 0 0\nv 0 0 -1\nf 82/1 83/2 84/10\n";
    let (alone, both) = (shown(patch(far, 1.0), &camera), shown(patch(far, 1.0) + marker, &camera));
    for what in ["hits", "prisms", "sub_triangles", "triangles"] {
        let [a, b] = [&alone, &both].map(|work| work[what].as_f64().expect("a number"));
        assert!((a - b).abs() <= 0.02 * a, "{what}: {a} becomes {b}");
    }
}

#[test]
fn sizes_beyond_floats_are_refused_and_what_vanishes_is_told() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let run = |text: &str| {
        std::fs::write(folder.path().join("m.obj"), text).expect("writable");
        render(folder.path(), &["m.obj", "none", "h.png", "0.5", "0", "2", "--output=out.png"])
    };
    for factor in [1e-13, 1e13] {
        let (code, said) = run(&patch([0.0; 3], factor));
        assert!(code == Some(1) && said.contains("sizes between 1e-12 and"), "{said}");
    }
    for factor in [1e-12, 1e11] {
        let (code, said) = run(&patch([0.0; 3], factor));
        assert_eq!(code, Some(0), "{said}");
    }
    let (code, said) = run(&patch([1e12, 0.0, 0.0], 1.0));
    assert!(code == Some(0) && said.contains("too few digits"), "{said}");
    // A triangle of a millionth beside one of a million.
    let corners = "v 0 0 0\nv 1e6 0 0\nv 0 1e6 0\nv 9e5 0 0\nv 900000.000001 0 0\nv 9e5 0.1 0\nvt 0 0\n";
    let (code, said) = run(&format!("{corners}f 1/1 2/1 3/1\nf 4/1 5/1 6/1\n"));
    assert!(code == Some(0) && said.contains("left out 1 that are smaller than floats tell apart"), "{said}");
}
