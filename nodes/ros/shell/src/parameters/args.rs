//! Command line of a ROS 2 node: `--ros-args` with remaps, parameters, parameter files and log levels.
//!
//! Hand-written. The crate `ros2args` 0.5.4 drops nested maps and namespaces of parameter files, does not name the file in its
//! messages, and reads another YAML than rcl.

use super::names::{self, NameError};
use super::yaml::Yaml;
use overrides::Overrides;
use std::path::{Path, PathBuf};

pub use error::ArgError;
pub use overrides::ParamOverride;

mod error;
mod file;
mod missed;
mod overrides;

#[cfg(test)]
mod table;
#[cfg(test)]
mod tests;

/// Remapping rule `from:=to`, for every node or for one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Remap {
    /// Base name of the node; `None`: every node.
    pub node: Option<String>,
    /// Name in the code, or `__ns`, `__node`.
    pub from: String,
    /// Name to use.
    pub to: String,
}

/// Level of `--log-level`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// Every step of the program.
    Debug,
    /// Milestones.
    Info,
    /// Degraded operation.
    Warn,
    /// Failures and lost data.
    Error,
    /// Errors that end the process.
    Fatal,
}

/// ROS 2 arguments of a process.
#[derive(Clone, Debug, PartialEq)]
pub struct RosArgs {
    /// Remapping rules in the order of the command line; the first that matches applies.
    pub remaps: Vec<Remap>,
    /// Parameter values, grouped by node or pattern in the order of first appearance. [`RosArgs::params_for`] gives the order of
    /// precedence.
    pub params: Vec<ParamOverride>,
    /// `--log-level LEVEL`.
    pub log_level: Option<Level>,
    /// `--log-level NAME:=LEVEL`.
    pub logger_levels: Vec<(String, Level)>,
    /// True: logs go to `/rosout`.
    pub rosout_logs: bool,
    /// True: logs go to stderr.
    pub console_logs: bool,
    /// Options of ROS 2 without effect in these nodes.
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
    /// Parses the arguments after the program's name. Also returns the arguments outside `--ros-args ... --`.
    ///
    /// # Errors
    /// [`ArgError`], with the option or the file and field, the expected and the given value.
    pub fn parse<S: Into<String>>(args: impl IntoIterator<Item = S>) -> Result<(Self, Vec<String>), ArgError> {
        Self::parse_with(args, &|path| std::fs::read_to_string(path))
    }

    /// Parses as [`RosArgs::parse`], and reads parameter files with `read`.
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
            // Options of rcl's logging library and of security enclaves. Accepted, so that launch files of ROS 2 work unchanged.
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

    /// Returns the name and namespace of a node after `__node:=` and `__ns:=`.
    ///
    /// # Errors
    /// [`ArgError::Name`] for an invalid new name.
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

    /// Returns the absolute name of a topic or service after expansion and remapping.
    ///
    /// # Errors
    /// [`NameError`] for an invalid `name` or replacement.
    pub fn resolve(&self, name: &str, namespace: &str, node: &str) -> Result<String, NameError> {
        let expanded = names::expand(name, namespace, node)?;
        for rule in self.remaps.iter().filter(|rule| rule.is_for(node)) {
            // Rules for the node's own name and namespace.
            if rule.from.starts_with("__") {
                continue;
            }
            if names::expand(&rule.from, namespace, node)? == expanded {
                return names::expand(&rule.to, namespace, node);
            }
        }
        Ok(expanded)
    }

    /// Returns the parameter values that apply to a node. The last of several values for one parameter takes precedence.
    ///
    /// Values are grouped by the node name or pattern that they stand under, in the order of first appearance. `-p` without
    /// a node stands under `/**`. Both rules are those of ROS 2. Therefore `-p` outranks a file's entry for the node, unless `/**` appeared before
    /// that entry.
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
