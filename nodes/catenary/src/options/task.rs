//! Option for the task of a policy.

use crate::exit::Given;
use crate::inputs::shipped::Kind;
use anyhow::{Context, Result};
use catenary_core::Model;
use catenary_core::model::TaskFile;
use clap::Args;
use std::path::PathBuf;

/// Task in place of the model's.
#[derive(Debug, Args)]
pub struct TaskOption {
    /// Task (file or name: reach, place_tip, settle, settle_fast, whip, lay); default: the model's
    #[arg(long)]
    pub task: Option<PathBuf>,
}

impl TaskOption {
    /// The model with the task that was asked for, or as it is.
    pub fn applied_to(&self, model: Model) -> Result<Model> {
        let Some(path) = &self.task else { return Ok(model) };
        let read = || {
            let text = Kind::Task.text(path)?;
            TaskFile::from_yaml(&text).with_context(|| format!("task {}", path.display()))
        };
        Ok(read().given()?.applied_to(&model))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inputs::model_file::read_or_soft_bar;
    use std::path::Path;

    #[test]
    fn every_shipped_task_reads_and_its_name_is_that_of_its_goal() {
        let names: Vec<&str> = Kind::Task.all().map(|(name, _)| name).collect();
        assert_eq!(names.len(), 6, "{names:?}");
        for name in names {
            let model = read_or_soft_bar(None).unwrap();
            let model = TaskOption { task: Some(name.into()) }.applied_to(model).unwrap();
            assert!(name.starts_with(model.task.unwrap().goal.name()), "{name}");
        }
    }

    #[test]
    fn the_models_task_is_kept_without_the_option_and_an_unknown_name_lists_the_tasks() {
        let model = read_or_soft_bar(None).unwrap();
        assert_eq!(TaskOption { task: None }.applied_to(model.clone()).unwrap(), model);
        // The task of the shipped model is the shipped task of its name.
        assert_eq!(TaskOption { task: Some(Path::new("reach").into()) }.applied_to(model.clone()).unwrap(), model);
        let error = TaskOption { task: Some("setle".into()) }.applied_to(model).unwrap_err().to_string();
        assert!(error.contains("shipped tasks are lay, place_tip, reach, settle, settle_fast, whip"), "{error}");
        assert!(error.ends_with("did you mean `settle`?"), "{error}");
    }
}
