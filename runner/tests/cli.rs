//! The program as a user meets it: what it says, what it writes, and how it ends. Every test runs the binary in a
//! folder of its own, on the CPU backend unless Vulkan is what it is about.

use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use tempfile::TempDir;

/// A small picture of the quickest scene.
const QUICK: [&str; 12] = [
    "render",
    "builtin:cube",
    "-",
    "-",
    "-",
    "-",
    "4",
    "--size=16x12",
    "--samples=2",
    "--backend=cpu",
    "--seed=1",
    "--output=out.png",
];

/// A triangle with texture coordinates.
const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n";

/// A folder to run in.
struct Place(TempDir);

impl Place {
    fn new() -> Place {
        Place(tempfile::tempdir().expect("a temporary folder"))
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn with(self, name: &str, content: impl AsRef<[u8]>) -> Place {
        std::fs::write(self.path(name), content).expect("the folder is writable");
        self
    }

    fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_emboss"));
        command.args(arguments).current_dir(self.0.path());
        command
    }

    fn run(&self, arguments: &[&str]) -> Run {
        Run::of(self.command(arguments).output().expect("the program starts"))
    }

    /// A small rendering of a model file on the CPU.
    fn render(&self, arguments: &[&str]) -> Run {
        let options = ["--size=16x12", "--samples=1", "--backend=cpu", "--output=out.png"];
        self.run(&[&["render"], arguments, &options].concat())
    }

    fn read(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).expect("the file was written")
    }

    /// What a picture shows, whatever command its file holds.
    fn texels(&self, name: &str) -> Vec<u8> {
        image::open(self.path(name)).expect("a picture").into_bytes()
    }

    fn files(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.0.path()).expect("readable");
        let mut names: Vec<String> = entries
            .map(|entry| entry.expect("readable").file_name().to_string_lossy().into_owned())
            .collect();
        names.sort();
        names
    }
}

/// How a run of the program ended.
#[derive(Debug)]
struct Run {
    code: Option<i32>,
    stdout: String,
    stderr: String,
}

impl Run {
    fn of(output: Output) -> Run {
        Run {
            code: output.status.code(),
            stdout: String::from_utf8(output.stdout).expect("text"),
            stderr: String::from_utf8(output.stderr).expect("text"),
        }
    }

    #[track_caller]
    fn succeeded(self) -> Run {
        assert_eq!(self.code, Some(0), "{}", self.stderr);
        self
    }

    /// The run ended with `code`, and its message has all of `parts`.
    #[track_caller]
    fn failed(self, code: i32, parts: &[&str]) {
        assert_eq!(self.code, Some(code), "{}", self.stderr);
        for part in parts {
            assert!(self.stderr.contains(part), "no `{part}` in: {}", self.stderr);
        }
    }
}

fn alphas(path: &Path) -> Vec<u8> {
    image::open(path).expect("a picture").to_rgba8().pixels().map(|pixel| pixel.0[3]).collect()
}

// What is written.

#[test]
fn a_picture_shows_the_model_before_a_transparent_background() {
    let place = Place::new();
    place.run(&QUICK).succeeded();
    let alphas = alphas(&place.path("out.png"));
    assert_eq!((alphas[0], alphas[6 * 16 + 8]), (0, 255));
    assert_eq!(place.files(), ["out.png"]);
}

#[test]
fn one_pixel_is_a_picture() {
    let place = Place::new();
    place
        .run(&[&QUICK[..7], &["--size=1x1", "--samples=64", "--backend=cpu", "-oout.png"]].concat())
        .succeeded();
    // Most of it is covered, but not its corners.
    let alphas = alphas(&place.path("out.png"));
    assert!(alphas.len() == 1 && alphas[0] > 64 && alphas[0] < 255, "{alphas:?}");
}

#[test]
fn the_seed_decides_every_byte() {
    let picture = |seed| {
        let place = Place::new();
        place.run(&[&QUICK[..10], &[seed, "--output=out.png"]].concat()).succeeded();
        place.texels("out.png")
    };
    assert_eq!(picture("--seed=1"), picture("--seed=1"));
    assert_ne!(picture("--seed=1"), picture("--seed=2"));
}

#[test]
fn a_background_fills_the_picture() {
    let place = Place::new();
    place.run(&[&QUICK[..], &["--background=1,0.5,0"]].concat()).succeeded();
    let picture = image::open(place.path("out.png")).expect("a picture").to_rgba8();
    assert_eq!(picture.get_pixel(0, 0).0, [255, 128, 0, 255]);
}

#[test]
fn png_has_16_bits_when_asked_for() {
    let place = Place::new();
    place.run(&[&QUICK[..], &["--depth=16"]].concat()).succeeded();
    let picture = image::open(place.path("out.png")).expect("a picture");
    assert_eq!((picture.color(), picture.width(), picture.height()), (image::ColorType::Rgba16, 16, 12));
    // Finer than 8 bits, whose codes are multiples of 257 here.
    assert!(picture.to_rgba16().as_raw().iter().any(|code| code % 257 != 0));
}

/// EXR and PNG show the same: linear premultiplied floats are what the PNG encodes.
#[test]
fn exr_holds_what_png_encodes() {
    let place = Place::new();
    place.run(&[&QUICK[..], &["--depth=16"]].concat()).succeeded();
    place.run(&[&QUICK[..11], &["--output=out.exr"]].concat()).succeeded();
    let png = image::open(place.path("out.png")).expect("a picture").to_rgba16();
    let exr = image::open(place.path("out.exr")).expect("a picture").to_rgba32f();
    for (coded, linear) in png.pixels().zip(exr.pixels()) {
        let alpha = linear.0[3];
        assert_eq!(f32::from(coded.0[3]), (alpha * 65535.0).round());
        let straight = if alpha > 0.0 { linear.0[0] / alpha } else { 0.0 };
        let decoded = emboss::picture::linear_from_srgb(f32::from(coded.0[0]) / 65535.0);
        // Half a code, times the curve's greatest slope of 2.3, and f32 rounding.
        assert!((decoded - straight.clamp(0.0, 1.0)).abs() < 2e-5, "{decoded} {straight}");
    }
}

#[test]
fn adaptive_n_says_what_it_was() {
    let place = Place::new();
    let options = ["--size=16x12", "--samples=1", "--backend=cpu", "--output=a.png", "--stats=stats.json"];
    let run = place.run(&[&["render", "builtin:cube", "-", "-", "-", "-", "auto:8"], &options[..]].concat());
    run.succeeded();
    let stats: Value = serde_json::from_slice(&place.read("stats.json")).expect("JSON");
    assert_eq!(stats["settings"]["N"], "auto:8");
    let [least, greatest, count] =
        ["n_least", "n_greatest", "micro_triangles"].map(|name| stats[name].as_u64().expect(name));
    assert!(least >= 1 && greatest < 64 && greatest.is_power_of_two(), "{least} {greatest}");
    assert!((12 * least.pow(2)..=12 * greatest.pow(2)).contains(&count), "{count}");
}

#[test]
fn statistics_have_every_number() {
    let place = Place::new();
    place.run(&[&QUICK[..], &["--stats=stats.json"]].concat()).succeeded();
    let stats: Value = serde_json::from_slice(&place.read("stats.json")).expect("JSON");
    let number = |pointer: &str| stats.pointer(pointer).and_then(Value::as_f64).expect(pointer);
    assert_eq!(number("/triangles"), 12.0);
    assert_eq!((number("/micro_triangles"), number("/n_least"), number("/n_greatest")), (192.0, 4.0, 4.0));
    assert_eq!(number("/work/primary_rays"), 16.0 * 12.0 * 2.0);
    assert_eq!(number("/rays"), number("/work/primary_rays") + number("/work/shadow_rays"));
    assert_eq!(number("/pixels_hit"), number("/work/hits") / 2.0);
    assert!(number("/pixels_hit") > 16.0 && number("/pixels_hit") < 16.0 * 12.0);
    assert_eq!(number("/bytes/film"), 16.0 * 12.0 * 20.0);
    assert_eq!(number("/bytes/triangles"), 12.0 * 32.0);
    assert_eq!(number("/bytes/nodes"), 23.0 * 32.0);
    for positive in ["/bvh_build_ms", "/frame_ms", "/rays_per_second", "/work/triangles", "/bytes/bounds"] {
        assert!(number(positive) > 0.0, "{positive}");
    }
    for present in
        ["vertices", "primitives", "height_texels", "height_ranges", "seams", "color_texels", "lights"]
    {
        number(&format!("/bytes/{present}"));
    }
    for present in ["steps", "cap_hits", "lost_walks", "boxes", "prisms", "sub_triangles"] {
        number(&format!("/work/{present}"));
    }
    assert_eq!(stats["backend"], "cpu");
    assert_eq!(stats.get("device_ms"), Some(&Value::Null), "there, and null on the CPU");
    assert_eq!(stats.get("pipelines"), Some(&Value::Null), "there, and null on the CPU");
    assert!(stats["device"].is_string());
    let settings = &stats["settings"];
    assert_eq!((&settings["N"], &settings["seed"], &settings["samples"]), (&4.into(), &1.into(), &2.into()));
    assert_eq!((&settings["width"], &settings["method"]), (&16.into(), &"quadtree".into()));
    assert_eq!((&settings["normals"], &settings["weld"]), (&"normalized".into(), &"on".into()));
    assert_eq!((&settings["smooth"], &settings["filter"]), (&false.into(), &"bilinear".into()));
}

