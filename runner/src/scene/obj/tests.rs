use super::*;
use crate::scene::MapFile;
use crate::settings::Wrap;
use crate::space::RenderSpace;
use emboss_kernels::interface::{FLIPPED, Triangle};
use glam::Vec3;
use std::io::Write;
use std::sync::{Arc, Mutex};
use tempfile::TempDir;

/// Four vertices of a square and their texture coordinates, lines 1 to 8.
const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n";

/// A folder with a model and other files.
fn folder(model: impl AsRef<[u8]>, others: &[(&str, &str)]) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    for (name, content) in others {
        std::fs::write(folder.path().join(name), content).unwrap();
    }
    let path = folder.path().join("model.obj");
    std::fs::write(&path, model).unwrap();
    (folder, path)
}

fn load(model: impl AsRef<[u8]>) -> Result<Mesh, SceneError> {
    let (_folder, path) = folder(model, &[]);
    load_obj(&path).map(|model| model.mesh)
}

/// The message of a model that cannot be loaded, after the folder's name.
fn message(model: impl AsRef<[u8]>) -> String {
    let (folder, path) = folder(model, &[]);
    let message = load_obj(&path).expect_err("the model is broken").to_string();
    let prefix = format!("{}/", folder.path().display());
    message.strip_prefix(&prefix).unwrap_or_else(|| panic!("{message} names no file")).into()
}

/// The square of lines 1 to 8, and then `faces` from line 9.
fn square(faces: &str) -> String {
    format!("{SQUARE}{faces}")
}

/// The outward normal times twice the area.
fn area_normal(mesh: &Mesh, triangle: &Triangle) -> Vec3 {
    let [p0, p1, p2] = triangle.vertices.map(|v| mesh.vertices[v as usize].position);
    let n = (p1 - p0).cross(p2 - p0);
    if triangle.flags == FLIPPED { -n } else { n }
}

/// Everything that is logged while `f` runs.
fn logged<T>(f: impl FnOnce() -> T) -> (T, String) {
    #[derive(Clone, Default)]
    struct Log(Arc<Mutex<Vec<u8>>>);
    impl Write for Log {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            self.0.lock().unwrap().write(bytes)
        }
        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }
    let log = Log::default();
    let writer = log.clone();
    let subscriber = tracing_subscriber::fmt().with_writer(move || writer.clone()).with_ansi(false).finish();
    let result = tracing::subscriber::with_default(subscriber, f);
    let text = String::from_utf8(log.0.lock().unwrap().clone()).unwrap();
    (result, text)
}

#[test]
fn a_quad_becomes_two_triangles_with_one_normal() {
    let mesh = load(square("f 1/1 2/2 3/3 4/4\n")).unwrap();
    assert_eq!((mesh.vertices.len(), mesh.triangles.len(), mesh.dropped), (4, 2, 0));
    for triangle in &mesh.triangles {
        assert_eq!(area_normal(&mesh, triangle), Vec3::Z);
    }
    for vertex in &mesh.vertices {
        assert_eq!((vertex.normal, vertex.u, vertex.v), (Vec3::Z, vertex.position.x, vertex.position.y));
    }
}

#[test]
fn winding_is_kept_when_mirrored() {
    let mesh = load(square("f 4/4 3/3 2/2 1/1\n")).unwrap();
    for triangle in &mesh.triangles {
        assert_eq!(area_normal(&mesh, triangle), -Vec3::Z);
    }
    assert!(mesh.vertices.iter().all(|vertex| vertex.normal == -Vec3::Z));
}

