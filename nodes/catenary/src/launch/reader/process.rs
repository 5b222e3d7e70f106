//! Elements `<executable>` and `<node>`.

use super::element::{Element, allow, flag, seconds};
use super::state::{Place, Reader};
use super::substitution::{command_line, substitute, words};
use super::{namespace, package, parameter};
use crate::launch::description::{Grace, Parameters, Process, Restart, Shown};
use anyhow::{Context, Result, anyhow, bail, ensure};
use catenary_shell::names;
use roxmltree::Node;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Attributes that both elements have.
const OF_PROCESSES: [&str; 12] = [
    "name",
    "output",
    "respawn",
    "respawn_delay",
    "respawn_max_retries",
    "cwd",
    "launch-prefix",
    "on_exit",
    "sigterm_timeout",
    "sigkill_timeout",
    "if",
    "unless",
];
/// ROS 2 package of this program's own nodes.
const OWN_PACKAGE: &str = "catenary";

/// Returns an error for attributes or children that an `<executable>` does not have.
pub fn allow_executable(node: Node<'_, '_>) -> Result<()> {
    allow(node, &["cmd"], &OF_PROCESSES, &["env"])
}

/// Returns an error for attributes or children that a `<node>` does not have.
pub fn allow_node(node: Node<'_, '_>) -> Result<()> {
    let own = ["pkg", "exec", "namespace", "exec_name", "args", "ros_args"];
    allow(node, &own, &OF_PROCESSES, &["param", "remap", "env"])
}

impl Reader<'_> {
    /// Adds the process of an `<executable>`.
    pub(super) fn executable(&mut self, node: Node<'_, '_>, place: Place<'_>) -> Result<()> {
        let process = self.with(node, place, |e| {
            let cmd = node.attribute("cmd").ok_or_else(|| anyhow!("the attribute `cmd` is missing"))?;
            let command = command_line(cmd, e.scope).map_err(|e| anyhow!("cmd: {e}"))?;
            self.process(e, e.optional("name")?, command, Vec::new())
        })?;
        self.description.processes.push(process);
        Ok(())
    }

    /// Adds the process of a `<node>`, with the arguments that ROS 2's launch gives it.
    pub(super) fn node(&mut self, node: Node<'_, '_>, place: Place<'_>) -> Result<()> {
        let process = self.with(node, place, |e| {
            let split = |attribute: &str| match node.attribute(attribute) {
                Some(text) => words(text, e.scope).map_err(|e| anyhow!("{attribute}: {e}")),
                None => Ok(Vec::new()),
            };
            let mut command = vec![program(e)?];
            command.extend(split("args")?);
            if node.has_attribute("ros_args") {
                command.push("--ros-args".to_owned());
                command.extend(split("ros_args")?);
            }
            command.push("--ros-args".to_owned());
            let name = e.optional("name")?;
            if let Some(name) = &name {
                names::check_node_name(name).map_err(|e| anyhow!("name: {e}"))?;
                command.extend(["-r".to_owned(), format!("__node:={name}")]);
            }
            let outer = self.context.variables.get(namespace::VARIABLE).map(String::as_str);
            let namespace = namespace::join(outer, e.optional("namespace")?.as_deref())?;
            if let Some(namespace) = &namespace {
                command.extend(["-r".to_owned(), format!("__ns:={namespace}")]);
            }
            let whose = name.zip(namespace).map(|(name, namespace)| names::node_path(&namespace, &name));
            let files = self.parameters(node, place, whose.as_deref().unwrap_or("/**"), &mut command)?;
            for child in children(node, "remap") {
                let rule = self.of_child(child, place, &["from", "to"])?;
                command.extend(["-r".to_owned(), format!("{}:={}", rule[0], rule[1])]);
            }
            self.process(e, e.optional("exec_name")?, command, files)
        })?;
        self.description.processes.push(process);
        Ok(())
    }

    /// Appends each `<param>` to the command, in order. Values become parameter files of the process.
    fn parameters(
        &self,
        node: Node<'_, '_>,
        place: Place<'_>,
        whose: &str,
        command: &mut Vec<String>,
    ) -> Result<Vec<Parameters>> {
        let mut files = Vec::new();
        for child in children(node, "param") {
            let line = child.document().text_pos_at(child.range().start).row;
            let given = self.with(child, place, parameter::read).with_context(|| format!("line {line}, <param>"))?;
            command.push("--params-file".to_owned());
            match given {
                parameter::Given::File(path) => command.push(path),
                parameter::Given::Values(values) => {
                    let yaml = parameter::file(whose, &values);
                    files.push(Parameters { word: command.len(), yaml });
                    command.push("(parameters)".to_owned());
                }
            }
        }
        Ok(files)
    }

    /// Values of a child element's attributes, all of which are required.
    fn of_child(&self, child: Node<'_, '_>, place: Place<'_>, attributes: &[&str]) -> Result<Vec<String>> {
        let tag = format!("<{}>", child.tag_name().name());
        allow(child, attributes, &[], &[]).with_context(|| tag.clone())?;
        let values = self.with(child, place, |e| attributes.iter().map(|a| e.required(a)).collect());
        values.context(tag)
    }

    /// Process with the attributes that both elements share; `parameters` refer to words of `command`.
    fn process(
        &self,
        e: &Element<'_, '_, '_>,
        name: Option<String>,
        mut command: Vec<String>,
        mut parameters: Vec<Parameters>,
    ) -> Result<Process> {
        if let Some(prefix) = e.optional("launch-prefix")? {
            let prefix = shlex::split(&prefix).ok_or_else(|| anyhow!("launch-prefix: unmatched quote"))?;
            parameters.iter_mut().for_each(|p| p.word += prefix.len());
            command.splice(0..0, prefix);
        }
        let program = Path::new(&command[0]).file_name().map(|n| n.to_string_lossy().into_owned());
        let name = name.or(program).unwrap_or_else(|| command[0].clone());
        // The name is also that of the log file.
        ensure!(!name.is_empty() && !name.contains('/'), "name: expected a name without `/`, got `{name}`");
        let mut environment = self.context.environment.clone();
        for child in children(e.node, "env") {
            allow(child, &["name", "value"], &[], &[]).context("<env>")?;
            let of = |attribute| {
                let text =
                    child.attribute(attribute).ok_or_else(|| anyhow!("the attribute `{attribute}` is missing"))?;
                substitute(text, e.scope).map_err(|e| anyhow!("{attribute}: {e}"))
            };
            let (name, value) = of("name").and_then(|n| Ok((n, of("value")?))).context("<env>")?;
            environment.insert(name, Some(value));
        }
        let ends_launch = match e.node.attribute("on_exit") {
            None => false,
            // The only `on_exit` action that ROS 2's XML front end knows.
            Some("shutdown") => true,
            Some(other) => bail!("on_exit: expected shutdown, got `{other}`"),
        };
        Ok(Process {
            name,
            command,
            environment,
            directory: e.optional("cwd")?.map(PathBuf::from),
            parameters,
            restart: restart(e)?,
            shown: shown(e)?,
            grace: self.grace(e)?,
            ends_launch,
        })
    }

    /// Time limits of the end: the element's own, else the launch variables that ROS 2 reads, else the defaults.
    fn grace(&self, e: &Element<'_, '_, '_>) -> Result<Grace> {
        let time =
            |attribute: &str, default: Duration| match (e.seconds(attribute)?, self.context.variables.get(attribute)) {
                (Some(own), _) => Ok(own),
                (None, Some(variable)) => seconds(attribute, variable),
                (None, None) => Ok(default),
            };
        let default = Grace::default();
        let interrupted = time("sigterm_timeout", default.interrupted)?;
        Ok(Grace { interrupted, terminated: time("sigkill_timeout", default.terminated)? })
    }
}

