//! Choice of topics to record or replay, by the rules of `ros2 bag`. Pure.

use crate::error::BagError;
use regex::Regex;

/// Regular expression over topic names.
#[derive(Debug, Clone)]
pub struct Pattern(Regex);

impl Pattern {
    /// Pattern that matches every name that contains a match, as in `ros2 bag record`.
    ///
    /// # Errors
    /// [`BagError::Setting`] for the setting called `name`.
    pub fn within(name: &'static str, text: &str) -> Result<Self, BagError> {
        Self::new(name, text, text)
    }

    /// Pattern that must match the whole name, as in `ros2 bag play`.
    ///
    /// # Errors
    /// As [`Pattern::within`].
    pub fn whole(name: &'static str, text: &str) -> Result<Self, BagError> {
        Self::new(name, text, &format!("^(?:{text})$"))
    }

    fn new(name: &'static str, given: &str, meant: &str) -> Result<Self, BagError> {
        Regex::new(meant).map(Self).map_err(|e| BagError::Setting {
            name,
            expected: "a regular expression".to_owned(),
            // The last line of the regex error describes the error; the lines before it draw its place.
            got: format!("{given:?} ({})", e.to_string().lines().last().unwrap_or_default().trim()),
        })
    }

    fn matches(&self, name: &str) -> bool {
        self.0.is_match(name)
    }
}

/// Choice of topics: those selected by `all`, `topics`, `types` or `regex`, without those selected by an `exclude`
/// field.
#[derive(Debug, Clone, Default)]
pub struct TopicFilter {
    /// Every topic that is not hidden.
    pub all: bool,
    /// Names, with or without the leading slash. A `*` at the end selects all names with that beginning.
    pub topics: Vec<String>,
    /// Type names, `package/msg/Type`.
    pub types: Vec<String>,
    /// Pattern of names.
    pub regex: Option<Pattern>,
    /// Names to leave out.
    pub exclude_topics: Vec<String>,
    /// Types to leave out.
    pub exclude_types: Vec<String>,
    /// Pattern of names to leave out.
    pub exclude_regex: Option<Pattern>,
}

fn is_named(names: &[String], topic: &str) -> bool {
    let topic = topic.trim_start_matches('/');
    names.iter().map(|name| name.trim_start_matches('/')).any(|name| match name.strip_suffix('*') {
        Some(start) => topic.starts_with(start),
        None => topic == name,
    })
}

/// True if ROS 2 hides the topic: a part of its name begins with an underscore.
fn is_hidden(topic: &str) -> bool {
    topic.split('/').any(|part| part.starts_with('_'))
}

impl TopicFilter {
    /// Filter that selects topics by name alone.
    #[must_use]
    pub fn of(topics: &[&str]) -> Self {
        Self { topics: topics.iter().map(|t| (*t).to_owned()).collect(), ..Self::default() }
    }

    /// Rejects names that no topic, and types that no message, can have.
    ///
    /// # Errors
    /// [`BagError::Setting`].
    pub fn check(&self) -> Result<(), BagError> {
        let is_part = |part: &str| {
            let letters = part.strip_suffix('*').unwrap_or(part);
            letters.chars().all(|c| c.is_ascii_alphanumeric() || c == '_') && !part.is_empty()
        };
        let is_name = |name: &str| name.strip_prefix('/').unwrap_or(name).split('/').all(is_part);
        for (setting, names) in [("topics", &self.topics), ("exclude_topics", &self.exclude_topics)] {
            if let Some(wrong) = names.iter().find(|n| !is_name(n)) {
                let expected = "names such as /dlo/keypoints, or /dlo/* for all that begin so".to_owned();
                return Err(BagError::Setting { name: setting, expected, got: format!("{wrong:?}") });
            }
        }
        let is_type = |name: &&String| name.split('/').count() == 3 && name.contains("/msg/");
        for (setting, types) in [("topic_types", &self.types), ("exclude_topic_types", &self.exclude_types)] {
            if let Some(wrong) = types.iter().find(|t| !is_type(t)) {
                let expected = "types such as geometry_msgs/msg/PoseStamped".to_owned();
                return Err(BagError::Setting { name: setting, expected, got: format!("{wrong:?}") });
            }
        }
        Ok(())
    }

