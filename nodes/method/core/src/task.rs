//! Task of the policy: bring the object to the target, inside the workspace.

mod anchor;
mod definition;
mod judge;
mod reward;

pub use definition::{
    DeltaAnchor, Goal, MAX_DELTA_M, MAX_LEAD_M, MOST_STEPS, REWARD_RANGE_M, STEP_PERIOD_S, Task, Workspace,
};
pub use judge::{Judge, Moment, Phase, Referee, Score, Verdict};
pub use reward::{LEFT_WORKSPACE_REWARD, reward};
