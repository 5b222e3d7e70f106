//! Replay of a bag into the graph.
#![allow(clippy::disallowed_methods, reason = "replaying follows the wall clock")]

mod arm_watch;
mod choice;
mod player;
mod settings;

use crate::error::BagError;
use crate::latched::latched_elsewhere;
use arm_watch::{ArmWatch, refuse_two_arms};
use catenary_msgs::Interface;
use catenary_msgs::msg::ArmState;
use catenary_shell::Node;
use choice::{choose, is_command, refuse_others};
use player::Player;
pub use player::ReplaySummary;
pub use settings::ReplaySettings;
use std::time::Duration;

/// Time for the last messages to reach reliable subscribers.
const LINGER: Duration = Duration::from_millis(500);

/// Publishes a bag's messages at their recorded times and with the profiles that were offered then, until the end of
/// the bag or the shutdown of the node.
///
/// A real arm in the graph, as reported by its bridge, prevents or ends a replay. Topics that may command an arm, by
/// their names, are left out unless [`ReplaySettings::allow_replay`] is set.
///
/// # Errors
/// [`BagError`]: settings, a path without a bag, a bag with nothing to replay, the graph, [`BagError::Refused`].
pub fn replay(node: &Node, settings: &ReplaySettings) -> Result<ReplaySummary, BagError> {
    let bag = settings.open()?;
    for note in bag.notes().iter().chain(bag.far_notes()).chain(&latched_elsewhere(&bag)) {
        tracing::warn!("{note}");
    }
    let mut summary = ReplaySummary::default();
    // Choices come before any publisher exists: a refused replay must not appear in the graph.
    let chosen = choose(node, &bag, settings, &mut summary.left_out)?;
    for left_out in &summary.left_out {
        tracing::warn!("not replayed: {left_out}");
    }
    for name in settings.overrides.topics().filter(|name| chosen.iter().all(|topic| topic.name != *name)) {
        tracing::warn!("{name}: its QoS override has no effect, because the topic is not replayed");
    }
    let states = chosen.iter().filter(|t| t.type_name == ArmState::TYPE_NAME).map(|t| t.name.clone());
    let watch = ArmWatch::start(node, states.collect())?;
    watch.wait_until_safe(node)?;
    let commands = chosen.iter().map(|topic| is_command(node, &topic.name)).collect::<Result<Vec<_>, _>>()?;
    if commands.contains(&true) {
        refuse_two_arms(node)?;
    }
    if !settings.allow_others {
        refuse_others(node, &chosen, settings)?;
    }
    let mut player = Player::new(node, &bag, &chosen, settings, watch)?;
    player.wait_for_subscribers(settings.wait);
    let names: Vec<&str> = chosen.iter().map(|t| t.name.as_str()).collect();
    let mut published = 0;
    while player.play(&bag, &names, settings, &mut summary)? && settings.repeat {
        // A pass without a message would loop without a pause.
        if summary.published == published {
            let expected = "messages to publish between the start and the end of what is played".to_owned();
            return Err(BagError::Setting { name: "loop", expected, got: "none".to_owned() });
        }
        published = summary.published;
    }
    node.shutdown().wait_timeout(LINGER);
    Ok(summary)
}
