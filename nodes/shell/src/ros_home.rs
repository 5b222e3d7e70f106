//! Where ROS 2 keeps a user's files.

use std::path::PathBuf;

/// `ROS_HOME`, else `~/.ros`; none where there is no home either.
#[must_use]
pub fn ros_home() -> Option<PathBuf> {
    variable("ROS_HOME").or_else(|| Some(variable("HOME")?.join(".ros")))
}

/// Where logs go: `ROS_LOG_DIR`, else `log` in [`ros_home`].
#[must_use]
pub fn ros_log_dir() -> Option<PathBuf> {
    variable("ROS_LOG_DIR").or_else(|| Some(ros_home()?.join("log")))
}

fn variable(name: &str) -> Option<PathBuf> {
    std::env::var_os(name).filter(|v| !v.is_empty()).map(PathBuf::from)
}
