//! Quality-of-service profiles in the form of rosbag2: a YAML list in the metadata of each topic.

use catenary_shell::Qos;
use serde::{Deserialize, Serialize};

/// Depth that replaces a history that keeps all, because every [`Qos`] has a finite depth.
pub(crate) const KEEP_ALL: u16 = 4096;

/// Infinite duration of rosbag2: the greatest ns of a signed 64-bit number.
const FOREVER: Span = Span { sec: 9_223_372_036, nsec: 854_775_807 };

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
struct Span {
    sec: u64,
    nsec: u64,
}

/// Offered profile in the words of metadata version 9.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub(crate) struct Profile {
    history: String,
    depth: u64,
    reliability: String,
    durability: String,
    deadline: Span,
    lifespan: Span,
    liveliness: String,
    liveliness_lease_duration: Span,
    avoid_ros_namespace_conventions: bool,
}

impl From<Qos> for Profile {
    fn from(qos: Qos) -> Self {
        Self {
            history: "keep_last".to_owned(),
            depth: qos.depth().into(),
            reliability: if qos.is_reliable() { "reliable" } else { "best_effort" }.to_owned(),
            durability: if qos.is_transient_local() { "transient_local" } else { "volatile" }.to_owned(),
            deadline: FOREVER,
            lifespan: FOREVER,
            liveliness: "automatic".to_owned(),
            liveliness_lease_duration: FOREVER,
            avoid_ros_namespace_conventions: false,
        }
    }
}

impl Profile {
    /// Part of the profile that this crate applies. Values other than best effort and transient local count as reliable
    /// and volatile, as in rosbag2.
    pub(crate) fn qos(&self) -> Qos {
        // Discovery does not carry the depth, so other recorders write 0.
        let depth = match (self.history.as_str(), self.depth) {
            ("keep_all", _) => KEEP_ALL,
            (_, 0) => Qos::DEFAULT.depth(),
            (_, depth) => u16::try_from(depth).unwrap_or(u16::MAX),
        };
        match (self.reliability.as_str(), self.durability.as_str()) {
            ("best_effort", _) => Qos::BestEffort { depth },
            (_, "transient_local") => Qos::ReliableTransientLocal { depth },
            _ => Qos::Reliable { depth },
        }
    }
}

/// Words for the numbers of the rmw enumerations: before version 9, files held numbers.
const HISTORIES: &[&str] = &["system_default", "keep_last", "keep_all"];
const RELIABILITIES: &[&str] = &["system_default", "reliable", "best_effort", "unknown", "best_available"];
const DURABILITIES: &[&str] = &["system_default", "transient_local", "volatile", "unknown", "best_available"];
const LIVELINESSES: &[&str] =
    &["system_default", "automatic", "unknown", "manual_by_topic", "unknown", "best_available"];

/// Value of a policy: a word or a number.
#[derive(Debug, Deserialize)]
#[serde(untagged)]
enum Word {
    Number(i64),
    Text(String),
}

impl Word {
    fn text(self, words: &[&str]) -> String {
        match self {
            Self::Number(n) => usize::try_from(n).ok().and_then(|n| words.get(n)).unwrap_or(&"unknown").to_string(),
            Self::Text(text) => text,
        }
    }
}

#[derive(Debug, Deserialize)]
struct Offered {
    #[serde(default)]
    history: Option<Word>,
    depth: u64,
    reliability: Word,
    durability: Word,
    #[serde(default)]
    deadline: Option<Span>,
    #[serde(default)]
    lifespan: Option<Span>,
    #[serde(default)]
    liveliness: Option<Word>,
    #[serde(default)]
    liveliness_lease_duration: Option<Span>,
    #[serde(default)]
    avoid_ros_namespace_conventions: bool,
}

impl From<Offered> for Profile {
    fn from(o: Offered) -> Self {
        Self {
            history: o.history.map_or_else(|| "keep_last".to_owned(), |w| w.text(HISTORIES)),
            depth: o.depth,
            reliability: o.reliability.text(RELIABILITIES),
            durability: o.durability.text(DURABILITIES),
            deadline: o.deadline.unwrap_or(FOREVER),
            lifespan: o.lifespan.unwrap_or(FOREVER),
            liveliness: o.liveliness.map_or_else(|| "automatic".to_owned(), |w| w.text(LIVELINESSES)),
            liveliness_lease_duration: o.liveliness_lease_duration.unwrap_or(FOREVER),
            avoid_ros_namespace_conventions: o.avoid_ros_namespace_conventions,
        }
    }
}

/// Parses the text of a topic's `offered_qos_profiles`, of any version. Text that is no such list gives no profiles.
pub(crate) fn parse(text: &str) -> Vec<Profile> {
    let offered: Vec<Offered> = serde_saphyr::from_str(text).unwrap_or_default();
    offered.into_iter().map(Profile::from).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn qos(text: &str) -> Vec<Qos> {
        parse(text).iter().map(Profile::qos).collect()
    }

    #[test]
    fn written_profiles_are_read_back() {
        for given in
            [Qos::BestEffort { depth: 5 }, Qos::Reliable { depth: 10 }, Qos::ReliableTransientLocal { depth: 16 }]
        {
            let text = serde_saphyr::to_string(&[Profile::from(given)]).unwrap();
            assert_eq!(qos(&text), [given], "{text}");
        }
    }

    #[test]
    fn numbers_of_older_versions_are_understood() {
        let text = "- history: 3\n  depth: 0\n  reliability: 1\n  durability: 1\n  deadline:\n    sec: 9223372036\n    nsec: 854775807\n\
                    - history: 1\n  depth: 7\n  reliability: 2\n  durability: 2\n\
                    - history: 2\n  depth: 0\n  reliability: 1\n  durability: 2\n";
        let expected = [
            Qos::ReliableTransientLocal { depth: 10 },
            Qos::BestEffort { depth: 7 },
            Qos::Reliable { depth: KEEP_ALL },
        ];
        assert_eq!(qos(text), expected);
        assert_eq!(qos(""), []);
        assert_eq!(qos("nonsense: ["), []);
    }

    #[test]
    fn policies_that_are_not_applied_are_still_stored() {
        let old = "- history: 2\n  depth: 0\n  reliability: 1\n  durability: 2\n  deadline:\n    sec: 1\n    nsec: 2\n  \
                   lifespan:\n    sec: 3\n    nsec: 4\n  liveliness: 3\n  liveliness_lease_duration:\n    sec: 5\n    nsec: 6\n  \
                   avoid_ros_namespace_conventions: true\n";
        let new = old.replace("history: 2", "history: keep_all").replace("reliability: 1", "reliability: reliable");
        let new = new
            .replace("durability: 2", "durability: volatile")
            .replace("liveliness: 3", "liveliness: manual_by_topic");
        assert_eq!(serde_saphyr::to_string(&parse(old)).unwrap(), new);
        assert_eq!(parse(old), parse(&new));
    }
}
