//! Square of a mask that the network sees.

use catenary_core::LabelMask;
use catenary_core::image::label;

/// Ratio of the side of a square around the object to the object's larger extent. An end of which up to a quarter of the length is hidden lies
/// inside.
const MARGIN: f64 = 1.5;
/// Least side of a square around the object, in mask pixels.
const LEAST_SIDE_PX: f64 = 24.0;

/// Square of a mask, in pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Square {
    /// Left and upper edge.
    pub(super) corner: [f64; 2],
    /// Side.
    pub(super) side: f64,
}

impl Square {
    /// The largest square in the middle of a mask.
    pub(super) fn whole(mask: &LabelMask) -> Self {
        let size = [f64::from(mask.width), f64::from(mask.height)];
        let side = size[0].min(size[1]);
        Self { corner: size.map(|s| 0.5 * (s - side)), side }
    }

    /// Square around what lies between two corners.
    pub(super) fn around(low: [f64; 2], high: [f64; 2]) -> Self {
        let side = (MARGIN * (high[0] - low[0]).max(high[1] - low[1])).max(LEAST_SIDE_PX);
        Self { corner: [0, 1].map(|i| 0.5 * (low[i] + high[i] - side)), side }
    }

    /// Square around the object; none without one.
    pub(super) fn around_object(mask: &LabelMask) -> Option<Self> {
        let (mut low, mut high, width) = ([f64::MAX; 2], [f64::MIN; 2], mask.width as usize);
        for (i, _) in mask.data.iter().enumerate().filter(|(_, l)| **l == label::DLO) {
            let at = [(i % width) as f64, (i / width) as f64];
            (0..2).for_each(|k| (low[k], high[k]) = (low[k].min(at[k]), high[k].max(at[k] + 1.0)));
        }
        (low[0] <= high[0]).then(|| Self::around(low, high))
    }

    /// Place in the square, from -1 to 1, of a place in the mask.
    pub(super) fn scaled(&self, p: [f64; 2]) -> [f32; 2] {
        [0, 1].map(|i| (2.0 * (p[i] - self.corner[i]) / self.side - 1.0) as f32)
    }

    /// Place in the mask of a place in the square, from -1 to 1.
    pub(super) fn px(&self, p: [f32; 2]) -> [f64; 2] {
        [0, 1].map(|i| self.corner[i] + 0.5 * (f64::from(p[i]) + 1.0) * self.side)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_square_around_the_object_holds_it_in_its_middle() {
        let mut mask = LabelMask::new(100, 80);
        for v in 10..40 {
            mask.data[v * 100 + 50..v * 100 + 54].fill(label::DLO);
        }
        let square = Square::around_object(&mask).unwrap();
        assert_eq!(square.scaled([52.0, 25.0]), [0.0, 0.0]);
        assert_eq!(square.side, 45.0);
        let back = square.px(square.scaled([51.0, 33.0]));
        assert!((back[0] - 51.0).abs() < 1e-4 && (back[1] - 33.0).abs() < 1e-4, "{back:?}");
        assert_eq!(Square::whole(&mask), Square { corner: [10.0, 0.0], side: 80.0 });
        assert_eq!(Square::around_object(&LabelMask::new(9, 9)), None);
    }
}
