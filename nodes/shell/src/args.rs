//! The command line of a ROS 2 node: `--ros-args` with remaps, parameters, parameter files, log levels.
//!
//! Written here because crate `ros2args` 0.5.4 (Apache-2.0) drops nested maps and namespaces of parameter files, its
//! messages about a file's structure do not name the file, and its YAML is not the one that rcl reads.

use crate::files;
use crate::names::{self, NameError};
use crate::yaml::Yaml;
use overrides::Overrides;
use std::path::{Path, PathBuf};
use thiserror::Error;

mod file;
mod overrides;

#[cfg(test)]
mod table;
#[cfg(test)]
mod tests;

/// What is wrong with the command line or with a file that it names.
#[derive(Debug, Error)]
pub enum ArgError {
    /// An option lacks its value.
    #[error("{option}: expected {expected} after it, got the end of the arguments")]
    MissingValue {
        /// The option.
        option: String,
        /// What should follow.
        expected: &'static str,
    },
    /// An option's value has the wrong form.
    #[error("{option} {value:?}: expected {expected}")]
    BadValue {
        /// The option.
        option: String,
        /// The value given.
        value: String,
        /// What would be right.
        expected: String,
    },
    /// An unknown option between `--ros-args` and `--`.
    #[error("--ros-args: unknown option {0:?}; expected -r, -p, --params-file, --log-level, --enable-* or --disable-*")]
    UnknownOption(String),
    /// A parameter file cannot be read.
    #[error("{}: cannot read the parameter file: {reason}{}", path.display(), files::hint(path))]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        reason: std::io::Error,
    },
    /// A parameter file is no YAML.
    #[error("{}: not YAML: {reason}", path.display())]
    Syntax {
        /// The file.
        path: PathBuf,
        /// The parser's words.
        reason: String,
    },
    /// A parameter file has the wrong structure.
    #[error("{}:{line}: {field}: expected {expected}, got {got}", path.display())]
    Structure {
        /// The file.
        path: PathBuf,
        /// The line in the file, from 1.
        line: u64,
        /// Where in the file.
        field: String,
        /// What would be right.
        expected: &'static str,
        /// What stands there.
        got: String,
    },
    /// A remapped node name or namespace is invalid.
    #[error("--remap {rule}: {reason}")]
    Name {
        /// The rule.
        rule: String,
        /// What is wrong with it.
        reason: NameError,
    },
}

/// A rule `from:=to`, perhaps for one node only.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Remap {
    /// The base name of the node that the rule is for; none: every node.
    pub node: Option<String>,
    /// The name in the code, or `__ns`, `__node`.
    pub from: String,
    /// The name to use.
    pub to: String,
}

/// A parameter value from the command line or from a file.
#[derive(Clone, Debug, PartialEq)]
pub struct ParamOverride {
    /// The nodes it is for, as a pattern: see [`names::matches_pattern`].
    pub node: String,
    /// The parameter's name, nested maps joined by dots.
    pub name: String,
    /// The value.
    pub value: Yaml,
    /// Where it stands, for messages: `-p a:=1` or `FILE:LINE: camera.ros__parameters.a`.
    pub origin: String,
    /// A later value of another type, which ROS 2 passes over, and its place.
    pub hidden: Option<(Yaml, String)>,
    /// From a file's entry with a wildcard, which is meant for those nodes that have the parameter.
    pub wildcard: bool,
}

/// Levels of `--log-level`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// Every step.
    Debug,
    /// Milestones.
    Info,
    /// Degraded.
    Warn,
    /// Failed or lost data.
    Error,
    /// About to end.
    Fatal,
}

/// The ROS 2 arguments of a process.
#[derive(Clone, Debug, PartialEq)]
pub struct RosArgs {
    /// In the order of the command line; the first that matches counts.
    pub remaps: Vec<Remap>,
    /// By node and pattern in the order in which these first appear; [`RosArgs::params_for`] says what counts.
    pub params: Vec<ParamOverride>,
    /// `--log-level LEVEL`.
    pub log_level: Option<Level>,
    /// `--log-level NAME:=LEVEL`.
    pub logger_levels: Vec<(String, Level)>,
    /// Whether logs go to `/rosout`.
    pub rosout_logs: bool,
    /// Whether logs go to stderr.
    pub console_logs: bool,
    /// Options that were understood and have no effect here.
    pub without_effect: Vec<String>,
}

