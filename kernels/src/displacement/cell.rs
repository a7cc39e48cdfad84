//! Cells of the barycentric grid: the micro-triangles by name, and the steps between neighbours.

use crate::math::clamp;

/// A micro-triangle of a base triangle whose sides have N parts.
///
/// It is (i,j,k) = floor(alpha N), floor(beta N), floor(gamma N) of its inner points; i + j + k is N-1 in a *lower*
/// (upright) and N-2 in an *upper* (inverted) one, so that j, k and the kind say all.
///
/// Its vertices, as grid points (j, k), are in the order of the base triangle's: in a lower cell (j, k), (j+1, k),
/// (j, k+1), in an upper one (j+1, k+1), (j, k+1), (j+1, k). Vertex e is the one that lies across edge e, and edge e
/// lies on a line of constant coordinate number e (alpha, beta, gamma).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cell {
    /// floor(beta N).
    pub j: u32,
    /// floor(gamma N).
    pub k: u32,
    /// Whether it is inverted.
    pub upper: bool,
}

/// Which coordinate of (i,j,k) changed by a step, and how: the `LastChange` of Smits, Shirley and Stark 2000. A path
/// that turns round a grid point takes the six in a ring: I-, J+, K-, I+, J-, K+.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum LastChange {
    /// i went down: from a lower to an upper cell across edge 0.
    IMinus = 0,
    /// j went up: from an upper to a lower cell across edge 1.
    JPlus = 1,
    /// k went down: from a lower to an upper cell across edge 2.
    KMinus = 2,
    /// i went up: from an upper to a lower cell across edge 0.
    IPlus = 3,
    /// j went down: from a lower to an upper cell across edge 1.
    JMinus = 4,
    /// k went up: from an upper to a lower cell across edge 2.
    KPlus = 5,
}

impl Cell {
    /// The cell as one word: j in bits 0 to 12, k in bits 13 to 25, bit 26 set in an upper cell. Cell (j, k) = (3, 1),
    /// upper, is `0x0400_2003`.
    #[inline]
    pub fn pack(self) -> u32 {
        self.j | self.k << 13 | (self.upper as u32) << 26
    }

    /// The cell of a packed word.
    #[inline]
    pub fn unpack(word: u32) -> Cell {
        Cell { j: word & 0x1fff, k: (word >> 13) & 0x1fff, upper: word >> 26 & 1 != 0 }
    }

    /// The cell that holds the point of barycentric coordinates (beta, gamma); points outside the triangle are
    /// brought to a cell at its border, and coordinates that are NaN count as 0.
    #[inline]
    pub fn containing(beta: f32, gamma: f32, n: u32) -> Cell {
        let last = n - 1;
        let x = clamp(beta, 0.0, 1.0) * n as f32;
        let y = clamp(gamma, 0.0, 1.0) * n as f32;
        let j = (x as u32).min(last);
        let k = (y as u32).min(last - j);
        let upper = j + k < last && (x - j as f32) + (y - k as f32) > 1.0;
        Cell { j, k, upper }
    }

    /// Grid point (j, k) of vertex e = 0, 1 or 2.
    #[inline]
    pub fn vertex(self, e: u32) -> (u32, u32) {
        let to_j = ((e == 1) != self.upper) as u32;
        let to_k = ((e == 2) != self.upper) as u32;
        (self.j + to_j, self.k + to_k)
    }

    /// The step out of this cell across edge e.
    #[inline]
    pub fn change_across(self, e: u32) -> LastChange {
        match (e, self.upper) {
            (0, false) => LastChange::IMinus,
            (0, true) => LastChange::IPlus,
            (1, false) => LastChange::JMinus,
            (1, true) => LastChange::JPlus,
            (2, false) => LastChange::KMinus,
            _ => LastChange::KPlus,
        }
    }

    /// Whether the step leads out of the grid.
    #[inline]
    pub fn leaves_grid(self, change: LastChange, n: u32) -> bool {
        match change {
            LastChange::IMinus => self.j + self.k + 1 == n,
            LastChange::JMinus => self.j == 0,
            LastChange::KMinus => self.k == 0,
            _ => false,
        }
    }

