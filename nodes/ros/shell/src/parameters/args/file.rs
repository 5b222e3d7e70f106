//! Parser of parameter files, with the semantics of rcl's parser.
//!
//! Like rcl, the parser handles one event of libyaml after the other. A repeated key takes its last value, the documents of a
//! stream are read in turn, and a name after `ros__parameters` is no longer below its node. Files are refused if rcl's parser
//! confuses its state on them and gives them no meaning.

use super::error::ArgError;
use super::overrides::Overrides;
use crate::parameters::names;
use crate::parameters::yaml::{Event, Events, Yaml};
use std::path::Path;

/// Key between a node's name and its parameters. rcl compares only the beginning of a key.
const PARAMETERS: &str = "ros__parameters";

/// Adds the values of a parameter file.
pub(super) fn read(path: &Path, text: &str, overrides: &mut Overrides) -> Result<(), ArgError> {
    let mut reader = Reader {
        path,
        overrides,
        line: 1,
        depth: 0,
        nodes: Joined::new('/'),
        prefix: Joined::new('.'),
        node: None,
        param: None,
        is_new_map: false,
        is_key: true,
        list: None,
    };
    for event in Events::new(text) {
        let (event, line) = event.map_err(|reason| ArgError::Syntax { path: path.to_owned(), reason })?;
        // An unexpected end of a document is reported at the line of the key without a value.
        if !matches!(event, Event::DocumentEnd) {
            reader.line = line;
        }
        reader.event(event)?;
    }
    Ok(())
}

/// Path of names joined by a separator.
struct Joined {
    text: String,
    count: usize,
    separator: char,
}

impl Joined {
    fn new(separator: char) -> Self {
        Self { text: String::new(), count: 0, separator }
    }

    fn push(&mut self, name: &str) {
        if self.count > 0 && !self.text.ends_with(self.separator) {
            self.text.push(self.separator);
        }
        self.text.push_str(name);
        self.count += 1;
    }

    /// Removes the last name up to its last separator. As in rcl, the rest of a name that contains a separator stays.
    fn pop(&mut self) {
        match self.text.rfind(self.separator) {
            Some(at) if self.count > 1 => self.text.truncate(at),
            _ if self.count <= 1 => self.text.clear(),
            _ => {}
        }
        self.count = self.count.saturating_sub(1);
    }
}

struct Reader<'a> {
    path: &'a Path,
    overrides: &'a mut Overrides,
    line: u64,
    /// Number of open maps.
    depth: usize,
    /// Keys above `ros__parameters`.
    nodes: Joined,
    /// Keys above a nested parameter.
    prefix: Joined,
    /// Node whose parameters are read; `None` above `ros__parameters`.
    node: Option<usize>,
    /// Parameter whose value is next.
    param: Option<usize>,
    /// True if a map has begun instead of the parameter's value, before its first key.
    is_new_map: bool,
    /// True if the next scalar is a key.
    is_key: bool,
    /// Open list with its first item.
    list: Option<Option<Yaml>>,
}

