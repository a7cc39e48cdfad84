//! One pass over the text of an OBJ file that finds what is wrong with it, line by line, and a second one that
//! reduces it to what a mesh needs.

use crate::scene::error::{Element, ObjProblem};
use std::borrow::Cow;
use std::fmt::Write;

/// What stands in an OBJ file.
#[derive(Debug, Default)]
pub(super) struct Survey {
    /// How many vertices, texture coordinates and normals there are, in the order of a corner's indices.
    counts: [usize; 3],
    /// How many faces there are.
    pub(super) faces: usize,
    /// How many of them have one or two corners.
    pub(super) thin_faces: usize,
    /// Names given by `mtllib`, each with its line.
    pub(super) libraries: Vec<(usize, String)>,
    /// Names of the materials that faces use, in order of first use; the empty name where a face names none.
    pub(super) materials: Vec<String>,
    /// Runs of triangles of one material, in their order: its index in `materials`, and how many there are.
    pub(super) runs: Vec<(u32, usize)>,
    /// Runs of polygons, which are faces of three corners and more, in their order.
    pub(super) polygons: Vec<PolygonRun>,
    /// What the faces to come use.
    material: String,
    /// The smoothing groups that `s` named, by their numbers in [`PolygonRun`] less one.
    groups: Vec<String>,
    /// The group of the faces to come; 0 where `s` named none, or turned them off.
    group: u32,
    /// The object or group that the faces belong to.
    object: Option<String>,
    /// Indices beyond the elements above their line, which may stand further below.
    forward: Vec<Reference>,
}

/// Polygons of one material and one smoothing group.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct PolygonRun {
    /// Its index in [`Survey::materials`].
    pub(super) material: u32,
    /// Their smoothing group; 0 for those that have none.
    pub(super) group: u32,
    /// How many they are.
    pub(super) count: usize,
}

/// An index of a face's corner.
#[derive(Debug)]
struct Reference {
    line: usize,
    element: Element,
    index: usize,
}

/// The attributes of a corner, in the order of its indices.
const ELEMENTS: [Element; 3] = [Element::Vertex, Element::TextureCoordinate, Element::Normal];

impl Survey {
    /// Surveys a text; the error is the first line with a problem, or the first index that is beyond the end.
    pub(super) fn of(text: &str) -> Result<Self, (usize, ObjProblem)> {
        let mut survey = Self::default();
        for (line, content) in logical_lines(text) {
            survey.add_line(line, &content).map_err(|problem| (line, problem))?;
        }
        survey.check_forward()?;
        Ok(survey)
    }

    /// Takes a line into account.
    fn add_line(&mut self, line: usize, content: &str) -> Result<(), ObjProblem> {
        let (keyword, rest) = split_keyword(content);
        match keyword {
            "v" => self.add_element(0, rest),
            "vt" => self.add_element(1, rest),
            "vn" => self.add_element(2, rest),
            "f" => self.add_face(line, rest),
            _ => {
                self.add_name(line, keyword, rest);
                Ok(())
            }
        }
    }

    /// Counts a vertex, texture coordinate or normal after checking its numbers.
    fn add_element(&mut self, attribute: usize, rest: &str) -> Result<(), ObjProblem> {
        let element = ELEMENTS[attribute];
        let needed = if element == Element::TextureCoordinate { 2 } else { 3 };
        let words: Vec<&str> = data(rest).split_whitespace().collect();
        let weighted = element == Element::Vertex && words.len() == 4;
        let used = if weighted { 4 } else { needed };
        let numbers: Option<Vec<f64>> = words.iter().take(used).map(|word| word.parse().ok()).collect();
        let Some(numbers) = numbers.filter(|numbers| numbers.len() == used) else {
            return Err(ObjProblem::Numbers { element, needed, found: data(rest).trim().into() });
        };
        let weight = if weighted { numbers[3] } else { 1.0 };
        if weight == 0.0 {
            return Err(ObjProblem::ZeroWeight);
        }
        // Doubles hold more, but what is computed of them is rounded to floats.
        #[expect(clippy::cast_possible_truncation, reason = "rounded, and checked")]
        if !numbers[..needed].iter().all(|x| ((x / weight) as f32).is_finite()) || weight.is_nan() {
            return Err(ObjProblem::NotFinite { element });
        }
        self.counts[attribute] += 1;
        Ok(())
    }

