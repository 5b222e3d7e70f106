//! Folders of ROS 2 for a user's files.

use std::path::PathBuf;

/// Returns `ROS_HOME`, otherwise `~/.ros`; `None` without a home folder.
#[must_use]
pub fn ros_home() -> Option<PathBuf> {
    variable("ROS_HOME").or_else(|| Some(variable("HOME")?.join(".ros")))
}

/// Returns the folder of logs: `ROS_LOG_DIR`, otherwise `log` in [`ros_home`].
#[must_use]
pub fn ros_log_dir() -> Option<PathBuf> {
    variable("ROS_LOG_DIR").or_else(|| Some(ros_home()?.join("log")))
}

fn variable(name: &str) -> Option<PathBuf> {
    std::env::var_os(name).filter(|v| !v.is_empty()).map(PathBuf::from)
}
