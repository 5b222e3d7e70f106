//! Parameters of the geometric tracker.

use crate::Error;

/// The end of the object that arc length is counted from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PathStart {
    /// The upper end: that which is held, of an object that hangs.
    #[default]
    Upper,
    /// The left end.
    Left,
}

/// Parameters of [`crate::GeometricTracker`]. Lengths and areas are in mask pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackerParams {
    /// Where the keypoints lie, as fractions of the centre line's length, each larger than the one before. Where they
    /// are not symmetric (f and 1 − f), the set depends on which end is `start`.
    pub fractions: [f64; 4],
    /// The end that the fractions are counted from.
    pub start: PathStart,
    /// Standard deviation of the Gaussian that smooths the centre line. Larger is steadier, and cuts tight bends: a bend
    /// of radius r moves inwards by about smoothing² / 2r.
    pub smoothing_px: f64,
    /// The least area of the object; less counts as not seen.
    pub min_area_px: usize,
    /// The least area of a further piece of the object, cut off by something in front of it.
    pub min_piece_area_px: usize,
    /// The longest gap between two pieces that the centre line is led across. 0: only the longest piece counts.
    pub max_gap_px: f64,
    /// Holes of at most this area are filled; larger ones are loops of the object.
    pub max_hole_px: usize,
    /// A piece that is thicker than twice this is a blob: its centre line is its main axis.
    pub max_half_width_px: f64,
    /// The least area of the target; less counts as not seen.
    pub min_target_area_px: usize,
}

impl Default for TrackerParams {
    fn default() -> Self {
        Self {
            fractions: [0.125, 0.375, 0.625, 0.875],
            start: PathStart::Upper,
            smoothing_px: 2.0,
            min_area_px: 20,
            min_piece_area_px: 6,
            max_gap_px: 28.0,
            max_hole_px: 12,
            max_half_width_px: 20.0,
            min_target_area_px: 8,
        }
    }
}

impl TrackerParams {
    /// Rejects values out of range; names the field.
    pub fn check(&self) -> Result<(), Error> {
        let [first, .., last] = self.fractions;
        let rising = self.fractions.windows(2).all(|pair| pair[0] < pair[1]);
        if !(rising && first >= 0.0 && last <= 1.0) {
            let expected = "four rising numbers from 0 to 1";
            return Err(Error::Parameter { field: "fractions", expected, got: format!("{:?}", self.fractions) });
        }
        let in_range = |field, expected, value: f64, range: std::ops::RangeInclusive<f64>| {
            if range.contains(&value) {
                Ok(())
            } else {
                Err(Error::Parameter { field, expected, got: value.to_string() })
            }
        };
        in_range("smoothing_px", "0 to 20", self.smoothing_px, 0.0..=20.0)?;
        in_range("max_gap_px", "0 to 1000", self.max_gap_px, 0.0..=1000.0)?;
        in_range("max_half_width_px", "1 to 100", self.max_half_width_px, 1.0..=100.0)?;
        in_range("min_area_px", "at least 1", self.min_area_px as f64, 1.0..=f64::INFINITY)?;
        in_range("min_piece_area_px", "at least 1", self.min_piece_area_px as f64, 1.0..=f64::INFINITY)?;
        in_range("min_target_area_px", "at least 1", self.min_target_area_px as f64, 1.0..=f64::INFINITY)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bad_values_are_rejected_by_name() {
        let rejects = |params: TrackerParams, field: &str| {
            let message = params.check().unwrap_err().to_string();
            assert!(message.starts_with(&format!("{field}: expected")), "{message}");
        };
        let good = TrackerParams::default();
        assert_eq!(good.check(), Ok(()));
        assert_eq!(TrackerParams { fractions: [0.25, 0.5, 0.75, 1.0], ..good }.check(), Ok(()));
        rejects(TrackerParams { fractions: [0.25, 0.5, 0.75, 1.1], ..good }, "fractions");
        rejects(TrackerParams { fractions: [0.25, 0.5, 0.5, 1.0], ..good }, "fractions");
        rejects(TrackerParams { fractions: [f64::NAN, 0.5, 0.7, 1.0], ..good }, "fractions");
        rejects(TrackerParams { smoothing_px: f64::NAN, ..good }, "smoothing_px");
        rejects(TrackerParams { max_gap_px: -1.0, ..good }, "max_gap_px");
        rejects(TrackerParams { min_area_px: 0, ..good }, "min_area_px");
    }
}
