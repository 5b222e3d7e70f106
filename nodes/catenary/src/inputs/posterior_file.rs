//! Posterior files.

use crate::exit::Given;
use anyhow::{Context, Result, ensure};
use catenary_core::{Model, Posterior};
use ppo_trainer::Domains;
use std::path::Path;

/// Posterior of a file. Returns an error unless its parameters are those of the model.
pub fn read(path: &Path, model: &Model) -> Result<Posterior> {
    let parse = || {
        let text = catenary_shell::files::read_text("posterior", path)?;
        let posterior: Posterior = serde_json::from_str(&text).with_context(|| path.display().to_string())?;
        ensure!(posterior.parameters == model.theta, "{}: its parameters are not those of the model", path.display());
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
