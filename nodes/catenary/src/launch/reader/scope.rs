//! Scope of the substitutions in a launch file.

use std::collections::BTreeMap;
use std::path::Path;

/// Values that substitutions refer to.
pub struct Scope<'a> {
    /// Arguments and `let` variables by name.
    pub variables: &'a BTreeMap<String, String>,
    /// Function that looks up an environment variable, with the changes of earlier elements.
    pub environment: &'a dyn Fn(&str) -> Option<String>,
    /// Absolute path of the launch file.
    pub file: &'a Path,
    /// Path of an included file, set behind the `<include>`: there, ROS 2's front end takes that file for the current
    /// one.
    pub included: Option<&'a Path>,
}
