//! Localisation of the residual energy by measured quantity and by time.
//!
//! The residual energy of each part is compared with the same part in the null sets. Because many parts are tested, a
//! p-value counts the null sets in which any part stands out as much (Westfall and Young's max-T).

use crate::evidence::Detection;
use nalgebra::DVector;
use serde::{Deserialize, Serialize};
use track_fit::data::{Channel, Quantity};
use track_fit::fitting::Fit;

/// Time windows of an episode.
const WINDOWS: usize = 8;

/// Part of the data.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Part {
    /// Measured quantity, over all episodes and times.
    Quantity(Quantity),
    /// Frames of an episode between two times.
    Window {
        /// Index of the episode.
        episode: usize,
        /// Time of the first frame, s.
        from_s: f64,
        /// Time of the last frame, s.
        to_s: f64,
    },
}

/// Excess of a part.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Localisation {
    /// Part of the data.
    pub part: Part,
    /// Mean square of its residuals, in variances of the noise.
    pub mean_square: f64,
    /// Excess over the mean of the measured and null sets, in standard deviations.
    pub excess: f64,
    /// p-value, corrected for the number of parts.
    pub p_value: f64,
}

/// Excess of each part: quantities first, then windows in order of time.
pub fn localise(fit: &Fit, channels: &[Channel], detection: &Detection) -> Vec<Localisation> {
    let parts = parts(channels);
    let rows: Vec<Vec<usize>> = parts.iter().map(|part| rows_of(part, channels)).collect();
    let sums = |residuals: &DVector<f64>| -> Vec<f64> {
        rows.iter().map(|rows| rows.iter().map(|&r| residuals[r].powi(2)).sum()).collect()
    };
    let null: Vec<Vec<f64>> = detection.null.iter().map(|n| sums(&n.residuals)).collect();
    let measured = sums(&fit.residuals);
    // If the model lacks nothing, the measured set is one more null set. The moments therefore include it.
    let pooled = || null.iter().chain([&measured]);
    let count = null.len() as f64 + 1.0;
    let moments: Vec<(f64, f64)> = (0..parts.len())
        .map(|i| {
            let mean = pooled().map(|s| s[i]).sum::<f64>() / count;
            let variance = pooled().map(|s| (s[i] - mean).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
            (mean, variance.sqrt().max(f64::MIN_POSITIVE))
        })
        .collect();
    // Standardised sums make quantities and windows of different size comparable.
    let excess = |sums: &[f64]| -> Vec<f64> { sums.iter().zip(&moments).map(|(s, (m, sd))| (s - m) / sd).collect() };
    let greatest: Vec<f64> = null.iter().map(|s| excess(s).into_iter().fold(f64::NEG_INFINITY, f64::max)).collect();
    let place = |(i, e): (usize, f64)| Localisation {
        part: parts[i],
        mean_square: measured[i] / rows[i].len().max(1) as f64,
        excess: e,
        p_value: crate::evidence::p_value(e, greatest.iter().copied()),
    };
    excess(&measured).into_iter().enumerate().map(place).collect()
}

/// First window that stands out at `level`.
pub fn onset(places: &[Localisation], level: f64) -> Option<&Localisation> {
    places.iter().find(|p| matches!(p.part, Part::Window { .. }) && p.p_value <= level)
}

/// Quantity that stands out most at `level`.
pub fn worst_quantity(places: &[Localisation], level: f64) -> Option<&Localisation> {
    let quantities = places.iter().filter(|p| matches!(p.part, Part::Quantity(_)) && p.p_value <= level);
    quantities.max_by(|a, b| a.excess.total_cmp(&b.excess))
}

fn parts(channels: &[Channel]) -> Vec<Part> {
    let mut quantities: Vec<Quantity> = channels.iter().map(|c| c.quantity).collect();
    quantities.sort_unstable();
    quantities.dedup();
    let mut parts: Vec<Part> = quantities.into_iter().map(Part::Quantity).collect();
    let episodes = channels.iter().map(|c| c.episode).max().map_or(0, |e| e + 1);
    for episode in 0..episodes {
        let mut times: Vec<f64> = channels.iter().filter(|c| c.episode == episode).map(|c| c.time_s).collect();
        // Channels are in order of time, so that equal times are neighbours.
        times.dedup();
        let frames = times.len();
        let windows = WINDOWS.min(frames);
        for w in 0..windows {
            let (from, to) = (w * frames / windows, (w + 1) * frames / windows);
            parts.push(Part::Window { episode, from_s: times[from], to_s: times[to - 1] });
        }
    }
    parts
}

fn rows_of(part: &Part, channels: &[Channel]) -> Vec<usize> {
    let is_in = |c: &Channel| match *part {
        Part::Quantity(q) => c.quantity == q,
        Part::Window { episode, from_s, to_s } => c.episode == episode && (from_s..=to_s).contains(&c.time_s),
    };
    (0..channels.len()).filter(|&i| is_in(&channels[i])).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evidence::NullFit;
    use catenary_core::seed;
    use nalgebra::DMatrix;
    use rand_distr::{Distribution, StandardNormal};

    fn channels() -> Vec<Channel> {
        let frame = |i: usize| {
            let points = (0..4).flat_map(|point| [0, 1].map(|axis| Quantity::Keypoint { point, axis }));
            points.map(move |quantity| Channel { episode: 0, frame: i, time_s: 0.25 * i as f64, quantity })
        };
        (0..32).flat_map(frame).collect()
    }

    fn noise(number: u64, shift: impl Fn(&Channel) -> f64) -> Fit {
        let mut rng = seed::rng(8, number);
        let values = channels()
            .iter()
            .map(|c| shift(c) + Distribution::<f64>::sample(&StandardNormal, &mut rng))
            .collect::<Vec<_>>();
        let residuals = DVector::from_vec(values);
        let jacobian = DMatrix::zeros(residuals.len(), 0);
        Fit { point: Vec::new(), cost: residuals.norm_squared(), residuals, jacobian, tracks: Vec::new() }
    }

    fn detection(fit: &Fit) -> Detection {
        let residue = |fit: Fit| NullFit { cost: fit.cost, residuals: fit.residuals };
        let null: Vec<NullFit> = (1..200).map(|i| residue(noise(i, |_| 0.0))).collect();
        Detection {
            p_value: crate::evidence::p_value(fit.cost, null.iter().map(|f| f.cost)),
            statistic: fit.cost,
            null,
            null_left_out: 0,
        }
    }

    #[test]
    fn a_shift_of_one_keypoint_after_contact_is_localised() {
        let tip_x = Quantity::Keypoint { point: 3, axis: 0 };
        let fit = noise(0, |c| if c.quantity == tip_x && c.time_s >= 4.0 { 4.0 } else { 0.0 });
        let places = localise(&fit, &channels(), &detection(&fit));
        assert_eq!(places.len(), 8 + 8);
        let first = onset(&places, 0.05).unwrap();
        assert_eq!(first.part, Part::Window { episode: 0, from_s: 4.0, to_s: 4.75 });
        assert_eq!(worst_quantity(&places, 0.05).unwrap().part, Part::Quantity(tip_x));
    }

    /// Among 100 noise sets 5 are expected to stand out; 12 or more have a chance of 1 in 200.
    #[test]
    fn noise_stands_out_no_more_often_than_the_level_says() {
        let null = detection(&noise(0, |_| 0.0));
        let out = (1000..1100).filter(|&i| {
            let fit = noise(i, |_| 0.0);
            localise(&fit, &channels(), &null).iter().any(|p| p.p_value <= 0.05)
        });
        let count = out.count();
        assert!(count < 12, "{count} of 100");
    }
}