impl Reader<'_> {
    fn error(&self, expected: &'static str, got: impl Into<String>) -> ArgError {
        let node = self.node.map(|node| self.overrides.node_name(node));
        let field = match (node, self.param) {
            (None, _) if self.nodes.count == 0 => "top level".to_owned(),
            (None, _) => self.nodes.text.clone(),
            (Some(node), _) => format!("{node}.{PARAMETERS}"),
        };
        ArgError::Structure { path: self.path.to_owned(), line: self.line, field, expected, got: got.into() }
    }

    /// Returns an error in the value of a parameter.
    fn value_error(&mut self, expected: &'static str, got: impl Into<String>) -> ArgError {
        let mut error = self.error(expected, got);
        if let (ArgError::Structure { field, .. }, Some(node), Some(param)) = (&mut error, self.node, self.param) {
            field.push('.');
            field.push_str(&self.overrides.param(node, param).name);
        }
        error
    }

    fn event(&mut self, event: Event) -> Result<(), ArgError> {
        match event {
            Event::Scalar(scalar) if self.is_key => {
                self.key(&scalar.text)?;
                self.is_key = false;
            }
            Event::Scalar(scalar) => self.value(scalar.value())?,
            Event::ListStart if self.is_key => return Err(self.error("a key", "a list")),
            Event::ListStart if self.node.is_none() => return Err(self.error("a map with ros__parameters", "a list")),
            Event::ListStart if self.param.is_none() => return Err(self.error("a map of parameters", "a list")),
            Event::ListStart => self.list = Some(None),
            Event::ListEnd => self.end_list()?,
            Event::MapStart => self.start_map()?,
            Event::MapEnd => self.end_map()?,
            Event::Alias => {
                return Err(self.value_error("a value: ROS 2 has no aliases, so quote a text with *", "an alias"));
            }
            Event::DocumentEnd if !self.is_key => {
                let name = Yaml::String(std::mem::take(&mut self.nodes.text)).describe();
                self.nodes.count = 0;
                return Err(self.error("a map of node names", name));
            }
            Event::DocumentEnd => {}
        }
        Ok(())
    }

    fn key(&mut self, key: &str) -> Result<(), ArgError> {
        if key.is_empty() {
            return Err(self.error("a key", "nothing"));
        }
        match self.node {
            None if key.starts_with(PARAMETERS) => self.begin_parameters(),
            None => {
                self.nodes.push(key);
                Ok(())
            }
            Some(node) => self.parameter(node, key),
        }
    }

    fn begin_parameters(&mut self) -> Result<(), ArgError> {
        if self.nodes.count == 0 {
            return Err(self.error("the name of a node, one ros__parameters in each", PARAMETERS));
        }
        let pattern =
            if self.nodes.text.starts_with('/') { self.nodes.text.clone() } else { format!("/{}", self.nodes.text) };
        if !names::is_pattern(&pattern) {
            let expected = "the name of a node with its namespace; * stands for one name, ** for any number of them";
            return Err(self.error(expected, Yaml::String(pattern).describe()));
        }
        self.node = Some(self.overrides.node(&self.nodes.text));
        self.param = None;
        self.nodes.pop();
        Ok(())
    }

    fn parameter(&mut self, node: usize, key: &str) -> Result<(), ArgError> {
        if std::mem::take(&mut self.is_new_map) {
            let Some(param) = self.param else {
                return Err(self.error("one ros__parameters in each node, and no namespace behind it", "another one"));
            };
            // A map as a value makes the parameter the prefix of the parameters in the map.
            self.prefix.text.clone_from(&self.overrides.param(node, param).name);
            self.prefix.count += 1;
        }
        if self.prefix.count == 0 {
            self.param = Some(self.overrides.find(node, key));
        } else {
            // Existing entries of the prefix itself are renamed, as in rcl.
            let param = self.overrides.find(node, &self.prefix.text);
            self.overrides.param(node, param).name = format!("{}.{key}", self.prefix.text);
            self.param = Some(param);
        }
        Ok(())
    }

    fn value(&mut self, value: Result<Yaml, String>) -> Result<(), ArgError> {
        let got = |value: Result<Yaml, String>| value.map_or_else(|_| "nothing".to_owned(), |value| value.describe());
        let Some(node) = self.node else { return Err(self.error("a map with ros__parameters", got(value))) };
        let Some(param) = self.param else { return Err(self.error("a map of parameters", got(value))) };
        let Ok(value) = value else { return Err(self.value_error("a value; write '' for an empty string", "nothing")) };
        let origin = self.origin(node, param);
        let mut list = self.list.take();
        let slot = &mut self.overrides.param(node, param).slot;
        let pushed = match &mut list {
            None => {
                slot.set(value, &origin);
                self.is_key = true;
                Ok(())
            }
            Some(first) => slot.push(value, first, &origin),
        };
        self.list = list;
        pushed.map_err(|reason| self.value_error("a list of one type", reason))
    }

    /// Returns the origin of a value, for messages.
    fn origin(&mut self, node: usize, param: usize) -> String {
        let name = self.overrides.param(node, param).name.clone();
        format!("{}:{}: {}.{PARAMETERS}.{name}", self.path.display(), self.line, self.overrides.node_name(node))
    }

    fn end_list(&mut self) -> Result<(), ArgError> {
        if self.list.is_none() && !self.is_key {
            return Err(self.value_error("a list of values", "a list in a list"));
        }
        if let (Some(first), Some(node), Some(param)) = (self.list.take(), self.node, self.param) {
            let origin = self.origin(node, param);
            self.overrides.param(node, param).slot.end_list(first, &origin);
        }
        self.is_key = true;
        Ok(())
    }

    fn start_map(&mut self) -> Result<(), ArgError> {
        if self.list.is_some() {
            return Err(self.value_error("a list of values", "a map in it"));
        }
        if self.is_key && self.depth > 0 {
            return Err(self.error("a key", "a map"));
        }
        self.depth += 1;
        self.is_key = true;
        // The map of ros__parameters holds parameters and adds no prefix. Open at this point: the document's map, one map per
        // name in `nodes`, the map of the node (its name was popped), and this map.
        let is_parameters = self.node.is_some() && self.depth == self.nodes.count + 3;
        self.is_new_map = !is_parameters;
        Ok(())
    }

    fn end_map(&mut self) -> Result<(), ArgError> {
        if self.node.is_some() {
            if self.is_new_map && self.param.is_some() {
                return Err(self.value_error("a value", "an empty map"));
            }
            if self.prefix.count > 0 {
                self.prefix.pop();
            } else {
                self.node = None;
            }
        } else if self.depth == self.nodes.count + 1 {
            self.nodes.pop();
        }
        self.depth -= 1;
        Ok(())
    }
}