impl Default for RosArgs {
    fn default() -> Self {
        Self {
            remaps: Vec::new(),
            params: Vec::new(),
            log_level: None,
            logger_levels: Vec::new(),
            rosout_logs: true,
            console_logs: true,
            without_effect: Vec::new(),
        }
    }
}

impl RosArgs {
    /// Reads the arguments after the program's name; returns what stands outside `--ros-args ... --` as well.
    ///
    /// # Errors
    /// [`ArgError`], naming the option or the file and field, with what was expected and what came.
    pub fn parse<S: Into<String>>(args: impl IntoIterator<Item = S>) -> Result<(Self, Vec<String>), ArgError> {
        Self::parse_with(args, &|path| std::fs::read_to_string(path))
    }

    /// Like [`RosArgs::parse`], with the parameter files read by `read`.
    ///
    /// # Errors
    /// As [`RosArgs::parse`].
    pub fn parse_with<S: Into<String>>(
        args: impl IntoIterator<Item = S>,
        read: &dyn Fn(&Path) -> std::io::Result<String>,
    ) -> Result<(Self, Vec<String>), ArgError> {
        let (mut parsed, mut overrides) = (Self::default(), Overrides::default());
        let mut rest = Vec::new();
        let mut inside = false;
        let mut args = args.into_iter().map(Into::into);
        while let Some(arg) = args.next() {
            match (inside, arg.as_str()) {
                (_, "--ros-args") => inside = true,
                (true, "--") => inside = false,
                (true, _) => parsed.option(arg, &mut args, read, &mut overrides)?,
                (false, _) => rest.push(arg),
            }
        }
        parsed.params = overrides.finish();
        Ok((parsed, rest))
    }

    fn option(
        &mut self,
        option: String,
        args: &mut dyn Iterator<Item = String>,
        read: &dyn Fn(&Path) -> std::io::Result<String>,
        overrides: &mut Overrides,
    ) -> Result<(), ArgError> {
        let mut value = |expected: &'static str| {
            args.next().ok_or_else(|| ArgError::MissingValue { option: option.clone(), expected })
        };
        match option.as_str() {
            "-r" | "--remap" => self.remaps.push(remap(&option, &value("FROM:=TO")?)?),
            "-p" | "--param" => param(&option, &value("NAME:=VALUE")?, overrides)?,
            "--params-file" => {
                let path = PathBuf::from(value("the path of a parameter file")?);
                let text = read(&path).map_err(|reason| ArgError::Read { path: path.clone(), reason })?;
                file::read(&path, &text, overrides)?;
            }
            "--log-level" => self.level(&value("a log level")?)?,
            "--enable-rosout-logs" => self.rosout_logs = true,
            "--disable-rosout-logs" => self.rosout_logs = false,
            "--enable-stdout-logs" => self.console_logs = true,
            "--disable-stdout-logs" => self.console_logs = false,
            "--enable-external-lib-logs" | "--disable-external-lib-logs" => {
                self.without_effect.push(option);
            }
            "-e" | "--enclave" | "--log-config-file" | "--log-file-name" => {
                let value = value("a value")?;
                self.without_effect.push(format!("{option} {value}"));
            }
            _ => return Err(ArgError::UnknownOption(option)),
        }
        Ok(())
    }

    fn level(&mut self, value: &str) -> Result<(), ArgError> {
        let (logger, word) = match value.split_once(":=") {
            Some((logger, word)) => (Some(logger), word),
            None => (None, value),
        };
        let level = match word.to_ascii_lowercase().as_str() {
            "debug" => Level::Debug,
            "info" => Level::Info,
            "warn" | "warning" => Level::Warn,
            "error" => Level::Error,
            "fatal" => Level::Fatal,
            _ => {
                return Err(ArgError::BadValue {
                    option: "--log-level".to_owned(),
                    value: value.to_owned(),
                    expected: "debug, info, warn, error or fatal, or LOGGER:=LEVEL".to_owned(),
                });
            }
        };
        match logger {
            Some(logger) => self.logger_levels.push((logger.to_owned(), level)),
            None => self.log_level = Some(level),
        }
        Ok(())
    }

    /// The name and namespace of a node after `__node:=` and `__ns:=`.
    ///
    /// # Errors
    /// [`ArgError::Name`] where the new name is none.
    pub fn node_identity(&self, name: &str, namespace: &str) -> Result<(String, String), ArgError> {
        let find =
            |keys: &[&str]| self.remaps.iter().find(|rule| rule.is_for(name) && keys.contains(&rule.from.as_str()));
        let new_name = match find(&["__node", "__name"]) {
            Some(rule) => {
                names::check_node_name(&rule.to).map(|()| rule.to.clone()).map_err(|reason| rule.error(reason))?
            }
            None => name.to_owned(),
        };
        let new_namespace = match find(&["__ns"]) {
            Some(rule) => names::normalise_namespace(&rule.to).map_err(|reason| rule.error(reason))?,
            None => namespace.to_owned(),
        };
        Ok((new_name, new_namespace))
    }

    /// The absolute name of a topic or service after expansion and remapping.
    ///
    /// # Errors
    /// [`NameError`] where `name` or its replacement is none.
    pub fn resolve(&self, name: &str, namespace: &str, node: &str) -> Result<String, NameError> {
        let expanded = names::expand(name, namespace, node)?;
        for rule in self.remaps.iter().filter(|rule| rule.is_for(node)) {
            if rule.from.starts_with("__") {
                continue;
            }
            if names::expand(&rule.from, namespace, node)? == expanded {
                return names::expand(&rule.to, namespace, node);
            }
        }
        Ok(expanded)
    }

    /// The parameter values that are meant for a node; of several for one parameter, the last counts.
    ///
    /// As in ROS 2, values are gathered by the node's name or pattern that they stand under, in the order in which these
    /// first appear; `-p` without a node stands under `/**`. So `-p` counts for more than a file's entry for the node,
    /// unless `/**` appeared before that entry.
    #[must_use]
    pub fn params_for(&self, namespace: &str, node: &str) -> Vec<&ParamOverride> {
        let path = names::node_path(namespace, node);
        self.params.iter().filter(|p| names::matches_pattern(&p.node, &path)).collect()
    }
}

