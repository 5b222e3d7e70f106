//! Options `--node` and `--wait-s` of commands that the running graph can execute.

use clap::Args;

/// Options of commands that the running graph can execute.
#[derive(Debug, Args)]
pub struct OnGraph {
    /// Let the running graph do the work; its nodes are in this namespace
    #[arg(long, value_name = "NAMESPACE", num_args = 0..=1, require_equals = true, default_missing_value = "/")]
    pub node: Option<String>,
    /// Seconds to wait for the graph
    #[arg(long, default_value_t = 10.0, allow_negative_numbers = true, requires = "node")]
    pub wait_s: f64,
}
