//! Parameters of the geometric tracker.

use crate::Error;

/// End of the object at which arc length begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PathStart {
    /// Upper end: the held one of a hanging object.
    #[default]
    Upper,
    /// Left end.
    Left,
}

/// Parameters of [`crate::GeometricTracker`]. Lengths and areas are in mask pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackerParams {
    /// Positions of the keypoints as fractions of the centre line's length, in rising order. If they are not symmetric
    /// (f and 1 − f), the set of keypoints depends on `start`.
    pub fractions: [f64; 4],
    /// End at which the fractions begin.
    pub start: PathStart,
    /// Standard deviation of the Gaussian that smooths the centre line. Larger is steadier and cuts tight bends: a bend of
    /// radius r moves inwards by about smoothing² / 2r.
    pub smoothing_px: f64,
    /// Least area of the object. A smaller object counts as not seen.
    pub min_area_px: usize,
    /// Least area of a further piece of the object behind an occluder.
    pub min_piece_area_px: usize,
    /// Longest gap between two pieces that the centre line bridges. 0: only the longest piece counts.
    pub max_gap_px: f64,
    /// Largest area of a hole that is filled. Larger holes are loops of the object.
    pub max_hole_px: usize,
    /// Largest half width of a bar. The centre line of a thicker piece, a blob, is its main axis.
    pub max_half_width_px: f64,
    /// Least area of the target. A smaller target counts as not seen.
    pub min_target_area_px: usize,
    /// Least score. A mask in which a keypoint of the object has a lower one counts as one without the object: all its scores
    /// become 0. 0: every mask counts.
    pub min_score: f64,
}

impl Default for TrackerParams {
    fn default() -> Self {
        Self {
            // Middles of four equal parts.
            fractions: [0.125, 0.375, 0.625, 0.875],
            start: PathStart::Upper,
            smoothing_px: 2.0,
            min_area_px: 20,
            min_piece_area_px: 6,
            // The camera keeps pieces across occluders up to the same distance.
            max_gap_px: 40.0,
            max_hole_px: 12,
            max_half_width_px: 20.0,
            min_target_area_px: 8,
            min_score: 0.25,
        }
    }
}

impl TrackerParams {
    /// Checks all ranges.
    ///
    /// # Errors
    /// [`Error::Parameter`] with the field that is out of range.
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
        // 20: the kernel's buffer in `polyline` holds three standard deviations of it.
        in_range("smoothing_px", "0 to 20", self.smoothing_px, 0.0..=20.0)?;
        in_range("max_gap_px", "0 to 1000", self.max_gap_px, 0.0..=1000.0)?;
        in_range("max_half_width_px", "1 to 100", self.max_half_width_px, 1.0..=100.0)?;
        in_range("min_score", "0 to 1", self.min_score, 0.0..=1.0)?;
        in_range("min_area_px", "at least 1", self.min_area_px as f64, 1.0..=f64::INFINITY)?;
        in_range("min_piece_area_px", "at least 1", self.min_piece_area_px as f64, 1.0..=f64::INFINITY)?;
        in_range("min_target_area_px", "at least 1", self.min_target_area_px as f64, 1.0..=f64::INFINITY)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_out_of_range_are_rejected_with_the_fields_name() {
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
        rejects(TrackerParams { min_score: f64::NAN, ..good }, "min_score");
    }
}
