#![expect(clippy::cast_possible_truncation, reason = "whole numbers of a few digits")]

use super::cage::CageBuilder;
use super::*;
use glam::{DVec2, dvec2, dvec3};
use std::collections::{HashMap, HashSet};

/// Polygons of corners by number, with the texture coordinates that `uv` gives a polygon's corner.
fn cage_of(points: &[DVec3], polygons: &[Vec<usize>], uv: impl Fn(usize, usize) -> DVec2) -> Cage {
    let mut builder = CageBuilder::default();
    for (f, polygon) in polygons.iter().enumerate() {
        builder.polygon(polygon.iter().map(|&v| (points[v], uv(f, v))), 0, 0);
    }
    builder.finish()
}

/// Where a control point is after subdivision: the vertices of a level come first on the next one.
fn moved(control: &Cage, finer: &Cage, point: DVec3) -> DVec3 {
    finer.positions[number(control, point)]
}

/// The number of a control point.
fn number(control: &Cage, point: DVec3) -> usize {
    control.positions.iter().position(|p| *p == point).expect("a control point")
}

fn flat_uv(_: usize, _: usize) -> DVec2 {
    DVec2::ZERO
}

/// The cube from -1 to 1, corner number x + 2 y + 4 z.
fn cube() -> (Vec<DVec3>, Vec<Vec<usize>>) {
    let side = |i: usize, bit: usize| if i & bit == 0 { -1.0 } else { 1.0 };
    let points = (0..8).map(|i| dvec3(side(i, 1), side(i, 2), side(i, 4))).collect();
    let polygons =
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]].map(Vec::from);
    (points, polygons.into())
}

/// A sheet of `n` by `n` quads over [0, n]², as high as `z` says; vertex number x + (n + 1) y.
fn sheet(n: usize, z: impl Fn(f64, f64) -> f64) -> (Vec<DVec3>, Vec<Vec<usize>>) {
    let at = |x, y| x + (n + 1) * y;
    let places = (0..=n).flat_map(|y| (0..=n).map(move |x| (f64::from(x as u32), f64::from(y as u32))));
    let points = places.map(|(x, y)| dvec3(x, y, z(x, y))).collect();
    let quads = (0..n).flat_map(|y| (0..n).map(move |x| (x, y)));
    let polygons = quads.map(|(x, y)| vec![at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)]).collect();
    (points, polygons)
}

/// Half of a disc that is no plane, of `k` triangles around the middle of its straight border.
fn half_disc(k: usize) -> (Vec<DVec3>, Vec<Vec<usize>>) {
    let at = |r: f64, i: f64| {
        let (y, x) = (i / k as f64 * std::f64::consts::PI).sin_cos();
        dvec3(r * x, r * y + 0.1 * x, 0.1 * (3.0 * i + r).sin() * r)
    };
    let mut points = vec![DVec3::ZERO];
    points.extend((0..=k).map(|i| at(1.0, i as f64)));
    let polygons = (0..k).map(|i| vec![0, 1 + i, 2 + i]).collect();
    (points, polygons)
}

fn by(text: &str) -> Subdivide {
    text.parse().expect("a subdivision")
}

/// How many faces each edge has, by its ends.
fn edges(cage: &Cage) -> HashMap<[u32; 2], usize> {
    let mut edges = HashMap::new();
    for face in &cage.faces {
        for c in face.corners() {
            let mut ends = [cage.corners[c].vertex, cage.corners[face.next(c)].vertex];
            ends.sort_unstable();
            *edges.entry(ends).or_default() += 1;
        }
    }
    edges
}

#[test]
fn words_are_what_they_print() {
    for text in ["0", "2", "3:loop", "1:crease=30", "2:loop,crease=0.5,edges", "12:edges"] {
        assert_eq!(by(text).to_string(), text);
    }
    assert_eq!(by("2:catmull-clark,corners"), by("2"));
    for text in ["", "-1", "13", "2:", "2:lop", "2:crease=", "2:crease=181", "2:crease=NaN", "loop", "2,loop"]
    {
        let message = text.parse::<Subdivide>().expect_err(text).to_string();
        assert!(message.contains(&format!("`{text}`")) && message.contains("2:loop"), "{message}");
    }
}

