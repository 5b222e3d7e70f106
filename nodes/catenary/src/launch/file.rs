//! Reading a launch file.

use super::substitution::{Scope, command_line, substitute};
use anyhow::{Context, Result, anyhow, bail};
use roxmltree::{Document, Node};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Includes may nest this deep; a file that includes itself ends here.
const MAX_INCLUDE_DEPTH: usize = 8;

/// One process to start.
#[derive(Debug, Clone, PartialEq)]
pub struct Process {
    /// Name in logs and messages.
    pub name: String,
    /// Program and arguments.
    pub command: Vec<String>,
    /// Environment variables to set.
    pub environment: Vec<(String, String)>,
    /// Whether to start it again when it ends by itself.
    pub respawn: bool,
    /// Time before it is started again.
    pub respawn_delay: Duration,
}

/// An argument that a launch file declares.
#[derive(Debug, Clone, PartialEq)]
pub struct Argument {
    /// Its name.
    pub name: String,
    /// Its default; none: it must be given.
    pub default: Option<String>,
    /// What it does.
    pub description: String,
}

/// What a launch file says.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LaunchDescription {
    /// Arguments of the file itself, in order.
    pub arguments: Vec<Argument>,
    /// Processes to start, in order.
    pub processes: Vec<Process>,
}

/// Reads the launch file at `path` with the arguments `given` (`name:=value`). `environment` looks up variables.
///
/// An argument that no file declares is an error, as is any element or attribute outside the subset.
pub fn read(
    path: &Path,
    given: &[(String, String)],
    environment: &dyn Fn(&str) -> Option<String>,
) -> Result<LaunchDescription> {
    let mut reader = Reader { environment, description: LaunchDescription::default() };
    let given: BTreeMap<String, String> = given.iter().cloned().collect();
    reader.file(path, &given, 0)?;
    let declared = |name: &String| reader.description.arguments.iter().any(|a| &a.name == name);
    if let Some(unknown) = given.keys().find(|name| !declared(name)) {
        let known: Vec<&str> = reader.description.arguments.iter().map(|a| a.name.as_str()).collect();
        bail!("{}: no argument `{unknown}`; it takes {}", path.display(), known.join(", "));
    }
    Ok(reader.description)
}

struct Reader<'a> {
    environment: &'a dyn Fn(&str) -> Option<String>,
    description: LaunchDescription,
}

/// Variables and folder of the file being read.
struct FileScope {
    variables: BTreeMap<String, String>,
    directory: PathBuf,
    depth: usize,
}

