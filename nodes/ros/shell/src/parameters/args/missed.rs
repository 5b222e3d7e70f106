//! Values for a node of the same name that is another node: in another namespace, or under the name before a remapping. ROS 2
//! passes them over without a word, and the node runs with its defaults.

use super::RosArgs;
use crate::names;
use std::collections::BTreeMap;

impl RosArgs {
    /// Returns warnings about values that are meant for one of these `bare` names, and do not apply to the node. None if other
    /// values do that name the node.
    pub(crate) fn missed_values(&self, namespace: &str, node: &str, bare: &[&str]) -> Vec<String> {
        let path = names::node_path(namespace, node);
        let is_of_name = |pattern: &str| pattern.rsplit('/').next().is_some_and(|last| bare.contains(&last));
        let applies = |pattern: &str| names::matches_pattern(pattern, &path);
        if self.params.iter().any(|p| is_of_name(&p.node) && applies(&p.node)) {
            return Vec::new();
        }
        let mut missed: BTreeMap<&str, (&str, usize)> = BTreeMap::new();
        for value in self.params.iter().filter(|p| is_of_name(&p.node)) {
            missed.entry(&value.node).or_insert((&value.origin, 0)).1 += 1;
        }
        let told = missed.into_iter().map(|(pattern, (origin, count))| {
            let values = if count == 1 { "this value is" } else { "the values there are" };
            format!("{origin}: {values} for `{pattern}`, and this node is {path}: write `{path}` or `/**/{node}`")
        });
        told.collect()
    }
}