    /// True if a field other than the `exclude` fields is set.
    #[must_use]
    pub fn chooses(&self) -> bool {
        self.all || !self.topics.is_empty() || !self.types.is_empty() || self.regex.is_some()
    }

    /// True if an `exclude` field selects a topic with these names, before and after remapping.
    #[must_use]
    pub fn excludes(&self, names: &[&str], type_name: &str) -> bool {
        let excluded = |name: &str| {
            is_named(&self.exclude_topics, name) || self.exclude_regex.as_ref().is_some_and(|p| p.matches(name))
        };
        self.exclude_types.iter().any(|t| t == type_name) || names.iter().any(|name| excluded(name))
    }

    /// True if the filter selects a topic with these names, before and after remapping.
    #[must_use]
    pub fn takes(&self, names: &[&str], type_name: &str) -> bool {
        let taken = |name: &str| {
            // A hidden topic is selected by its name alone, never by `all` or a pattern.
            is_named(&self.topics, name)
                || !is_hidden(name) && (self.all || self.regex.as_ref().is_some_and(|p| p.matches(name)))
        };
        let by_type = self.types.iter().any(|t| t == type_name);
        (by_type || names.iter().any(|name| taken(name))) && !self.excludes(names, type_name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const POSE: &str = "geometry_msgs/msg/PoseStamped";
    const TOPICS: [(&str, &str); 5] = [
        ("/panda/current_pose", POSE),
        ("/panda/target_pose", POSE),
        ("/panda/arm_state", "catenary_msgs/msg/ArmState"),
        ("/lab/notes", "std_msgs/msg/String"),
        ("/lab/_hidden/notes", "std_msgs/msg/String"),
    ];

    fn taken(filter: &TopicFilter) -> Vec<&'static str> {
        TOPICS.iter().filter(|(name, kind)| filter.takes(&[name], kind)).map(|(name, _)| *name).collect()
    }

    #[test]
    fn selections_add_up_and_exclusions_apply_last() {
        let within = |text: &str| Some(Pattern::within("regex", text).unwrap());
        assert_eq!(taken(&TopicFilter::default()), [] as [&str; 0]);
        assert_eq!(taken(&TopicFilter { all: true, ..TopicFilter::default() }).len(), 4);
        assert_eq!(taken(&TopicFilter::of(&["panda/arm_state", "/lab/*"])).len(), 3);
        let filter =
            TopicFilter { regex: within("_p"), types: vec!["std_msgs/msg/String".into()], ..TopicFilter::default() };
        assert_eq!(taken(&filter).len(), 4);
        let filter = TopicFilter { exclude_regex: within("^/panda/t"), ..filter };
        assert_eq!(taken(&filter), ["/panda/current_pose", "/lab/notes", "/lab/_hidden/notes"]);
        let filter =
            TopicFilter { exclude_types: vec![POSE.into()], exclude_topics: vec!["lab/notes".into()], ..filter };
        assert_eq!(taken(&filter), ["/lab/_hidden/notes"]);
    }

    #[test]
    fn a_recorders_pattern_is_found_within_a_name_and_a_players_is_the_name() {
        let within = Pattern::within("regex", "pose|state").unwrap();
        let whole = Pattern::whole("regex", "pose|/panda/.*state").unwrap();
        assert!(within.matches("/panda/current_pose") && !whole.matches("/panda/current_pose"));
        assert!(whole.matches("/panda/arm_state"));
        let error = Pattern::within("exclude_regex", "(a").unwrap_err().to_string();
        assert!(
            error.starts_with("exclude_regex: expected a regular expression, got \"(a\" (error: unclosed"),
            "{error}"
        );
    }

    #[test]
    fn names_that_no_topic_has_are_refused() {
        for wrong in ["", "/", "a b", "/dlo/", "a//b", "/x*y"] {
            let error = TopicFilter::of(&[wrong]).check().unwrap_err().to_string();
            assert!(error.starts_with("topics: expected names such as /dlo/keypoints"), "{wrong}: {error}");
        }
        TopicFilter::of(&["a", "/a/b_2", "/a/*", "*"]).check().unwrap();
        let wrong = TopicFilter { types: vec!["PoseStamped".into()], ..TopicFilter::default() };
        assert!(wrong.check().unwrap_err().to_string().starts_with("topic_types: expected types such as"));
    }
}
