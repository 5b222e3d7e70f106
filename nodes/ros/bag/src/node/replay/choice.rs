//! Choice of the topics to replay, and the topics on which an arm takes commands.

use super::settings::ReplaySettings;
use crate::error::BagError;
use crate::node::kinds;
use crate::reader::{BagReader, Topic};
use catenary_msgs::Interface;
use catenary_msgs::rosgraph_msgs::msg::Clock;
use catenary_shell::{Node, list_peers};

/// Fails if another node publishes `/clock`, or measurements of an arm or a camera, that are to be replayed:
/// subscribers could not tell the two apart. Topics computed from measurements may come from both.
pub(super) fn refuse_others(node: &Node, topics: &[&Topic], settings: &ReplaySettings) -> Result<(), BagError> {
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
            "others publish {} now, and subscribers could not tell their messages from the bag's; stop them, replay in another \
             ROS_DOMAIN_ID, or set allow_others",
            taken.join(", ")
        ))),
    }
}

/// Chooses the topics to replay. Topics that are left out are appended to `left_out` with the reason.
pub(super) fn choose<'a>(
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

/// Reason for which messages of a topic cannot be published; none if they can.
fn unplayable(topic: &Topic) -> Option<String> {
    match kinds::find(&topic.type_name) {
        _ if topic.encoding != "cdr" => Some(format!("expected messages in cdr, got {}", topic.describe_type())),
        Some(kind) => kind.check(topic).err().map(|error| match error {
            BagError::Type { expected, found, .. } => format!("expected {expected}, found {found}"),
            other => other.to_string(),
        }),
        None if topic.type_name.split('/').nth(1) != Some("msg") => {
            Some(format!("its type {:?} is no message's", topic.type_name))
        }
        None => None,
    }
}

/// Last parts of the names under which arms take commands: those of this project, and those of the ROS 2 controllers
/// behind the relay.
const COMMANDS: [&str; 3] = ["target_pose", "target_joint", "target_wrench"];

/// True if an arm may follow messages on this topic, before or after remapping, in any namespace.
pub(super) fn is_command(node: &Node, name: &str) -> Result<bool, BagError> {
    let commands = |name: &str| name.rsplit('/').next().is_some_and(|last| COMMANDS.contains(&last));
    Ok(commands(name) || commands(&node.resolve(name)?))
}