#[test]
fn smooth_shading_is_asked_for_and_shows() {
    let place = Place::new();
    for shade in ["lit", "normal"] {
        let picture = |more: &[&str]| {
            let arguments = [&QUICK[..], &["--shade", shade, "--stats=stats.json"], more].concat();
            place.run(&arguments).succeeded();
            place.texels("out.png")
        };
        let flat = picture(&[]);
        assert_ne!(flat, picture(&["--smooth"]), "{shade}");
        let stats: Value = serde_json::from_slice(&place.read("stats.json")).expect("JSON");
        assert_eq!(stats["settings"]["smooth"], true);
    }
}

#[test]
fn filtered_colors_are_asked_for_and_show() {
    let place = Place::new();
    let picture = |filter: &str| {
        let arguments = ["render", "builtin:quilt", "-", "-", "-", "-", "2", "--size=16x12", "--samples=1"];
        let options = ["--backend=cpu", "--output=out.png", "--filter", filter];
        place.run(&[&arguments[..], &options].concat()).succeeded();
        place.texels("out.png")
    };
    assert_ne!(picture("bilinear"), picture("trilinear"));
}

// What is said.

#[test]
fn arguments_left_out_are_filled_and_printed() {
    let place = Place::new().with("triangle.obj", TRIANGLE);
    let stdout = place.render(&["triangle.obj"]).succeeded().stdout;
    // 5 % of the diagonal of a box of 1 x 1.
    let expected = [
        "model  triangle.obj  (given)",
        "color  none  (default)",
        "height none  (default)",
        "zero   0.5  (default)",
        "scale  0.07071068  (default)",
        "N      16  (default)",
        "Imported 1 triangles",
    ];
    assert_eq!(stdout.lines().take(7).collect::<Vec<_>>(), expected);
    assert!(stdout.lines().nth(7).is_some_and(|line| line.starts_with("Wrote out.png: 16x12")));
}

#[test]
fn built_in_scenes_bring_their_relief() {
    let stdout = Place::new().run(&QUICK).succeeded().stdout;
    assert!(stdout.contains("height builtin:cube  (built-in)"), "{stdout}");
    // Not the default of files, which is 0.5.
    assert!(stdout.contains("zero   0  (built-in)"), "{stdout}");
    assert!(stdout.contains("N      4  (given)"), "{stdout}");
}

#[test]
fn materials_bring_their_maps() {
    let mut model = format!("mtllib maps.mtl\nusemtl skin\n{TRIANGLE}");
    model.push('\n');
    let place = Place::new()
        .with("model.obj", model)
        .with("maps.mtl", "newmtl skin\nmap_Kd color.png\ndisp missing.png\n");
    image::RgbImage::from_pixel(2, 2, image::Rgb([255, 0, 0]))
        .save(place.path("color.png"))
        .expect("written");
    let run = place.render(&["model.obj"]).succeeded();
    assert!(run.stdout.contains("color.png  (from the materials)"), "{}", run.stdout);
    assert!(run.stdout.contains("height none  (default)"), "{}", run.stdout);
    assert!(run.stderr.contains("missing.png: the materials name this map, but it is not there"));
}

/// Two triangles side by side, the left one of the material `a`, the right one of `b`.
const TWO_MATERIALS: &str = "mtllib two.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 3 0 0\nv 4 0 0\nv 4 1 0\n\
    vt 0 0\nvt 1 0\nvt 0 1\nusemtl a\nf 1/1 2/2 3/3\nusemtl b\nf 4/1 5/2 6/3\n";

/// The colours of the opaque pixels in the left and in the right half of a picture; no more than four steps apart.
fn halves(path: &Path) -> [[u8; 3]; 2] {
    let picture = image::open(path).expect("a picture").to_rgba8();
    [false, true].map(|right| {
        let half = picture
            .enumerate_pixels()
            .filter(|(x, _, p)| (*x >= picture.width() / 2) == right && p.0[3] == 255);
        let colors: Vec<[u8; 3]> = half.map(|(.., pixel)| [0, 1, 2].map(|i| pixel.0[i])).collect();
        let far = |color: &[u8; 3]| color.iter().zip(colors[0]).any(|(a, b)| a.abs_diff(b) > 4);
        assert!(!colors.is_empty() && !colors.iter().any(far), "{colors:?}");
        colors[0]
    })
}

/// Full ambient light and nothing else, so that a pixel is its surface's colour.
const AMBIENT: [&str; 3] = ["--ambient=1", "--light=0,0,9:0,0,0", "--eye=2,0.5,9"];

#[test]
fn each_material_has_its_own_maps() {
    let pixel = |name: &str, place: &Place, color| {
        image::RgbImage::from_pixel(1, 1, image::Rgb(color)).save(place.path(name)).expect("written");
    };
    let library = "newmtl a\nKd 0 0 1\nmap_Kd red.png\nnewmtl b\nKd 0 1 0\ndisp white.png\n";
    let place = Place::new().with("two.obj", TWO_MATERIALS).with("two.mtl", library);
    pixel("red.png", &place, [255, 0, 0]);
    pixel("white.png", &place, [255; 3]);
    let render = |more: &[&str]| place.render(&[&["two.obj"], more, &AMBIENT[..]].concat()).succeeded();
    let run = render(&[]);
    for line in ["color  red.png, 0,1,0  (from the materials)", "height none, white.png  (several origins)"] {
        assert!(run.stdout.contains(line), "{}", run.stdout);
    }
    assert_eq!(halves(&place.path("out.png")), [[255, 0, 0], [0, 255, 0]]);
    // Height over the range of all maps: none is black, white is white.
    render(&["--shade=height"]);
    assert_eq!(halves(&place.path("out.png")), [[0; 3], [255; 3]]);
    // The command line's go before all of them.
    pixel("blue.png", &place, [0, 0, 255]);
    render(&["blue.png"]);
    assert_eq!(halves(&place.path("out.png")), [[0, 0, 255]; 2]);
    render(&["none"]);
    assert_eq!(halves(&place.path("out.png")), [[0, 0, 255], [0, 255, 0]]);
}

#[test]
fn normal_map_stands_in_for_a_missing_colour_map_only() {
    let pixel = image::RgbImage::from_pixel(2, 2, image::Rgb([128, 128, 255]));
    let place = Place::new().with("model.obj", format!("mtllib maps.mtl\nusemtl skin\n{TRIANGLE}\n"));
    for name in ["color.png", "normal.png"] {
        pixel.save(place.path(name)).expect("written");
    }
    let alone = place.with("maps.mtl", "newmtl skin\nnorm normal.png\n");
    let run = alone.render(&["model.obj"]).succeeded();
    assert!(run.stdout.contains("normal.png  (from the materials: their normal map"), "{}", run.stdout);
    let both = alone.with("maps.mtl", "newmtl skin\nmap_Kd color.png\nnorm normal.png\n");
    let run = both.render(&["model.obj"]).succeeded();
    assert!(run.stdout.contains("color.png  (from the materials)"), "{}", run.stdout);
}

/// Also where it is wanted twice: as a colour map, and by a method that reads normals.
#[test]
fn missing_map_is_warned_of_once() {
    let model = format!("mtllib maps.mtl\nusemtl skin\n{TRIANGLE}");
    let place = Place::new().with("model.obj", model).with("maps.mtl", "newmtl skin\nnorm normal.png\n");
    for method in ["--method=normal-map", "--method=bump"] {
        let run = place.render(&["model.obj", method]).succeeded();
        assert!(run.stdout.contains("color  none  (default)"), "{}", run.stdout);
        assert_eq!(run.stderr.matches("normal.png: the materials name").count(), 1, "{}", run.stderr);
    }
}

/// Maps of one texel, whose normals are along the surface's, along its tangent, and along its bitangent.
fn with_normal_maps(place: Place) -> Place {
    for (name, normal) in
        [("up.png", [128, 128, 255]), ("u.png", [255, 128, 128]), ("v.png", [128, 255, 128])]
    {
        image::RgbImage::from_pixel(1, 1, image::Rgb(normal)).save(place.path(name)).expect("written");
    }
    place
}

