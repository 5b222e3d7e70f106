//! Files and values that a command line names: models, policies, posteriors, actions and parameter values.

pub mod actions_file;
pub mod model_file;
pub mod parameter_values;
pub mod policy_file;
pub mod posterior_file;
pub mod shipped;