    /// Counts a face after checking its corners.
    fn add_face(&mut self, line: usize, rest: &str) -> Result<(), ObjProblem> {
        let mut corners = 0;
        for corner in data(rest).split_whitespace() {
            self.check_corner(line, corner)?;
            corners += 1;
        }
        match corners {
            0 => return Err(ObjProblem::NoCorners),
            1 | 2 => self.thin_faces += 1,
            _ => {
                self.add_triangles(corners - 2);
                self.add_polygon();
            }
        }
        self.faces += 1;
        Ok(())
    }

    /// Notes of which material the triangles of a polygon are.
    fn add_triangles(&mut self, count: usize) {
        let last = self.runs.last_mut().filter(|(i, _)| self.materials[*i as usize] == self.material);
        if let Some((_, triangles)) = last {
            *triangles += count;
            return;
        }
        let known = self.materials.iter().position(|name| *name == self.material);
        let material = known.unwrap_or_else(|| {
            self.materials.push(self.material.clone());
            self.materials.len() - 1
        });
        self.runs.push((u32::try_from(material).unwrap_or(u32::MAX), count));
    }

    /// Notes of which material and smoothing group a polygon is whose triangles were noted.
    fn add_polygon(&mut self) {
        let (material, group) = (self.runs.last().map_or(0, |(material, _)| *material), self.group);
        let last = self.polygons.last_mut();
        match last.filter(|run| (run.material, run.group) == (material, group)) {
            Some(run) => run.count += 1,
            None => self.polygons.push(PolygonRun { material, group, count: 1 }),
        }
    }

    /// Takes the smoothing group of the faces to come: `s 1`; `s off` or `s 0` for none.
    fn choose_group(&mut self, name: &str) {
        if matches!(name, "" | "off" | "0") {
            self.group = 0;
            return;
        }
        let known = self.groups.iter().position(|group| group == name);
        let number = known.unwrap_or_else(|| {
            self.groups.push(name.into());
            self.groups.len() - 1
        });
        self.group = u32::try_from(number + 1).unwrap_or(u32::MAX);
    }

    /// Checks where a corner's indices point.
    fn check_corner(&mut self, line: usize, corner: &str) -> Result<(), ObjProblem> {
        let indices = parse_corner(corner)?;
        for ((element, index), count) in ELEMENTS.into_iter().zip(indices).zip(self.counts) {
            match index {
                None if element == Element::TextureCoordinate => return Err(self.no_texture_coordinates()),
                None => {}
                Some(0) => return Err(ObjProblem::ZeroIndex { element }),
                Some(index) if index < 0 && index.unsigned_abs() > count => {
                    return Err(ObjProblem::BeforeStart { element, index, count });
                }
                Some(index) if index > 0 && index.unsigned_abs() > count => {
                    self.forward.push(Reference { line, element, index: index.unsigned_abs() });
                }
                Some(_) => {}
            }
        }
        Ok(())
    }

    /// The problem of a corner of the present object without texture coordinates.
    fn no_texture_coordinates(&self) -> ObjProblem {
        let object = self.object.as_ref().map_or("the model".into(), |name| format!("object `{name}`"));
        ObjProblem::NoTextureCoordinates { object }
    }

    /// Notes the names of objects, groups, materials and material libraries.
    fn add_name(&mut self, line: usize, keyword: &str, rest: &str) {
        let name = rest.trim();
        match keyword {
            _ if name.is_empty() => {}
            "o" | "g" => self.object = Some(name.into()),
            "mtllib" => self.libraries.push((line, name.into())),
            "usemtl" => self.material = name.into(),
            "s" => self.choose_group(data(rest).trim()),
            _ => {}
        }
    }

