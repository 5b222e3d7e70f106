//! `catenary deploy`: one episode of a policy on the running graph.

use crate::cli::DeployArgs;
use crate::output;
use anyhow::{Context, Result, bail, ensure};
use catenary_core::Policy;
use catenary_msgs::action::{MoveToStart, MoveToStartGoal, RunEpisode, RunEpisodeGoal};
use catenary_shell::{Act, ActionClient, CallError, NodeBuilder, RosArgs};
use indicatif::ProgressBar;
use serde::Serialize;
use std::time::{Duration, Instant};

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

/// Runs the episode; Ctrl-C cancels it.
pub fn run(arguments: &DeployArgs) -> Result<()> {
    let path = &arguments.policy;
    let bytes = std::fs::read(path).with_context(|| format!("policy {}", path.display()))?;
    let policy = Policy::from_bytes(&bytes).with_context(|| format!("{}", path.display()))?;
    let wait = Duration::try_from_secs_f64(arguments.wait_s).ok().filter(|w| !w.is_zero());
    let wait =
        wait.with_context(|| format!("--wait-s: expected a positive number of seconds, got {}", arguments.wait_s))?;
    let builder = NodeBuilder::new("deploy", &RosArgs::default())?;
    catenary_shell::end_on_signals(builder.shutdown())?;
    let node = builder.build()?;
    if !arguments.from_here {
        let client: ActionClient<MoveToStart> = node.action_client("panda/move_to_start")?;
        let moved = follow(&client, MoveToStartGoal::default(), wait, |_| {})?;
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
    let result = follow(&client, goal, wait, move |feedback| {
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

/// Sends a goal and waits for its result, however long it takes; Ctrl-C cancels it.
fn follow<A: Act>(
    client: &ActionClient<A>,
    goal: A::Goal,
    wait: Duration,
    on_feedback: impl FnMut(A::Feedback) + Send + 'static,
) -> Result<A::Result> {
    let mut running = client.send(goal, wait, on_feedback)?;
    let mut asked = Instant::now();
    loop {
        match running.wait(Duration::from_millis(500)) {
            Ok((_, result)) => return Ok(result),
            Err(CallError::Timeout { .. }) => {}
            Err(CallError::Shutdown { name }) => bail!("{name}: interrupted; the goal ends with this program"),
            Err(e) => return Err(e.into()),
        }
        // Only its answer tells a server that was started anew from the one that runs the goal.
        if asked.elapsed() > ASK {
            running.ask_again()?;
            asked = Instant::now();
        }
        if !client.wait_for_server(Duration::from_secs(5)) {
            bail!("{}: its server went away while the goal ran", client.name());
        }
    }
}