impl Remap {
    fn is_for(&self, node: &str) -> bool {
        self.node.as_deref().is_none_or(|name| name == node)
    }

    fn error(&self, reason: NameError) -> ArgError {
        ArgError::Name { rule: format!("{}:={}", self.from, self.to), reason }
    }
}

fn remap(option: &str, rule: &str) -> Result<Remap, ArgError> {
    let bad = |expected: &str| ArgError::BadValue {
        option: option.to_owned(),
        value: rule.to_owned(),
        expected: expected.to_owned(),
    };
    let (left, to) =
        rule.split_once(":=").ok_or_else(|| bad("FROM:=TO, NODE:FROM:=TO, __ns:=/NAMESPACE or __node:=NAME"))?;
    let (left, to) = (strip_scheme(left), strip_scheme(to));
    let (node, from) = match left.split_once(':') {
        Some((node, from)) => (Some(node.to_owned()), from),
        None => (None, left),
    };
    if from.is_empty() || to.is_empty() {
        return Err(bad("a name on both sides of :="));
    }
    if from.starts_with("__") && !["__ns", "__node", "__name"].contains(&from) {
        return Err(bad("__ns, __node or __name before :="));
    }
    if !from.starts_with("__") {
        for name in [from, to] {
            names::expand(name, "/", "node").map_err(|error| bad(&error.to_string()))?;
        }
    }
    Ok(Remap { node, from: from.to_owned(), to: to.to_owned() })
}

fn strip_scheme(name: &str) -> &str {
    name.strip_prefix("rostopic://").or_else(|| name.strip_prefix("rosservice://")).unwrap_or(name)
}

fn param(option: &str, assignment: &str, overrides: &mut Overrides) -> Result<(), ArgError> {
    let bad =
        |expected: String| ArgError::BadValue { option: option.to_owned(), value: assignment.to_owned(), expected };
    let (left, value) = assignment.split_once(":=").ok_or_else(|| bad("NAME:=VALUE or NODE:NAME:=VALUE".to_owned()))?;
    let (node, name) = match left.split_once(':') {
        Some((node, name)) if names::check_node_name(node).is_ok() => (node, name),
        Some(_) => return Err(bad("the name of a node, without a namespace, before the first :".to_owned())),
        None => ("/**", left),
    };
    if !names::is_parameter_name(name) {
        return Err(bad("before := a parameter's name of letters, digits and _, with . between its parts".to_owned()));
    }
    let value = Yaml::parse(value).map_err(|reason| bad(format!("a YAML value after := ({reason})")))?;
    overrides.set(node, name, value, &format!("{option} {assignment}"));
    Ok(())
}
