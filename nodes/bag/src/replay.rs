//! Replays a bag into the graph.
#![allow(clippy::disallowed_methods, reason = "replaying follows the wall clock")]

mod arm_watch;
mod player;
mod settings;

use crate::error::BagError;
use crate::kinds;
use crate::reader::{BagReader, Topic};
use arm_watch::{ArmWatch, refuse_two_arms};
use catenary_msgs::Interface;
use catenary_msgs::msg::ArmState;
use catenary_msgs::rosgraph_msgs::msg::Clock;
use catenary_shell::{Node, list_peers};
use player::Player;
pub use settings::ReplaySettings;
use std::time::Duration;

/// How long the last messages have to reach reliable subscribers.
const LINGER: Duration = Duration::from_millis(500);

/// What was replayed.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ReplaySummary {
    /// Messages that were published.
    pub published: u64,
    /// Messages that could not be, or were not readable, each with a warning; of a damaged chunk nobody knows how many, and it
    /// counts once.
    pub failed: u64,
    /// Topics that were left out, and why.
    pub left_out: Vec<String>,
}

/// Publishes a bag's messages in time, as they were recorded and with the profiles that were offered then, until its end
/// or until the node is told to end.
///
/// Never with a real arm in the graph, as far as its bridge tells of it: that it is there, or comes, ends the replay. What may
/// command an arm, by its name, is left out unless [`ReplaySettings::allow_replay`] says otherwise.
///
/// # Errors
/// [`BagError`]: settings, a bag that is none or has nothing to replay, the graph, [`BagError::Refused`].
pub fn replay(node: &Node, settings: &ReplaySettings) -> Result<ReplaySummary, BagError> {
    let bag = settings.open()?;
    for note in bag.notes() {
        tracing::warn!("{note}");
    }
    let mut summary = ReplaySummary::default();
    let chosen = choose(node, &bag, settings, &mut summary.left_out)?;
    for left_out in &summary.left_out {
        tracing::warn!("not replayed: {left_out}");
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
        if summary.published == published {
            let expected = "messages to publish between the start and the end of what is played".to_owned();
            return Err(BagError::Setting { name: "loop", expected, got: "none".to_owned() });
        }
        published = summary.published;
    }
    node.shutdown().wait_timeout(LINGER);
    Ok(summary)
}

/// Fails where somebody publishes a time, or what an arm or a camera measures, that is to be replayed: nobody could tell
/// the two apart. What is computed from that may come from both.
fn refuse_others(node: &Node, topics: &[&Topic], settings: &ReplaySettings) -> Result<(), BagError> {
    let measured = |name: &&str| ["/panda/", "/camera/"].iter().any(|part| name.contains(part)) || *name == "/clock";
    let clock = settings.clock_hz.map(|_| "/clock");
    let mut taken = Vec::new();
    for name in topics.iter().map(|t| t.name.as_str()).chain(clock) {
        let played = node.resolve(name)?;
        if measured(&played.as_str()) && !is_command(node, name)? && node.publisher_count(name)? > 0 {
            taken.push(format!("{played} ({})", list_peers(&node.publishers(name)?)));
        }
    }
    match taken.is_empty() {
        true => Ok(()),
        false => Err(BagError::Refused(format!(
            "others publish {} now, and nobody could tell theirs from the bag's; end them, replay in another \
             ROS_DOMAIN_ID, or allow_others",
            taken.join(", ")
        ))),
    }
}

/// The topics to replay; what is left out is said in words.
fn choose<'a>(
    node: &Node,
    bag: &'a BagReader,
    settings: &ReplaySettings,
    left_out: &mut Vec<String>,
) -> Result<Vec<&'a Topic>, BagError> {
    let mut chosen: Vec<&Topic> = Vec::new();
    for entry in bag.topics() {
        let topic: &Topic = &entry.topic;
        if !settings.takes(topic) {
            continue;
        }
        let reason = if settings.clock_hz.is_some() && topic.type_name == Clock::TYPE_NAME {
            Some("/clock is made in step with the bag".to_owned())
        } else if let Err(error) = node.resolve(&topic.name) {
            Some(error.to_string())
        } else if is_command(node, &topic.name)? && !settings.allow_replay {
            Some("it commands an arm, and allow_replay is false".to_owned())
        } else if let Some(other) = chosen.iter().find(|other| other.name == topic.name) {
            Some(format!("it is of type {}, and another topic of that name of {}", topic.type_name, other.type_name))
        } else {
            unplayable(topic)
        };
        match reason {
            Some(reason) => left_out.push(format!("{}: {reason}", topic.name)),
            None => chosen.push(topic),
        }
    }
    if chosen.is_empty() {
        return Err(BagError::NoTopic {
            path: bag.path().to_owned(),
            needed: "a topic to replay".to_owned(),
            found: match left_out.as_slice() {
                [] => bag.describe_topics(),
                reasons => format!("{}; left out: {}", bag.describe_topics(), reasons.join("; ")),
            },
        });
    }
    Ok(chosen)
}

/// Why messages of a topic cannot be published; none: they can.
fn unplayable(topic: &Topic) -> Option<String> {
    match kinds::find(&topic.type_name) {
        Some(kind) => kind.check(topic).err().map(|e| e.to_string()),
        None if topic.type_name.split('/').nth(1) != Some("msg") => {
            Some(format!("its type {:?} is no message's", topic.type_name))
        }
        None if topic.encoding != "cdr" => Some(format!("its messages are in {}, not in cdr", topic.encoding)),
        None => None,
    }
}

/// Names under which arms take commands: ours, and those of the ROS 2 controllers behind the relay.
const COMMANDS: [&str; 3] = ["target_pose", "target_joint", "target_wrench"];

/// Whether an arm may follow what is published under this name, before or after remapping, in any namespace.
fn is_command(node: &Node, name: &str) -> Result<bool, BagError> {
    let commands = |name: &str| name.rsplit('/').next().is_some_and(|last| COMMANDS.contains(&last));
    Ok(commands(name) || commands(&node.resolve(name)?))
}
