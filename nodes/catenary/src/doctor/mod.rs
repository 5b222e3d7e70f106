//! `catenary doctor`: checks of this machine, of its way to a real arm, and of its ROS 2 settings.

pub mod args;
mod check;
mod daemon;
mod machine;
mod network;
mod realtime;
mod ros;

use crate::inputs::{model_file, shipped};
use crate::terminal::output;
use anyhow::{Result, bail};
use args::DoctorArgs;
use check::{Check, Verdict};
use std::path::Path;

/// Runs the checks. Returns an error if one of them says that the graph cannot work.
pub fn run(arguments: &DoctorArgs) -> Result<()> {
    // Read first: a wrong path is an error of the command line and no finding about the machine.
    let model = arguments.model.as_deref().map(model).transpose()?;
    let mut checks = machine::checks();
    checks.extend(realtime::checks(arguments.robot.is_some()));
    checks.push(network::check(arguments.robot.as_deref()));
    checks.extend(ros::checks());
    checks.extend(model);
    output::result(&arguments.output, &checks, |checks| {
        checks.iter().map(Check::words).collect::<Vec<_>>().join("\n")
    })?;
    match checks.iter().filter(|c| c.verdict == Verdict::Bad).count() {
        0 => Ok(()),
        n => bail!("{n} of {} checks say that the graph cannot work here", checks.len()),
    }
}

fn model(path: &Path) -> Result<Check> {
    match model_file::read(path) {
        Ok(m) => {
            let detail = format!("{}: `{}`, {} inferred parameters", path.display(), m.name, m.theta.dimension());
            Ok(Check::good("model", detail))
        }
        Err(error) if path.exists() || shipped::Kind::Model.named(path).is_some() => {
            Ok(Check::bad("model", format!("{error:#}"), "correct the file"))
        }
        Err(error) => Err(error),
    }
}
