//! Arguments of `node`.

use clap::Args;

/// `catenary node`.
#[derive(Debug, Args)]
pub struct NodeArgs {
    /// Name of the node; without one, all nodes are listed
    pub name: Option<String>,
    /// Arguments of the node
    #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
    pub arguments: Vec<String>,
}
