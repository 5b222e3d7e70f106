//! Node of `record` and `replay`.

use anyhow::Result;
use catenary_shell::{Node, NodeBuilder, RosArgs};

/// A node of this process that shuts down on Ctrl-C.
pub fn node(name: &str, arguments: &RosArgs) -> Result<Node> {
    let builder = NodeBuilder::new(name, arguments)?;
    catenary_shell::end_on_signals(builder.shutdown())?;
    Ok(builder.build()?)
}