/// Each material is lit by its own normal map, all of them by that of the command line; no other method reads any.
#[test]
fn materials_bring_their_normal_maps() {
    let library = "newmtl a\nmap_Kd up.png\nnorm -clamp on u.png\nnewmtl b\nmap_Kd up.png\nmap_Kn v.png\n";
    let place = with_normal_maps(Place::new().with("two.obj", TWO_MATERIALS).with("two.mtl", library));
    let render = |more: &[&str]| {
        let common = ["two.obj", "--method=normal-map", "--shade=normal", "--eye=2,0.5,9"];
        let run = place.render(&[&common, more].concat()).succeeded();
        (run, halves(&place.path("out.png")))
    };
    let (of_u, of_v) = (render(&["--normal-map=u.png"]).1[0], render(&["--normal-map=v.png"]).1[0]);
    assert!(of_u[0] > of_u[1] + 50 && of_v[1] > of_v[0] + 50, "{of_u:?} {of_v:?}");
    let (run, shown) = render(&[]);
    assert_eq!(shown, [of_u, of_v]);
    assert!(run.stdout.contains("normal u.png, v.png  (from the materials)"), "{}", run.stdout);
    let (run, shown) = render(&["--normal-map=v.png"]);
    assert_eq!(shown, [of_v, of_v]);
    assert!(run.stdout.contains("normal v.png  (given)"), "{}", run.stdout);

    // One that is missing is a warning, where it is read.
    let place = place.with("two.mtl", library.replace("v.png", "w.png"));
    let command = ["two.obj", "--shade=normal", "--eye=2,0.5,9"];
    let run = place.render(&[&command[..], &["--method=normal-map"]].concat()).succeeded();
    assert!(run.stderr.contains("w.png: the materials name this map, but it is not there"), "{}", run.stderr);
    assert!(run.stdout.contains("normal u.png, made from the height map"), "{}", run.stdout);
    let up = halves(&place.path("out.png"))[1];
    assert!(up[2] > up[0] + 50 && up[2] > up[1] + 50, "{up:?}");
    let run = place.render(&command).succeeded();
    assert!(
        !run.stderr.contains("w.png") && !run.stdout.contains("normal "),
        "{} {}",
        run.stderr,
        run.stdout
    );
    assert_eq!(halves(&place.path("out.png")), [up, up]);
}

/// A scene file's normal map goes before the model's own; what is wrong with it names the line.
#[test]
fn scene_files_name_normal_maps() {
    let scene = "[render]\nmethod = \"normal-map\"\nshade = \"normal\"\n[camera]\neye = [2, 0.5, 9]\n\
        [material.one]\nnormal = \"v.png\"\n[material.two]\nnormal = \"none\"\n\
        [[model]]\npath = \"two.obj\"\nmaterial = { a = \"one\", b = \"two\" }\n";
    let library = "newmtl a\nKd 1 1 1\nnorm u.png\nnewmtl b\nKd 1 1 1\nnorm u.png\n";
    let place = with_normal_maps(Place::new().with("two.obj", TWO_MATERIALS).with("two.mtl", library));
    let place = place.with("scene.toml", scene);
    let run = place.render(&["scene.toml"]).succeeded();
    assert!(
        run.stdout.contains("normal ") && run.stdout.contains("v.png, made from the height map"),
        "{}",
        run.stdout
    );
    let [v, up] = halves(&place.path("out.png"));
    assert!(v[1] > v[0] + 50 && up[2] > up[1] + 50, "{v:?} {up:?}");
    // In world space red is along x, wherever the tangents are.
    let world = scene.replace("\"v.png\"", "\"u.png\"\nnormal_space = \"world\"");
    let place = place.with("scene.toml", world);
    place.render(&["scene.toml"]).succeeded();
    let [x, _] = halves(&place.path("out.png"));
    assert!(x[0] > x[1] + 50, "{x:?}");
    let place = place.with("scene.toml", scene.replace("v.png", "two.obj"));
    place.render(&["scene.toml"]).failed(1, &["scene.toml:6: ", "two.obj: not an image"]);
}

/// The distance map of a height map is kept beside it, and read from there; neither with `--no-cache`.
#[test]
fn distance_maps_are_kept_beside_their_maps() {
    let place = Place::new().with("model.obj", TRIANGLE);
    let texels = (0..64_u8).map(|i| i.wrapping_mul(37)).collect();
    let map = image::GrayImage::from_raw(8, 8, texels).expect("64 codes");
    map.save(place.path("h.png")).expect("written");
    let render = |more: &[&str]| {
        let arguments = ["model.obj", "none", "h.png", "-", "-", "16", "--method=sphere", "--verbose"];
        place.render(&[&arguments, more].concat()).succeeded()
    };
    let file = "h.png.repeat.cpu.emboss-distances";
    render(&["--no-cache"]);
    assert_eq!(place.files(), ["h.png", "model.obj", "out.png"]);
    let first = place.texels("out.png");
    let run = render(&[]);
    assert!(run.stderr.contains(&format!("{file}: distances computed and kept")), "{}", run.stderr);
    assert_eq!(place.files(), ["h.png", file, "model.obj", "out.png"]);
    assert_eq!(place.texels("out.png"), first);
    let run = render(&["--exaggerate=2"]);
    assert!(run.stderr.contains(&format!("{file}: distances read")), "{}", run.stderr);
    // Other files, since they are other distances.
    render(&["--invert"]);
    render(&["--exaggerate=-1", "--wrap=mirror"]);
    let others = ["h.png.inverted.repeat.cpu.emboss-distances", "h.png.negative.mirror.cpu.emboss-distances"];
    assert_eq!(place.files(), ["h.png", others[0], others[1], file, "model.obj", "out.png"]);
    let place = place.with(file, "no distances");
    let run = place.render(&["model.obj", "none", "h.png", "-", "-", "16", "--method=sphere"]).succeeded();
    assert!(
        run.stderr.contains(&format!("{file}: is no distance map; distances are computed")),
        "{}",
        run.stderr
    );
    assert_eq!(place.texels("out.png"), first);
}

#[test]
fn models_beyond_what_floats_compute_with_are_refused() {
    for (factor, place) in [("e25", Place::new()), ("e38", Place::new()), ("e-25", Place::new())] {
        let model = TRIANGLE
            .replace("v 1 0 0", &format!("v 1{factor} 0 0"))
            .replace("v 0 1 0", &format!("v 0 1{factor} 0"));
        let place = place.with("model.obj", model);
        place.render(&["model.obj"]).failed(1, &["the displaced model reaches from", "scale the model"]);
    }
    let place = Place::new();
    let scaled = ["builtin:cube", "-", "-", "-", "1e30"];
    place.render(&scaled).failed(1, &["the displaced model reaches from", "change SCALE"]);
    assert!(place.files().is_empty());
}

#[test]
fn statistics_do_not_replace_the_picture() {
    let run = Place::new().run(&[&QUICK[..], &["--stats=out.png"]].concat());
    run.failed(2, &["--stats and --output name the same file, out.png"]);
}

#[test]
fn quiet_says_nothing() {
    let run = Place::new().run(&[&QUICK[..], &["--quiet"]].concat()).succeeded();
    assert_eq!((run.stdout.as_str(), run.stderr.as_str()), ("", ""));
}

#[test]
fn devices_lists_the_processor() {
    let run = Place::new().run(&["devices"]).succeeded();
    assert!(run.stdout.lines().last().is_some_and(|line| line.starts_with("cpu ")), "{}", run.stdout);
}

#[test]
fn the_processor_is_exact() {
    let run = Place::new().run(&["devices", "--check", "--backend=cpu"]).succeeded();
    assert!(
        run.stdout.starts_with("cpu ")
            && run.stdout.ends_with("Emboss is exact here, as far as this looked.\n")
    );
    assert!(!run.stdout.contains("FAILS"), "{}", run.stdout);
}

/// Lavapipe's loops end too early, and nothing else of it is wrong.
#[test]
fn vulkan_devices_are_checked() {
    let run = Place::new().run(&["devices", "--check", "--device=llvmpipe"]);
    assert_eq!(run.stdout.matches("FAILS").count(), 1, "{}", run.stdout);
    run.failed(1, &["exactness does not hold on llvmpipe", "loops end after 65535 turns", "--backend cpu"]);
}

#[test]
fn a_check_is_of_one_device_and_asked_for() {
    let place = Place::new();
    place
        .run(&["devices", "--check", "--backend=cpu", "--device=0"])
        .failed(2, &["--device chooses a Vulkan device"]);
    place.run(&["devices", "--device=0"]).failed(2, &["--check"]);
    place.run(&["devices", "--check", "--device=none such"]).failed(1, &["no Vulkan device"]);
}

#[test]
fn without_a_device_auto_renders_on_the_cpu_and_says_so() {
    let place = Place::new();
    let mut command = place.command(&QUICK[..9]);
    let run = Run::of(without_vulkan(&mut command).arg("-oout.png").output().expect("starts")).succeeded();
    assert!(run.stderr.contains("rendering on the CPU"), "{}", run.stderr);
    assert!(run.stdout.contains("(cpu)"), "{}", run.stdout);
}

/// The loader then finds no driver, whatever is installed.
fn without_vulkan(command: &mut Command) -> &mut Command {
    command.env("VK_ICD_FILENAMES", "/nonexistent.json").env("VK_DRIVER_FILES", "/nonexistent.json")
}