/// V, E, F become V + E + F vertices and a quad for each corner; of Loop V + E and four triangles for each. Closed
/// meshes stay closed, the number of triangles is what was told before, and the same input gives the same bits.
#[test]
fn counts_are_eulers_and_closed_meshes_stay_closed() {
    let (points, polygons) = cube();
    let cage = || cage_of(&points, &polygons, flat_uv);
    for (text, expected) in [
        ("1", (26, 48, 24)),
        ("2", (98, 192, 96)),
        ("1:loop", (26, 72, 48)),
        ("2:loop", (98, 288, 192)),
        ("2:crease=30", (98, 192, 96)),
    ] {
        let (finer, normals) = by(text).limit(cage());
        let edges = edges(&finer);
        assert_eq!((finer.positions.len(), edges.len(), finer.faces.len()), expected, "{text}");
        assert!(edges.values().all(|&faces| faces == 2), "{text}");
        assert_eq!(by(text).triangles(&cage(), by(text).levels), finer.fan_triangles(), "{text}");
        let again = by(text).limit(cage());
        assert_eq!((finer.positions, finer.corners, normals), (again.0.positions, again.0.corners, again.1));
    }
}

/// By hand: of a cube's corner (1, 1, 1) the three neighbours sum up to (1, 1, 1) and the three corners across faces to
/// (-1, -1, -1), so that Halstead's limit is (9 + 4 - 1) / 24; a tetrahedron's three neighbours sum up to -v, and
/// Loop's limit is v (1 - 3 / 5) - v / 5. Of level after level it is the same, which the masks of no other rule give.
#[test]
fn limits_of_extraordinary_vertices_are_those_by_hand() {
    let (points, polygons) = cube();
    let tetrahedron =
        [dvec3(1.0, 1.0, 1.0), dvec3(1.0, -1.0, -1.0), dvec3(-1.0, 1.0, -1.0), dvec3(-1.0, -1.0, 1.0)];
    let sides = [[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]].map(Vec::from);
    for levels in 1..=4 {
        for (points, polygons, scheme, share) in
            [(&points[..], &polygons[..], "", 0.5), (&tetrahedron[..], &sides[..], ":loop", 0.2)]
        {
            let control = cage_of(points, polygons, flat_uv);
            let (finer, normals) = by(&format!("{levels}{scheme}")).limit(control.clone());
            for before in points {
                let after = moved(&control, &finer, *before);
                // Some twenty roundings of f64 a level.
                assert!(after.distance(*before * share) < 1e-14, "{levels}{scheme}: {after}");
            }
            for (corner, normal) in finer.corners.iter().zip(&normals) {
                if let Some(v) = control.positions.get(corner.vertex as usize) {
                    assert!(normal.distance(v.normalize()) < 1e-14, "{levels}{scheme}: {normal}");
                }
            }
        }
    }
}

/// A grid that closes in both directions is a bicubic B-spline of its control points: the limit is known everywhere.
#[test]
fn regular_meshes_are_b_splines() {
    const N: usize = 6;
    let control = |i: usize, j: usize| {
        let (a, b) = [i, j].map(|i| (i % N) as f64 / N as f64 * std::f64::consts::TAU).into();
        let r = 2.0 + (b + 0.3).cos() * 0.7 + 0.1 * a.sin();
        dvec3(r * a.cos(), r * a.sin(), b.sin() * (1.0 + 0.2 * (2.0 * a).cos()))
    };
    let points: Vec<_> = (0..N * N).map(|v| control(v % N, v / N)).collect();
    let at = |i: usize, j: usize| i % N + N * (j % N);
    let polygons: Vec<_> = (0..N * N)
        .map(|v| (v % N, v / N))
        .map(|(i, j)| vec![at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)])
        .collect();
    // Value and derivative at a share of a span, of four control points.
    let basis = |t: f64| {
        let s = 1.0 - t;
        let b =
            [s * s * s, 3.0 * t * t * t - 6.0 * t * t + 4.0, 3.0 * s * s * s - 6.0 * s * s + 4.0, t * t * t];
        let d = [-3.0 * s * s, 9.0 * t * t - 12.0 * t, -9.0 * s * s + 12.0 * s, 3.0 * t * t];
        (b.map(|x| x / 6.0), d.map(|x| x / 6.0))
    };
    for levels in 1..=3_u32 {
        let parts = 1 << levels;
        let (finer, normals) = by(&levels.to_string()).limit(cage_of(&points, &polygons, flat_uv));
        // Vertex (0, 0) of the last level is control point (0, 0); walk the surface from there by its places.
        let mut known = 0;
        for i in 0..N * parts {
            for j in 0..N * parts {
                let [(bi, di), (bj, dj)] = [i, j].map(|i| basis((i % parts) as f64 / parts as f64));
                let (mut p, mut du, mut dv) = (DVec3::ZERO, DVec3::ZERO, DVec3::ZERO);
                for (k, l) in (0..4).flat_map(|k| (0..4).map(move |l| (k, l))) {
                    let c = control(i / parts + N + k - 1, j / parts + N + l - 1);
                    p += c * bi[k] * bj[l];
                    du += c * di[k] * bj[l];
                    dv += c * bi[k] * dj[l];
                }
                let n = du.cross(dv).normalize();
                let near = finer.corners.iter().zip(&normals);
                for (_, normal) in
                    near.filter(|(c, _)| finer.positions[c.vertex as usize].distance(p) < 1e-13)
                {
                    assert!(normal.distance(n) < 1e-12, "{levels}: {normal} at ({i}, {j}), not {n}");
                    known += 1;
                }
            }
        }
        assert_eq!(known, finer.corners.len(), "each corner is a point of the spline");
    }
}

