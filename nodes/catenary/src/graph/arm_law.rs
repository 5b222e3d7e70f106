//! Law that the arm of the running graph announces.

use super::DISCOVERY_TIME;
use crate::launch::running_launch;
use anyhow::{Context, Result};
use catenary_core::model::ArmLaw;
use catenary_msgs::std_msgs::msg::String as Text;
use catenary_shell::{Latest, Node, NodeBuilder, RosArgs, contract};
use std::time::Duration;

/// Longest wait for the message of an arm that was discovered. Chosen: latched messages come within a second, to a busy machine later.
const MESSAGE: Duration = Duration::from_secs(5);

/// Law of the arm in the domain of `node`, whose discovery must have ended. None if no arm announces one: a relay whose controller's law is
/// unknown, or an arm of others.
///
/// # Errors
/// An arm that has not told its law in time, or a text that is no law.
pub fn of_graph(node: &Node) -> Result<Option<ArmLaw>> {
    let topic = contract::ARM_LAW;
    if node.publishers(topic.name)?.is_empty() {
        return Ok(None);
    }
    let heard: Latest<Text> = node.latest(topic.name, topic.qos)?;
    // A relay announces a law only once it knows one, and its topic exists from the start.
    let Some(received) = heard.wait_newer(0, MESSAGE) else { return Ok(None) };
    ArmLaw::from_text(&received.message.data).map(Some).with_context(|| heard.topic().to_owned())
}

/// Law of the arm in the domain of the environment.
///
/// # Errors
/// As [`of_graph`]; the environment, the middleware.
pub fn of_domain() -> Result<Option<ArmLaw>> {
    let node = NodeBuilder::new("look", &RosArgs::default())?.build()?;
    let _everybody = node.look_around(DISCOVERY_TIME);
    let law = of_graph(&node);
    // It must not stay visible to the graph while this process works.
    node.stop();
    law
}

/// Law of the arm of a launch on this machine, with the launch file. None if no launch runs, or its arm tells none.
///
/// # Errors
/// As [`of_domain`].
pub fn of_launch() -> Result<Option<(ArmLaw, String)>> {
    let Some(file) = running_launch() else { return Ok(None) };
    Ok(of_domain()?.map(|law| (law, file.display().to_string())))
}
