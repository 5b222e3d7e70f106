//! Parameter values of a command line, collected in rcl's order.

use crate::parameters::yaml::{Slot, Yaml};

/// Parameter value from the command line or from a file.
#[derive(Clone, Debug, PartialEq)]
pub struct ParamOverride {
    /// Pattern of the nodes that it applies to: see [`matches_pattern`](crate::names::matches_pattern).
    pub node: String,
    /// Name of the parameter, nested maps joined by dots.
    pub name: String,
    /// Value.
    pub value: Yaml,
    /// Origin for messages: `-p a:=1` or `FILE:LINE: camera.ros__parameters.a`.
    pub origin: String,
    /// Later value of another type, which ROS 2 ignores, with its origin.
    pub hidden: Option<(Yaml, String)>,
    /// True for a file's entry with a wildcard: nodes without this parameter ignore it.
    pub wildcard: bool,
}

/// Values by node or pattern and by name, both in the order of first appearance.
#[derive(Debug, Default)]
pub(super) struct Overrides {
    nodes: Vec<(String, Vec<Named>)>,
}

/// Parameter. Its name may occur more than once; the last entry takes precedence: see [`super::file`].
#[derive(Debug)]
pub(super) struct Named {
    pub(super) name: String,
    pub(super) slot: Slot,
    /// True if an assignment on the command line has set it.
    is_asked: bool,
}

impl Overrides {
    /// Returns the index of a node or pattern, and adds a new one.
    pub(super) fn node(&mut self, name: &str) -> usize {
        self.nodes.iter().position(|(node, _)| node == name).unwrap_or_else(|| {
            self.nodes.push((name.to_owned(), Vec::new()));
            self.nodes.len() - 1
        })
    }

    /// Returns the name of a node or pattern.
    pub(super) fn node_name(&self, node: usize) -> &str {
        &self.nodes[node].0
    }

    /// Returns the index of the first parameter of this name, and adds a new one.
    pub(super) fn find(&mut self, node: usize, name: &str) -> usize {
        let named = &mut self.nodes[node].1;
        named.iter().position(|param| param.name == name).unwrap_or_else(|| {
            named.push(Named { name: name.to_owned(), slot: Slot::default(), is_asked: false });
            named.len() - 1
        })
    }

    /// Returns a parameter.
    pub(super) fn param(&mut self, node: usize, param: usize) -> &mut Named {
        &mut self.nodes[node].1[param]
    }

    /// Sets a value from the command line.
    pub(super) fn set(&mut self, node: &str, name: &str, value: Yaml, origin: &str) {
        let node = self.node(node);
        let param = self.find(node, name);
        let param = self.param(node, param);
        param.slot.set(value, origin);
        param.is_asked = true;
    }

    /// Returns the values in order.
    pub(super) fn finish(self) -> Vec<ParamOverride> {
        let of_node = |(node, params): (String, Vec<Named>)| {
            params.into_iter().filter_map(move |param| param.into_override(&node)).collect::<Vec<_>>()
        };
        self.nodes.into_iter().flat_map(of_node).collect()
    }
}

impl Named {
    fn into_override(self, node: &str) -> Option<ParamOverride> {
        let (value, origin) = self.slot.value()?.clone();
        let hidden = self.slot.hidden().cloned();
        Some(ParamOverride {
            node: node.to_owned(),
            name: self.name,
            value,
            // An assignment without a node also stands under `/**`, but the user meant this node.
            wildcard: node.contains('*') && !self.is_asked,
            origin,
            hidden,
        })
    }
}