/// Borders are cubic B-splines of their own control points, corners stay or not, and the inside of a sheet whose
/// control points are an affine map of the plane is that map.
#[test]
fn borders_are_cubic_splines() {
    let wave = |x: f64, y: f64| if x == 2.0 { y * (4.0 - y) } else { 0.0 };
    let (points, polygons) = sheet(4, wave);
    for levels in [1, 3] {
        let control = cage_of(&points, &polygons, flat_uv);
        let (finer, _) = by(&levels.to_string()).limit(control.clone());
        let moved = |finer: &Cage, v: usize| moved(&control, finer, points[v]);
        // Along y = 0: control points 0 to 4 of x. All z are 0 there.
        for x in 1..4 {
            let expected = (points[x - 1] + points[x] * 4.0 + points[x + 1]) / 6.0;
            let after = moved(&finer, x);
            assert!(after.distance(expected) < 1e-14, "{after} {expected}");
        }
        assert_eq!([0, 4, 20, 24].map(|v| moved(&finer, v)), [0, 4, 20, 24].map(|v| points[v]));
        let (round, _) = by(&format!("{levels}:edges")).limit(cage_of(&points, &polygons, flat_uv));
        let expected = (points[0] * 4.0 + points[1] + points[5]) / 6.0;
        let after = moved(&round, 0);
        assert!(after.distance(expected) < 1e-14, "{after} {expected}");
    }
}

/// A cube all of whose edges are creases stays a cube, its sides' normals apart; less sharp edges than asked for are
/// none.
#[test]
fn creases_keep_a_cube() {
    let (points, polygons) = cube();
    for scheme in ["", "loop,"] {
        let (finer, normals) =
            by(&format!("2:{scheme}crease=89")).limit(cage_of(&points, &polygons, flat_uv));
        let mut sides = HashSet::new();
        for (face, corners) in finer.faces.iter().map(|face| (face, face.corners())) {
            let ring: Vec<DVec3> =
                corners.clone().map(|c| finer.positions[finer.corners[c].vertex as usize]).collect();
            let n = (ring[1] - ring[0]).cross(ring[2] - ring[0]).normalize();
            assert!(ring.iter().all(|p| (p.dot(n) - 1.0).abs() < 1e-14), "{face:?}: {ring:?}");
            for c in corners {
                assert!(normals[c].distance(n) < 1e-12, "{} not {n}", normals[c]);
            }
            sides.insert(n.round().to_array().map(|x| x as i8));
        }
        assert_eq!(sides.len(), 6);
        let mut control = cage_of(&points, &polygons, flat_uv);
        control.mark_creases(Some(89.0));
        let of_fans = control.cut_into_fans();
        assert_eq!([&control, &of_fans].map(|c| c.corners.iter().filter(|c| c.crease).count()), [24, 24]);
        let smooth = by(&format!("2:{scheme}crease=91")).limit(cage_of(&points, &polygons, flat_uv)).0;
        assert!(smooth.positions.iter().all(|p| p.length() < 1.3), "rounded");
    }
}

/// The edges between smoothing groups are creases: a cube's top that is a group of its own keeps a round border, which
/// is the cubic spline of its four corners.
#[test]
fn smoothing_groups_part_at_creases() {
    let (points, polygons) = cube();
    let mut builder = CageBuilder::default();
    for (f, polygon) in polygons.iter().enumerate() {
        builder.polygon(polygon.iter().map(|&v| (points[v], DVec2::ZERO)), 0, u32::from(f == 1));
    }
    let control = builder.finish();
    let (finer, normals) = by("2").limit(control.clone());
    let corner = number(&control, DVec3::ONE);
    // Corner (1, 1, 1): its neighbours on the top are (-1, 1, 1) and (1, -1, 1).
    let after = finer.positions[corner];
    assert!(after.distance(dvec3(2.0 / 3.0, 2.0 / 3.0, 1.0)) < 1e-14, "{after}");
    let there = finer.corners.iter().zip(&normals).filter(|(c, _)| c.vertex as usize == corner);
    let different: Vec<&DVec3> = there.map(|(_, normal)| normal).collect();
    let up = different.iter().filter(|n| n.distance(DVec3::Z) < 1e-12).count();
    assert_eq!((up, different.len()), (1, 3), "{different:?}");
}