/// Program of a `<node>`: the executable of its package, or `exec` unchanged. Our own nodes need no installation.
fn program(e: &Element<'_, '_, '_>) -> Result<String> {
    let exec = e.required("exec")?;
    let Some(package) = e.optional("pkg")? else { return Ok(exec) };
    match package::executable(&exec, &package, e.scope.environment) {
        Ok(path) => Ok(path.display().to_string()),
        Err(_) if package == OWN_PACKAGE && crate::node::is_node(&exec) => Ok(exec),
        Err(reason) => bail!("pkg, exec: {reason}"),
    }
}

fn restart(e: &Element<'_, '_, '_>) -> Result<Restart> {
    let respawn = e.optional("respawn")?.map_or(Ok(false), |text| flag("respawn", &text))?;
    let delay = e.seconds("respawn_delay")?.unwrap_or_default();
    let limit = match e.node.attribute("respawn_max_retries") {
        None => None,
        // A negative number means no limit, as in ROS 2's launch.
        Some(text) => match text.trim().parse::<i32>() {
            Ok(number) => u32::try_from(number).ok(),
            Err(_) => bail!("respawn_max_retries: expected a whole number, got `{text}`"),
        },
    };
    Ok(Restart { respawn, delay, limit })
}

fn shown(e: &Element<'_, '_, '_>) -> Result<Shown> {
    match e.optional("output")?.as_deref() {
        None | Some("log") => Ok(Shown { stdout: false, stderr: true }),
        Some("screen" | "both") => Ok(Shown { stdout: true, stderr: true }),
        Some("own_log") => Ok(Shown { stdout: false, stderr: false }),
        Some(other) => bail!("output: expected log, screen, both or own_log, got `{other}`"),
    }
}

fn children<'d, 'i>(node: Node<'d, 'i>, name: &'static str) -> impl Iterator<Item = Node<'d, 'i>> {
    node.children().filter(move |c| c.has_tag_name(name))
}
