//! Posterior files.

use crate::exit::Given;
use anyhow::{Context, Result, ensure};
use bayes_sim::sequential::SupportMove;
use catenary_core::{Mixture, Model, ParameterSpace, Posterior};
use catenary_simulator::Registry;
use catenary_simulator::parameters::range_of;
use ppo_trainer::Domains;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Size limit of a posterior file, bytes. A thousand components over ten parameters take 3 MB.
const MOST_BYTES: u64 = 64 << 20;
/// Draws that a posterior must give inside its support. Each tries often, so that one that is next to impossible to draw from is refused here, by
/// the name of its file, and not in a later draw.
const DRAWS: usize = 32;
/// Most moves of a support: one for each bound of each parameter in each iteration.
const MOST_MOVES: usize = 100_000;

/// Contents of a posterior file. Reading checks it: values of the parameters' priors, of the mixture and of the moves, and their numbers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Written")]
pub struct PosteriorFile {
    /// Parameters with the support that was used.
    pub parameters: ParameterSpace,
    /// Mixture over their unit coordinates.
    pub mixture: Mixture,
    /// Moves from the model's support to the used one, in order; absent in the file if the support did not move.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub support_moves: Vec<SupportMove>,
}

/// Contents as they stand in the file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Written {
    parameters: ParameterSpace,
    mixture: Mixture,
    #[serde(default)]
    support_moves: Vec<SupportMove>,
}

impl TryFrom<Written> for PosteriorFile {
    type Error = anyhow::Error;

    fn try_from(Written { parameters, mixture, support_moves }: Written) -> Result<Self> {
        let Posterior { parameters, mixture } = Posterior::new(parameters, mixture)?;
        ensure!(
            support_moves.len() <= MOST_MOVES,
            "support_moves: expected at most {MOST_MOVES}, got {}",
            support_moves.len()
        );
        for (i, step) in support_moves.iter().enumerate() {
            let name = &step.parameter;
            ensure!(
                parameters.index_of(name).is_some(),
                "support_moves: {i}: `parameter`: expected one of the parameters, got `{name}`"
            );
            for (field, [low, high]) in [("from", step.from), ("to", step.to)] {
                let is_range = low < high && (high - low).is_finite();
                ensure!(is_range, "support_moves: {i}: `{field}`: expected finite low < high, got [{low:?}, {high:?}]");
            }
        }
        Ok(Self { parameters, mixture, support_moves })
    }
}

impl PosteriorFile {
    /// Contents for `posterior`, whose support moved by `support_moves`.
    pub fn new(posterior: &Posterior, support_moves: Vec<SupportMove>) -> Self {
        let Posterior { parameters, mixture } = posterior.clone();
        Self { parameters, mixture, support_moves }
    }

    /// Text of the file.
    ///
    /// # Errors
    /// An error of the JSON writer.
    pub fn text(&self) -> Result<String> {
        Ok(serde_json::to_string_pretty(self)?)
    }
}

/// Posterior of a file. Returns an error unless its parameters are those of the model, with values that the simulator takes, and draws fall inside
/// their support. The priors may have other bounds than the model's: an inference with `--prior-support adaptive` moves them.
pub fn read(path: &Path, model: &Model) -> Result<Posterior> {
    let parse = || {
        let bytes = catenary_shell::files::read_at_most("posterior", path, MOST_BYTES)?;
        checked(&bytes, model).with_context(|| format!("posterior {}", path.display()))
    };
    parse().given()
}

fn checked(bytes: &[u8], model: &Model) -> Result<Posterior> {
    let file: PosteriorFile = serde_json::from_slice(bytes)?;
    let posterior = Posterior { parameters: file.parameters, mixture: file.mixture };
    ensure!(
        posterior.parameters.equals_up_to_bounds(&model.theta),
        "its parameters are not those of model `{}`",
        model.name
    );
    let registry = Registry::shipped().with_expressions(model)?;
    for p in posterior.parameters.parameters() {
        let [least, most] = range_of(&registry, &p.name)?;
        let (low, high) = p.prior.bounds();
        ensure!(
            least <= low && high <= most,
            "theta `{}`: expected a prior within {least} and {most}, got {low:?} to {high:?}",
            p.name
        );
    }
    posterior.sample(DRAWS, 0)?;
    Ok(posterior)
}

/// Distribution of the object's parameters: the posterior in a file, or the model's prior.
pub fn domains(posterior: Option<&Path>, model: &Model) -> Result<Domains> {
    Ok(match posterior {
        None => Domains::Prior(model.theta.clone()),
        Some(path) => Domains::Mixture(read(path, model)?),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inputs::model_file;
    use catenary_core::{Parameter, ParameterSpace};

    #[test]
    fn a_posterior_whose_support_moved_is_read_with_its_own_prior() {
        let model = model_file::read_or_soft_bar(None).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("posterior.json");
        let written = |change: fn(&mut Parameter)| {
            let mut parameters = model.theta.parameters().to_vec();
            change(&mut parameters[0]);
            let parameter = parameters[0].name.clone();
            let posterior = Posterior::prior(ParameterSpace::new(parameters).unwrap());
            let step = SupportMove {
                iteration: 1,
                parameter,
                from: [0.195, 0.305],
                to: [0.195, 0.36],
                because: "of a test".into(),
            };
            std::fs::write(&path, PosteriorFile::new(&posterior, vec![step]).text().unwrap()).unwrap();
            posterior
        };
        let moved = written(|p| p.prior = p.prior.with_bounds(0.195, 0.36).unwrap());
        assert_eq!(read(&path, &model).unwrap(), moved);
        assert!(matches!(domains(Some(&path), &model).unwrap(), Domains::Mixture(read) if read == moved));
        // A posterior without moves is a plain document of its parameters and its mixture.
        let plain = Posterior::prior(model.theta.clone());
        let text = PosteriorFile::new(&plain, Vec::new()).text().unwrap();
        assert_eq!(text, serde_json::to_string_pretty(&plain).unwrap());
        std::fs::write(&path, text).unwrap();
        assert_eq!(read(&path, &model).unwrap(), plain);
        written(|p| p.name = "mass_kg".into());
        let refusal = format!("{:#}", read(&path, &model).unwrap_err());
        assert!(refusal.contains("not those of model `"), "{refusal}");
    }
}
