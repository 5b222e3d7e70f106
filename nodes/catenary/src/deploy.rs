//! `catenary deploy`: one episode of a policy on the running graph.

use crate::cli::DeployArgs;
use crate::interrupted::Interrupted;
use crate::output;
use anyhow::{Context, Error, Result, anyhow, ensure};
use catenary_core::Policy;
use catenary_msgs::action::{MoveToStart, MoveToStartGoal, RunEpisode, RunEpisodeGoal};
use catenary_shell::{Act, ActionClient, CallError, NodeBuilder, RosArgs, RunningGoal, Shutdown, Status};
use indicatif::ProgressBar;
use serde::Serialize;
use std::time::{Duration, Instant};

/// How often a signal is looked for.
const LOOK: Duration = Duration::from_millis(100);
/// Time without its server after which a goal is given up.
const GONE: Duration = Duration::from_secs(5);
/// Time in which a goal must say that it is being cancelled, and then end.
const CANCEL: Duration = Duration::from_secs(5);
/// How often the server is asked whether it still runs the goal.
const ASK: Duration = Duration::from_secs(2);

/// What came of the episode.
#[derive(Debug, Serialize)]
struct Deployed {
    episode: u32,
    end: String,
    rewards: Vec<f64>,
    episode_return: f64,
}

/// Runs the episode; Ctrl-C cancels it, which stops the arm.
pub fn run(arguments: &DeployArgs) -> Result<()> {
    let path = &arguments.policy;
    let bytes = std::fs::read(path).with_context(|| format!("policy {}", path.display()))?;
    let policy = Policy::from_bytes(&bytes).with_context(|| format!("{}", path.display()))?;
    let wait = Duration::try_from_secs_f64(arguments.wait_s).ok().filter(|w| !w.is_zero());
    let wait =
        wait.with_context(|| format!("--wait-s: expected a positive number of seconds, got {}", arguments.wait_s))?;
    // Not the node's own shutdown: a node that has ended can cancel nothing.
    let interrupted = Shutdown::new();
    catenary_shell::end_on_signals(&interrupted)?;
    let node = NodeBuilder::new("deploy", &RosArgs::default())?.build()?;
    if !arguments.from_here {
        let client: ActionClient<MoveToStart> = node.action_client("panda/move_to_start")?;
        let moved = follow(&client, MoveToStartGoal::default(), wait, &interrupted, |_| {})?;
        ensure!(moved.success, "move to start: {}", moved.message);
    }
    let client: ActionClient<RunEpisode> = node.action_client("policy_runner/run_episode")?;
    let goal = RunEpisodeGoal {
        policy: bytes,
        policy_name: policy.name.clone(),
        run_all_steps: arguments.run_all_steps,
        ..RunEpisodeGoal::default()
    };
    let bar = ProgressBar::new(policy.steps as u64);
    let shown = bar.clone();
    let result = follow(&client, goal, wait, &interrupted, move |feedback| {
        shown.set_position(u64::from(feedback.step) + 1);
        shown.set_message(format!("reward {:.3}", feedback.reward));
    })?;
    bar.finish_and_clear();
    ensure!(result.success, "{}", result.message);
    let deployed = Deployed {
        episode: result.episode,
        end: result.end,
        rewards: result.rewards,
        episode_return: result.episode_return,
    };
    output::result(&arguments.output, &deployed, |d| {
        let rewards: Vec<String> = d.rewards.iter().map(|r| format!("{r:.3}")).collect();
        format!(
            "episode {}: {} after {} steps, return {:.3}\nrewards {}",
            d.episode,
            d.end,
            d.rewards.len(),
            d.episode_return,
            rewards.join(" ")
        )
    })
}

/// Sends a goal and waits for its result, however long it takes; at `interrupted` it is cancelled, and its end awaited.
fn follow<A: Act>(
    client: &ActionClient<A>,
    goal: A::Goal,
    wait: Duration,
    interrupted: &Shutdown,
    on_feedback: impl FnMut(A::Feedback) + Send + 'static,
) -> Result<A::Result> {
    let name = client.name();
    let deadline = Instant::now() + wait;
    while !client.wait_for_server(LOOK) {
        if interrupted.is_triggered() {
            return Err(Error::from(Interrupted(String::new())).context(name.to_owned()));
        }
        if Instant::now() >= deadline {
            return Err(CallError::NoServer { name: name.to_owned(), waited: wait }.into());
        }
    }
    let mut running = client.send(goal, wait, on_feedback)?;
    let (mut seen, mut asked) = (Instant::now(), Instant::now());
    loop {
        if interrupted.is_triggered() {
            return Err(cancel(name, &running));
        }
        match running.wait(LOOK) {
            Ok((_, result)) => return Ok(result),
            Err(CallError::Timeout { .. }) => {}
            Err(e) => return Err(e.into()),
        }
        if client.wait_for_server(Duration::ZERO) {
            seen = Instant::now();
        }
        ensure!(seen.elapsed() < GONE, "{name}: its server went away while the goal ran");
        // Only its answer tells a server that was started anew from the one that runs the goal.
        if asked.elapsed() > ASK {
            running.ask_again()?;
            asked = Instant::now();
        }
    }
}

/// Cancels a goal and says what came of it.
fn cancel<A: Act>(name: &str, running: &RunningGoal<A>) -> Error {
    let asked = running.cancel(CANCEL);
    match asked.and_then(|_| running.wait(CANCEL)) {
        Ok((Status::Canceled, _)) => Error::from(Interrupted(" and cancelled".to_owned())).context(name.to_owned()),
        Ok((status, _)) => anyhow!("{name}: interrupted when it was over: {status:?}"),
        Err(e) => anyhow!("{name}: interrupted, and may run on: {e}"),
    }
}