    /// Checks the indices that pointed below their line, now that all elements are counted.
    fn check_forward(&mut self) -> Result<(), (usize, ObjProblem)> {
        for Reference { line, element, index } in self.forward.drain(..) {
            let count = self.counts[element as usize];
            if index > count {
                return Err((line, ObjProblem::BeyondEnd { element, index, count }));
            }
        }
        Ok(())
    }

    /// The text with only its vertices, texture coordinates, normals and faces of three and more corners, in one
    /// object. Corners without a normal get a zero one, to be computed.
    pub(super) fn reduce(&self, text: &str) -> String {
        let mut reduced = String::with_capacity(text.len());
        let zero_normal = self.counts[2] + 1;
        for (_, content) in logical_lines(text) {
            let (keyword, rest) = split_keyword(&content);
            match keyword {
                "v" => push_vertex(&mut reduced, rest),
                "vt" | "vn" => push_words(&mut reduced, keyword, data(rest).split_whitespace()),
                "f" => push_face(&mut reduced, rest, zero_normal),
                _ => {}
            }
        }
        reduced.push_str("vn 0 0 0\n");
        reduced
    }
}

/// Appends a vertex without its colours, of which tobj wants all vertices to have some or none.
fn push_vertex(reduced: &mut String, rest: &str) {
    let words = data(rest).split_whitespace();
    let used = if words.clone().count() == 4 { 4 } else { 3 };
    push_words(reduced, "v", words.take(used));
}

/// Appends a face of three or more corners, each with all of its indices.
fn push_face(reduced: &mut String, rest: &str, zero_normal: usize) {
    let corners = data(rest).split_whitespace();
    if corners.clone().count() < 3 {
        return;
    }
    reduced.push('f');
    for corner in corners {
        let mut indices = corner.split('/');
        let [v, vt, vn] = [(); 3].map(|()| indices.next().unwrap_or(""));
        // Writing to a string cannot fail.
        let _ = if vn.is_empty() {
            write!(reduced, " {v}/{vt}/{zero_normal}")
        } else {
            write!(reduced, " {v}/{vt}/{vn}")
        };
    }
    reduced.push('\n');
}

/// Appends a line of words.
fn push_words<'a>(reduced: &mut String, keyword: &str, words: impl Iterator<Item = &'a str>) {
    reduced.push_str(keyword);
    for word in words {
        reduced.push(' ');
        reduced.push_str(word);
    }
    reduced.push('\n');
}

/// The indices of `vertex/texture/normal`, those left out as `None`.
fn parse_corner(corner: &str) -> Result<[Option<isize>; 3], ObjProblem> {
    let bad = || ObjProblem::Corner { corner: corner.into() };
    let mut indices = [None; 3];
    for (i, word) in corner.split('/').enumerate() {
        let slot = indices.get_mut(i).ok_or_else(bad)?;
        if !word.is_empty() {
            *slot = Some(word.parse().map_err(|_| bad())?);
        }
    }
    if indices[0].is_none() { Err(bad()) } else { Ok(indices) }
}

/// The first word of a line, and what follows it.
fn split_keyword(content: &str) -> (&str, &str) {
    let content = content.trim_start();
    content.split_once(char::is_whitespace).unwrap_or((content.trim_end(), ""))
}

/// A line of numbers without the comment at its end.
fn data(rest: &str) -> &str {
    rest.split('#').next().unwrap_or("")
}

/// The lines of a text, each with its number from 1. One that ends in a backslash goes on in the next; comments
/// do not, since some end with a path.
fn logical_lines(text: &str) -> impl Iterator<Item = (usize, Cow<'_, str>)> {
    let mut lines = text.lines().zip(1..);
    std::iter::from_fn(move || {
        let (content, number) = lines.next()?;
        let mut content = Cow::Borrowed(content);
        while let Some(head) = continued(&content) {
            let tail = lines.next().map_or("", |(tail, _)| tail);
            content = Cow::Owned(format!("{head} {tail}"));
        }
        Some((number, content))
    })
}

/// What stands before a backslash at the end of a line that is no comment.
fn continued(content: &str) -> Option<&str> {
    content.trim_end().strip_suffix('\\').filter(|head| !head.trim_start().starts_with('#'))
}
