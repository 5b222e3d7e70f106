//! Request for work to a node of the running graph.

use super::goal::{follow, wait};
use crate::exit::Given;
use anyhow::{Result, anyhow};
use catenary_shell::{Act, ActionClient, NodeBuilder, RosArgs, Shutdown, files};
use indicatif::ProgressBar;
use std::path::PathBuf;
use std::time::Instant;

/// Request to the nodes of a namespace.
pub struct Request<'a> {
    /// Name of the requesting node.
    pub who: &'a str,
    /// Name of the action.
    pub action: &'a str,
    /// Namespace of the nodes.
    pub namespace: &'a str,
    /// Time to wait for a server, s.
    pub wait_s: f64,
}

/// Answer to a request.
pub struct Answer<R> {
    /// Full name of the action.
    pub name: String,
    /// Result of the action.
    pub result: R,
    /// Time from the request to the result, s.
    pub wall_s: f64,
}

impl Request<'_> {
    /// Sends a goal and follows it to its end. `show` updates the bar. Ctrl-C cancels the goal.
    pub fn send<A: Act>(
        &self,
        goal: A::Goal,
        bar: &ProgressBar,
        mut show: impl FnMut(&ProgressBar, A::Feedback) + Send + 'static,
    ) -> Result<Answer<A::Result>> {
        let wait = wait(self.wait_s)?;
        let interrupted = Shutdown::new();
        catenary_shell::end_on_signals(&interrupted)?;
        // Names of the actions are relative: the namespace of this node completes them.
        let namespace = format!("__ns:={}", self.namespace);
        let (arguments, _) = RosArgs::parse(["--ros-args".to_owned(), "-r".to_owned(), namespace])?;
        let node = NodeBuilder::new(self.who, &arguments)?.build()?;
        let client: ActionClient<A> = node.action_client(self.action)?;
        let (started, shown) = (Instant::now(), bar.clone());
        let result = follow(&node, &client, goal, wait, &interrupted, move |feedback| show(&shown, feedback))?;
        bar.finish_and_clear();
        Ok(Answer { name: client.name().to_owned(), result, wall_s: started.elapsed().as_secs_f64() })
    }
}

/// Absolute path of a bag, for a node that runs in another folder.
pub fn absolute(bag: &PathBuf) -> Result<String> {
    let path = std::fs::canonicalize(bag).map_err(|e| anyhow!("bag {}: {e}{}", bag.display(), files::hint(bag)));
    Ok(path.given()?.display().to_string())
}