#[test]
fn polygons_are_fans_from_their_first_corner() {
    let pentagon = "v 2 0.5 0\nvt 2 0.5\nf 1/1 2/2 5/5 3/3 4/4\n";
    let mesh = load(square(pentagon)).unwrap();
    assert_eq!(mesh.triangles.len(), 3);
    // An arrowhead is filled from its tip or its notch; from elsewhere a triangle reaches outside and turns over.
    let arrow = "v 0.1 0.2 0\nvt 0.1 0.2\nf 1/1 2/2 5/5 4/4\n";
    let mesh = load(square(arrow)).unwrap();
    let areas: Vec<f32> = mesh.triangles.iter().map(|t| area_normal(&mesh, t).z).collect();
    assert_eq!(areas, [0.2, 0.1]);
    let mesh = load(square("v 0.1 0.2 0\nvt 0.1 0.2\nf 2/2 5/5 4/4 1/1\n")).unwrap();
    let areas: Vec<f32> = mesh.triangles.iter().map(|t| area_normal(&mesh, t).z).collect();
    assert!(areas[0] < 0.0 && areas[1] > 0.0, "{areas:?}");
}

#[test]
fn negative_indices_count_back() {
    let positive = load(square("f 1/1 2/2 3/3 4/4\n")).unwrap();
    let negative = load(square("f -4/-4 -3/-3 -2/-2 -1/-1\nv 9 9 9\nvt 9 9\n")).unwrap();
    assert_eq!(positive.vertices, negative.vertices);
    assert_eq!(positive.triangles, negative.triangles);
}

#[test]
fn windows_line_ends_comments_and_a_byte_order_mark_do_not_matter() {
    let plain = load(square("f 1/1 2/2 3/3 4/4\n")).unwrap();
    let text = square("# C:\\folder\\\r\nf 1/1 2/2 \\\r\n 3/3 4/4 # the face\r\n")
        .replace("vt 0 1\n", "\tvt  0 1 0\r\n");
    let mesh = load(format!("\u{feff}{text}")).unwrap();
    assert_eq!((plain.vertices, plain.triangles), (mesh.vertices, mesh.triangles));
}

#[test]
fn colours_weights_and_polylines_do_not_matter() {
    let plain = load(square("f 1/1 2/2 3/3 4/4\n")).unwrap();
    let text = square("l 1 2 3\nl 1/1 2/2 3/3 4/4\np 1\nf 1/1 2/2 3/3 4/4\n");
    let text = text.replace("v 1 1 0", "v 1 1 0 0.5 0.5 0.5").replace("v 1 0 0", "v 2 0 0 2");
    let mesh = load(text).unwrap();
    assert_eq!((plain.vertices, plain.triangles), (mesh.vertices, mesh.triangles));
}

#[test]
fn objects_and_groups_are_merged() {
    let mesh =
        load(square("o a\nf 1/1 2/2 3/3\ng b\nf 1/1 3/3 4/4\no later\nf 5/1 2/2 3/3\nv 0 0 1\n")).unwrap();
    assert_eq!(mesh.triangles.len(), 3);
    assert_eq!(mesh.vertices.len(), 5);
}

#[test]
fn missing_and_zero_normals_are_computed_and_others_normalised() {
    let mesh = load(square("vn 0 3 4\nvn 0 0 0\nf 1/1/1 2/2/2 3/3 4/4/\n")).unwrap();
    let at =
        |x: f32, y: f32| mesh.vertices.iter().find(|v| v.position == Vec3::new(x, y, 0.0)).unwrap().normal;
    // One rounding of f32 each.
    assert!(at(0.0, 0.0).abs_diff_eq(Vec3::new(0.0, 0.6, 0.8), f32::EPSILON / 2.0));
    assert_eq!([at(1.0, 0.0), at(1.0, 1.0), at(0.0, 1.0)], [Vec3::Z; 3]);
}

