//! Whether what a backend reports can be what f32 arithmetic makes of the exact answer.

use super::tessellation::mixed;
use super::{Answer, Cell, DVec2, DVec3, MISS, Meeting, Oracle, Ray, Rounding, UNIT_ROUNDOFF, edge_distance};
use emboss_kernels::interface::Intersection;

/// How much room rounding left.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Clarity {
    /// Only one result was possible.
    Clear,
    /// The ray passes so near to an edge, an outline or its own end that others would have been as right.
    Close,
}

/// Why a reported intersection is wrong.
#[derive(Clone, Debug, PartialEq)]
pub enum Disagreement {
    /// A miss, though the ray cannot help hitting within these distances.
    Missed {
        /// Least and greatest distance of the hit, in model units.
        between: (f64, f64),
    },
    /// A hit behind one that the ray cannot help.
    NotNearest {
        /// The reported distance, in model units.
        t: f64,
        /// The greatest distance of the hit before it.
        before: f64,
    },
    /// A hit on a micro-triangle that the ray passes by.
    PassedBy,
    /// A hit on the right micro-triangle at a distance that rounding does not explain.
    Distance {
        /// The reported distance, in model units.
        t: f64,
        /// The least and the greatest possible one.
        between: (f64, f64),
    },
    /// A hit behind the origin or beyond the end of the ray.
    OutOfRange {
        /// The reported distance, in model units.
        t: f64,
    },
    /// The reported point is farther from the surface than its error says.
    Point {
        /// By how much, in model units.
        off: f64,
        /// The bound.
        bound: f64,
    },
    /// The reported point is farther from the ray than rounding explains.
    OffTheRay {
        /// By how much, in model units.
        off: f64,
        /// The bound.
        bound: f64,
    },
    /// The reported normal is not that of the micro-triangle.
    Normal {
        /// Length of the difference.
        off: f64,
        /// The bound.
        bound: f64,
    },
    /// The reported texture coordinates are not those of the point.
    TextureCoordinates {
        /// The greater difference.
        off: f64,
        /// The bound.
        bound: f64,
    },
}

impl Answer {
    /// Whether `reported` is an answer that rounding allows, and whether it allowed any other.
    ///
    /// # Errors
    /// Where it is none.
    pub fn judge(&self, reported: &Intersection) -> Result<Clarity, Disagreement> {
        let certain = self.nearest_certain();
        if reported.primitive == MISS {
            return match certain {
                Some(between) => Err(Disagreement::Missed { between }),
                None => Ok(if self.possible().next().is_none() { Clarity::Clear } else { Clarity::Close }),
            };
        }
        let t = f64::from(reported.t) * self.direction_length;
        let is_it = |m: &&Meeting| (m.base, m.cell) == (reported.primitive, reported.cell);
        let met = self.meetings.iter().find(is_it).ok_or(Disagreement::PassedBy)?;
        let between = (met.t_low, met.t_high);
        if !(met.t_low..=met.t_high).contains(&t) {
            return Err(Disagreement::Distance { t, between });
        }
        if !(0.0..=self.t_max * (1.0 + 4.0 * UNIT_ROUNDOFF)).contains(&t) {
            return Err(Disagreement::OutOfRange { t });
        }
        match certain {
            Some((_, before)) if t > before => Err(Disagreement::NotNearest { t, before }),
            Some((_, before)) if self.possible().filter(|m| m.t_low <= before).count() == 1 => {
                Ok(Clarity::Clear)
            }
            _ => Ok(Clarity::Close),
        }
    }

    /// Whether f32 arithmetic cannot miss the surface, whatever it hits of it.
    pub fn must_hit(&self) -> bool {
        self.nearest_certain().is_some()
    }

    /// Meetings that f32 arithmetic may report.
    fn possible(&self) -> impl Iterator<Item = &Meeting> {
        self.meetings.iter().filter(|m| m.t_low <= m.t_high && m.t_high >= 0.0 && m.t_low <= self.t_max)
    }

    /// Least and greatest distance of the nearest hit that f32 arithmetic cannot miss.
    fn nearest_certain(&self) -> Option<(f64, f64)> {
        let within = |&(low, high): &(f64, f64)| low > 0.0 && high < self.t_max;
        let certain = (0..self.meetings.len()).filter_map(|m| self.certain(m)).filter(within);
        certain.min_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// Where meeting `first` and those joined to it across edges near the ray close the way for certain: least and
    /// greatest distance among them. `None` where the ray may slip past, at an outline of the surface.
    fn certain(&self, first: usize) -> Option<(f64, f64)> {
        let mut group = vec![first];
        let mut next = 0;
        while next < group.len() {
            let one = &self.meetings[group[next]];
            if !one.has_certain_side(self.lateral_error) {
                return None;
            }
            for e in (0..3).filter(|&e| edge_distance(one.outline, e) <= self.lateral_error) {
                let across = self.meetings.iter().position(|other| other.continues(one, e))?;
                if !group.contains(&across) {
                    group.push(across);
                }
            }
            next += 1;
        }
        let members = group.into_iter().map(|m| &self.meetings[m]).filter(|m| m.t_low <= m.t_high);
        members.map(|m| (m.t_low, m.t_high)).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
    }
}

impl Meeting {
    /// Whether the ray sees the same side of the triangle however its vertices are moved by `error`: its width is more
    /// than two of them could make up.
    fn has_certain_side(&self, error: f64) -> bool {
        let [a, b, c] = self.outline;
        let sides = [b - a, c - b, a - c].map(DVec2::length_squared);
        let longest = sides[0].max(sides[1]).max(sides[2]).sqrt();
        (b - a).perp_dot(c - a).abs() > 2.0 * error * longest
    }

