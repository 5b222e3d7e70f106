//! Simulation backends, by name.

use crate::simulator::BeamSimulator;
use catenary_core::simulator::SimulatorError;
use catenary_core::{Model, Simulator};

/// Physics that simulates a model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Backend {
    /// Planar beam.
    #[default]
    Beam,
    /// Finite elements of rapier, for cross-checks: a hundred times slower. Built with the feature `rapier_fem` only.
    RapierFem,
}

impl Backend {
    /// All backends.
    pub const ALL: [Backend; 2] = [Backend::Beam, Backend::RapierFem];

    /// Returns the name used in requests and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Backend::Beam => "beam",
            Backend::RapierFem => "rapier_fem",
        }
    }

    /// Returns the backend named `name`.
    pub fn from_name(name: &str) -> Option<Backend> {
        Self::ALL.into_iter().find(|b| b.name() == name)
    }

    /// Makes a simulator of `model` with `workers` threads.
    ///
    /// # Errors
    /// [`SimulatorError::Input`] if the model makes no object, or if this program was built without the backend.
    pub fn simulator(self, model: &Model, workers: usize) -> Result<Box<dyn Simulator + Send + Sync>, SimulatorError> {
        let input = |e: crate::parameters::ParameterError| SimulatorError::Input(e.to_string());
        match self {
            Backend::Beam => Ok(Box::new(BeamSimulator::new(model, workers).map_err(input)?)),
            #[cfg(feature = "rapier_fem")]
            Backend::RapierFem => {
                Ok(Box::new(crate::rapier_fem::RapierFemSimulator::new(model, workers).map_err(input)?))
            }
            #[cfg(not(feature = "rapier_fem"))]
            Backend::RapierFem => Err(SimulatorError::Input(
                "backend `rapier_fem` is not in this program: expected one built with the feature `rapier_fem`".into(),
            )),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parameters::tests::soft_bar;

    #[test]
    fn backends_are_chosen_by_name() {
        for backend in Backend::ALL {
            assert_eq!(Backend::from_name(backend.name()), Some(backend));
            match backend.simulator(&soft_bar(), 1) {
                Ok(_) => {}
                Err(e) => assert!(backend == Backend::RapierFem && e.to_string().contains("rapier_fem"), "{e}"),
            }
        }
        assert_eq!(Backend::from_name("mujoco"), None);
        assert_eq!(Backend::default(), Backend::Beam);
    }
}
