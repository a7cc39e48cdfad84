//! What the user is told of each argument.

use crate::scene::assembly::{MapSource, MaterialSource};
use std::fmt;

/// An argument's value and where it comes from.
pub(in crate::cli) struct Choice {
    pub(super) name: &'static str,
    pub(super) value: String,
    pub(super) origin: &'static str,
}

impl fmt::Display for Choice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:<7}{}  ({})", self.name, self.value, self.origin)
    }
}

// Where a value comes from.

pub(super) const GIVEN: &str = "given";
pub(super) const BUILTIN: &str = "built-in";
pub(super) const MATERIAL: &str = "from the materials";
/// The geometry carries the relief, so a normal map has nothing to add to the shading; but where materials have no
/// other picture of the surface, it shows which part is which, as the program did that Emboss follows.
pub(super) const NORMAL_MAP: &str = "from the materials: their normal map, for want of a map_Kd";
pub(super) const SCENE_FILE: &str = "from the scene file";
pub(super) const DEFAULT: &str = "default";
const SEVERAL: &str = "several origins";

impl Choice {
    /// What all materials have; where they differ each value once.
    pub(super) fn of_all(name: &'static str, values: impl Iterator<Item = (String, &'static str)>) -> Choice {
        let (mut shown, mut origins) = (Vec::new(), Vec::new());
        for (value, origin) in values {
            if !shown.contains(&value) {
                shown.push(value);
            }
            if !origins.contains(&origin) {
                origins.push(origin);
            }
        }
        let more = shown.len().saturating_sub(MOST_SHOWN);
        shown.truncate(MOST_SHOWN);
        let mut value = shown.join(", ");
        if more > 0 {
            value = format!("{value} and {more} more");
        }
        Choice { name, value, origin: if let [origin] = origins[..] { origin } else { SEVERAL } }
    }
}

/// How many different values of materials are named.
const MOST_SHOWN: usize = 4;

pub(super) fn map_name<T>(map: Option<&MapSource<T>>) -> String {
    map.map_or_else(|| "none".to_owned(), MapSource::name)
}

pub(super) fn normal_name(source: &MaterialSource) -> String {
    source
        .normal
        .as_ref()
        .map_or("made from the height map".to_owned(), |normal| normal.path.display().to_string())
}

pub(super) fn color_name(source: &MaterialSource) -> String {
    match (&source.color, source.albedo) {
        (None, Some(albedo)) => {
            let [r, g, b] = albedo.to_array().map(|part| (1000.0 * part).round() / 1000.0);
            format!("{r},{g},{b}")
        }
        (map, _) => map_name(map.as_ref()),
    }
}
