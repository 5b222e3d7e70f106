//! Posterior files.

use crate::exit::Given;
use anyhow::{Context, Result, ensure};
use catenary_core::{Model, Posterior};
use ppo_trainer::Domains;
use std::path::Path;

/// Posterior of a file. Returns an error unless its parameters are those of the model. Their priors may have other bounds:
/// an inference with `--prior-support adaptive` moves them.
pub fn read(path: &Path, model: &Model) -> Result<Posterior> {
    let parse = || {
        let text = catenary_shell::files::read_text("posterior", path)?;
        let posterior: Posterior = serde_json::from_str(&text).with_context(|| path.display().to_string())?;
        ensure!(
            posterior.parameters.equals_up_to_bounds(&model.theta),
            "{}: its parameters are not those of the model",
            path.display()
        );
        Ok::<_, anyhow::Error>(posterior)
    };
    parse().given()
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
            let posterior = Posterior::prior(ParameterSpace::new(parameters).unwrap());
            std::fs::write(&path, serde_json::to_string(&posterior).unwrap()).unwrap();
            posterior
        };
        let moved = written(|p| p.prior = p.prior.with_bounds(0.195, 0.36).unwrap());
        assert_eq!(read(&path, &model).unwrap(), moved);
        assert!(matches!(domains(Some(&path), &model).unwrap(), Domains::Mixture(read) if read == moved));
        written(|p| p.name = "mass_kg".into());
        let refusal = format!("{:#}", read(&path, &model).unwrap_err());
        assert!(refusal.contains("not those of the model"), "{refusal}");
    }
}