/// `--invert` turns the relief upside down, in a file as in a built-in scene.
#[test]
fn inverted_maps_are_the_complement() {
    let place = Place::new().with("triangle.obj", TRIANGLE);
    let ramp = image::GrayImage::from_fn(8, 8, |x, _| image::Luma([u8::try_from(x * 30).expect("small")]));
    let complement = image::GrayImage::from_fn(8, 8, |x, y| image::Luma([255 - ramp.get_pixel(x, y).0[0]]));
    ramp.save(place.path("ramp.png")).expect("written");
    complement.save(place.path("complement.png")).expect("written");
    let picture = |arguments: &[&str]| {
        place.render(&[&["triangle.obj", "none"], arguments, &["--shade=height"]].concat()).succeeded();
        place.texels("out.png")
    };
    assert_eq!(picture(&["ramp.png", "--invert"]), picture(&["complement.png"]));
    assert_ne!(picture(&["ramp.png"]), picture(&["complement.png"]));

    let cube = |more: &[&str]| {
        place.run(&[&QUICK[..], more].concat()).succeeded();
        place.texels("out.png")
    };
    assert_ne!(cube(&["--shade=height"]), cube(&["--shade=height", "--invert"]));
}

#[test]
fn welding_and_linear_normals_change_the_picture() {
    let place = Place::new();
    let picture = |scene: &str, options: &[&str]| {
        place.render(&[&[scene, "-", "-", "-", "-", "4"], options].concat()).succeeded();
        place.texels("out.png")
    };
    for (scene, default, other) in [
        ("builtin:cube", "--weld=on", "--weld=off"),
        ("builtin:knot", "--normals=normalized", "--normals=linear"),
    ] {
        let picture = |options: &[&str]| picture(scene, options);
        assert_eq!(picture(&[]), picture(&[default]));
        assert_ne!(picture(&[]), picture(&[other]), "{other}");
    }
}

// Scene files.

/// A scene of the two triangles, the right one moved up, and what a test adds.
fn scene_place(scene: &str) -> Place {
    let place = Place::new().with("two.obj", TWO_MATERIALS).with("two.mtl", "newmtl a\nnewmtl b\nKd 0 1 0\n");
    image::RgbImage::from_pixel(1, 1, image::Rgb([255, 0, 0])).save(place.path("red.png")).expect("written");
    place.with("scene.toml", scene)
}

/// What the tests' picture needs to show plain colours.
const PLAIN: &str = "[render]\nwidth = 40\nheight = 20\nsamples = 1\nambient = 1\nn = 2\n\
    [camera]\neye = [2, 0.5, 9]\ntarget = [2, 0.5, 0]\n[[light]]\nposition = [0, 0, 9]\ncolor = [0, 0, 0]\n";

#[test]
fn a_scene_file_says_what_is_rendered() {
    let scene = format!(
        "{PLAIN}[material.idle]\n[material.paint]\ncolor = \"red.png\"\n[[model]]\npath = \"two.obj\"\n\
         material = {{ a = \"paint\" }}\n"
    );
    let place = scene_place(&scene);
    let run = place.run(&["render", "scene.toml", "--backend=cpu", "--output=out.png"]).succeeded();
    for line in ["model  scene.toml  (given)", "color  red.png, 0,1,0", "N      2  (from the scene file)"] {
        assert!(run.stdout.contains(line), "{}", run.stdout);
    }
    assert!(run.stdout.contains("Wrote out.png: 40x20, 1 samples"), "{}", run.stdout);
    let (idle, paint) = ("scene.toml:13: no model has the material `idle`", "material `paint`");
    assert!(run.stderr.contains(idle) && !run.stderr.contains(paint), "{}", run.stderr);
    assert_eq!(halves(&place.path("out.png")), [[255, 0, 0], [0, 255, 0]]);
}

#[test]
fn the_command_line_goes_before_the_scene_file() {
    let scene = format!(
        "{PLAIN}[material.blue]\ncolor = [0, 0, 1]\n[[model]]\npath = \"two.obj\"\nmaterial = \"blue\"\n"
    );
    let place = scene_place(&scene);
    let options = ["--backend=cpu", "--output=out.png", "--size=80x40", "--samples=3"];
    let run = place.run(&[&["render", "scene.toml", "red.png", "-", "-", "-", "5"], &options[..]].concat());
    let stdout = run.succeeded().stdout;
    assert!(
        stdout.contains("Wrote out.png: 80x40, 3 samples") && stdout.contains("N      5  (given)"),
        "{stdout}"
    );
    assert_eq!(halves(&place.path("out.png")), [[255, 0, 0]; 2]);
    place.run(&[&["render", "scene.toml"], &options[..]].concat()).succeeded();
    assert_eq!(halves(&place.path("out.png")), [[0, 0, 255]; 2]);
}

/// Paths are relative to the scene file, wherever the program is run.
#[test]
fn paths_are_relative_to_the_scene_file() {
    let scene = format!(
        "{PLAIN}[material.m]\ncolor = \"sub/../red.png\"\n[[model]]\npath = \"two.obj\"\nmaterial = \"m\"\n"
    );
    let place = scene_place(&scene);
    std::fs::create_dir(place.path("sub")).expect("writable");
    let mut command = place.command(&["render", "../scene.toml", "--backend=cpu", "-oout.png"]);
    Run::of(command.current_dir(place.path("sub")).output().expect("starts")).succeeded();
    assert_eq!(halves(&place.path("sub/out.png")), [[255, 0, 0]; 2]);
}

/// The two triangles again, each of a file of its own, brought to their places by transforms: the right one's file has
/// it mirrored, half as large, upside down and elsewhere.
#[test]
fn models_stand_where_their_transforms_put_them() {
    let left = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n";
    // Its corners times (-2, 2), then y and z change signs, then x gets 3 more: (3, 0), (4, 0), (4, 1).
    let right = "v 0 0 0\nv -0.5 0 0\nv -0.5 -0.5 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n";
    let scene = format!(
        "{PLAIN}[material.a]\ncolor = [1, 0, 0]\n[material.b]\ncolor = [0, 1, 0]\n\
        [[model]]\npath = \"left.obj\"\nmaterial = \"a\"\n\
        [[model]]\npath = \"right.obj\"\nmaterial = \"b\"\n\
        scale = [-2, 2, 1]\nrotate = [180, 0, 0]\ntranslate = [3, 0, 0]\n"
    );
    let place = scene_place(&scene).with("left.obj", left).with("right.obj", right);
    let render = |model: &str| {
        let options = ["--size=64x32", "--samples=1", "--backend=cpu", "--output=out.png"];
        place.run(&[&["render", model, "-", "none"], &AMBIENT[..], &options[..]].concat()).succeeded();
        image::open(place.path("out.png")).expect("a picture").to_rgba8()
    };
    let (scene, model) = (render("scene.toml"), render("two.obj"));
    assert_eq!(halves(&place.path("out.png"))[1], [0, 255, 0]);
    // Edges are moved by roundings of some 1e-7 units, a millionth of a pixel.
    let differ = scene.pixels().zip(model.pixels()).filter(|(a, b)| a.0[3] != b.0[3]).count();
    assert!(differ <= 1, "{differ} pixels");
}

