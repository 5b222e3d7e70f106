//! Task in a file of its own, which replaces that of a model.

use super::outline::Node;
use super::{ArmLaw, Model, ModelError, check};
use crate::Task;
use serde::Deserialize;

/// Task of a file of its own: the same object, seen by the same camera, with another aim.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TaskFile {
    /// Task, as a model file has it.
    pub task: Task,
    /// Law of the arm, if the task needs another than the model's, such as a faster one.
    #[serde(default)]
    pub arm_law: Option<ArmLaw>,
}

impl TaskFile {
    /// Reads and checks the text of a task file.
    ///
    /// # Errors
    /// [`ModelError`] with line and field.
    pub fn from_yaml(text: &str) -> Result<Self, ModelError> {
        let options = serde_saphyr::options! { with_snippet: false };
        let read = serde_saphyr::from_str_with_options(text, options);
        let file: Self = read.map_err(|e| ModelError::from_yaml(&e, text, Node::of(text).as_ref()))?;
        let law = || file.arm_law.as_ref().map_or(Ok(()), check::arm_law);
        // A task file has the law at its top.
        let law = || law().map_err(|e| e.with_field(|field| field.replacen("arm.law", "arm_law", 1)));
        check::task(&file.task).and_then(|()| law()).map_err(|e| e.in_text(text))?;
        Ok(file)
    }

    /// The model with this task in place of its own.
    #[must_use]
    pub fn applied_to(&self, model: &Model) -> Model {
        let mut model = Model { task: Some(self.task), ..model.clone() };
        if let Some(law) = self.arm_law {
            model.arm.law = law;
        }
        model
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "task:\n  goal: {settle: {reward_range_m: 0.2}}\n  steps: 4\n  rest_steps: 8\n  step_period_s: 0.25\n  \
                        delta_anchor: last_target\n  target_m: [0.5, 0.1]\n  target_jitter_m: 0.0\n";

    #[test]
    fn a_task_file_replaces_the_task_and_the_law_that_it_gives() {
        let text = include_str!("../../../../../launch_configs/models/soft_bar.yaml");
        let model = Model::from_yaml(text).unwrap();
        let file = TaskFile::from_yaml(TEXT).unwrap();
        let settled = file.applied_to(&model);
        assert_eq!(settled.task, Some(file.task));
        assert_eq!((settled.task.unwrap().all_steps(), settled.arm), (12, model.arm));
        let fast = format!("{TEXT}arm_law: {{lag: {{time_constant_s: 0.08, max_speed_m_s: 1.5}}}}\n");
        let fast = TaskFile::from_yaml(&fast).unwrap().applied_to(&model);
        assert_eq!(fast.arm.law, ArmLaw::Lag { time_constant_s: 0.08, max_speed_m_s: 1.5 });
    }

    #[test]
    fn errors_name_line_and_field() {
        for (from, to, words) in [
            (
                "rest_steps: 8",
                "rest_steps: 1",
                "line 4, `task.rest_steps`: expected at least 2 for the goal `settle`, got 1",
            ),
            (
                "reward_range_m: 0.2",
                "reward_range_m: 0",
                "`task.goal.settle.reward_range_m`: expected 0.001 to 10 m, got 0",
            ),
            ("settle:", "setle:", "setle"),
            ("  steps: 4\n", "  steps: 200000\n", "`task.steps`: expected at most 100000 steps in all, got 200000"),
            ("  steps: 4\n", "", "steps"),
        ] {
            let error = TaskFile::from_yaml(&TEXT.replace(from, to)).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        }
        let slow = format!("{TEXT}arm_law: {{lag: {{time_constant_s: -1.0, max_speed_m_s: 1.5}}}}\n");
        let error = TaskFile::from_yaml(&slow).unwrap_err().to_string();
        assert!(error.starts_with("line 9, `arm_law.lag.time_constant_s`"), "{error}");
        let ends = format!("{TEXT}  ends_at_success: true\n");
        let error = TaskFile::from_yaml(&ends).unwrap_err().to_string();
        assert!(error.contains("`task.ends_at_success`: expected false, or the goal `reach`"), "{error}");
    }
}