#[test]
fn a_texture_seam_splits_vertices_but_not_computed_normals() {
    let text = square("v 0 0 -1\nv 0 1 -1\nf 1/1 2/2 3/3 4/4\nf 5/1 1/2 4/3 6/4\n");
    let mesh = load(text).unwrap();
    assert_eq!(mesh.vertices.len(), 8);
    let seam: Vec<_> = mesh.vertices.iter().filter(|v| v.position.x == 0.0 && v.position.z == 0.0).collect();
    assert_eq!(seam.len(), 4);
    // Each end of the seam has one triangle of the fan on one side and two on the other, of the same area.
    for pair in seam.chunks(2) {
        assert_eq!((pair[0].position, pair[0].normal), (pair[1].position, pair[1].normal));
        assert!(pair[0].normal.z > 0.1 && pair[0].normal.x < -0.1, "{pair:?}");
    }
}

#[test]
fn coinciding_corners_and_thin_faces_are_counted() {
    let mesh = load(square("f 1/1 2/2 3/3\nf 1/1 1/1 2/2\nf 1/1 2/2\n")).unwrap();
    assert_eq!((mesh.triangles.len(), mesh.dropped), (1, 2));
}

#[test]
fn broken_files_are_named_with_a_remedy() {
    let (folder, path) = folder("", &[]);
    let missing = folder.path().join("missing.obj");
    for path in [&missing, &folder.path().to_path_buf()] {
        let message = load_obj(path).unwrap_err().to_string();
        assert!(message.starts_with(&format!("{}: cannot be read: ", path.display())), "{message}");
        assert!(message.ends_with("; check the path and its permissions"), "{message}");
    }
    let message_of_empty =
        "has no faces; export the mesh with its polygons, and check that it is an OBJ file";
    assert_eq!(load_obj(&path).unwrap_err().to_string(), format!("{}: {message_of_empty}", path.display()));
    assert_eq!(message(SQUARE), format!("model.obj: {message_of_empty}"));
    assert_eq!(
        message(square("f 1/1 2/2 2/2\nf 1/1 2/2\n")),
        "model.obj: none of its 2 triangles has three different corners; check the scale of the export"
    );
    assert_eq!(
        message(b"v 0 0 0\n# caf\xe9\n"),
        "model.obj:2: not UTF-8 text; save the model as UTF-8, and check that it is an OBJ file"
    );
}

#[test]
fn broken_numbers_are_named_with_line_and_remedy() {
    for (text, expected) in [
        ("v 1 2\n", "1: a vertex needs 3 numbers, but here stands `1 2`; check the export"),
        ("\nv 1 2 x # no\n", "2: a vertex needs 3 numbers, but here stands `1 2 x`; check the export"),
        ("vt 0.5\n", "1: a texture coordinate needs 2 numbers, but here stands `0.5`; check the export"),
        ("vn\n", "1: a normal needs 3 numbers, but here stands ``; check the export"),
        ("v 1 2 \\\n nan\n", "1: this vertex is NaN or infinite; repair the mesh before exporting it"),
        ("v 1 2 1e39\n", "1: this vertex is NaN or infinite; repair the mesh before exporting it"),
        ("v 1 2 3 1e-45\n", "1: this vertex is NaN or infinite; repair the mesh before exporting it"),
        ("v 1 2 3 nan\n", "1: this vertex is NaN or infinite; repair the mesh before exporting it"),
        ("vt inf 0\n", "1: this texture coordinate is NaN or infinite; repair the mesh before exporting it"),
        ("vn 0 -inf 0\n", "1: this normal is NaN or infinite; repair the mesh before exporting it"),
        (
            "v 1 2 3 0\n",
            "1: this vertex has the weight 0, so that it lies at infinity; leave the fourth number out",
        ),
    ] {
        assert_eq!(message(text), format!("model.obj:{expected}"));
    }
}

