//! Map between the unit coordinates of two spaces whose priors differ by their bounds.

use catenary_core::mixture::MixtureError;
use catenary_core::{Mixture, ParameterSpace};
use nalgebra::{DMatrix, DVector};

/// Affine map of unit coordinates, `offset + scale * u` on each axis.
///
/// A prior with other bounds has the same density inside both supports up to a factor. Its distribution function is
/// therefore an affine function of the earlier one.
#[derive(Debug, Clone, PartialEq)]
pub struct UnitMap {
    offset: Vec<f64>,
    scale: Vec<f64>,
}

impl UnitMap {
    /// Map from the unit coordinates of `from` to those of `to`. The support of a prior other than uniform or log-uniform
    /// in `to` must contain that in `from`.
    pub fn new(from: &ParameterSpace, to: &ParameterSpace) -> Self {
        let edges = from.parameters().iter().zip(to.parameters()).map(|(from, to)| {
            let (low, high) = from.prior.bounds();
            (to.prior.to_unit(low), to.prior.to_unit(high))
        });
        let (offset, scale) = edges.map(|(low, high)| (low, high - low)).unzip();
        Self { offset, scale }
    }

    /// Map of the opposite direction.
    pub fn inverse(&self) -> Self {
        let scale: Vec<f64> = self.scale.iter().map(|s| 1.0 / s).collect();
        Self { offset: self.offset.iter().zip(&scale).map(|(o, s)| -o * s).collect(), scale }
    }

    /// Map that applies this one and then `next`.
    pub fn then(&self, next: &Self) -> Self {
        let scale = self.scale.iter().zip(&next.scale).map(|(a, b)| a * b).collect();
        Self { offset: next.apply(&self.offset), scale }
    }

    /// Image of the point `u` (D).
    pub fn apply(&self, u: &[f64]) -> Vec<f64> {
        u.iter().zip(&self.offset).zip(&self.scale).map(|((u, o), s)| o + s * u).collect()
    }

    /// Scale of each axis (D).
    pub fn scale(&self) -> &[f64] {
        &self.scale
    }

    /// Volume of the image of the unit cube.
    pub fn volume(&self) -> f64 {
        self.scale.iter().product()
    }

    /// Share of the unit cube that is not the image of a point of the unit cube.
    pub fn added(&self) -> f64 {
        let kept = |(o, s): (&f64, &f64)| (o + s).min(1.0) - o.max(0.0);
        1.0 - self.offset.iter().zip(&self.scale).map(|pair| kept(pair).max(0.0)).product::<f64>()
    }

    /// Image of a mixture.
    ///
    /// # Errors
    /// [`MixtureError`] if a scale makes a covariance indefinite by rounding.
    pub fn mixture(&self, mixture: &Mixture) -> Result<Mixture, MixtureError> {
        let scale = DMatrix::from_diagonal(&DVector::from_column_slice(&self.scale));
        let image = |k: usize| {
            let (mean, covariance) = mixture.component(k);
            (DVector::from_vec(self.apply(mean.as_slice())), &scale * covariance * &scale)
        };
        let (means, covariances) = (0..mixture.weights().len()).map(image).unzip();
        Mixture::new(mixture.weights(), means, covariances)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::{Parameter, Prior};

    fn space(length: [f64; 2], stiffness: [f64; 2], mass: [f64; 2]) -> ParameterSpace {
        let priors = [
            Prior::Uniform { low: length[0], high: length[1] },
            Prior::LogUniform { low: stiffness[0], high: stiffness[1] },
            Prior::Normal { mean: 0.25, sd: 0.01, low: mass[0], high: mass[1] },
        ];
        let named = |(name, prior): (&str, Prior)| Parameter { name: name.into(), prior };
        ParameterSpace::new(["length_m", "e_pa", "mass_kg"].into_iter().zip(priors).map(named).collect()).unwrap()
    }

    #[test]
    fn equal_thetas_correspond() {
        let narrow = space([0.2, 0.3], [1e3, 5e4], [0.24, 0.25]);
        let wide = space([0.15, 0.45], [1e3, 2e5], [0.23, 0.27]);
        let map = UnitMap::new(&narrow, &wide);
        for u in [[0.0, 1.0, 0.5], [0.3, 0.9, 0.1], [1.0, 0.0, 1.0]] {
            let expected = wide.to_unit(&narrow.from_unit(&u));
            let back = map.inverse().apply(&map.apply(&u));
            for axis in 0..3 {
                assert!(
                    (map.apply(&u)[axis] - expected[axis]).abs() < 1e-9,
                    "{u:?}: {:?}, {expected:?}",
                    map.apply(&u)
                );
                assert!((back[axis] - u[axis]).abs() < 1e-12, "{back:?}");
            }
        }
        let same = map.then(&map.inverse()).apply(&[0.2, 0.4, 0.6]);
        assert!(same.iter().zip([0.2, 0.4, 0.6]).all(|(a, b)| (a - b).abs() < 1e-12), "{same:?}");
    }

    #[test]
    fn new_ground_is_what_the_old_support_does_not_cover() {
        let of = |low, high| space([low, high], [1e3, 5e4], [0.24, 0.25]);
        let added = |to: ParameterSpace| UnitMap::new(&of(0.2, 0.3), &to).added();
        assert!((added(of(0.2, 0.4)) - 0.5).abs() < 1e-12);
        assert!((added(of(0.24, 0.34)) - 0.4).abs() < 1e-12, "the support moved by four tenths of its width");
        assert!(added(of(0.2, 0.3)).abs() < 1e-12 && (added(of(0.5, 0.6)) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_mixture_keeps_its_mass() {
        let (narrow, wide) = (space([0.2, 0.3], [1e3, 5e4], [0.24, 0.25]), space([0.2, 0.4], [5e2, 5e4], [0.24, 0.26]));
        let map = UnitMap::new(&narrow, &wide);
        let mixture = Mixture::new(
            &[0.3, 0.7],
            vec![DVector::from_element(3, 0.4), DVector::from_element(3, 0.8)],
            vec![DMatrix::from_diagonal_element(3, 3, 0.01), DMatrix::from_diagonal_element(3, 3, 0.02)],
        )
        .unwrap();
        let moved = map.mixture(&mixture).unwrap();
        let u = [0.5, 0.6, 0.7];
        let ratio = mixture.log_density(&u) - moved.log_density(&map.apply(&u));
        assert!((ratio - map.volume().ln()).abs() < 1e-9, "{ratio}");
    }
}
