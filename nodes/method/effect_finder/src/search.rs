//! Search for missing effects: its steps, and their progress.

mod calibrate;
mod contenders;
mod context;
mod correction;
mod elsewhere;
mod explain;
mod find;
mod missing;
mod naming;
mod priors;
mod progress;
mod question;
mod rivals;
mod template_groups;
mod unlike;
mod validation;
mod with_discrepancy;

pub use find::find;
pub use progress::{OnProgress, Progress, Stage};
pub use question::Question;