#[test]
fn broken_faces_are_named_with_line_and_remedy() {
    let form = "write it as vertex/texture or vertex/texture/normal, in whole numbers";
    for (faces, expected) in [
        ("f 1/1 2/2 9/3\n", "9: face points to vertex 9, but the file has 4 vertices; check the export"),
        (
            "f 1/1 2/2 3/5\n",
            "9: face points to texture coordinate 5, but the file has 4 texture coordinates; check the export",
        ),
        (
            "vn 0 0 1\nf 1/1/2 2/2 3/3\n",
            "10: face points to normal 2, but the file has 1 normal; check the export",
        ),
        (
            "f 1/1 2/2 3/3\nf 0/1 2/2 3/3\n",
            "10: face points to vertex 0, but OBJ counts from 1; check the export",
        ),
        (
            "f 1/0 2/2 3/3\n",
            "9: face points to texture coordinate 0, but OBJ counts from 1; check the export",
        ),
        (
            "f -5/1 2/2 3/3\nv 5 5 5\n",
            "9: face points to vertex -5, but only 4 vertices stand above it; check the export",
        ),
        (
            "f 1/-9 2/2 3/3\n",
            "9: face points to texture coordinate -9, but only 4 texture coordinates stand above it; check the export",
        ),
        ("f\n", "9: this face has no corners; check the export"),
        ("f a 2/2 3/3\n", &format!("9: `a` is no corner of a face; {form}")),
        ("f /1 2/2 3/3\n", &format!("9: `/1` is no corner of a face; {form}")),
        ("f 1/1/1/1 2/2 3/3\n", &format!("9: `1/1/1/1` is no corner of a face; {form}")),
        ("f 1.5/1 2/2 3/3\n", &format!("9: `1.5/1` is no corner of a face; {form}")),
        ("f 1 2 3\n", "9: the model has a face without texture coordinates; unwrap its UVs and export them"),
        (
            "o Left arm\nf 1//1 2 3\n",
            "10: object `Left arm` has a face without texture coordinates; unwrap its UVs and export them",
        ),
    ] {
        assert_eq!(message(square(faces)), format!("model.obj:{expected}"));
    }
}

#[test]
fn what_the_survey_passes_tobj_reads() {
    // An index that wraps around in tobj, and forward references beyond an object's end.
    assert!(load(square("f -9223372036854775808/1 2/2 3/3\n")).is_err());
    assert!(load(square("o a\nf 1/1 2/2 5/5\no b\nv 2 2 2\nvt 2 2\nf 1/1 2/2 5/5\n")).is_ok());
}

/// What a model's materials say that uses `a` and `b` of a library, in the order of `used`; and what is logged.
fn with_materials(used: [&str; 2], library: &str) -> (Vec<ModelMaterial>, String, TempDir) {
    let [first, second] = used;
    let model =
        square(&format!("mtllib model.mtl\nusemtl {first}\nf 1/1 2/2 3/3\nusemtl {second}\nf 1/1 3/3 4/4\n"));
    let (folder, path) = folder(model, &[("model.mtl", library)]);
    let (result, log) = logged(|| load_obj(&path));
    (result.unwrap().materials, log, folder)
}

/// The map of that name in a folder, without options.
fn map(folder: &TempDir, name: &str) -> Option<MapFile> {
    Some(MapFile { path: folder.path().join(name), ..MapFile::default() })
}

#[test]
fn maps_are_relative_to_the_library_and_follow_its_options() {
    let library = "map_Kd lost.png\nnewmtl a\nKd 1\nmap_Kd -s 2 2 -clamp on my colours.png\n\
        map_Bump -bm 0.5 bump.png\nDisp -mm -0.5 2 \"sub\\height.tif\"\nnorm -clamp off normal.png\n";
    let (materials, log, folder) = with_materials(["a", "a"], library);
    let [material] = &materials[..] else { panic!("{materials:?}") };
    let with_wrap = |name, wrap| map(&folder, name).map(|map| MapFile { wrap: Some(wrap), ..map });
    assert_eq!(material.albedo, Some(Vec3::ONE));
    assert_eq!(material.color, with_wrap("my colours.png", Wrap::Clamp));
    let height = map(&folder, "sub/height.tif");
    assert_eq!(material.height, height.map(|map| MapFile { base_and_gain: Some((-0.5, 2.0)), ..map }));
    assert_eq!(material.normal, with_wrap("normal.png", Wrap::Repeat));
    assert_eq!(log, "");
}