#[test]
fn scene_files_that_are_wrong_name_the_line_and_a_remedy() {
    let cases: [(&str, &str); 38] = [
        ("", "1: the scene has no model; add one"),
        ("[render]\nwidth = 5\n", "3: the scene has no model"),
        ("[render]\nwidht = 5\n", "2: unknown field `widht`, expected one of `width`, `height`"),
        ("[rendr]\n", "1: unknown field `rendr`, expected one of `render`, `camera`"),
        ("[camera]\n\neye = [1, 2]\n", "3: invalid length 2"),
        ("[camera]\neye = [1, nan, 2]\n", "2: `NaN` is not finite; write a number"),
        ("[camera]\neye = [1, 1e39, 2]\n", "is not finite; write a number"),
        ("[camera]\nfov = 180\n", "2: `180` is no field of view; that is an angle from 0.01 to 179"),
        ("[render]\nwidth = 0\n", "2: a side of 0 pixels is not possible"),
        ("[render]\nwidth = 1e3\n", "2: invalid type: floating point"),
        (
            "[render]\nwidth = 2000000000\nheight = 2000000000\n[[model]]\nbuiltin = \"cube\"\n",
            "choose a smaller size",
        ),
        ("[render]\nn = 4097\n", "2: 4097 is no N; write a whole number from 1 to 4096"),
        ("[render]\nn = \"auto:100\"\n", "2: auto:100 is no N; write a whole number from 1 to 4096"),
        ("[render]\nn = 2.5\n", "2: a whole number from 1 to 4096, \"auto\""),
        ("[render]\nsamples = -1\n", "2: -1 is no number of samples"),
        (
            "[render]\nmethod = \"magic\"\n",
            "2: unknown variant `magic`, expected one of `quadtree`, `grid-walk`",
        ),
        ("[render]\nbackground = [255, 0, 0]\n", "2: `255` is not from 0 to 1"),
        ("[render]\nambient = -0.5\n", "2: `-0.5` is not a number from 0 on"),
        ("[render\n", "1: invalid table header"),
        ("\n[render]\nseed = 1\nseed = 2\n", "duplicate key `seed`"),
        ("[[light]]\ncolor = [1, 1, 1]\n", "1: missing field `position`"),
        ("[material.a]\ncolor = 5\n", "2: the name of an image, \"none\", or three numbers from 0 to 1"),
        ("[material.a]\n[material.a]\n", "2: invalid table header, duplicate key"),
        (
            "[material.a]\nwrap = \"tile\"\n",
            "2: unknown variant `tile`, expected one of `repeat`, `clamp`, `mirror`",
        ),
        ("[[model]]\n", "1: a model has either a path or a builtin"),
        ("[[model]]\npath = \"a.obj\"\nbuiltin = \"cube\"\n", "1: a model has either a path or a builtin"),
        ("[[model]]\n\nbuiltin = \"teapot\"\n", "3: there is no built-in scene `teapot`; choose cube"),
        (
            "[material.a]\n[[model]]\nbuiltin = \"cube\"\nmaterial = \"b\"\n",
            "4: there is no [material.b]; add it, or choose a",
        ),
        ("[[model]]\nbuiltin = \"cube\"\nmaterial = 5\n", "3: the name of a material, or a table"),
        ("[[model]]\nbuiltin = \"cube\"\nscale = 0\n", "3: a scale of 0 leaves nothing"),
        ("[[model]]\nbuiltin = \"cube\"\nscale = [1, -0.0, 1]\n", "3: a scale of 0 leaves nothing"),
        (
            "[[model]]\nbuiltin = \"cube\"\nscale = 3e38\nrotate = [0, 45, 0]\n",
            "1: the model's coordinates become too large",
        ),
        (
            "[material.m]\n[[model]]\npath = \"two.obj\"\nmaterial = { c = \"m\" }\n",
            "2: the model has no material `c`; it has a, b",
        ),
        (
            "[[model]]\nname = \"a\"\nbuiltin = \"cube\"\n[[instance]]\nmodel = \"b\"\n",
            "5: there is no model `b`; write name = \"b\" in its [[model]], or choose a",
        ),
        (
            "[[model]]\nname = \"a\"\nbuiltin = \"cube\"\n[[model]]\nname = \"a\"\nbuiltin = \"knot\"\n",
            "5: there is another model `a`; give each",
        ),
        ("[[model]]\nbuiltin = \"cube\"\n[[instance]]\nscale = 2\n", "3: missing field `model`"),
        (
            "[[model]]\nname = \"a\"\nbuiltin = \"cube\"\n[[instance]]\nmodel = \"a\"\nscale = [1, 0, 1]\n",
            "6: a scale of 0 leaves nothing",
        ),
        (
            "[[model]]\nname = \"a\"\nbuiltin = \"cube\"\n\n[[instance]]\nmodel = \"a\"\nscale = 1e-35\n",
            "5: the instance is too small, too large or too far away",
        ),
    ];
    for (scene, message) in cases {
        let place = scene_place(scene);
        place.run(&["render", "scene.toml", "--backend=cpu"]).failed(2, &["error: scene.toml:", message]);
        assert!(!place.path("emboss.png").exists());
    }
}

#[test]
fn what_a_scene_file_names_is_named_with_its_line() {
    let cases = [
        ("\n[[model]]\npath = \"lost.obj\"\n", "scene.toml:2: lost.obj: cannot be read"),
        ("[[model]]\npath = \".\"\n", "scene.toml:1: .: cannot be read"),
        ("[[model]]\npath = \"two.mtl\"\n", "scene.toml:1: two.mtl: has no faces"),
        (
            "[material.m]\ncolor = \"lost.png\"\n[[model]]\nbuiltin = \"cube\"\nmaterial = \"m\"\n",
            "scene.toml:1: lost.png: cannot be read",
        ),
        (
            "\n[material.m]\nheight = \"two.obj\"\n[[model]]\nbuiltin = \"cube\"\nmaterial = \"m\"\n",
            "scene.toml:2: two.obj: not an image that can be read; use PNG",
        ),
    ];
    for (scene, message) in cases {
        scene_place(scene).run(&["render", "scene.toml", "--backend=cpu"]).failed(1, &[message]);
    }
    let place = Place::new().with("bad.toml", [b'\n', 0xff]);
    place
        .run(&["render", "bad.toml"])
        .failed(2, &["bad.toml:2: not UTF-8 text; save the scene file as UTF-8"]);
    place.run(&["render", "lost.toml"]).failed(1, &["lost.toml: cannot be read", "check the path"]);
    std::fs::create_dir(place.path("folder.toml")).expect("writable");
    place.run(&["render", "folder.toml"]).failed(1, &["folder.toml: cannot be read"]);
}

#[test]
fn the_example_scenes_render() {
    for (name, n) in [("table", 48), ("rings", 16)] {
        let path = format!("{}/../docs/scenes/{name}.toml", env!("CARGO_MANIFEST_DIR"));
        let place = Place::new();
        let run = place.render(&[&path]).succeeded();
        assert!(run.stdout.contains(&format!("N      {n}  (from the scene file)")), "{}", run.stdout);
        assert!(alphas(&place.path("out.png")).iter().all(|&alpha| alpha == 255), "it has a background");
    }
}

/// A model that has instances is shown by them alone, each stored once; what it costs is told.
#[test]
fn instances_show_their_model_in_their_places() {
    let model = "[[model]]\nname = \"a\"\nbuiltin = \"cube\"\n";
    let at = |x: i32| format!("[[instance]]\nmodel = \"a\"\ntranslate = [{x}, 0, 0]\n");
    let picture = "[render]\nwidth = 24\nheight = 9\nsamples = 1\nn = 2\n\
                   [camera]\neye = [0, 0, 20]\ntarget = [0, 0, 0]\nfov = 15\n";
    let scene = format!("{picture}{model}translate = [0, 0, -90]\n{}{}", at(-3), at(3));
    // The model's own transform comes first: it takes the instances along.
    let near = scene.replace("-90", "0");
    let shown = |scene: &str| {
        let place = Place::new().with("scene.toml", scene);
        let options = ["render", "scene.toml", "--backend=cpu", "--output=out.png", "--stats=stats.json"];
        place.run(&options).succeeded();
        let stats: serde_json::Value =
            serde_json::from_slice(&std::fs::read(place.path("stats.json")).expect("written")).expect("JSON");
        (alphas(&place.path("out.png")), stats)
    };
    let (alphas, stats) = shown(&near);
    let column = |x: usize| (0..9).any(|y| alphas[24 * y + x] > 0);
    assert!(column(5) && column(18) && !column(11) && !column(12), "{alphas:?}");
    let number = |key: &str| stats.pointer(key).and_then(serde_json::Value::as_u64).expect(key);
    assert_eq!((number("/triangles"), number("/instances")), (12, 2));
    assert_eq!(number("/micro_triangles"), 2 * 12 * number("/settings/N").pow(2));
    assert_eq!(number("/bytes/instances"), 2 * 112);
    // Of two instances, and of twelve triangles.
    assert_eq!(number("/bytes/nodes"), (3 + 23) * 32);
    assert!(shown(&scene).0.iter().filter(|&&alpha| alpha > 0).count() < 24, "it is far away");
}

// Vector maps.

/// Vectors along x, y and z of a model that has other axes would be wrong; along its tangents they turn with it.
#[test]
fn turned_models_take_no_vectors_in_object_space() {
    let scene = |kind: &str, rotate: &str| {
        let settings = PLAIN.replace("[render]\n", &format!("[render]\ndisplacement = \"{kind}\"\n"));
        format!("{settings}[[model]]\nbuiltin = \"mushroom\"\nrotate = {rotate}\nscale = 2\n")
    };
    let run = |kind: &str, rotate: &str| {
        let place = Place::new().with("scene.toml", scene(kind, rotate));
        place.run(&["render", "scene.toml", "--backend=cpu", "--output=out.png"])
    };
    run("object", "[0, 90, 0]")
        .failed(2, &["scene.toml:14: vectors in object space", "displacement = \"tangent\""]);
    run("object", "[0, 0, 0]").succeeded();
    run("tangent", "[0, 90, 0]").succeeded();
}

/// A square in the xy plane, its u along x and its v along y.
const SQUARE: &str =
    "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3 4/4\n";

