//! Distance transform: distance of each cell of the object from the background.

use super::pieces::{MAX_PIECES, Pieces};

/// Length of a step to a side neighbour, in units of 1/5 pixel: the 5-7 chamfer of Borgefors (1986), which differs from the
/// Euclidean distance by less than 5 %.
const SIDE: u16 = 5;
/// Length of a step to a corner neighbour, in units of 1/5 pixel.
const CORNER: u16 = 7;

/// Distance transform. Reuses its buffer.
#[derive(Debug, Clone, Default)]
pub(crate) struct Distance {
    units: Vec<u16>,
}

impl Distance {
    /// Measures every cell of `pieces`, in a forward and a backward pass (Borgefors 1986).
    pub(crate) fn measure(&mut self, pieces: &Pieces) {
        let stride = pieces.stride;
        self.units.clear();
        self.units.resize(pieces.cells.len(), 0);
        // The grid's frame is empty: every cell of the object has eight neighbours.
        for &i in &pieces.inside {
            let up = i - stride;
            self.units[i] = self.nearest([i - 1, up], [up - 1, up + 1]);
        }
        for &i in pieces.inside.iter().rev() {
            let down = i + stride;
            self.units[i] = self.units[i].min(self.nearest([i + 1, down], [down + 1, down - 1]));
        }
    }

    /// Half the local width in pixels at a cell on the medial axis.
    pub(crate) fn half_width_px(&self, cell: usize) -> f64 {
        // A border cell has the distance 1, and its centre lies half a pixel inside of the border.
        f64::from(self.units[cell]) / f64::from(SIDE) - 0.5
    }

    /// Largest half width in pixels by piece id. Entry 0 is unused.
    pub(crate) fn thickest_px(&self, pieces: &Pieces) -> [f64; MAX_PIECES + 1] {
        let mut most = [0; MAX_PIECES + 1];
        for &cell in &pieces.inside {
            let most = &mut most[usize::from(pieces.cells[cell])];
            *most = self.units[cell].max(*most);
        }
        most.map(|units| f64::from(units) / f64::from(SIDE) - 0.5)
    }

    /// Smallest distance over four neighbours: the distance of a neighbour plus the length of the step from it.
    fn nearest(&self, sides: [usize; 2], corners: [usize; 2]) -> u16 {
        let side = sides.map(|i| self.units[i]).into_iter().min().unwrap_or(0);
        let corner = corners.map(|i| self.units[i]).into_iter().min().unwrap_or(0);
        (side + SIDE).min(corner + CORNER)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TrackerParams;
    use catenary_core::LabelMask;
    use catenary_core::regions::Regions;

    #[test]
    fn the_middle_of_a_disc_lies_a_radius_deep() {
        let mut mask = LabelMask::new(64, 64);
        for (i, label) in mask.data.iter_mut().enumerate() {
            let d = [(i % 64) as f64 - 31.0, (i / 64) as f64 - 31.0];
            *label = u8::from(d[0].hypot(d[1]) < 20.0);
        }
        let (mut pieces, mut distance) = (Pieces::default(), Distance::default());
        pieces.load(&mask, &mut Regions::default(), &TrackerParams::default());
        distance.measure(&pieces);
        let middle = distance.half_width_px(32 * pieces.stride + 32);
        assert!((middle - 19.5).abs() < 1.0, "{middle}");
        assert_eq!(distance.half_width_px(0), -0.5);
    }
}