#[test]
fn colours_are_of_one_number_or_three() {
    for (line, expected) in [
        ("Kd 0.5", Some(Vec3::splat(0.5))),
        ("kd 0.1 0.2 3", Some(Vec3::new(0.1, 0.2, 3.0))),
        ("Kd spectral file.rfl 1", None),
        ("Kd 0.1 nan 0", None),
        ("Kd 0.1 -1 0", None),
        ("Kd", None),
    ] {
        let (materials, ..) = with_materials(["a", "a"], &format!("newmtl a\n{line}\n"));
        assert_eq!(materials[0].albedo, expected, "{line}");
    }
}

#[test]
fn disp_goes_before_map_disp_before_bump() {
    for (library, expected) in [
        ("newmtl a\nbump b.png\nmap_disp m.png\ndisp d.png\n", "d.png"),
        ("newmtl a\nbump b.png\nmap_disp m.png\n", "m.png"),
        ("newmtl a\nmap_bump b.png\n", "b.png"),
    ] {
        let (materials, _, folder) = with_materials(["a", "a"], library);
        assert_eq!(materials[0].height, map(&folder, expected));
    }
}

#[test]
fn each_material_has_its_own_maps() {
    let library =
        "newmtl a\nmap_Kd a.png\nnewmtl idle\nmap_Kd idle.png\nnewmtl b\nmap_Kd b.png\ndisp h.png\n";
    let (materials, log, folder) = with_materials(["b", "a"], library);
    let names: Vec<_> = materials.iter().map(|material| material.name.as_str()).collect();
    assert_eq!(names, ["b", "a"]);
    assert_eq!((&materials[0].color, &materials[0].height), (&map(&folder, "b.png"), &map(&folder, "h.png")));
    assert_eq!((&materials[1].color, &materials[1].height), (&map(&folder, "a.png"), &None));
    assert_eq!(log, "");
}

/// A polygon's triangles are all of its material; so are those behind triangles that are left out.
#[test]
fn triangles_name_their_materials() {
    let faces = "f 1/1 2/2 3/3\nusemtl b\nf 1/1 2/2 3/3 4/4\nf 1/1 1/1 2/2\nusemtl idle\nusemtl a\nf 1/1 2/2\n\
        f 1/1 2/2 4/4\nusemtl b\nf 2/2 3/3 4/4\n";
    let (_folder, path) = folder(square(faces), &[]);
    let ObjModel { mesh, materials, .. } = load_obj(&path).unwrap();
    let names: Vec<_> =
        mesh.triangles.iter().map(|t| materials[t.material() as usize].name.as_str()).collect();
    assert_eq!(names, ["", "b", "b", "a", "b"]);
    assert_eq!((materials.len(), mesh.dropped), (3, 2));
}

#[test]
fn models_that_name_no_material_take_their_libraries_first_maps() {
    let library = "newmtl a\nmap_Kd a.png\nnewmtl b\nmap_Kd b.png\ndisp h.png\n";
    let (folder, path) = folder(square("mtllib model.mtl\nf 1/1 2/2 3/3\n"), &[("model.mtl", library)]);
    let ObjModel { materials, libraries, .. } = load_obj(&path).unwrap();
    assert_eq!(libraries, [folder.path().join("model.mtl")]);
    let [material] = &materials[..] else { panic!("{materials:?}") };
    assert_eq!((&material.color, &material.height), (&map(&folder, "a.png"), &map(&folder, "h.png")));
}

#[test]
fn a_material_that_no_library_has_is_a_warning() {
    let (materials, log, _folder) = with_materials(["a", "lost"], "newmtl a\n");
    assert_eq!(materials[1], ModelMaterial { name: "lost".into(), ..ModelMaterial::default() });
    assert!(log.contains("its libraries have no material `lost`") && !log.contains("`a`"), "{log}");
}

