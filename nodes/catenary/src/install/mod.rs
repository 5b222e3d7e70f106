//! `catenary install`: an ament prefix with this program in it, so that `ros2 run catenary NODE` and `ros2 launch
//! catenary FILE` find nodes and launch files.

pub mod args;
mod pages;

use crate::exit::Given;
use crate::inputs::shipped::LAUNCH_CONFIGS;
use crate::node;
use crate::terminal::output;
use anyhow::{Context, Result, bail};
use args::InstallArgs;
use serde::Serialize;
use std::fs;
use std::path::{Path, PathBuf};

/// Name of the ROS 2 package.
const PACKAGE: &str = "catenary";
/// Default folder of the nodes in launch files: the stand-ins of a checkout, which are not installed.
const DEFAULT_BIN: &str = "$(dirname)/bin";
/// Manifest of the package.
const PACKAGE_XML: &str = include_str!("../../../package.xml");

/// Result of `catenary install`.
#[derive(Debug, Serialize)]
struct Installed {
    prefix: PathBuf,
    nodes: Vec<String>,
    launch_files: Vec<String>,
}

/// Creates the prefix. Files of an earlier installation are replaced.
pub fn run(arguments: &InstallArgs) -> Result<()> {
    let prefix = std::path::absolute(&arguments.prefix).context("--prefix")?;
    check(&prefix).given()?;
    let installed = lay_out(&prefix)?;
    output::result(&arguments.output, &installed, |i| {
        let prefix = i.prefix.display();
        format!("{prefix}: {} nodes\nsource {prefix}/setup.sh", i.nodes.len())
    })
}

/// Returns an error for a path with letters that have a meaning in launch files or in colon-separated lists of folders.
fn check(prefix: &Path) -> Result<()> {
    let is_awkward = |letter: char| letter.is_whitespace() || "()'\"$<>&:".contains(letter);
    if prefix.to_str().is_none_or(|path| path.contains(is_awkward)) {
        let expected = "a path that launch files can name, without blanks, brackets and colons";
        bail!("--prefix: expected {expected}, got {}", prefix.display());
    }
    Ok(())
}

fn lay_out(prefix: &Path) -> Result<Installed> {
    let (lib, share) = (prefix.join("lib").join(PACKAGE), prefix.join("share").join(PACKAGE));
    let own = std::env::current_exe().context("the path of this program")?;
    let program = prefix.join("bin").join(PACKAGE);
    // The installed program may install itself again, and must not overwrite itself.
    if fs::canonicalize(&program).ok() != fs::canonicalize(&own).ok() {
        put(&program, |draft| fs::copy(&own, draft).map(|_len| ()))?;
    }
    let names: Vec<String> = node::NODES.iter().map(|(name, _, _)| (*name).to_owned()).collect();
    for name in names.iter().map(String::as_str).chain([PACKAGE]) {
        // The program acts as the node that it is called as.
        put(&lib.join(name), |draft| std::os::unix::fs::symlink("../../bin/catenary", draft))?;
    }
    let launch = share.join("launch");
    for (name, bytes) in LAUNCH_CONFIGS {
        let is_text = [".xml", ".yaml"].iter().any(|ending| name.ends_with(ending));
        let text = std::str::from_utf8(bytes).ok().filter(|_| is_text);
        let adapted = text.map(|t| t.replace(DEFAULT_BIN, &lib.display().to_string()).into_bytes());
        put(&launch.join(name), |draft| fs::write(draft, adapted.as_deref().unwrap_or(bytes)))?;
    }
    put(&share.join("package.xml"), |draft| fs::write(draft, PACKAGE_XML))?;
    let man_pages = pages::man_pages().context("pages for man")?;
    for (path, text) in pages::completions().into_iter().chain(man_pages) {
        put(&prefix.join("share").join(path), |draft| fs::write(draft, &text))?;
    }
    let index = prefix.join("share/ament_index/resource_index/packages");
    put(&index.join(PACKAGE), |draft| fs::write(draft, ""))?;
    // One text for all three: the script asks which shell runs it.
    for shell in ["sh", "bash", "zsh"] {
        let path = prefix.join(format!("setup.{shell}"));
        // A prefix shared with other packages has a setup script of its own, which is kept.
        let is_ours = fs::read_to_string(&path).map_or(true, |text| text.starts_with(SETUP_TITLE));
        if is_ours {
            put(&path, |draft| fs::write(draft, setup(prefix)))?;
        }
    }
    let launch_files = LAUNCH_CONFIGS.iter().map(|(name, _)| (*name).to_owned()).filter(|n| n.ends_with(".launch.xml"));
    Ok(Installed { prefix: prefix.to_owned(), nodes: names, launch_files: launch_files.collect() })
}

const SETUP_TITLE: &str = "# Makes ROS 2 find the package catenary.";

/// Text of a setup script for any shell.
fn setup(prefix: &Path) -> String {
    let prefix = prefix.display();
    let add =
        |variable: &str, part: &str| format!("export {variable}='{prefix}{part}'\"${{{variable}:+:${variable}}}\"\n");
    let (bash, zsh) = (pages::BASH, pages::ZSH);
    // fish finds its completions by XDG_DATA_DIRS, and `man` its pages by PATH. Other shells cannot parse zsh's lists.
    let zsh_only = format!(
        "fpath=({prefix}/share/{zsh} $fpath); whence compdef >/dev/null && autoload -Uz _{PACKAGE} && compdef _{PACKAGE} {PACKAGE}"
    );
    let interactive = format!(
        "case $- in *i*)\n\
         if [ -n \"${{BASH_VERSION:-}}\" ]; then . '{prefix}/share/{bash}'\n\
         elif [ -n \"${{ZSH_VERSION:-}}\" ]; then eval '{zsh_only}' || true\n\
         fi\n\
         esac\n"
    );
    let data = format!("export XDG_DATA_DIRS='{prefix}/share':\"${{XDG_DATA_DIRS:-/usr/local/share:/usr/share}}\"\n");
    let paths = [add("AMENT_PREFIX_PATH", ""), add("PATH", "/bin"), data].concat();
    format!("{SETUP_TITLE}\n{paths}{interactive}")
}

/// Creates a file or link atomically, replacing an existing one.
fn put(path: &Path, make: impl FnOnce(&Path) -> std::io::Result<()>) -> Result<()> {
    let parent = path.parent().unwrap_or(Path::new("."));
    // Made beside its place and renamed: a running program's file cannot be overwritten.
    let draft = path.with_extension("part");
    let remove = |path: &Path| match fs::remove_file(path) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    };
    fs::create_dir_all(parent)
        .and_then(|()| remove(&draft))
        .and_then(|()| make(&draft))
        .and_then(|()| fs::rename(&draft, path))
        .with_context(|| format!("cannot install {}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_prefix_that_a_list_of_folders_would_take_apart_is_refused() {
        check(Path::new("/opt/lab/catenary-1.0")).unwrap();
        let error = check(Path::new("/opt/a:b")).unwrap_err().to_string();
        assert!(error.contains("without blanks, brackets and colons, got /opt/a:b"), "{error}");
    }

    #[test]
    fn launch_files_name_the_folder_that_is_replaced() {
        let launch: Vec<_> = LAUNCH_CONFIGS.iter().filter(|(name, _)| name.ends_with(".launch.xml")).collect();
        assert!(launch.len() >= 3);
        for (name, bytes) in launch {
            assert!(String::from_utf8_lossy(bytes).contains(DEFAULT_BIN), "{name}");
        }
    }
}