/// Vectors of every format, in both spaces; mid-grey of integers and black of floats do not displace.
#[test]
fn vector_maps_displace_along_their_axes() {
    let place = Place::new().with("square.obj", SQUARE);
    let save = |name: &str, image: image::DynamicImage| image.save(place.path(name)).expect("written");
    let ramp = |x: u32, y: u32| [x, y, x + y].map(|i| 0.1 + 0.05 * i as f32);
    save("float.exr", image::Rgb32FImage::from_fn(8, 8, |x, y| image::Rgb(ramp(x, y))).into());
    let code = |i: u32| u16::try_from(6554 + 3277 * i).expect("small");
    let codes = |x, y| image::Rgb([x, y, x + y].map(code));
    save("sixteen.png", image::ImageBuffer::from_fn(8, 8, codes).into());
    save("black.exr", image::Rgb32FImage::new(8, 8).into());
    // 0.5 lies between two codes, half of one off; 1e-5 of the scale does not show.
    save("grey.png", image::ImageBuffer::from_pixel(8, 8, image::Rgb([32768_u16; 3])).into());
    let picture = |map: &str, scale: &str, options: &[&str]| {
        let arguments = ["square.obj", "none", map, "-", scale, "8", "--shade=normal", "--eye=0.5,-2,2"];
        place.render(&[&arguments, options].concat()).succeeded();
        place.texels("out.png")
    };
    let flat = picture("none", "0.5", &[]);
    for kind in ["--displacement=tangent", "--displacement=object"] {
        assert_eq!(picture("black.exr", "0.5", &[kind]), flat, "{kind}");
        assert_eq!(picture("grey.png", "1e-3", &[kind]), flat, "{kind}");
        assert_ne!(picture("float.exr", "0.5", &[kind]), flat, "{kind}");
        assert_ne!(
            picture("sixteen.png", "0.5", &[kind]),
            picture("float.exr", "0.5", &[kind]),
            "{kind}: zero"
        );
    }
    // Here tangent, bitangent and normal are x, y and z.
    let (tangent, object) = ("--displacement=tangent", "--displacement=object");
    let of = |options: &[&str]| picture("float.exr", "0.5", options);
    assert_eq!(of(&[tangent]), of(&[object, "--channels=+r+b+g"]));
    assert_eq!(of(&[tangent, "--channels=+r+g+b"]), of(&[object]));
    for program in ["blender", "mudbox", "zbrush"] {
        assert_eq!(of(&[tangent]), of(&[tangent, &format!("--channels={program}")]));
    }
    assert_eq!(of(&[object, "--channels=blender"]), of(&[object, "--channels=+r+b-g"]));
    assert_ne!(of(&[object]), of(&[object, "--channels=-r+g+b"]));
    assert_eq!(picture("float.exr", "-0.5", &[object]), of(&[object, "--channels=-r-g-b"]));
}

/// A texel with a value that is no number does not displace, and is counted once.
#[test]
fn vectors_that_are_no_numbers_do_not_displace_and_are_counted() {
    let place = Place::new().with("square.obj", SQUARE);
    let rendered = |bad: [f32; 3]| {
        let map =
            image::Rgb32FImage::from_fn(4, 4, |x, y| image::Rgb(if x == y { bad } else { [0.2, 0.1, 0.3] }));
        image::DynamicImage::from(map).save(place.path("map.exr")).expect("written");
        let run =
            place.render(&["square.obj", "none", "map.exr", "0.25", "0.3", "4", "--displacement=tangent"]);
        (place.texels("out.png"), run.succeeded().stderr)
    };
    let (picture, stderr) = rendered([1.0, f32::NAN, f32::INFINITY]);
    assert!(stderr.contains("map.exr: 4 texels are NaN or infinite"), "{stderr}");
    assert!(picture == rendered([0.25; 3]).0, "they displace");
    assert!(picture != rendered([0.9; 3]).0, "these texels are not seen");
}

#[test]
fn a_vector_map_of_one_channel_is_refused() {
    let place = Place::new().with("square.obj", SQUARE);
    image::GrayImage::new(4, 4).save(place.path("grey.png")).expect("written");
    place
        .render(&["square.obj", "none", "grey.png", "--displacement=tangent"])
        .failed(1, &["grey.png: has one channel", "--displacement height"]);
}

/// A cube of six quads, each with the whole map.
fn cube_of_quads() -> String {
    let mut text = String::new();
    for i in 0..8 {
        let side = |bit: i32| if i & bit == 0 { -1 } else { 1 };
        text += &format!("v {} {} {}\n", side(1), side(2), side(4));
    }
    text += "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n";
    for [a, b, c, d] in [[1, 3, 4, 2], [5, 6, 8, 7], [1, 2, 6, 5], [3, 7, 8, 4], [1, 5, 7, 3], [2, 4, 8, 6]] {
        text += &format!("f {a}/1 {b}/2 {c}/3 {d}/4\n");
    }
    text
}

/// By the command line, by a scene file, and by the command line in its place; the picture's own command has it.
#[test]
fn base_meshes_are_subdivided() {
    let scene = "[render]\nsubdivide = \"1:loop\"\n[[model]]\npath = \"cube.obj\"\n\
                 [[model]]\npath = \"cube.obj\"\nsubdivide = 0\ntranslate = [4, 0, 0]\n";
    let place = Place::new().with("cube.obj", cube_of_quads()).with("scene.toml", scene);
    for (arguments, triangles) in [
        (&["cube.obj"][..], 12),
        (&["cube.obj", "--subdivide=0"], 12),
        (&["cube.obj", "--subdivide", "2"], 192),
        (&["cube.obj", "--subdivide=2:loop,crease=30"], 192),
        (&["scene.toml"], 48 + 12),
        (&["scene.toml", "--subdivide=1"], 2 * 48),
        (&["builtin:cube", "--subdivide=1"], 12 * 3 * 2),
    ] {
        let stdout = place.render(arguments).succeeded().stdout;
        assert!(stdout.contains(&format!("Imported {triangles} triangles\n")), "{arguments:?}: {stdout}");
    }
    let round = place.texels("out.png");
    place.render(&["builtin:cube"]).succeeded();
    assert_ne!(place.texels("out.png"), round);
    // 48 · 4^9 triangles are a third of what a BVH holds, four times as many are too many.
    let parts = ["cube.obj: 12 levels", "201326592 triangles of its 6 faces", "at most 10 times"];
    place.render(&["cube.obj", "--subdivide=12"]).failed(1, &parts);
}

// What is refused: usage.

#[test]
fn impossible_options_are_usage_errors() {
    let cases: [(&[&str], &str); 33] = [
        (&["-", "-", "-", "-", "-", "0"], "is no N; write a whole number from 1 to 4096"),
        (&["-", "-", "-", "-", "-", "4097"], "is no N; write a whole number from 1 to 4096"),
        (&["-", "-", "-", "nan"], "`nan` is not finite"),
        (&["-", "-", "-", "-", "inf"], "`inf` is not finite"),
        (&["--size=0x100"], "at least 1x1"),
        (&["--size=100"], "WIDTHxHEIGHT"),
        (&["--size=100000x100000"], "choose a smaller size"),
        (&["--samples=0"], "try 4"),
        (&["--light=1,2"], "write X,Y,Z"),
        (&["--light=1,2,3:1,1,1:-5"], "light is 0 or more"),
        (&["--eye=1,nan,3"], "`nan` is not finite"),
        (&["--eye=1,1,1", "--target=1,1,1"], "--eye and --target are the same point"),
        (&["--fov=180"], "from 0.01 to 179"),
        (&["--method=magic"], "grid-walk"),
        (&["--subdivide=13"], "write the levels, 0 to 12"),
        (&["--subdivide=2:lop"], "as 2 or 2:loop"),
        (&["--weld=maybe"], "[possible values: on, off]"),
        (&["--normals=bent"], "[possible values: normalized, linear]"),
        (&["--displacement=up"], "[possible values: height, tangent, object]"),
        (&["--channels=+r+r+b"], "three different channels such as +r+b-g"),
        (&["--channels=blender"], "name one as HEIGHT, with --displacement"),
        (&["--displacement=object"], "the relief of builtin:knot is a height map"),
        (&["builtin:mushroom", "--invert"], "choose the signs with --channels"),
        (&["builtin:mushroom", "--method=grid-walk"], "use --method quadtree"),
        (&["-", "-", "-", "-", "-", "auto:0"], "auto:PIXELS with 0.1 to 64 pixels"),
        (&["-", "-", "-", "-", "-", "auto", "--method=grid-walk"], "use --method quadtree"),
        (&["-", "-", "-", "-", "-", "auto", "--method=steep"], "use --method quadtree"),
        (&["builtin:mushroom", "--method=relief"], "use --method quadtree"),
        (&["--method=bump", "--normal-map=n.png"], "--normal-map is read by --method normal-map alone"),
        (&["--method=normal-map", "--normal-space=world"], "--normal-map"),
        (&["--method=bump", "--offset-map=o.png"], "--offset-map is read by --method bump-offset alone"),
        (&["--depth=16", "--output=a.exr"], "leave --depth out"),
        (&["--output=a.jpg"], ".png or .exr"),
    ];
    for (arguments, message) in cases {
        let place = Place::new();
        place.run(&[&["render"], arguments].concat()).failed(2, &["error: ", message]);
        assert!(place.files().is_empty());
    }
}

#[test]
fn unknown_built_in_scenes_are_usage_errors() {
    Place::new().render(&["builtin:teapot"]).failed(2, &["builtin:teapot", "builtin:knot", "builtin:cube"]);
}

// What is refused: files.