#[test]
fn a_missing_library_is_a_warning() {
    let (_folder, path) = folder(square("mtllib lost.mtl\nf 1/1 2/2 3/3\n"), &[]);
    let (result, log) = logged(|| load_obj(&path));
    let model = result.unwrap();
    assert_eq!((&model.materials[..], &model.libraries[..]), (&[ModelMaterial::default()][..], &[][..]));
    assert!(
        log.contains("model.obj:9: material library") && log.contains("lost.mtl cannot be read"),
        "{log}"
    );
    assert!(log.contains("going on without its maps"), "{log}");
}

#[test]
fn the_monster_frog_loads() {
    let path = Path::new(concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../shared/data/monsterfrog/monsterfrog_mapped.obj"
    ));
    if !path.exists() {
        skip(path);
        return;
    }
    let ObjModel { mesh, materials, .. } = load_obj(path).unwrap();
    assert_eq!((mesh.triangles.len(), mesh.dropped), (2584, 0));
    assert_eq!(materials, [ModelMaterial::default()]);
    assert!(mesh.vertices.iter().all(|v| v.normal.is_normalized()));
}

#[expect(clippy::print_stderr, reason = "a skipped test says so")]
fn skip(path: &Path) {
    eprintln!("skipped: {} is not there", path.display());
}

/// Digits that floats do not have: of a square 0.25 m wide in UTM coordinates, and in degrees; and of texture
/// coordinates that count metres.
#[test]
fn positions_keep_the_digits_of_the_file() {
    for (x, y, side, u) in [(412_345.125, 5_123_456.75, 0.25, 412_345.0), (11.576_124, 48.137_154, 3e-6, 0.0)]
    {
        let corner = |i: f64, j: f64| {
            format!("v {:.9} {:.9} -7\nvt {} {}\n", x + i * side, y + j * side, u + i / 4.0, u + j / 4.0)
        };
        let corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(i, j)| corner(i, j)).concat();
        let mesh = load(corners + "f 1/1 2/2 3/3 4/4\n").unwrap();
        assert_eq!((mesh.triangles.len(), mesh.dropped, mesh.collapsed), (2, 0, 0));
        let at = |i: usize| mesh.space.world(mesh.vertices[i].position.as_dvec3());
        let apart = at(2) - at(0);
        // Nine digits behind the point, and a float's of what is no farther from the origin than 1.5 sides.
        assert!(
            (apart.truncate() - glam::DVec2::splat(side)).abs().max_element() < 1e-9 + side * 2e-7,
            "{apart}"
        );
        assert!(mesh.vertices.iter().all(|v| v.u.abs() <= 2.0 && v.v.abs() <= 2.0), "{:?}", mesh.vertices);
        assert_eq!(mesh.vertices[1].u - mesh.vertices[0].u, 0.25);
        assert_eq!((at(0).z, mesh.tiles.is_empty()), (-7.0, u == 0.0));
    }
}

/// The cube from 0 to 1 as six quads, its corners given once for each face, as exporters do that split them.
fn split_cube(faces: impl Fn(usize) -> String) -> String {
    let mut text = String::from("vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvn 0 0 1\n");
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    for (i, quad) in quads.into_iter().enumerate() {
        for corner in quad {
            text += &format!("v {} {} {}\n", corner & 1, corner >> 1 & 1, corner >> 2);
        }
        text += &format!("{}f -4/1/1 -3/2/1 -2/3/1 -1/4/1\n", faces(i));
    }
    text
}

/// The mesh with its positions about the world's origin.
fn load_subdivided(model: &str, subdivide: &str) -> Mesh {
    let (_folder, path) = folder(model, &[]);
    let mesh = load_subdivided_obj(&path, &subdivide.parse().unwrap()).unwrap().mesh;
    mesh.in_space(RenderSpace::default()).expect("it is near")
}

