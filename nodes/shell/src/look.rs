//! A short look at a domain: which ROS 2 nodes are there, without a node of one's own.

use crate::error::ShellError;
use crate::participant::Participation;
use crate::settle::settle;
use ros2_client::builtin_topics::ros_discovery::{TOPIC_NAME, TYPE_NAME};
use ros2_client::entities_info::ParticipantEntitiesInfo;
use rustdds::policy::{Durability, History, Reliability};
use rustdds::{Duration as DdsDuration, QosPolicyBuilder, TopicKind};
use std::collections::{BTreeMap, BTreeSet};
use std::time::{Duration, Instant};

/// How often what came is taken in.
const LOOK: Duration = Duration::from_millis(50);

/// Absolute names of the nodes that answer within `time` in the domain of the environment, in order. Nodes of this process
/// are among them.
///
/// # Errors
/// [`ShellError`]: environment variables, the middleware.
pub fn nodes_in_domain(time: Duration) -> Result<Vec<String>, ShellError> {
    let (participation, _) = Participation::from_environment(&|name| std::env::var(name).ok())?;
    let participant = participation.join()?;
    settle(&participant);
    let failed = |error: &dyn std::fmt::Display| ShellError::create(format!("reader of {TOPIC_NAME}"), error);
    let qos = QosPolicyBuilder::new()
        .durability(Durability::TransientLocal)
        .reliability(Reliability::Reliable { max_blocking_time: DdsDuration::ZERO })
        // Of each participant its last word counts, and a domain may have many.
        .history(History::KeepAll)
        .build();
    let topic = participant.create_topic(TOPIC_NAME.to_owned(), TYPE_NAME.to_owned(), &qos, TopicKind::NoKey);
    let topic = topic.map_err(|error| failed(&error))?;
    let subscriber = participant.create_subscriber(&qos).map_err(|error| failed(&error))?;
    let reader = subscriber.create_datareader_no_key_cdr::<ParticipantEntitiesInfo>(&topic, Some(qos));
    let mut reader = reader.map_err(|error| failed(&error))?;
    let mut nodes = BTreeMap::new();
    let end = Instant::now() + time;
    while Instant::now() < end {
        std::thread::sleep(LOOK);
        // A message that is none tells nothing of the others.
        while let Ok(Some(sample)) = reader.take_next_sample() {
            let names = sample.value().nodes().iter().map(|node| path(node.namespace(), node.name()));
            nodes.insert(sample.value().gid(), names.collect::<Vec<_>>());
        }
    }
    let names: BTreeSet<String> = nodes.into_values().flatten().collect();
    Ok(names.into_iter().collect())
}

fn path(namespace: &str, name: &str) -> String {
    match namespace.trim_end_matches('/') {
        "" => format!("/{name}"),
        namespace => format!("/{}/{name}", namespace.trim_start_matches('/')),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_absolute() {
        assert_eq!(
            [path("/", "a"), path("", "a"), path("/lab", "a"), path("lab/", "a")],
            ["/a", "/a", "/lab/a", "/lab/a"]
        );
    }
}
