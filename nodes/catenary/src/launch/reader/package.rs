//! ROS 2 packages, found in the ament index below each prefix of `AMENT_PREFIX_PATH`.

use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

/// Function that looks up an environment variable.
type Environment<'a> = &'a dyn Fn(&str) -> Option<String>;

/// Prefix that a package is installed in.
pub fn prefix(package: &str, environment: Environment<'_>) -> Result<PathBuf, String> {
    let paths = environment("AMENT_PREFIX_PATH").unwrap_or_default();
    let holds = |prefix: &PathBuf| prefix.join("share/ament_index/resource_index/packages").join(package).exists();
    let found = paths.split(':').filter(|p| !p.is_empty()).map(PathBuf::from).find(holds);
    found.ok_or_else(|| match paths.as_str() {
        "" => format!("no package `{package}`: AMENT_PREFIX_PATH is not set; source the workspace's setup.sh"),
        paths => format!("no package `{package}` in the prefixes of AMENT_PREFIX_PATH, {paths}"),
    })
}

/// Folder of a package's data.
pub fn share(package: &str, environment: Environment<'_>) -> Result<PathBuf, String> {
    Ok(prefix(package, environment)?.join("share").join(package))
}

/// Executable of a package.
pub fn executable(program: &str, package: &str, environment: Environment<'_>) -> Result<PathBuf, String> {
    let folder = prefix(package, environment)?.join("lib").join(package);
    let path = folder.join(program);
    let found = Some(path).filter(|path| is_executable(path));
    found.ok_or_else(|| format!("no executable `{program}` in {}", folder.display()))
}

/// Program on the `PATH`.
pub fn program(name: &str, environment: Environment<'_>) -> Result<PathBuf, String> {
    let paths = environment("PATH").unwrap_or_default();
    let found = paths.split(':').map(|folder| Path::new(folder).join(name)).find(|path| is_executable(path));
    found.ok_or_else(|| format!("no program `{name}` on the PATH"))
}

fn is_executable(path: &Path) -> bool {
    std::fs::metadata(path).is_ok_and(|m| m.is_file() && m.permissions().mode() & 0o111 != 0)
}
