//! Quality-of-service profiles as rosbag2 stores them: a YAML list in the metadata of each topic.

use catenary_shell::Qos;
use serde::{Deserialize, Serialize};

/// rosbag2's "for ever": the greatest ns that a signed 64-bit number holds.
const FOREVER: Span = Span { sec: 9_223_372_036, nsec: 854_775_807 };

#[derive(Debug, Clone, Copy, Serialize)]
struct Span {
    sec: u64,
    nsec: u64,
}

/// One offered profile, in the words of metadata version 9.
#[derive(Debug, Clone, Copy, Serialize)]
pub(crate) struct Profile {
    history: &'static str,
    depth: u16,
    reliability: &'static str,
    durability: &'static str,
    deadline: Span,
    lifespan: Span,
    liveliness: &'static str,
    liveliness_lease_duration: Span,
    avoid_ros_namespace_conventions: bool,
}

impl From<Qos> for Profile {
    fn from(qos: Qos) -> Self {
        Self {
            history: "keep_last",
            depth: qos.depth(),
            reliability: if qos.is_reliable() { "reliable" } else { "best_effort" },
            durability: if qos.is_transient_local() { "transient_local" } else { "volatile" },
            deadline: FOREVER,
            lifespan: FOREVER,
            liveliness: "automatic",
            liveliness_lease_duration: FOREVER,
            avoid_ros_namespace_conventions: false,
        }
    }
}

/// A policy's value: a word since version 9, a number of the rmw enumeration before.
#[derive(Debug, Deserialize)]
#[serde(untagged)]
enum Word {
    Number(i64),
    Text(String),
}

impl Word {
    fn is(&self, number: i64, text: &str) -> bool {
        match self {
            Self::Number(n) => *n == number,
            Self::Text(t) => t == text,
        }
    }
}

#[derive(Debug, Deserialize)]
struct Offered {
    depth: u64,
    reliability: Word,
    durability: Word,
}

/// The profiles in the text of a topic's `offered_qos_profiles`, of any version. Whatever is neither best effort nor
/// transient local counts as reliable and volatile, as rosbag2 takes it. Text that is no such list gives none.
pub(crate) fn parse(text: &str) -> Vec<Qos> {
    let offered: Vec<Offered> = serde_saphyr::from_str(text).unwrap_or_default();
    let qos = |o: Offered| {
        // Discovery does not carry the depth: other recorders write 0.
        let depth = u16::try_from(o.depth).unwrap_or(u16::MAX);
        let depth = if depth == 0 { Qos::DEFAULT.depth() } else { depth };
        match (o.reliability.is(2, "best_effort"), o.durability.is(1, "transient_local")) {
            (true, _) => Qos::BestEffort { depth },
            (false, true) => Qos::ReliableTransientLocal { depth },
            (false, false) => Qos::Reliable { depth },
        }
    };
    offered.into_iter().map(qos).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn written_profiles_are_read_back() {
        for qos in
            [Qos::BestEffort { depth: 5 }, Qos::Reliable { depth: 10 }, Qos::ReliableTransientLocal { depth: 16 }]
        {
            let text = serde_saphyr::to_string(&[Profile::from(qos)]).unwrap();
            assert_eq!(parse(&text), [qos], "{text}");
        }
    }

    #[test]
    fn numbers_of_older_versions_are_understood() {
        let text = "- history: 3\n  depth: 0\n  reliability: 1\n  durability: 1\n  deadline:\n    sec: 9223372036\n    nsec: 854775807\n\
                    - history: 1\n  depth: 7\n  reliability: 2\n  durability: 2\n";
        let expected = [Qos::ReliableTransientLocal { depth: 10 }, Qos::BestEffort { depth: 7 }];
        assert_eq!(parse(text), expected);
        assert_eq!(parse(""), []);
        assert_eq!(parse("nonsense: ["), []);
    }
}
