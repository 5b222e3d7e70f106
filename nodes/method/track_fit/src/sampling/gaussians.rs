//! Mixture of Gaussians fitted to draws in the unit cube.

use super::moments::moments;
use catenary_core::mixture::log_sum_exp;
use catenary_core::{Mixture, seed};
use nalgebra::{DMatrix, DVector};
use rand::{Rng, RngExt};

/// Numbers of components that are tried.
const COMPONENTS: [usize; 6] = [1, 2, 3, 4, 6, 8];
/// Rounds of an expectation-maximisation.
const ROUNDS: usize = 40;
/// Fits from different clusters.
const TRIES: usize = 3;
/// Rounds of the clustering.
const CLUSTERINGS: usize = 10;
/// Distance from a face of the cube within which draws are mirrored at a face that they press on. It also bounds the mass of
/// the mixture outside of the cube.
const MARGIN: f64 = 0.25;
/// Share of the draws in the outer tenth of their own range above which they press on the face there. A Gaussian that is
/// whole has 0.02 in the outer tenth of its range of plus and minus three standard deviations.
const PRESSED: f64 = 0.05;
/// Most coordinates in which draws are mirrored.
const MOST_MIRRORS: usize = 4;
/// Least standard deviation of a component. A narrower posterior is widened to it.
const LEAST_SD: f64 = 1e-4;

/// Mixture of Gaussians whose truncation to the unit cube approximates these draws; none for fewer than 2 (d + 1) draws. Draws that press on a face are mirrored at it, because a Gaussian at a face would have
/// half of its density there. The number of components is the one that predicts held-out draws best.
pub fn gaussians_of(draws: &[Vec<f64>], seed: u64) -> Option<Mixture> {
    let d = draws.first()?.len();
    if draws.len() < 2 * (d + 1) {
        return None;
    }
    let pressed = pressed_most((0..d).map(|i| pressed_faces(draws, i)).collect());
    // Draws of one walker follow each other at a fixed distance, so that the halves are of different walkers.
    let (left, right) = draws.split_at(draws.len() / 2);
    let of = |draws: &[Vec<f64>]| draws.iter().flat_map(|draw| images(draw, &pressed)).collect::<Vec<_>>();
    let (left, right, all) = (of(left), of(right), of(draws));
    let score = |k: usize, (train, test): (&[DVector<f64>], &[DVector<f64>])| {
        let fitted = Gaussians::fitted(train, k, &mut seed::rng(seed, k as u64))?;
        Some(test.iter().map(|x| fitted.log_density(x)).sum::<f64>() / test.len() as f64)
    };
    let both = |k: &usize| Some((score(*k, (&left, &right))? + score(*k, (&right, &left))?, *k));
    let (_, k) = COMPONENTS.iter().filter_map(both).max_by(|a, b| a.0.total_cmp(&b.0))?;
    Gaussians::fitted(&all, k, &mut seed::rng(seed, k as u64))?.mixture()
}

/// Faces of the coordinates that press most. Each doubles the images of a draw, so that there are few.
fn pressed_most(shares: Vec<[f64; 2]>) -> Vec<[bool; 2]> {
    let greatest = |i: &usize| shares[*i][0].max(shares[*i][1]);
    let mut order: Vec<usize> = (0..shares.len()).filter(|i| greatest(i) > 0.0).collect();
    order.sort_by(|a, b| greatest(b).total_cmp(&greatest(a)));
    order.truncate(MOST_MIRRORS);
    (0..shares.len()).map(|i| shares[i].map(|share| share > 0.0 && order.contains(&i))).collect()
}

/// Share of the draws that press on the lower and the upper face in coordinate `i`; zero if none does.
fn pressed_faces(draws: &[Vec<f64>], i: usize) -> [f64; 2] {
    let ends = draws.iter().fold([1.0f64, 0.0f64], |[low, high], u| [low.min(u[i]), high.max(u[i])]);
    let tenth = 0.1 * (ends[1] - ends[0]);
    let share =
        |is_there: &dyn Fn(f64) -> bool| draws.iter().filter(|u| is_there(u[i])).count() as f64 / draws.len() as f64;
    // Draws whose range ends inside the cube do not press.
    let [low, high] = [share(&|u| u < ends[0] + tenth), share(&|u| u > ends[1] - tenth)];
    let pressing = |share: f64, gap: f64| if gap < tenth && share > PRESSED { share } else { 0.0 };
    [pressing(low, ends[0]), pressing(high, 1.0 - ends[1])]
}

/// A draw and its mirror images in the pressed faces near it.
fn images(draw: &[f64], pressed: &[[bool; 2]]) -> Vec<DVector<f64>> {
    let mut all = vec![DVector::from_column_slice(draw)];
    for (i, faces) in pressed.iter().enumerate() {
        for (face, is_pressed) in [0.0, 1.0].into_iter().zip(faces) {
            if *is_pressed && (draw[i] - face).abs() < MARGIN {
                let mirrored: Vec<DVector<f64>> = all
                    .iter()
                    .filter(|image| image[i] == draw[i])
                    .map(|image| {
                        let mut other = image.clone();
                        other[i] = 2.0 * face - draw[i];
                        other
                    })
                    .collect();
                all.extend(mirrored);
            }
        }
    }
    all
}

