//! Law that the arm of the running graph announces.

use super::DISCOVERY_TIME;
use crate::launch::running_launch;
use anyhow::{Context, Result};
use catenary_core::model::ArmLaw;
use catenary_msgs::std_msgs::msg::String as Text;
use catenary_shell::{Latest, Node, NodeBuilder, Peer, RosArgs, contract, list_peers};
use std::fmt;
use std::time::Duration;

/// Longest wait for the message of an arm that was discovered. Chosen: latched messages come within a second, to a busy machine later.
const MESSAGE: Duration = Duration::from_secs(5);

/// Word of a graph about the law of its arm. Its display is that word as the reason of a decision.
#[derive(Debug, Clone)]
pub enum Told {
    /// Law of the arm.
    Law(ArmLaw),
    /// No node announces a law: a relay that knows none, an arm of others, or no arm.
    Nobody,
    /// This node offers the topic, and no message came in time.
    Nothing(Peer),
    /// Several nodes announce a law, so that nobody knows which is that of the arm.
    Several(Vec<Peer>),
}

impl fmt::Display for Told {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let topic = contract::ARM_LAW.name;
        match self {
            Self::Law(law) => write!(f, "the arm announces {law}"),
            Self::Nobody => write!(
                f,
                "nobody announces {topic}; a relay does so with the parameter controller.arm_law, or after set_compliance"
            ),
            Self::Nothing(peer) => {
                write!(f, "{peer} offers {topic}, but no message came within {} s", MESSAGE.as_secs())
            }
            Self::Several(peers) => write!(f, "{} announce {topic}, and one arm has one law", list_peers(peers)),
        }
    }
}

/// Word about the law of the arm in the domain of `node`, whose discovery must have ended.
///
/// # Errors
/// A text that is no law; names, the middleware.
pub fn of_graph(node: &Node) -> Result<Told> {
    within(node, MESSAGE)
}

fn within(node: &Node, wait: Duration) -> Result<Told> {
    let topic = contract::ARM_LAW;
    let mut publishers = node.publishers(topic.name)?;
    if publishers.len() > 1 {
        return Ok(Told::Several(publishers));
    }
    let Some(publisher) = publishers.pop() else { return Ok(Told::Nobody) };
    let heard: Latest<Text> = node.latest(topic.name, topic.qos)?;
    let Some(received) = heard.wait_newer(0, wait) else { return Ok(Told::Nothing(publisher)) };
    ArmLaw::from_text(&received.message.data).map(Told::Law).with_context(|| heard.topic().to_owned())
}

/// Word about the law of the arm in the domain of the environment.
///
/// # Errors
/// As [`of_graph`]; the environment, the middleware.
pub fn of_domain() -> Result<Told> {
    let node = NodeBuilder::new("look", &RosArgs::default())?.build()?;
    let _everybody = node.look_around(DISCOVERY_TIME);
    let told = of_graph(&node);
    // It must not stay visible to the graph while this process works.
    node.stop();
    told
}

/// Word about the law of the arm of a launch on this machine, with the launch file. None if no launch runs.
///
/// # Errors
/// As [`of_domain`].
pub fn of_launch() -> Result<Option<(Told, String)>> {
    let Some(file) = running_launch() else { return Ok(None) };
    Ok(Some((of_domain()?, file.display().to_string())))
}

#[cfg(test)]
#[allow(clippy::disallowed_methods, reason = "the test of a graph waits for its discovery")]
mod tests {
    use super::*;
    use catenary_shell::{Discovery, DomainClaim, Publisher};
    use std::time::Instant;

    #[test]
    fn no_publisher_a_silent_one_a_law_and_two_publishers_are_told_apart() {
        let domain = DomainClaim::any(|_| Ok(true)).unwrap();
        let node = |name: &str| {
            let builder = NodeBuilder::new(name, &RosArgs::default()).unwrap();
            builder.domain(domain.id(), Discovery::Localhost).build().unwrap()
        };
        let offer =
            |node: &Node| -> Publisher<Text> { node.publisher(contract::ARM_LAW.name, contract::ARM_LAW.qos).unwrap() };
        let (look, relay, other) = (node("look"), node("relay"), node("other"));
        let found = |count: usize| {
            let start = Instant::now();
            while look.publishers(contract::ARM_LAW.name).unwrap().len() < count {
                assert!(start.elapsed() < Duration::from_secs(20), "{count} publishers within 20 s");
                std::thread::sleep(Duration::from_millis(20));
            }
        };
        assert!(matches!(within(&look, Duration::ZERO).unwrap(), Told::Nobody));
        let first = offer(&relay);
        found(1);
        let told = within(&look, Duration::from_millis(300)).unwrap();
        assert!(matches!(told, Told::Nothing(_)) && told.to_string().contains("no message came"), "{told}");
        let law = ArmLaw::Lag { time_constant_s: 0.1, max_speed_m_s: 0.5 };
        first.send(Text { data: law.to_text() });
        let Told::Law(heard) = of_graph(&look).unwrap() else { panic!("the relay told its law") };
        assert_eq!(heard, law);
        let _second = offer(&other);
        found(2);
        let words = of_graph(&look).unwrap().to_string();
        assert!(words.contains("relay") && words.contains("other") && words.contains("one arm has one law"), "{words}");
    }
}
