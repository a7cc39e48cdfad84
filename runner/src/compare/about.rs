//! What is to be said of each method, for `docs/METHODS.md`.

/// A method in words.
#[derive(Clone, Copy, Debug)]
pub struct About {
    /// The command line's name.
    pub name: &'static str,
    /// The idea in a sentence.
    pub idea: &'static str,
    /// Who published it.
    pub paper: &'static str,
    /// What a ray costs, and what has to be in memory.
    pub cost: &'static str,
    /// When to choose it.
    pub choose: &'static str,
}

/// All methods, from the least that is done to the most.
pub const ABOUT: [About; 16] = [
    About {
        name: "none",
        idea: "The base triangles as they are.",
        paper: "none",
        cost: "a ray through the BVH over the base triangles",
        choose: "from so far away that the relief is below a pixel",
    },
    About {
        name: "bump",
        idea: "The base triangles, lit by the normals of the relief, which are worked out from the height map.",
        paper: "Blinn: *Simulation of Wrinkled Surfaces*, SIGGRAPH 1978",
        cost: "as `none`, and a few texels for each hit",
        choose: "for relief that is only a little rough, seen from the front",
    },
    About {
        name: "bump-offset",
        idea: "The same, from a map of offsets instead of heights.",
        paper: "Blinn 1978",
        cost: "as `bump`; a second map in memory",
        choose: "where an offset map is what there is",
    },
    About {
        name: "normal-map",
        idea: "The base triangles, lit by normals that a map holds.",
        paper: "Cohen, Olano, Manocha: *Appearance-Preserving Simplification*, SIGGRAPH 1998",
        cost: "as `none`, and a few texels for each hit; a map of normals in memory",
        choose: "where a normal map is what there is",
    },
    About {
        name: "parallax",
        idea: "Texture coordinates are moved along the view by the height that is read at the base.",
        paper: "Kaneko and others: *Detailed Shape Representation with Parallax Mapping*, ICAT 2001",
        cost: "as `bump`, and one more texel",
        choose: "for low and smooth relief, seen from the front",
    },
    About {
        name: "parallax-limited",
        idea: "The same, moved no farther than the height, so that grazing views do not swim.",
        paper: "Welsh: *Parallax Mapping with Offset Limiting*, 2004",
        cost: "as `parallax`",
        choose: "in place of `parallax` where views graze",
    },
    About {
        name: "steep",
        idea: "The ray is followed through layers of the height field until it is below the relief.",
        paper: "McGuire, McGuire: *Steep Parallax Mapping*, I3D 2005",
        cost: "up to N texels for each hit of the base",
        choose: "seldom: `occlusion` costs as much and shows fewer steps",
    },
    About {
        name: "relief",
        idea: "As `steep`, and then a binary search in the layer that was found.",
        paper: "Policarpo, Oliveira, Comba: *Real-Time Relief Mapping on Arbitrary Polygonal Surfaces*, I3D 2005",
        cost: "up to N texels and a few more for each hit of the base",
        choose: "for deep relief of broad features within outlines that may stay flat",
    },
    About {
        name: "occlusion",
        idea: "As `steep`, and then the point where straight lines between the last two layers meet; soft shadows.",
        paper: "Tatarchuk: *Dynamic Parallax Occlusion Mapping with Approximate Soft Shadows*, I3D 2006",
        cost: "up to N texels for each hit of the base",
        choose: "as `relief`, with fewer texels",
    },
    About {
        name: "pyramid",
        idea: "The ray goes down a pyramid of greatest heights and skips what it cannot meet.",
        paper: "Oh, Ki, Lee: *Pyramidal Displacement Mapping*, VRST 2006",
        cost: "some texels for each level of the pyramid",
        choose: "for thin features that layers would miss",
    },
    About {
        name: "sphere",
        idea: "The ray steps by the distance to the relief, which a map in three dimensions holds.",
        paper: "Donnelly: *Per-Pixel Displacement Mapping with Distance Functions*, GPU Gems 2, 2005",
        cost: "a few steps for each hit of the base; a map in three dimensions, computed once and kept in a file",
        choose: "for relief that does not change and is seen often",
    },
    About {
        name: "inverse",
        idea: "The ray is followed in texture space, where it is a curve, through the prism over each triangle.",
        paper: "Patterson, Hoggar, Logie: *Inverse Displacement Mapping*, Computer Graphics Forum 10(2), 1991",
        cost: "up to N texels for each prism",
        choose: "for outlines without micro-triangles",
    },
    About {
        name: "tessellate",
        idea: "The micro-triangles are stored, in a BVH of their own.",
        paper: "Cook: *Shade Trees*, SIGGRAPH 1984, as ray tracers do it",
        cost: "a ray through the BVH over N² times as many triangles; memory and time to prepare grow likewise",
        choose: "where memory does not matter and nothing is edited",
    },
    About {
        name: "grid-walk",
        idea: "The ray walks from micro-triangle to micro-triangle of each prism that it enters.",
        paper: "Smits, Shirley, Stark: *Direct Ray Tracing of Displacement Mapped Triangles*, Rendering Techniques \
            2000",
        cost: "up to 6 N micro-triangles for each prism; nothing stored",
        choose: "for speed where a few wrong pixels do not matter",
    },
    About {
        name: "quadtree",
        idea: "Each prism's triangle is quartered again and again, nearest parts first, where bounds on its heights \
            let the ray in.",
        paper: "this program's; bounds as in Smits and others 2000, and a min/max pyramid of the map",
        cost: "some log N bounds for each prism; the pyramid, a third of the map, in memory",
        choose: "whenever the picture has to be right: it is exact",
    },
    About {
        name: "brute-force",
        idea: "Every micro-triangle of each prism that the ray enters is tested.",
        paper: "none",
        cost: "N² micro-triangles for each prism",
        choose: "to check the others",
    },
];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Method;
    use clap::ValueEnum;

    #[test]
    fn every_method_is_described() {
        for method in Method::value_variants() {
            let value = method.to_possible_value().expect("named");
            assert!(ABOUT.iter().any(|about| about.name == value.get_name()), "{}", value.get_name());
        }
    }
}