/// Gaussians with shares.
struct Gaussians {
    shares: Vec<f64>,
    means: Vec<DVector<f64>>,
    covariances: Vec<DMatrix<f64>>,
    /// Inverse Cholesky factors, with the logarithms of the normalising factors.
    inverses: Vec<(DMatrix<f64>, f64)>,
}

impl Gaussians {
    /// Best of several fits by expectation-maximisation; none if a covariance has no Cholesky factor.
    fn fitted(points: &[DVector<f64>], k: usize, rng: &mut impl Rng) -> Option<Self> {
        // One component has one fit.
        let tries = if k == 1 { 1 } else { TRIES };
        let (_, common) = moments(points)?;
        let fits = (0..tries).filter_map(|_| Self::fitted_once(points, k, &common, rng));
        let scored = fits.map(|fit| (points.iter().map(|x| fit.log_density(x)).sum::<f64>(), fit));
        scored.max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, fit)| fit)
    }

    /// Fit from the clusters of random means.
    fn fitted_once(points: &[DVector<f64>], k: usize, common: &DMatrix<f64>, rng: &mut impl Rng) -> Option<Self> {
        let d = common.nrows();
        let means = spread_out(points, k, common, rng);
        let mut covariances = vec![common * (0.1 * d as f64); k];
        let mut counts = vec![d as f64; k];
        for x in points {
            let i = nearest(x, &means, common);
            covariances[i] += (x - &means[i]) * (x - &means[i]).transpose();
            counts[i] += 1.0;
        }
        covariances.iter_mut().zip(&counts).for_each(|(c, count)| *c /= *count);
        let whole: f64 = counts.iter().sum();
        let mut own = Self::new(counts.iter().map(|count| count / whole).collect(), means, covariances)?;
        for _ in 0..ROUNDS {
            own = own.improved(points, common)?;
        }
        Some(own)
    }

    fn new(shares: Vec<f64>, means: Vec<DVector<f64>>, mut covariances: Vec<DMatrix<f64>>) -> Option<Self> {
        let mut inverses = Vec::with_capacity(means.len());
        for covariance in &mut covariances {
            let d = covariance.nrows();
            (0..d).for_each(|i| covariance[(i, i)] += LEAST_SD * LEAST_SD);
            let l = covariance.clone().cholesky()?.l();
            let log_norm =
                -l.diagonal().iter().map(|v| v.ln()).sum::<f64>() - 0.5 * d as f64 * (2.0 * std::f64::consts::PI).ln();
            inverses.push((l.solve_lower_triangular(&DMatrix::identity(d, d))?, log_norm));
        }
        Some(Self { shares, means, covariances, inverses })
    }

    fn log_terms(&self, x: &DVector<f64>) -> Vec<f64> {
        let of = |i: usize| {
            let (inverse, log_norm) = &self.inverses[i];
            self.shares[i].max(f64::MIN_POSITIVE).ln() + log_norm
                - 0.5 * (inverse * (x - &self.means[i])).norm_squared()
        };
        (0..self.means.len()).map(of).collect()
    }

    fn log_density(&self, x: &DVector<f64>) -> f64 {
        log_sum_exp(&self.log_terms(x))
    }

    /// Gaussians after a round. A component of few points is drawn towards the common covariance.
    fn improved(&self, points: &[DVector<f64>], common: &DMatrix<f64>) -> Option<Self> {
        let (k, d) = (self.means.len(), common.nrows());
        let (mut sums, mut means) = (vec![0.0; k], vec![DVector::zeros(d); k]);
        let parts: Vec<Vec<f64>> = points
            .iter()
            .map(|x| {
                let terms = self.log_terms(x);
                let total = log_sum_exp(&terms);
                terms.iter().map(|t| (t - total).exp()).collect()
            })
            .collect();
        for (x, part) in points.iter().zip(&parts) {
            for (i, share) in part.iter().enumerate() {
                sums[i] += share;
                means[i].axpy(*share, x, 1.0);
            }
        }
        // A component without points goes back to its old mean with no share.
        (0..k).for_each(|i| means[i] = if sums[i] > 0.0 { &means[i] / sums[i] } else { self.means[i].clone() });
        let mut covariances = vec![DMatrix::zeros(d, d); k];
        for (x, part) in points.iter().zip(&parts) {
            for (i, share) in part.iter().enumerate() {
                let away = x - &means[i];
                covariances[i].ger(*share, &away, &away, 1.0);
            }
        }
        let towards = 0.5 * d as f64;
        // The common covariance has the spread between components in it, so that it counts a tenth.
        let shrunk = |(c, sum): (DMatrix<f64>, &f64)| (c + common * (0.1 * towards)) / (sum + towards);
        let covariances = covariances.into_iter().zip(&sums).map(shrunk).collect();
        let n = points.len() as f64;
        Self::new(sums.iter().map(|sum| sum / n).collect(), means, covariances)
    }

    fn mixture(self) -> Option<Mixture> {
        Mixture::new(&self.shares, self.means, self.covariances).ok()
    }
}

