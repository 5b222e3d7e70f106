//! Reader of a launch file. Elements and attributes of ROS 2's front end that are not supported are refused by name.

use super::element::{Element, allow, flag};
use super::namespace;
use super::process::{allow_executable, allow_node};
use super::state::{Configuration, Place, Reader};
use super::substitution::literal;
use crate::launch::description::{Argument, LaunchDescription};
use anyhow::{Context, Result, anyhow, bail, ensure};
use catenary_core::spelling::did_you_mean;
use roxmltree::{Document, Node};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Largest nesting depth of includes; it stops a file that includes itself.
const MAX_INCLUDE_DEPTH: usize = 8;
/// Supported elements, for messages.
const ELEMENTS: &str =
    "arg, let, group, include, executable, node, set_env, unset_env, append_env or push_ros_namespace";

/// Reads the launch file at `path` with the arguments `given` (`name:=value`). `environment` looks up variables.
///
/// Returns an error for an argument that no file declares, and for an unsupported element or attribute.
pub fn read(
    path: &Path,
    given: &[(String, String)],
    environment: &dyn Fn(&str) -> Option<String>,
) -> Result<LaunchDescription> {
    let names: BTreeSet<String> = given.iter().map(|(name, _)| name.clone()).collect();
    let context = Configuration { variables: given.iter().cloned().collect(), environment: BTreeMap::new() };
    let file = std::path::absolute(path).with_context(|| format!("launch file {}", path.display()))?;
    let mut reader = Reader {
        base: environment,
        context,
        current: file.clone(),
        given: names.clone(),
        asked: names.clone(),
        description: LaunchDescription::default(),
    };
    reader.file(path, &file, 0)?;
    let declared = |name: &String| reader.description.arguments.iter().any(|a| &a.name == name);
    if let Some(unknown) = names.iter().find(|name| !declared(name)) {
        let known: Vec<&str> = reader.description.arguments.iter().map(|a| a.name.as_str()).collect();
        let (hint, known) = (did_you_mean(unknown, known.iter().copied()), known.join(", "));
        bail!("{}: no argument `{unknown}`; it takes {known}{hint}", path.display());
    }
    reader.name_apart();
    Ok(reader.description)
}

