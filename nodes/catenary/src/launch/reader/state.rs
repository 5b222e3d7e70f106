//! State of the reader between elements.

use super::element::Element;
use super::scope::Scope;
use crate::launch::description::LaunchDescription;
use anyhow::Result;
use roxmltree::Node;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// State that elements set for later elements. As in ROS 2, an included file shares it with the including one.
#[derive(Clone)]
pub struct Configuration {
    /// Arguments, `let` variables, and the namespace of nodes.
    pub variables: BTreeMap<String, String>,
    /// Changes to the environment.
    pub environment: BTreeMap<String, Option<String>>,
}

/// Reader of a launch file and its includes.
pub struct Reader<'a> {
    /// Environment of the launch.
    pub base: &'a dyn Fn(&str) -> Option<String>,
    /// State at the current element.
    pub context: Configuration,
    /// File that ROS 2's front end takes for the current one: the one that was opened last.
    pub current: PathBuf,
    /// Arguments given on the command line or by an `<include>`.
    pub given: BTreeSet<String>,
    /// Arguments given on the command line.
    pub asked: BTreeSet<String>,
    /// Description so far.
    pub description: LaunchDescription,
}

/// File that contains an element.
#[derive(Clone, Copy)]
pub struct Place<'a> {
    /// Absolute path of the file.
    pub file: &'a Path,
    /// Nesting depth of its `<include>`.
    pub depth: usize,
}

impl Reader<'_> {
    /// Calls `work` with an element and the scope of its substitutions.
    pub fn with<T>(
        &self,
        node: Node<'_, '_>,
        place: Place<'_>,
        work: impl FnOnce(&Element<'_, '_, '_>) -> Result<T>,
    ) -> Result<T> {
        let environment = |name: &str| match self.context.environment.get(name) {
            Some(value) => value.clone(),
            None => (self.base)(name),
        };
        let included = (self.current != place.file).then_some(self.current.as_path());
        let scope = Scope { variables: &self.context.variables, environment: &environment, file: place.file, included };
        work(&Element { node, scope: &scope })
    }
}