/// Squared distance in standard deviations of all points, coordinate by coordinate.
fn squared(a: &DVector<f64>, b: &DVector<f64>, common: &DMatrix<f64>) -> f64 {
    (0..a.len()).map(|i| (a[i] - b[i]).powi(2) / common[(i, i)].max(LEAST_SD * LEAST_SD)).sum()
}

/// Index of the mean nearest to a point.
fn nearest(x: &DVector<f64>, means: &[DVector<f64>], common: &DMatrix<f64>) -> usize {
    let distance = |i: &usize| squared(x, &means[*i], common);
    (0..means.len()).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(0)
}

/// Means of clusters (Lloyd 1982), which begin far from each other: each next one is drawn with a probability that grows
/// with its squared distance from those before (Arthur and Vassilvitskii 2007).
fn spread_out(points: &[DVector<f64>], k: usize, common: &DMatrix<f64>, rng: &mut impl Rng) -> Vec<DVector<f64>> {
    let mut means = vec![points[rng.random_range(0..points.len())].clone()];
    let mut shares = vec![f64::INFINITY; points.len()];
    while means.len() < k {
        let newest = &means[means.len() - 1];
        shares.iter_mut().zip(points).for_each(|(least, x)| *least = least.min(squared(x, newest, common)));
        let mut left = rng.random::<f64>() * shares.iter().sum::<f64>();
        let chosen = shares.iter().position(|share| {
            left -= share;
            left < 0.0
        });
        means.push(points[chosen.unwrap_or(0)].clone());
    }
    for _ in 0..CLUSTERINGS {
        let (mut sums, mut counts) = (vec![DVector::zeros(common.nrows()); k], vec![0.0; k]);
        for x in points {
            let i = nearest(x, &means, common);
            sums[i] += x;
            counts[i] += 1.0;
        }
        // A cluster without points stays where it was.
        let own = sums.into_iter().zip(&counts).zip(&means);
        means = own.map(|((sum, count), old)| if *count > 0.0 { sum / *count } else { old.clone() }).collect();
    }
    means
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_distr::{Distribution, StandardNormal};

    fn moments(draws: &[Vec<f64>], i: usize) -> (f64, f64) {
        let n = draws.len() as f64;
        let mean = draws.iter().map(|u| u[i]).sum::<f64>() / n;
        (mean, (draws.iter().map(|u| (u[i] - mean).powi(2)).sum::<f64>() / n).sqrt())
    }

    fn redrawn(draws: &[Vec<f64>]) -> Vec<Vec<f64>> {
        let mixture = gaussians_of(draws, 0).unwrap();
        let mut rng = seed::rng(9, 0);
        (0..4000).map(|_| mixture.sample_truncated(&mut rng).unwrap()).collect()
    }

    #[test]
    fn the_mixture_has_the_moments_of_the_draws_also_at_faces() {
        let mut rng = seed::rng(5, 0);
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        // A half normal at a face, a whole Gaussian that follows it, and a flat coordinate.
        let draws: Vec<Vec<f64>> = (0..1000)
            .map(|i| {
                let half = normal().abs();
                vec![0.05 * half, 0.5 + 0.02 * half + 0.01 * normal(), (f64::from(i) * 0.618_034).fract()]
            })
            .collect();
        let again = redrawn(&draws);
        for i in 0..3 {
            let ((a, sa), (b, sb)) = (moments(&draws, i), moments(&again, i));
            assert!((a - b).abs() < 0.12 * sa && (sb / sa - 1.0).abs() < 0.1, "{i}: {a} {b}, {sa} {sb}");
        }
        // The density does not fall at the face: a tenth of a half normal lies below 0.126 standard deviations.
        let first = again.iter().filter(|u| u[0] < 0.126 * 0.05).count() as f64 / again.len() as f64;
        assert!((first - 0.1).abs() < 0.025, "{first}");
    }

    #[test]
    fn two_groups_stay_two() {
        let mut rng = seed::rng(6, 0);
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let draws: Vec<Vec<f64>> = (0..900)
            .map(|i| if i % 3 == 0 { vec![0.2 + 0.01 * normal(), 0.8] } else { vec![0.7 + 0.02 * normal(), 0.3] })
            .map(|u: Vec<f64>| vec![u[0], u[1] + 1e-3])
            .collect();
        let again = redrawn(&draws);
        let low = again.iter().filter(|u| u[0] < 0.45).count() as f64 / again.len() as f64;
        let between = again.iter().filter(|u| (0.3..0.6).contains(&u[0])).count();
        assert!((low - 1.0 / 3.0).abs() < 0.05 && between < 8, "{low} {between}");
    }

    #[test]
    fn too_few_draws_have_no_mixture() {
        assert!(gaussians_of(&[], 0).is_none() && gaussians_of(&[vec![0.5; 3], vec![0.4; 3]], 0).is_none());
    }
}
