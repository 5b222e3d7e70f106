//! Parameter values of a command line, gathered as rcl gathers them.

use super::ParamOverride;
use crate::yaml::{Slot, Yaml};

/// Values by the node or pattern that they stand under, and by name, each in the order of its first appearance.
#[derive(Debug, Default)]
pub(super) struct Overrides {
    nodes: Vec<(String, Vec<Named>)>,
}

/// A parameter. A name can be there more than once, and the last counts: see [`super::file`].
#[derive(Debug)]
pub(super) struct Named {
    pub(super) name: String,
    pub(super) slot: Slot,
    /// Set by an assignment on the command line.
    is_asked: bool,
}

impl Overrides {
    /// Index of a node or pattern, which is added where it is new.
    pub(super) fn node(&mut self, name: &str) -> usize {
        self.nodes.iter().position(|(node, _)| node == name).unwrap_or_else(|| {
            self.nodes.push((name.to_owned(), Vec::new()));
            self.nodes.len() - 1
        })
    }

    /// Name of a node or pattern.
    pub(super) fn node_name(&self, node: usize) -> &str {
        &self.nodes[node].0
    }

    /// Index of the first parameter of this name, which is added where it is new.
    pub(super) fn find(&mut self, node: usize, name: &str) -> usize {
        let named = &mut self.nodes[node].1;
        named.iter().position(|param| param.name == name).unwrap_or_else(|| {
            named.push(Named { name: name.to_owned(), slot: Slot::default(), is_asked: false });
            named.len() - 1
        })
    }

    /// A parameter.
    pub(super) fn param(&mut self, node: usize, param: usize) -> &mut Named {
        &mut self.nodes[node].1[param]
    }

    /// Sets the value of an assignment on the command line.
    pub(super) fn set(&mut self, node: &str, name: &str, value: Yaml, origin: &str) {
        let node = self.node(node);
        let param = self.find(node, name);
        let param = self.param(node, param);
        param.slot.set(value, origin);
        param.is_asked = true;
    }

    /// The values in order.
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
            wildcard: node.contains('*') && !self.is_asked,
            origin,
            hidden,
        })
    }
}