/// Texture coordinates that are an affine map of the positions stay that inside, since both follow the same rule; along
/// seams and borders they are linear, on each side its own.
#[test]
fn texture_coordinates_move_inside_and_stay_at_seams() {
    let (points, polygons) = sheet(4, |x, y| 0.3 * x * x - 0.2 * x * y);
    let of = |p: DVec3| dvec2(p.x * 0.25 + 0.1, p.y * 0.5 - p.x);
    // Quads beyond x = 2 have a chart of their own.
    let offset = |f: usize| if f % 4 >= 2 { dvec2(10.0, 0.0) } else { DVec2::ZERO };
    let cage = || cage_of(&points, &polygons, |f, v| of(points[v]) + offset(f));
    for scheme in ["", ":loop"] {
        let (finer, _) = by(&format!("2{scheme}")).limit(cage());
        let (mut inner, mut seam) = (0, HashSet::new());
        for face in &finer.faces {
            for c in face.corners() {
                let corner = finer.corners[c];
                let (uv, p) =
                    (finer.uvs[corner.uv as usize].truncate(), finer.positions[corner.vertex as usize]);
                let (chart, uv) = if uv.x > 5.0 { (1, uv - dvec2(10.0, 0.0)) } else { (0, uv) };
                let is_seam = (p.x - 2.0).abs() < 1e-12;
                let is_border = [p.x, p.y].iter().any(|x| !(1e-12..=4.0 - 1e-12).contains(x));
                if is_seam && !is_border {
                    // Control points are a whole number apart, which are quarters at the second level.
                    let y = (uv.y + 2.0) * 2.0;
                    assert!(
                        (uv.x - 0.6).abs() < 1e-14 && ((y * 4.0).round() - y * 4.0).abs() < 1e-12,
                        "{uv}"
                    );
                    seam.insert((chart, (y * 4.0).round() as i32));
                } else if !is_border && p.x > 1.0 && p.x < 3.0 {
                    inner += 1;
                    // A ring of faces beside the seam reads from it.
                    let off = uv.distance(of(p));
                    assert!((p.x - 2.0).abs() < 0.6 || off < 1e-13, "{off} at {p}");
                }
            }
        }
        assert!(inner > 50, "{inner}");
        assert_eq!(seam.len(), 2 * 15, "each side's own, of 17 but for the ends");
    }
}