impl Reader<'_> {
    fn file(&mut self, path: &Path, given: &BTreeMap<String, String>, depth: usize) -> Result<()> {
        if depth > MAX_INCLUDE_DEPTH {
            bail!("{}: includes nest deeper than {MAX_INCLUDE_DEPTH}", path.display());
        }
        let text = std::fs::read_to_string(path).with_context(|| format!("launch file {}", path.display()))?;
        let document =
            Document::parse(&text).with_context(|| format!("launch file {}: is this one, in XML?", path.display()))?;
        let root = document.root_element();
        if root.tag_name().name() != "launch" {
            let got = root.tag_name().name();
            bail!("{}: expected <launch>, got <{got}>: is this a launch file?", path.display());
        }
        let directory = path.parent().map_or_else(PathBuf::new, Path::to_path_buf);
        let mut scope = FileScope { variables: given.clone(), directory, depth };
        self.children(root, &mut scope).with_context(|| format!("launch file {}", path.display()))
    }

    fn children(&mut self, parent: Node<'_, '_>, scope: &mut FileScope) -> Result<()> {
        for node in parent.children().filter(Node::is_element) {
            let line = node.document().text_pos_at(node.range().start).row;
            self.element(node, scope).with_context(|| format!("line {line}, <{}>", node.tag_name().name()))?;
        }
        Ok(())
    }

    fn element(&mut self, node: Node<'_, '_>, scope: &mut FileScope) -> Result<()> {
        if !self.condition(node, scope)? {
            return Ok(());
        }
        match node.tag_name().name() {
            "arg" => self.argument(node, scope),
            "let" => {
                allow(node, &["name", "value", "if", "unless"])?;
                let value = self.required(node, "value", scope)?;
                scope.variables.insert(self.required(node, "name", scope)?, value);
                Ok(())
            }
            "group" => {
                allow(node, &["if", "unless", "scoped"])?;
                let outer = scope.variables.clone();
                self.children(node, scope)?;
                scope.variables = outer;
                Ok(())
            }
            "include" => self.include(node, scope),
            "executable" => self.executable(node, scope),
            other => bail!("expected arg, let, group, include or executable, got {other}"),
        }
    }

    fn argument(&mut self, node: Node<'_, '_>, scope: &mut FileScope) -> Result<()> {
        allow(node, &["name", "default", "description", "if", "unless"])?;
        let name = self.required(node, "name", scope)?;
        let default = self.optional(node, "default", scope)?;
        if !scope.variables.contains_key(&name) {
            let value = default.clone().ok_or_else(|| anyhow!("the argument `{name}` must be given: {name}:=VALUE"))?;
            scope.variables.insert(name.clone(), value);
        }
        if scope.depth == 0 {
            let description = self.optional(node, "description", scope)?.unwrap_or_default();
            self.description.arguments.push(Argument { name, default, description });
        }
        Ok(())
    }

    fn include(&mut self, node: Node<'_, '_>, scope: &FileScope) -> Result<()> {
        allow(node, &["file", "if", "unless"])?;
        let file = scope.directory.join(self.required(node, "file", scope)?);
        let mut given = BTreeMap::new();
        for child in node.children().filter(Node::is_element) {
            if !matches!(child.tag_name().name(), "arg" | "let") {
                bail!("expected <arg> or <let> inside <include>, got <{}>", child.tag_name().name());
            }
            given.insert(self.required(child, "name", scope)?, self.required(child, "value", scope)?);
        }
        self.file(&file, &given, scope.depth + 1)
    }

    fn executable(&mut self, node: Node<'_, '_>, scope: &FileScope) -> Result<()> {
        allow(node, &["cmd", "name", "output", "respawn", "respawn_delay", "if", "unless"])?;
        let cmd = node.attribute("cmd").ok_or_else(|| anyhow!("the attribute `cmd` is missing"))?;
        let command = command_line(cmd, &self.scope(scope)).map_err(|e| anyhow!("cmd: {e}"))?;
        let program = Path::new(&command[0]).file_name().map(|n| n.to_string_lossy().into_owned());
        let name = self.optional(node, "name", scope)?.or(program).unwrap_or_else(|| command[0].clone());
        let mut environment = Vec::new();
        for child in node.children().filter(Node::is_element) {
            if child.tag_name().name() != "env" {
                bail!("expected <env> inside <executable>, got <{}>", child.tag_name().name());
            }
            environment.push((self.required(child, "name", scope)?, self.required(child, "value", scope)?));
        }
        let delay = self.optional(node, "respawn_delay", scope)?.unwrap_or_else(|| "0".to_owned());
        let seconds: f64 = delay
            .parse()
            .ok()
            .filter(|s| (0.0..=3600.0).contains(s))
            .ok_or_else(|| anyhow!("respawn_delay: expected seconds between 0 and 3600, got `{delay}`"))?;
        let respawn = self.optional(node, "respawn", scope)?.map_or(Ok(false), |v| boolean("respawn", &v))?;
        let respawn_delay = Duration::from_secs_f64(seconds);
        self.description.processes.push(Process { name, command, environment, respawn, respawn_delay });
        Ok(())
    }

    fn condition(&self, node: Node<'_, '_>, scope: &FileScope) -> Result<bool> {
        let holds = self.optional(node, "if", scope)?.map_or(Ok(true), |v| boolean("if", &v))?;
        let prevented = self.optional(node, "unless", scope)?.map_or(Ok(false), |v| boolean("unless", &v))?;
        Ok(holds && !prevented)
    }

    fn scope<'s>(&'s self, scope: &'s FileScope) -> Scope<'s> {
        Scope { variables: &scope.variables, environment: self.environment, directory: &scope.directory }
    }

    fn optional(&self, node: Node<'_, '_>, attribute: &str, scope: &FileScope) -> Result<Option<String>> {
        let Some(text) = node.attribute(attribute) else { return Ok(None) };
        substitute(text, &self.scope(scope)).map(Some).map_err(|e| anyhow!("{attribute}: {e}"))
    }

    fn required(&self, node: Node<'_, '_>, attribute: &str, scope: &FileScope) -> Result<String> {
        self.optional(node, attribute, scope)?.ok_or_else(|| anyhow!("the attribute `{attribute}` is missing"))
    }
}