#[test]
fn missing_and_unreadable_models_are_errors() {
    let place = Place::new();
    place.render(&["none.obj"]).failed(1, &["none.obj", "check the path"]);
    place.render(&["."]).failed(1, &[".: cannot be read", "check the path"]);
}

#[test]
fn broken_models_name_file_and_line() {
    let render = |model: &str| Place::new().with("model.obj", model).render(&["model.obj"]);
    render("").failed(1, &["model.obj", "no faces", "export"]);
    render("v 0 0 zero\n").failed(1, &["model.obj:1", "zero", "export"]);
    render("v 0 0 0\nv 0 nan 0\n").failed(1, &["model.obj:2", "NaN", "repair"]);
    render(&TRIANGLE.replace("3/3", "9/3")).failed(1, &["model.obj:7", "vertex 9", "3 vertices"]);
    let bare = "o Bare\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    render(bare).failed(1, &["model.obj:5", "Bare", "texture coordinates", "UVs"]);
    render(&TRIANGLE.replace("2/2 3/3", "1/1 1/1")).failed(1, &["model.obj", "three different corners"]);
    Place::new().with("model.obj", [0xff; 40]).render(&["model.obj"]).failed(1, &["model.obj:1", "UTF-8"]);
}

#[test]
fn triangles_without_three_corners_are_left_out_and_counted() {
    let place =
        Place::new().with("model.obj", format!("{TRIANGLE}v 0.5 0 0\nf 1/1 1/1 2/2\nf 1/1 4/1 2/2\n"));
    let stdout = place.render(&["model.obj"]).succeeded().stdout;
    assert!(stdout.contains("Imported 2 triangles, left out 1 without three different corners"), "{stdout}");
    assert!(alphas(&place.path("out.png")).contains(&255));
}

#[test]
fn maps_that_are_no_images_are_errors() {
    let place = Place::new().with("model.obj", TRIANGLE).with("map.png", "no image");
    place.render(&["model.obj", "map.png"]).failed(1, &["map.png", "image"]);
    place.render(&["model.obj", "none", "map.png"]).failed(1, &["map.png", "image"]);
    place.render(&["model.obj", "none", "missing.png"]).failed(1, &["missing.png", "check the path"]);
}

#[test]
fn maps_of_one_texel_and_of_16k_are_rendered() {
    for (width, height) in [(1, 1), (16_384, 16)] {
        let place = Place::new().with("model.obj", TRIANGLE);
        let map = image::GrayImage::from_pixel(width, height, image::Luma([128]));
        map.save(place.path("map.png")).expect("written");
        let run = place.render(&["model.obj", "map.png", "map.png"]).succeeded();
        assert!(alphas(&place.path("out.png")).contains(&255));
        assert!(run.stderr.contains("map.png: has 8 bits"), "{}", run.stderr);
    }
}

/// What is NaN or infinite in a height map counts as `zero`, from the file to the picture, and is counted for the user.
#[test]
fn heights_that_are_no_numbers_do_not_displace_and_are_counted() {
    const ZERO: f32 = 0.25;
    for name in ["map.exr", "map.tiff"] {
        let rendered = |bad: [f32; 3]| {
            let place = Place::new();
            let map = image::Rgb32FImage::from_fn(4, 4, |x, y| {
                let texel = if x == y && x > 0 { bad[x as usize - 1] } else { (x + 4 * y) as f32 / 16.0 };
                image::Rgb([texel; 3])
            });
            image::DynamicImage::from(map).save(place.path(name)).expect("written");
            let run = place.render(&["builtin:cube", "none", name, "0.25", "0.3", "4"]).succeeded();
            (place.texels("out.png"), run.stderr)
        };
        let (picture, stderr) = rendered([f32::NAN, f32::INFINITY, f32::NEG_INFINITY]);
        assert!(stderr.contains(&format!("{name}: 3 texels are NaN or infinite")), "{stderr}");
        let (expected, stderr) = rendered([ZERO; 3]);
        assert!(!stderr.contains("NaN"), "{stderr}");
        assert!(picture == expected, "{name}: they displace");
        let (other, _) = rendered([0.9; 3]);
        assert!(picture != other, "{name}: these texels are not seen");
    }
}

// What may surprise: said once each, and part of the statistics.

/// Two triangles, a square whose texture coordinates go from 0 to `repeats`.
fn square(repeats: u32) -> String {
    format!(
        "v -1 0 1\nv 1 0 1\nv 1 0 -1\nv -1 0 -1\nvt 0 0\nvt {repeats} 0\nvt {repeats} {repeats}\nvt 0 {repeats}\n\
            vn 0 1 0\nvn 0 -1 0\n{FACE}"
    )
}

/// The face of a [`square`].
const FACE: &str = "f 1/1/1 2/2/1 3/3/1 4/4/1\n";

/// A place with a square, and a map of 64 x 64 texels with 16 stripes.
fn striped(repeats: u32) -> Place {
    let place = Place::new().with("square.obj", square(repeats));
    let stripe = |x: u32| if x % 4 < 2 { 0 } else { u16::MAX };
    let map = image::ImageBuffer::from_fn(64, 64, |x, _| image::Luma([stripe(x)]));
    map.save(place.path("stripes.png")).expect("written");
    place
}

fn stats(place: &Place) -> Value {
    serde_json::from_slice(&place.read("stats.json")).expect("JSON")
}

/// The lines of a run that are warnings.
fn warnings(run: &Run) -> Vec<&str> {
    run.stderr.lines().filter(|line| line.contains("WARN")).collect()
}

#[test]
fn relief_between_micro_vertices_is_told() {
    let render = |place: &Place, more: &[&str]| {
        let arguments = ["square.obj", "none", "stripes.png", "0.5", "0.1"];
        place.render(&[&arguments[..], more, &["--stats=stats.json"]].concat()).succeeded()
    };
    let place = striped(1);
    let run = render(&place, &[]);
    let [warning] = &warnings(&run)[..] else { panic!("{}", run.stderr) };
    for part in ["stripes.png: 4.0 texels", "N = 16", "2 of 2 triangles", "N = 64 reads all", "N = auto"] {
        assert!(warning.contains(part), "no `{part}` in: {warning}");
    }
    let told = &stats(&place)["warnings"]["undersampled"];
    assert_eq!(
        (&told[0]["needed"], &told[0]["N"], &told[0]["texels"]),
        (&64.into(), &16.into(), &4.0.into())
    );
    assert_eq!(told.as_array().map(Vec::len), Some(1));
    for quiet in [&["64"][..], &["auto"], &["32"], &["--method=relief"], &["--method=none"]] {
        let run = render(&place, quiet);
        assert!(warnings(&run).is_empty(), "{quiet:?}: {}", run.stderr);
        assert_eq!(stats(&place)["warnings"]["undersampled"], Value::Array(vec![]), "{quiet:?}");
    }
    // Parts that are wider than a pixel were asked for.
    let run = render(&place, &["auto:16"]);
    assert!(warnings(&run).len() == 1 && run.stderr.contains("N = auto what a pixel"), "{}", run.stderr);
    let walk = render(&place, &["--method=grid-walk"]);
    assert!(walk.stderr.contains("N = 64 reads all") && !walk.stderr.contains("auto"), "{}", walk.stderr);
    let run = render(&striped(250), &[]);
    assert!(run.stderr.contains("even N = 4096, the greatest, leaves 3.9 between them"), "{}", run.stderr);
    assert!(run.stderr.contains("cut the base mesh finer"), "{}", run.stderr);
}

/// A map of several materials is told of once, a vector map by its name; N of a built-in scene is its own.
#[test]
fn relief_between_micro_vertices_is_told_once_for_a_map() {
    let place = striped(1);
    let scene = "[material.a]\nheight = \"stripes.png\"\nscale = 0.1\n\
        [material.b]\nheight = \"stripes.png\"\nscale = 0.2\n\
        [[model]]\npath = \"square.obj\"\nmaterial = \"a\"\n\
        [[model]]\npath = \"square.obj\"\nmaterial = \"b\"\ntranslate = [3, 0, 0]\n";
    let place = place.with("scene.toml", scene);
    let run = place.render(&["scene.toml", "-", "-", "-", "-", "4"]).succeeded();
    assert_eq!(run.stderr.matches("stripes.png: 16.0 texels").count(), 1, "{}", run.stderr);
    assert!(run.stderr.contains("in 4 of 4 triangles"), "{}", run.stderr);
    let vectors = ["square.obj", "none", "stripes.png", "-", "0.1", "--displacement=tangent"];
    image::open(place.path("stripes.png"))
        .expect("a map")
        .to_rgb16()
        .save(place.path("stripes.png"))
        .expect("a map");
    let run = place.render(&vectors).succeeded();
    assert_eq!(run.stderr.matches("stripes.png: 4.0 texels").count(), 1, "{}", run.stderr);
    let own = place.render(&["builtin:cube"]).succeeded();
    assert!(warnings(&own).is_empty(), "{}", own.stderr);
    let given = place.render(&["builtin:cube", "-", "-", "-", "-", "16"]).succeeded();
    assert!(given.stderr.contains("builtin:cube: 32.0 texels"), "{}", given.stderr);
}