/// What many levels' faces say is what the normals say: the angle between them goes down as the third eigenvalue is to
/// the second (a half at regular vertices, 0.452 / 0.5 where five triangles meet on a border), at inner vertices, on
/// borders, on creases and in corners, of both schemes. Each level says the same normals, since masks are left
/// eigenvectors of the rules.
#[test]
fn normals_are_those_that_faces_approach() {
    let bump = |x: f64, y: f64| ((x * 1.3).sin() + (y * 0.9).cos()) * 0.4;
    let (mut points, polygons) = sheet(3, bump);
    // A pentagon's fan beside it would be no sheet: instead a fold makes a crease along x = 2.
    points.iter_mut().filter(|p| p.x > 2.5).for_each(|p| p.z += 2.0);
    let (cube_points, cube_polygons) = cube();
    // Vertices on a border with two faces to five. Of one, as of a corner that becomes round, faces approach no plane:
    // they are as much bent as they are small.
    let halves: Vec<_> = (2..=5).map(half_disc).collect();
    let halves = halves.iter().map(|(points, polygons)| (points, polygons, ""));
    let meshes = [
        (&points, &polygons, ""),
        (&points, &polygons, ",edges"),
        (&points, &polygons, ",crease=40"),
        (&cube_points, &cube_polygons, ""),
    ];
    for (points, polygons, words) in meshes.into_iter().chain(halves) {
        for scheme in ["catmull-clark", "loop"] {
            // Beyond three faces on a border Catmull-Clark's rules have a second eigenvalue not below that of the
            // border, and beyond five Loop's: there is no tangent plane then.
            if scheme == "catmull-clark" && polygons.iter().filter(|polygon| polygon.contains(&0)).count() > 3
            {
                continue;
            }
            let mut before: Vec<f64> = vec![];
            let mut first: Vec<Vec<DVec3>> = vec![];
            for levels in 1..=5 {
                let (finer, normals) =
                    by(&format!("{levels}:{scheme}{words}")).limit(cage_of(points, polygons, flat_uv));
                // At the control points' own vertices, by corner.
                let mut errors = vec![0.0_f64; points.len()];
                for face in &finer.faces {
                    for c in face.corners() {
                        let corner = |c: usize| finer.positions[finer.corners[c].vertex as usize];
                        let (here, next, last) = (corner(c), corner(face.next(c)), corner(face.previous(c)));
                        let of_face = (next - here).cross(last - here).normalize();
                        if let Some(error) = errors.get_mut(finer.corners[c].vertex as usize) {
                            *error = error.max(of_face.distance(normals[c]));
                        }
                    }
                }
                let mut sectors: Vec<Vec<DVec3>> = vec![vec![]; points.len()];
                for (corner, normal) in finer.corners.iter().zip(&normals) {
                    if let Some(sectors) = sectors.get_mut(corner.vertex as usize)
                        && sectors.iter().all(|known| known.distance(*normal) > 1e-9)
                    {
                        sectors.push(*normal);
                    }
                }
                for (now, first) in sectors.iter().zip(&first) {
                    let is_known = |n: &DVec3| first.iter().any(|known| known.distance(*n) < 1e-9);
                    assert!(now.iter().all(is_known), "{scheme}{words} {levels}: {now:?} {first:?}");
                }
                if levels == 1 {
                    first = sectors;
                }
                for (now, before) in errors.iter().zip(&before) {
                    assert!(
                        levels < 4 || *now < 0.92 * before || *now < 1e-9,
                        "{scheme}{words} {levels}: {now} {before}"
                    );
                }
                before = errors;
            }
            assert!(before.iter().all(|&error| error < 0.15), "{scheme}{words}: {before:?}");
        }
    }
}

/// Corners that repeat a position are no corners; polygons that come back to one are left out and counted.
#[test]
fn polygons_of_coinciding_corners_shrink_or_go() {
    let mut builder = CageBuilder::default();
    let mut add = |xs: &[(f64, f64)]| {
        builder.polygon(xs.iter().map(|&(x, y)| (dvec3(x, y, 0.0), dvec2(x, y))), 0, 0);
    };
    add(&[(0.0, 0.0), (1.0, 0.0), (1.0, 0.0), (0.0, 1.0)]);
    add(&[(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (-0.0, 0.0)]);
    add(&[(0.0, 0.0), (1.0, 0.0), (0.0, 0.0), (0.0, 1.0)]);
    add(&[(0.0, 0.0), (0.0, 0.0), (1.0, 0.0)]);
    let cage = builder.finish();
    assert_eq!(cage.faces.iter().map(|face| face.count).collect::<Vec<_>>(), [3, 3]);
    assert_eq!((cage.dropped, cage.positions.len()), (3, 3));
}

/// Sheets that meet along edges of three faces share their curve, the cubic spline of its control points.
#[test]
fn edges_of_three_faces_hold_together() {
    let rib = |y: f64| [(0.0, 0.0), (1.0, 0.0), (-1.0, 0.5), (-0.5, -1.0)].map(|(x, z)| dvec3(x, y, z));
    let points: Vec<DVec3> = [0.0, 1.0, 3.0].into_iter().flat_map(rib).collect();
    let sheets = (0..2).flat_map(|rib| (1..4).map(move |sheet| (4 * rib, sheet)));
    let polygons: Vec<_> =
        sheets.map(|(rib, sheet)| vec![rib, rib + sheet, rib + 4 + sheet, rib + 4]).collect();
    for scheme in ["", ":loop"] {
        let control = cage_of(&points, &polygons, flat_uv);
        let (finer, _) = by(&format!("2{scheme}")).limit(control.clone());
        let shared: Vec<_> = edges(&finer).into_iter().filter(|&(_, faces)| faces == 3).collect();
        assert_eq!(shared.len(), 8, "two edges in four parts each");
        let on_curve = |v: u32| finer.positions[v as usize].reject_from(DVec3::Y).length() < 1e-14;
        assert!(shared.iter().flat_map(|(ends, _)| ends).all(|&v| on_curve(v)));
        let after = moved(&control, &finer, points[4]);
        assert!(after.distance((points[0] + points[4] * 4.0 + points[8]) / 6.0) < 1e-14, "{after}");
    }
}