fn boolean(attribute: &str, text: &str) -> Result<bool> {
    match text {
        "true" | "True" | "1" => Ok(true),
        "false" | "False" | "0" => Ok(false),
        other => bail!("{attribute}: expected true or false, got `{other}`"),
    }
}

/// Refuses attributes that nothing reads.
fn allow(node: Node<'_, '_>, known: &[&str]) -> Result<()> {
    match node.attributes().find(|a| !known.contains(&a.name())) {
        Some(a) => bail!("unknown attribute `{}`; it takes {}", a.name(), known.join(", ")),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn launch(text: &str, given: &[(&str, &str)]) -> Result<LaunchDescription> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("x.launch.xml");
        std::fs::write(&path, text)?;
        std::fs::write(
            folder.path().join("inner.xml"),
            r#"<launch><arg name="who"/><executable cmd="echo $(var who)"/></launch>"#,
        )?;
        let given: Vec<(String, String)> = given.iter().map(|(a, b)| ((*a).to_owned(), (*b).to_owned())).collect();
        read(&path, &given, &|_| None)
    }

    #[test]
    fn arguments_conditions_includes_and_environment_are_applied() {
        let text = r#"<launch>
            <arg name="n" default="2" description="a number"/>
            <arg name="with" default="false"/>
            <let name="twice" value="$(var n)$(var n)"/>
            <executable cmd="run '--a b' $(var twice)" respawn="true" respawn_delay="0.5"><env name="K" value="$(var n)"/></executable>
            <executable cmd="never" if="$(var with)"/>
            <include file="inner.xml"><arg name="who" value="you$(var n)"/></include>
        </launch>"#;
        let d = launch(text, &[("n", "7")]).unwrap();
        assert_eq!(
            d.arguments[0],
            Argument { name: "n".into(), default: Some("2".into()), description: "a number".into() }
        );
        assert_eq!(d.processes.len(), 2);
        assert_eq!(d.processes[0].command, ["run", "--a b", "77"]);
        assert_eq!(d.processes[0].environment, [("K".to_owned(), "7".to_owned())]);
        assert!(d.processes[0].respawn && d.processes[0].respawn_delay == Duration::from_millis(500));
        assert_eq!(d.processes[1].command, ["echo", "you7"]);
    }

    #[test]
    fn a_value_stays_one_word_of_the_command_whatever_is_in_it() {
        let text = r#"<launch><arg name="theta"/><executable cmd="cell -p theta:=$(var theta) -p seed:=1"/></launch>"#;
        let d = launch(text, &[("theta", "[9.0, 1000.0]")]).unwrap();
        assert_eq!(d.processes[0].command, ["cell", "-p", "theta:=[9.0, 1000.0]", "-p", "seed:=1"]);
    }

    #[test]
    fn mistakes_name_file_line_and_attribute() {
        let error = |text: &str, given: &[(&str, &str)]| format!("{:#}", launch(text, given).unwrap_err());
        let e = error("<launch>\n<executable cmd=\"x\" respan=\"true\"/></launch>", &[]);
        assert!(e.contains("x.launch.xml") && e.contains("line 2") && e.contains("respan"), "{e}");
        assert!(error("<launch><arg name=\"a\"/></launch>", &[]).contains("a:=VALUE"));
        assert!(error("<launch/>", &[("b", "1")]).contains("`b`"));
        assert!(error("<launch><node pkg=\"p\"/></launch>", &[]).contains("node"));
        assert!(error("<launch><executable cmd=\"x\" if=\"maybe\"/></launch>", &[]).contains("maybe"));
    }
}