    /// Whether the surface goes on here across edge `e` of `other`, on the other side of that edge.
    fn continues(&self, other: &Meeting, e: usize) -> bool {
        let (from, to) = ((e + 1) % 3, (e + 2) % 3);
        let shared = [other.keys[from], other.keys[to]];
        let Some(own) = (0..3).find(|&v| !shared.contains(&self.keys[v])) else { return false };
        if !shared.iter().all(|key| self.keys.contains(key)) {
            return false;
        }
        let (a, along) = (other.outline[from], other.outline[to] - other.outline[from]);
        let side = |p: DVec2| along.perp_dot(p - a) > 0.0;
        side(self.outline[own]) != side(other.outline[e])
    }
}

impl Oracle {
    /// Whether point, normal and texture coordinates of a reported hit describe its micro-triangle.
    ///
    /// # Errors
    /// Where one does not.
    ///
    /// # Panics
    /// On a miss, or a micro-triangle that does not exist: [`Answer::judge`] comes first.
    pub fn judge_surface(
        &self,
        ray: &Ray,
        answer: &Answer,
        reported: &Intersection,
    ) -> Result<(), Disagreement> {
        let piece = &self.pieces[reported.primitive as usize];
        let cell = Cell::unpack(reported.cell);
        let corners = piece.corners(cell);
        let (b1, b2) = (f64::from(reported.b1), f64::from(reported.b2));
        let weights = [1.0 - b1 - b2, b1, b2];
        let (point, error) = (reported.point.as_dvec3(), reported.point_error.as_dvec3());

        // The same barycentrics on the true triangle: off by the stated error, and by what its vertices are.
        let true_point = mixed(weights, corners);
        within((point - true_point).length(), error.length() + piece.error, |off, bound| {
            Disagreement::Point { off, bound }
        })?;

        // They are those of a point on the ray, as far as vertices are where f32 sees them.
        let from_origin = point - ray.origin.as_dvec3();
        let off_the_ray = from_origin.reject_from(ray.direction.as_dvec3()).length();
        within(off_the_ray, error.length() + answer.lateral_error, |off, bound| Disagreement::OffTheRay {
            off,
            bound,
        })?;

        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize();
        let normal = if piece.flipped { -normal } else { normal };
        let off = (reported.normal.as_dvec3() - normal).length();
        within(off, normal_error(corners, piece.error, self.rounding), |off, bound| Disagreement::Normal {
            off,
            bound,
        })?;

        // Barycentrics on the base triangle (b0 rounded twice, the grid's weights and the sum of three), and the sum of
        // three coordinates.
        let on_base = mixed(weights, cell.grid_points().map(|(j, k)| DVec3::from(piece.weights(j, k))));
        let uv = mixed(on_base.to_array(), piece.uv);
        let magnitude = piece.uv.iter().fold(0.0, |most: f64, t| most.max(t.abs().max_element()));
        let off = (uv - DVec2::new(f64::from(reported.u), f64::from(reported.v))).abs().max_element();
        let bound = 4.0 * self.rounding.interpolation() * UNIT_ROUNDOFF * magnitude;
        within(off, bound, |off, bound| Disagreement::TextureCoordinates { off, bound })
    }
}

/// The error that `describe` makes where `off` is above `bound`, or no number.
fn within(off: f64, bound: f64, describe: impl FnOnce(f64, f64) -> Disagreement) -> Result<(), Disagreement> {
    if off <= bound { Ok(()) } else { Err(describe(off, bound)) }
}

/// Bound on the error of a unit normal computed in f32 from vertices that are off by `error`.
///
/// A linear function between -e and e at the vertices climbs by 2 e over the triangle's width at the most, so that
/// the plane tilts by 2 e / (width - 2 e). Rounding the edges' differences moves a vertex by another u of the longest
/// edge; products that are not fused are off by as much as moves of the ends of both edges by u each. The cross product
/// is within 3 u, normalisation adds its own. Two normals are 2 apart at the most.
fn normal_error([a, b, c]: [DVec3; 3], error: f64, rounding: Rounding) -> f64 {
    let longest = (b - a).length().max((c - b).length()).max((a - c).length());
    let width = (b - a).cross(c - a).length() / longest;
    let moved = 2.0 * (error + (1.0 + 2.0 * rounding.product) * UNIT_ROUNDOFF * longest);
    let rounded = UNIT_ROUNDOFF * (3.0 + rounding.by_length());
    if width > 2.0 * moved { (moved / (width - moved) + rounded).min(2.0) } else { 2.0 }
}
