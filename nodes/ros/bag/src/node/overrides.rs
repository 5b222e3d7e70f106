//! QoS overrides: profiles by topic from a file in the format of `ros2 bag --qos-profile-overrides-path`.

use crate::error::BagError;
use crate::format::profile::KEEP_ALL;
use catenary_shell::Qos;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::Path;

/// Overrides of the profiles of topics.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct QosOverrides {
    by_topic: BTreeMap<String, Override>,
}

#[derive(Debug, Clone, Default, PartialEq, Eq)]
struct Override {
    depth: Option<u16>,
    is_reliable: Option<bool>,
    is_latched: Option<bool>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Profile {
    #[serde(default)]
    history: Option<String>,
    #[serde(default)]
    depth: Option<u64>,
    #[serde(default)]
    reliability: Option<String>,
    #[serde(default)]
    durability: Option<String>,
    #[serde(default)]
    liveliness: Option<String>,
    #[serde(default)]
    deadline: Option<Span>,
    #[serde(default)]
    lifespan: Option<Span>,
    #[serde(default)]
    liveliness_lease_duration: Option<Span>,
    #[serde(default)]
    avoid_ros_namespace_conventions: Option<bool>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Span {
    sec: u64,
    nsec: u64,
}

impl Span {
    /// True for the values with which rosbag2 writes "infinite" and "unspecified".
    fn is_unlimited(&self) -> bool {
        // DDS writes an infinite duration as 2^31 - 1 s; that of rosbag2 is longer.
        (self.sec, self.nsec) == (0, 0) || self.sec >= 2_147_483_647
    }
}

impl QosOverrides {
    /// Reads the file at `path`.
    ///
    /// # Errors
    /// [`BagError::Overrides`] naming file, topic and policy.
    #[allow(clippy::disallowed_methods, reason = "the file is what is asked for")]
    pub fn read(path: &Path) -> Result<Self, BagError> {
        let wrong = |reason: String| BagError::Overrides { path: path.to_owned(), reason };
        let text = std::fs::read_to_string(path).map_err(|e| wrong(format!("cannot be read: {e}")))?;
        Self::parse(&text).map_err(wrong)
    }

    /// Parses the text of a file. The error names topic and policy.
    fn parse(text: &str) -> Result<Self, String> {
        let profiles: BTreeMap<String, Profile> =
            serde_saphyr::from_str(text).map_err(|e| e.to_string().lines().next().unwrap_or_default().to_owned())?;
        let mut by_topic = BTreeMap::new();
        for (topic, profile) in profiles {
            if !topic.starts_with('/') {
                return Err(format!("{topic}: expected a topic's absolute name such as /dlo/keypoints"));
            }
            let changed = profile.changes().map_err(|reason| format!("{topic}: {reason}"))?;
            by_topic.insert(topic, changed);
        }
        Ok(Self { by_topic })
    }

    /// Topics with an override.
    pub fn topics(&self) -> impl Iterator<Item = &str> {
        self.by_topic.keys().map(String::as_str)
    }

    /// Applies the override of `topic` to `qos`.
    #[must_use]
    pub fn apply(&self, topic: &str, qos: Qos) -> Qos {
        let Some(changed) = self.by_topic.get(topic) else { return qos };
        let depth = changed.depth.unwrap_or(qos.depth());
        let is_latched = changed.is_latched.unwrap_or(qos.is_transient_local());
        // Latched topics are reliable, unless the override states otherwise.
        let is_reliable = changed.is_reliable.unwrap_or(qos.is_reliable() || is_latched);
        match (is_reliable, is_latched) {
            (false, _) => Qos::BestEffort { depth },
            (true, false) => Qos::Reliable { depth },
            (true, true) => Qos::ReliableTransientLocal { depth },
        }
    }
}

/// Parses a policy with two values: true for `yes`, false for `no`, none for the defaults that change nothing.
fn choice(policy: &str, value: Option<&str>, no: &str, yes: &str) -> Result<Option<bool>, String> {
    match value {
        None | Some("system_default" | "best_available") => Ok(None),
        Some(word) if word == yes => Ok(Some(true)),
        Some(word) if word == no => Ok(Some(false)),
        Some(other) => Err(format!("{policy}: expected {no}, {yes} or system_default, got {other:?}")),
    }
}

impl Profile {
    fn changes(&self) -> Result<Override, String> {
        let keeps_all = choice("history", self.history.as_deref(), "keep_last", "keep_all")?;
        let depth = match (keeps_all, self.depth) {
            (Some(true), _) => Some(KEEP_ALL),
            (_, None | Some(0)) => None,
            (_, Some(depth)) => {
                let fits = u16::try_from(depth).map_err(|_| format!("depth: expected at most 65535, got {depth}"))?;
                Some(fits)
            }
        };
        let is_reliable = choice("reliability", self.reliability.as_deref(), "best_effort", "reliable")?;
        let is_latched = choice("durability", self.durability.as_deref(), "volatile", "transient_local")?;
        if (is_reliable, is_latched) == (Some(false), Some(true)) {
            return Err("reliability: expected reliable where durability is transient_local, got best_effort".into());
        }
        if choice("liveliness", self.liveliness.as_deref(), "manual_by_topic", "automatic")? == Some(false) {
            return Err("liveliness: expected automatic, got manual_by_topic, which catenary does not support".into());
        }
        let spans = [
            ("deadline", &self.deadline),
            ("lifespan", &self.lifespan),
            ("liveliness_lease_duration", &self.liveliness_lease_duration),
        ];
        for (policy, span) in spans {
            if let Some(span) = span.as_ref().filter(|s| !s.is_unlimited()) {
                let Span { sec, nsec } = span;
                return Err(format!(
                    "{policy}: expected none, got {sec} s and {nsec} ns, which catenary does not enforce"
                ));
            }
        }
        if self.avoid_ros_namespace_conventions == Some(true) {
            return Err("avoid_ros_namespace_conventions: expected false, got true".into());
        }
        Ok(Override { depth, is_reliable, is_latched })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_profile_changes_what_it_names() {
        let text = "/a:\n  reliability: best_effort\n/b:\n  history: keep_last\n  depth: 3\n  durability: transient_local\n\
                    /c:\n  history: keep_all\n  reliability: reliable\n  durability: volatile\n  liveliness: system_default\n  \
                    deadline:\n    sec: 2147483647\n    nsec: 4294967295\n";
        let overrides = QosOverrides::parse(text).unwrap();
        let latched = Qos::ReliableTransientLocal { depth: 7 };
        assert_eq!(overrides.apply("/a", latched), Qos::BestEffort { depth: 7 });
        assert_eq!(overrides.apply("/b", Qos::BestEffort { depth: 7 }), Qos::ReliableTransientLocal { depth: 3 });
        assert_eq!(overrides.apply("/c", latched), Qos::Reliable { depth: KEEP_ALL });
        assert_eq!(overrides.apply("/d", latched), latched);
    }

    #[test]
    fn invalid_policies_and_topics_are_named() {
        let wrong = |text: &str| QosOverrides::parse(text).unwrap_err();
        assert_eq!(
            wrong("/a:\n  reliability: perhaps\n"),
            "/a: reliability: expected best_effort, reliable or system_default, got \"perhaps\""
        );
        assert!(wrong("/a:\n  lifespan: {sec: 1, nsec: 0}\n").starts_with("/a: lifespan: expected none, got 1 s"));
        assert!(wrong("/a:\n  reliability: best_effort\n  durability: transient_local\n").contains("got best_effort"));
        assert!(wrong("/a:\n  relibility: reliable\n").contains("relibility"));
        assert!(wrong("a:\n  depth: 1\n").starts_with("a: expected a topic's absolute name"));
        assert!(wrong("/a:\n  depth: 70000\n").contains("at most 65535"));
    }
}