    /// The neighbour that the step leads to; the step must not leave the grid.
    #[inline]
    pub fn step(self, change: LastChange) -> Cell {
        let Cell { j, k, upper } = self;
        match change {
            LastChange::IMinus | LastChange::IPlus => Cell { j, k, upper: !upper },
            LastChange::JPlus => Cell { j: j + 1, k, upper: !upper },
            LastChange::JMinus => Cell { j: j - 1, k, upper: !upper },
            LastChange::KPlus => Cell { j, k: k + 1, upper: !upper },
            LastChange::KMinus => Cell { j, k: k - 1, upper: !upper },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cells(n: u32) -> impl Iterator<Item = Cell> {
        (0..n).flat_map(move |j| {
            (0..n - j).flat_map(move |k| {
                [false, true]
                    .into_iter()
                    .filter(move |upper| !upper || j + k + 1 < n)
                    .map(move |upper| Cell { j, k, upper })
            })
        })
    }

    fn i(cell: Cell, n: u32) -> u32 {
        n - 1 - cell.upper as u32 - cell.j - cell.k
    }

    #[test]
    fn grid_has_n_squared_cells_that_pack_without_loss() {
        for n in [1, 2, 3, 8, 33] {
            assert_eq!(cells(n).count(), (n * n) as usize);
            assert!(cells(n).all(|c| Cell::unpack(c.pack()) == c));
        }
        assert_eq!(Cell { j: 3, k: 1, upper: true }.pack(), 0x0400_2003);
        let far = Cell { j: 4095, k: 4095, upper: true };
        assert_eq!(Cell::unpack(far.pack()), far);
    }

    #[test]
    fn point_lies_in_the_cell_of_its_floors() {
        let n = 7;
        for c in cells(n) {
            let centroid = (0..3)
                .map(|e| c.vertex(e))
                .fold((0.0, 0.0), |s, v| (s.0 + v.0 as f32 / 3.0, s.1 + v.1 as f32 / 3.0));
            let (beta, gamma) = (centroid.0 / n as f32, centroid.1 / n as f32);
            assert_eq!(Cell::containing(beta, gamma, n), c);
            assert_eq!(((1.0 - beta - gamma) * n as f32).floor() as u32, i(c, n));
        }
    }

    #[test]
    fn points_at_and_beyond_the_border_go_to_border_cells() {
        assert_eq!(Cell::containing(1.0, 0.0, 5), Cell { j: 4, k: 0, upper: false });
        assert_eq!(Cell::containing(0.0, 1.5, 5), Cell { j: 0, k: 4, upper: false });
        assert_eq!(Cell::containing(-0.1, -0.1, 5), Cell { j: 0, k: 0, upper: false });
        assert_eq!(Cell::containing(0.7, 0.7, 5), Cell { j: 3, k: 1, upper: false });
        assert_eq!(Cell::containing(f32::NAN, 0.0, 5).pack(), 0);
    }

    #[test]
    fn neighbours_share_the_edge_and_step_back() {
        let n = 6;
        for c in cells(n) {
            for e in 0..3 {
                let change = c.change_across(e);
                if c.leaves_grid(change, n) {
                    assert_eq!([i(c, n), c.j, c.k][e as usize], 0);
                    continue;
                }
                let other = c.step(change);
                assert_eq!(other.step(other.change_across(e)), c);
                // The new vertex stands at place e, the two shared ones change places.
                let (a, b) = ((e + 1) % 3, (e + 2) % 3);
                assert_eq!((other.vertex(a), other.vertex(b)), (c.vertex(b), c.vertex(a)));
                assert_ne!(other.vertex(e), c.vertex(e));
                let before = [i(c, n), c.j, c.k];
                let after = [i(other, n), other.j, other.k];
                assert_eq!(before.iter().zip(&after).filter(|(x, y)| x != y).count(), 1);
            }
        }
    }

    #[test]
    fn the_six_changes_in_a_ring_turn_round_a_grid_point() {
        use LastChange::{IMinus, IPlus, JMinus, JPlus, KMinus, KPlus};
        let start = Cell { j: 2, k: 2, upper: false };
        let ring = [IMinus, JPlus, KMinus, IPlus, JMinus, KPlus];
        let end = ring.into_iter().fold(start, |cell, change| {
            assert!((0..3).any(|e| cell.vertex(e) == (3, 2)), "{cell:?} is at the point");
            assert!((0..3).any(|e| cell.change_across(e) == change), "{change:?} leads out of {cell:?}");
            cell.step(change)
        });
        assert_eq!(end, start);
    }
}
