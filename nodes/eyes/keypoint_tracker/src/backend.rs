//! Choice of the tracker.

use crate::learned::{LearnedTracker, NetworkKind, Weights, shipped_weights};
use crate::{Error, GeometricTracker, KeypointTracker, TrackerParams};

/// Way to track.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Backend {
    /// Geometry of the mask.
    #[default]
    Geometric,
    /// Network of Transporter, as in the paper.
    Transporter,
    /// Network that was trained to find fixed fractions of the length behind covers.
    Ordered,
}

impl Backend {
    /// All backends.
    pub const ALL: [Self; 3] = [Self::Geometric, Self::Transporter, Self::Ordered];

    /// Value of the node's parameter `tracker`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self.network() {
            None => "geometric",
            Some(kind) => kind.name(),
        }
    }

    /// Backend of a name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|backend| backend.name() == name)
    }

    /// Network that it runs; none for geometry.
    #[must_use]
    pub fn network(self) -> Option<NetworkKind> {
        match self {
            Self::Geometric => None,
            Self::Transporter => Some(NetworkKind::Transporter),
            Self::Ordered => Some(NetworkKind::Ordered),
        }
    }
}

/// Parameters of all trackers.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TrackingParams {
    /// Chosen tracker.
    pub backend: Backend,
    /// Parameters of the geometric tracker; areas and `min_score` of all trackers.
    pub geometry: TrackerParams,
    /// Weights of the network; none: those that are shipped.
    pub weights: Option<Weights>,
}

impl TrackingParams {
    /// Builds the chosen tracker.
    ///
    /// # Errors
    /// [`Error::Parameter`] for a value out of range; [`Error::Weights`] for weights of another network.
    pub fn build(&self) -> Result<Box<dyn KeypointTracker + Send>, Error> {
        Ok(match self.backend.network() {
            None => Box::new(GeometricTracker::new(self.geometry)?),
            Some(kind) => {
                let weights = self.weights.clone().unwrap_or_else(|| shipped_weights(kind));
                Box::new(LearnedTracker::new(kind, self.geometry, weights)?)
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_backend_has_its_name_and_builds() {
        for backend in Backend::ALL {
            assert_eq!(Backend::from_name(backend.name()), Some(backend));
            assert!(TrackingParams { backend, ..TrackingParams::default() }.build().is_ok(), "{backend:?}");
            let params = TrackingParams { backend, weights: Some(vec![0.0; 3]), ..TrackingParams::default() };
            assert_eq!(params.build().is_err(), backend.network().is_some(), "{backend:?}");
        }
        assert_eq!(Backend::from_name("lk"), None);
    }
}