/// Far from the origin the same mesh stands there, and keeps its digits.
#[test]
fn models_are_subdivided_wherever_they_stand() {
    let subdivided = |far: u32| {
        let text = split_cube(|_| String::new()).replace("v 0 ", &format!("v {far} "));
        let (_folder, path) = folder(text.replace("v 1 ", &format!("v {} ", far + 1)), &[]);
        load_subdivided_obj(&path, &"2".parse().unwrap()).unwrap().mesh
    };
    // Moved by a multiple of the grid of its origin.
    let (near, far) = (subdivided(0), subdivided(1 << 30));
    assert_eq!((&near.vertices, &near.triangles), (&far.vertices, &far.triangles));
    assert_eq!(far.space.origin - near.space.origin, DVec3::X * f64::from(1_u32 << 30));
}

/// Corners that are split in the file are one, quads stay quads, and vn is not read: by hand Halstead's limit of a
/// corner is a quarter of the way to the middle.
#[test]
fn polygons_are_subdivided_before_they_are_cut() {
    let mesh = load_subdivided(&split_cube(|_| String::new()), "1");
    assert_eq!(mesh.triangles.len(), 48);
    let mut positions: Vec<_> =
        mesh.vertices.iter().map(|v| v.position.to_array().map(f32::to_bits)).collect();
    positions.sort_unstable();
    positions.dedup();
    assert_eq!(positions.len(), 26, "V + E + F");
    let corner = mesh.vertices.iter().find(|v| v.position == Vec3::splat(0.25)).expect("the corner's limit");
    assert!(corner.normal.abs_diff_eq(Vec3::splat(-1.0 / 3f32.sqrt()), 1e-6), "{corner:?}");
    // Cut first, the quads' triangles would give three quads each.
    let cut = load_subdivided(&split_cube(|_| String::new()), "1:loop");
    assert_eq!(cut.triangles.len(), 48);
    let limits = |mesh: &Mesh| {
        let is_limit = |p: &Vec3| p.to_array().into_iter().all(|x| x == 0.25 || x == 0.75);
        let at: std::collections::HashSet<_> = mesh
            .vertices
            .iter()
            .map(|v| v.position)
            .filter(is_limit)
            .map(|p| p.to_array().map(f32::to_bits))
            .collect();
        at.len()
    };
    assert_eq!(limits(&mesh), 8);
    assert!(limits(&cut) < 8, "Loop's corners have four to six neighbours");
}

/// Materials go on with their polygons; `s 1` and `s 2` part at a crease, and so do `s 1` and `s off`; what is off
/// everywhere is one group.
#[test]
fn materials_and_smoothing_groups_reach_the_subdivided_mesh() {
    let top = |name: &'static str| move |i: usize| if i == 1 { format!("{name}\n") } else { "s 1\n".into() };
    let corner_is = |mesh: &Mesh, p: Vec3| mesh.vertices.iter().any(|v| v.position.abs_diff_eq(p, 1e-6));
    // The top's border is the cubic spline of its corners: each (4 + neighbours) / 6 of the way.
    let on_crease = Vec3::new(1.0 / 6.0, 1.0 / 6.0, 1.0);
    for (name, is_crease) in
        [("s 2", true), ("s off", true), ("s 0", true), ("s 1", false), ("s 1 # too", false)]
    {
        let mesh = load_subdivided(&split_cube(top(name)), "1");
        assert_eq!(corner_is(&mesh, on_crease), is_crease, "{name}");
    }
    let off = load_subdivided(&split_cube(|_| "s off\n".into()), "1");
    assert!(corner_is(&off, Vec3::splat(0.25)));
    let painted = load_subdivided(&split_cube(|i| format!("usemtl m{}\n", i % 3)), "2");
    let of = |material| painted.triangles.iter().filter(|t| t.material() == material).count();
    assert_eq!([0, 1, 2].map(of), [64; 3]);
}