impl Reader<'_> {
    fn file(&mut self, shown: &Path, file: &Path, depth: usize) -> Result<()> {
        ensure!(depth <= MAX_INCLUDE_DEPTH, "{}: includes nest deeper than {MAX_INCLUDE_DEPTH}", shown.display());
        // The user's spelling of the path, so that a suggestion in an error keeps it.
        let read = if depth == 0 { shown } else { file };
        let text = catenary_shell::files::read_text("launch file", read)?;
        let document =
            Document::parse(&text).with_context(|| format!("launch file {}: no valid XML", shown.display()))?;
        let root = document.root_element();
        let got = root.tag_name().name();
        ensure!(got == "launch", "{}: expected <launch>, got <{got}>: is this a launch file?", shown.display());
        self.children(root, Place { file, depth }).with_context(|| format!("launch file {}", shown.display()))
    }

    fn children(&mut self, parent: Node<'_, '_>, place: Place<'_>) -> Result<()> {
        for node in parent.children().filter(Node::is_element) {
            let line = node.document().text_pos_at(node.range().start).row;
            self.element(node, place).with_context(|| format!("line {line}, <{}>", node.tag_name().name()))?;
        }
        Ok(())
    }

    fn element(&mut self, node: Node<'_, '_>, place: Place<'_>) -> Result<()> {
        let conditional = &["if", "unless"];
        match node.tag_name().name() {
            "arg" => allow(node, &["name", "default", "description"], conditional, &["choice"])?,
            "let" | "set_env" => allow(node, &["name", "value"], conditional, &[])?,
            "unset_env" => allow(node, &["name"], conditional, &[])?,
            "append_env" => allow(node, &["name", "value", "prepend", "separator"], conditional, &[])?,
            "push_ros_namespace" | "push-ros-namespace" => allow(node, &["namespace"], conditional, &[])?,
            "group" => allow(node, &["scoped"], conditional, &["*"])?,
            "include" => allow(node, &["file"], conditional, &["arg"])?,
            "executable" => allow_executable(node)?,
            "node" => allow_node(node)?,
            other => bail!("expected {ELEMENTS}, got {other}"),
        }
        if !self.with(node, place, |e| e.condition())? {
            return Ok(());
        }
        match node.tag_name().name() {
            "arg" => self.argument(node, place),
            "let" => {
                let (name, value) = self.with(node, place, |e| Ok((e.required("name")?, e.required("value")?)))?;
                self.context.variables.insert(name, value);
                Ok(())
            }
            "group" => {
                let scoped = node.attribute("scoped").map_or(Ok(true), |text| flag("scoped", text))?;
                // ROS 2's launch pushes and pops the whole configuration around a scoped group.
                let outer = self.context.clone();
                self.children(node, place)?;
                if scoped {
                    self.context = outer;
                }
                Ok(())
            }
            "include" => self.include(node, place),
            "executable" => self.executable(node, place),
            "node" => self.node(node, place),
            "push_ros_namespace" | "push-ros-namespace" => self.push_namespace(node, place),
            _ => self.change_environment(node, place),
        }
    }

    fn argument(&mut self, node: Node<'_, '_>, place: Place<'_>) -> Result<()> {
        let text = |attribute| node.attribute(attribute).map(literal);
        let name = text("name").ok_or_else(|| anyhow!("the attribute `name` is missing"))?;
        let default = self.with(node, place, |e| e.optional("default"))?;
        let mut choices = Vec::new();
        for choice in node.children().filter(Node::is_element) {
            allow(choice, &["value"], &[], &[]).context("<choice>")?;
            choices.push(choice.attribute("value").map(literal).context("<choice>: the attribute `value` is missing")?);
        }
        let is_given = self.given.contains(&name);
        // Only arguments that the user can set are listed by `--show`.
        let is_free = self.asked.contains(&name) || !self.context.variables.contains_key(&name);
        if !is_given && default.is_none() {
            bail!("the argument `{name}` must be given: {name}:=VALUE");
        }
        let value = match (self.context.variables.get(&name), &default) {
            (None, Some(default)) => {
                self.context.variables.insert(name.clone(), default.clone());
                default
            }
            (value, _) => value.ok_or_else(|| anyhow!("the argument `{name}` must be given: {name}:=VALUE"))?,
        };
        if !choices.is_empty() && !choices.contains(value) {
            bail!("the argument `{name}`: expected {}, got `{value}`", choices.join(" or "));
        }
        let is_listed = self.description.arguments.iter().any(|a| a.name == name);
        if is_free && !is_listed {
            let description = text("description").unwrap_or_default();
            self.description.arguments.push(Argument { name, default, description, choices });
        }
        Ok(())
    }

    fn include(&mut self, node: Node<'_, '_>, place: Place<'_>) -> Result<()> {
        let shown = PathBuf::from(self.with(node, place, |e| e.required("file"))?);
        let file = std::path::absolute(&shown).with_context(|| format!("launch file {}", shown.display()))?;
        self.current.clone_from(&file);
        for child in node.children().filter(Node::is_element) {
            // ROS 2's launch changes this when it visits the include and does not change it back.
            allow(child, &["name", "value"], &[], &[]).context("<arg>")?;
            let argument = self.with(child, place, |e| Ok((e.required("name")?, e.required("value")?)));
            let (name, value) = argument.context("<arg>")?;
            self.asked.remove(&name);
            self.given.insert(name.clone());
            self.context.variables.insert(name, value);
        }
        self.file(&shown, &file, place.depth + 1)
    }

    fn push_namespace(&mut self, node: Node<'_, '_>, place: Place<'_>) -> Result<()> {
        let pushed = self.with(node, place, |e| e.required("namespace"))?;
        let outer = self.context.variables.get(namespace::VARIABLE).map(String::as_str);
        let inner = namespace::join(outer, Some(&pushed))?.unwrap_or_default();
        self.context.variables.insert(namespace::VARIABLE.to_owned(), inner);
        Ok(())
    }

    fn change_environment(&mut self, node: Node<'_, '_>, place: Place<'_>) -> Result<()> {
        let (name, value) = self.with(node, place, |e| {
            let name = e.required("name")?;
            let value = match node.tag_name().name() {
                "unset_env" => None,
                "append_env" => Some(appended(e, (e.scope.environment)(&name))?),
                _ => Some(e.required("value")?),
            };
            Ok((name, value))
        })?;
        self.context.environment.insert(name, value);
        Ok(())
    }

    /// Makes the names of processes unique: the second process of a name gets the suffix `-2`, and so on.
    fn name_apart(&mut self) {
        let mut taken = BTreeSet::new();
        for process in &mut self.description.processes {
            let name = process.name.clone();
            for number in 2.. {
                if taken.insert(process.name.clone()) {
                    break;
                }
                process.name = format!("{name}-{number}");
            }
        }
    }
}

/// Value of a variable after `<append_env>`.
fn appended(element: &Element<'_, '_, '_>, before: Option<String>) -> Result<String> {
    let value = element.required("value")?;
    let separator = element.optional("separator")?.unwrap_or_else(|| ":".to_owned());
    let first = element.optional("prepend")?.map_or(Ok(false), |text| flag("prepend", &text))?;
    Ok(match before {
        None => value,
        Some(before) if first => format!("{value}{separator}{before}"),
        Some(before) => format!("{before}{separator}{value}"),
    })
}