#[test]
fn pictures_that_show_nothing_are_told() {
    let place = striped(1);
    let render = |more: &[&str]| {
        let arguments = ["square.obj", "none", "stripes.png", "0", "0.5", "64", "--stats=stats.json"];
        let run = place.render(&[&arguments[..], more].concat()).succeeded();
        let lines: Vec<String> = warnings(&run).into_iter().map(str::to_owned).collect();
        let kind = stats(&place)["warnings"]["useless"]["kind"].as_str().unwrap_or("").to_owned();
        (lines, kind)
    };
    let is_one = |(lines, kind): (Vec<String>, String), expected: &str, parts: &[&str]| {
        assert!(lines.len() == 1 && kind == expected, "{kind} {lines:?}");
        for part in parts {
            assert!(lines[0].contains(part), "no `{part}` in: {}", lines[0]);
        }
    };
    assert_eq!(render(&[]), (vec![], String::new()));
    let away = render(&["--eye=0,1,3", "--target=0,1,10"]);
    is_one(
        away,
        "nothing-hit",
        &[
            "picture is empty",
            "behind the camera",
            "leave --eye",
            "--target 0,0.25,0",
            "between -1,0,-1 and 1,0.5,1",
        ],
    );
    let inside = render(&["--eye=0.094,0.2,0.2", "--target=0.094,0.2,-1"]);
    is_one(inside, "camera-inside", &["inside the relief", "0.094,0.2,0.2", "leave --eye out"]);
    let dark = render(&["--light=-1e20,1e20,0"]);
    is_one(dark, "no-light", &["no light reaches", "so far away", "move --light"]);
    let dark = render(&["--light=0,-3,0", "--method=none"]);
    is_one(dark, "no-light", &["no light reaches", "behind what is seen"]);
}

/// Within a file, and across models and instances of a scene.
#[test]
fn faces_that_are_there_twice_are_told() {
    let place = Place::new()
        .with("once.obj", square(1))
        .with("twice.obj", square(1) + FACE)
        .with("sides.obj", square(1) + "f 4/4/2 3/3/2 2/2/2 1/1/2\n")
        .with("diagonal.obj", square(1) + "f 2/2/1 3/3/1 4/4/1 1/1/1\n")
        .with("models.toml", "[[model]]\npath = \"once.obj\"\n[[model]]\npath = \"once.obj\"\n")
        .with(
            "instances.toml",
            "[[model]]\nname = \"a\"\npath = \"once.obj\"\n[[instance]]\nmodel = \"a\"\n[[instance]]\nmodel = \"a\"\n\
                translate = [3, 0, 0]\n[[instance]]\nmodel = \"a\"\n",
        );
    for (file, repeated, across) in [
        ("once.obj", 0, 0),
        ("twice.obj", 2, 0),
        ("sides.obj", 2, 0),
        ("diagonal.obj", 2, 0),
        ("models.toml", 2, 2),
        ("instances.toml", 2, 2),
    ] {
        let run = place.render(&[file, "--stats=stats.json"]).succeeded();
        let told = &stats(&place)["warnings"]["repeated"];
        assert_eq!(
            (&told["triangles"], &told["across_models"]),
            (&repeated.into(), &across.into()),
            "{file}"
        );
        let lines = warnings(&run);
        assert_eq!(lines.len(), usize::from(repeated > 0), "{file}: {lines:?}");
        let of_model = format!("{file}: {repeated} of its 4 triangles repeat others");
        let of_scene =
            format!("{file}: {across} triangles of a model or an instance repeat those of another");
        assert!(
            repeated == 0 || run.stderr.contains(if across > 0 { &of_scene } else { &of_model }),
            "{lines:?}"
        );
    }
}

// What is refused: machines.

#[test]
fn without_a_device_vulkan_is_an_error() {
    let place = Place::new();
    let mut command = place.command(&["render", "--backend=vulkan"]);
    let run = Run::of(without_vulkan(&mut command).output().expect("starts"));
    run.failed(1, &["no Vulkan device", "install a Vulkan driver, or use --backend cpu"]);
}

#[test]
fn a_device_for_the_cpu_backend_is_a_usage_error() {
    Place::new()
        .run(&["render", "--backend=cpu", "--device=0"])
        .failed(2, &["--device", "leave one of them out"]);
}

/// Half a tebibyte: more than the machines have that run this. Where the system does not tell its memory the
/// allocation fails instead, with other words.
#[test]
fn pictures_beyond_memory_are_refused() {
    let run = Place::new().run(&["render", "--backend=cpu", "--size=65535x65535"]);
    run.failed(1, &["memory"]);
}

#[test]
fn a_missing_output_folder_is_found_before_the_model_is_read() {
    let run = Place::new().run(&["render", "none.obj", "--output=none/out.png"]);
    run.failed(1, &["none/out.png", "there is no folder none", "create it"]);
    let run = Place::new().run(&["render", "none.obj", "--stats=none/stats.json"]);
    run.failed(1, &["none/stats.json", "folder does not exist"]);
}

#[cfg(unix)]
mod unix {
    use super::*;
    use std::io::{BufRead, BufReader};
    use std::process::{Child, ChildStderr, Stdio};

    /// A limit on the size of files stands for a disk that fills up: the write fails half-way. (The signal that
    /// comes with it is ignored, so that the program gets the error.)
    #[test]
    fn a_full_disk_keeps_the_old_picture_and_leaves_no_rest() {
        let place = Place::new().with("out.png", "the old picture");
        let script = "trap '' XFSZ; ulimit -f 1; exec \"$0\" \"$@\"";
        let run = Run::of(
            Command::new("sh")
                .args(["-c", script, env!("CARGO_BIN_EXE_emboss")])
                .args(QUICK)
                // Larger than the limit of one block, which is 512 or 1024 bytes.
                .arg("--depth=16")
                .current_dir(place.0.path())
                .output()
                .expect("sh starts"),
        );
        run.failed(1, &["out.png", "could not be written", "make room"]);
        assert_eq!(place.read("out.png"), b"the old picture");
        assert_eq!(place.files(), ["out.png"]);
    }

    /// Starts a rendering that takes minutes, and waits until its first sample has begun.
    fn started(place: &Place, samples: &str, subdivisions: &str) -> (Child, BufReader<ChildStderr>) {
        let arguments = [
            "render",
            "builtin:cube",
            "-",
            "-",
            "-",
            "-",
            subdivisions,
            "--method=brute-force",
            "--size=64x64",
            samples,
            "--backend=cpu",
            "--output=out.png",
            "--verbose",
        ];
        let mut child = place
            .command(&arguments)
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the program starts");
        let mut stderr = BufReader::new(child.stderr.take().expect("piped"));
        wait_for(&mut stderr, "rendering on ");
        (child, stderr)
    }

    fn wait_for(stderr: &mut BufReader<ChildStderr>, message: &str) {
        let mut line = String::new();
        while !line.contains(message) {
            line.clear();
            assert_ne!(stderr.read_line(&mut line).expect("text"), 0, "ended before `{message}`");
        }
    }

    fn interrupt(child: &Child) {
        let status =
            Command::new("kill").args(["-INT", &child.id().to_string()]).status().expect("kill starts");
        assert!(status.success());
    }

    #[test]
    fn ctrl_c_keeps_the_picture_so_far() {
        let place = Place::new();
        let (mut child, mut stderr) = started(&place, "--samples=20000", "4");
        interrupt(&child);
        wait_for(&mut stderr, "interrupted; the picture so far was written to out.png");
        assert_eq!(child.wait().expect("ended").code(), Some(130));
        assert_eq!(alphas(&place.path("out.png")).len(), 64 * 64);
        assert_eq!(place.files(), ["out.png"]);
    }

    /// A tile of a thousand pixels at 16 million micro-triangles a prism takes many minutes, one pixel a second or two.
    #[test]
    fn ctrl_c_does_not_wait_for_a_tile() {
        let place = Place::new();
        let (mut child, _stderr) = started(&place, "--samples=1", "4096");
        interrupt(&child);
        let patience = std::time::Instant::now() + std::time::Duration::from_secs(60);
        while child.try_wait().expect("a child").is_none() {
            assert!(std::time::Instant::now() < patience, "still at the tile");
            std::thread::sleep(std::time::Duration::from_millis(100));
        }
        assert_eq!(child.wait().expect("ended").code(), Some(130));
    }

    /// A ray of 16 million micro-triangles takes a second or more: only the second Ctrl-C ends it.
    #[test]
    fn a_second_ctrl_c_ends_at_once() {
        let place = Place::new();
        let (mut child, mut stderr) = started(&place, "--samples=1", "4096");
        interrupt(&child);
        wait_for(&mut stderr, "press Ctrl-C again to end at once");
        assert!(child.try_wait().expect("a child").is_none(), "ended at the first Ctrl-C");
        interrupt(&child);
        assert_eq!(child.wait().expect("ended").code(), Some(130));
        assert!(place.files().is_empty());
    }
}
