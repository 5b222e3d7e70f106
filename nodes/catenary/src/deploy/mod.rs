//! `catenary deploy`: one episode of a policy on the running graph.

pub mod args;

use crate::exit::WrongInput;
use crate::graph::arm_law::{self, Told};
use crate::graph::goal::{self, SilentServer, Unwatched, follow};
use crate::graph::one_arm::{REMEDY, ensure_one_arm};
use crate::inputs::policy_file;
use crate::terminal::{output, progress};
use anyhow::{Error, Result, anyhow, ensure};
use args::DeployArgs;
use catenary_core::Policy;
use catenary_msgs::action::{MoveToStart, MoveToStartGoal, RunEpisode, RunEpisodeFeedback, RunEpisodeGoal};
use catenary_msgs::std_srvs::srv::{SetBool, SetBoolRequest};
use catenary_shell::{ActionClient, Node, NodeBuilder, RosArgs, Shutdown, contract};
use indicatif::ProgressBar;
use policy_runner::convert;
use serde::Serialize;
use std::time::Duration;

/// Result of the episode.
#[derive(Debug, Serialize)]
struct Deployed {
    episode: u32,
    end: String,
    rewards: Vec<f64>,
    episode_return: f64,
}

/// Period of the lines about a wait, s.
const TELL_S: f64 = 10.0;
/// Time in which the arm must answer that it is disabled.
const DISABLE: Duration = Duration::from_secs(2);

/// Disables the arm if the node that commands it fell silent, or did not confirm the end of the episode: it may go on later, when nobody
/// watches any more.
fn stopped(node: &Node, error: Error) -> Error {
    if !(error.is::<SilentServer>() || error.is::<Unwatched>()) {
        return error;
    }
    let client = node.client::<SetBool>(contract::ENABLE.name);
    let answer =
        client.map_err(Error::from).and_then(|client| Ok(client.call(SetBoolRequest { data: false }, DISABLE)?));
    match answer {
        Ok(answer) if answer.success => anyhow!("{error:#}; the arm was disabled"),
        Ok(answer) => anyhow!("{error:#}; the arm refused to be disabled: {}", answer.message),
        Err(other) => anyhow!("{error:#}; the arm did not say that it is disabled: {other:#}"),
    }
}

/// Shows the feedback of an episode of `steps` steps on a bar: the wait for the object, then the rewards.
pub fn show_episode(bar: &ProgressBar, feedback: &RunEpisodeFeedback, steps: usize) {
    if let Some(wait) = convert::progress(feedback) {
        // Short: a bar cuts its message to the width of the terminal.
        let left = wait.remaining_s.map_or_else(String::new, |s| format!(", about {s:.0} s to go"));
        let moves = wait.motion_px.map_or_else(|| "?".to_owned(), |px| format!("{px:.1}"));
        bar.set_message(format!(
            "stay clear: waited {:.0} s{left}; {moves} px, still at {}",
            wait.waited_s, wait.limit_px
        ));
        return;
    }
    progress::advance(bar, progress::share(feedback.step + 1, steps as f64));
    bar.set_message(format!("reward {:.3}", feedback.reward));
}

/// Compares the law of a policy's training with what the graph tells of its arm. Returns a warning if there is nothing to compare with, or
/// if any arm was asked for.
///
/// # Errors
/// An arm of another law, and more than one announcement, unless any arm was asked for.
fn compare(policy: &Policy, told: &Told, any_arm: bool) -> Result<Option<String>> {
    let (what, remedy) = match told {
        Told::Law(law) => match policy.other_arm(law) {
            None => return Ok(None),
            Some(other) => (
                other.to_string(),
                "Train for this arm, with `catenary train --arm running` while its graph runs, or deploy all the same with --any-arm; \
                 nothing was sent",
            ),
        },
        // One of them may be the arm's: which one cannot be told.
        Told::Several(_) => (told.to_string(), REMEDY),
        // An arm of others announces nothing, and policies must run on it.
        Told::Nobody | Told::Nothing(_) => {
            return Ok(Some(format!(
                "the arm does not tell its law, so that it is not compared with that of the policy ({told})"
            )));
        }
    };
    if any_arm { Ok(Some(what)) } else { Err(WrongInput::error(format!("{what}. {remedy}"))) }
}

/// Refuses a policy that was trained for an arm of another law than the graph's, unless any arm is asked for.
fn ensure_trained_arm(arguments: &DeployArgs, policy: &Policy, node: &Node) -> Result<()> {
    // The file of an earlier version states no law, and waits for none.
    if policy.arm.is_none() {
        return Ok(());
    }
    let shown = arguments.policy.display();
    match compare(policy, &arm_law::of_graph(node)?, arguments.any_arm) {
        Ok(warning) => warning.iter().for_each(|words| output::warn(&format!("{shown}: {words}"))),
        Err(error) => return Err(error.context(shown.to_string())),
    }
    Ok(())
}

/// Runs the episode. Ctrl-C cancels it, which stops the arm.
pub fn run(arguments: &DeployArgs) -> Result<()> {
    let (policy, bytes) = policy_file::read(&arguments.policy)?;
    // Checked before a node exists.
    let wait = goal::wait(arguments.wait_s)?;
    // A shutdown of its own, apart from the node's: a node that has shut down can cancel nothing.
    let interrupted = Shutdown::new();
    catenary_shell::end_on_signals(&interrupted)?;
    let node = NodeBuilder::new("deploy", &RosArgs::default())?.build()?;
    let (start, episode) = (contract::MOVE_TO_START.name, contract::RUN_EPISODE.name);
    let needed = if arguments.from_here { vec![episode] } else { vec![start, episode] };
    ensure_one_arm(&node, &needed, wait, &interrupted)?;
    ensure_trained_arm(arguments, &policy, &node)?;
    if !arguments.from_here {
        let client: ActionClient<MoveToStart> = node.action_client(start)?;
        let moved = follow(&node, &client, MoveToStartGoal::default(), wait, &interrupted, |_| {});
        let moved = moved.map_err(|error| stopped(&node, error))?;
        ensure!(moved.success, "move to start: {}", moved.message);
    }
    let client: ActionClient<RunEpisode> = node.action_client(episode)?;
    let goal = RunEpisodeGoal {
        policy: bytes,
        policy_name: policy.name.clone(),
        run_all_steps: arguments.run_all_steps,
        ..RunEpisodeGoal::default()
    };
    let bar = progress::bar("episode", 0.0)?;
    match policy.moving_start() {
        Some(why) => output::tell(&format!("the episode begins at once: stay clear; {why}")),
        None => bar.set_message("begins when the object hangs still: stay clear"),
    }
    let (shown, steps, mut tell_s) = (bar.clone(), policy.steps, 0.0);
    let result = follow(&node, &client, goal, wait, &interrupted, move |feedback| {
        show_episode(&shown, &feedback, steps);
        // Without a terminal there is no bar.
        if let Some(wait) = convert::progress(&feedback).filter(|wait| shown.is_hidden() && wait.waited_s >= tell_s) {
            tell_s = wait.waited_s + TELL_S;
            output::tell(&format!("the episode begins when the object hangs still: stay clear; {wait}"));
        }
    });
    bar.finish_and_clear();
    let result = result.map_err(|error| stopped(&node, error))?;
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

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::mlp::Layer;
    use catenary_core::model::ArmLaw;
    use catenary_core::policy::Observes;
    use catenary_core::{DeltaAnchor, Mlp, Observation};

    fn lag(time_constant_s: f64) -> ArmLaw {
        ArmLaw::Lag { time_constant_s, max_speed_m_s: 0.5 }
    }

    fn policy(arm: ArmLaw) -> Policy {
        let weight = vec![0.0; 2 * Observation::LEN];
        let layer = Layer { inputs: Observation::LEN, outputs: 2, weight, bias: vec![0.0; 2] };
        Policy {
            name: "still".to_owned(),
            actor: Mlp::new(vec![layer]).unwrap(),
            observes: Observes::default(),
            plan: None,
            observation_mean: [0.0; Observation::LEN],
            observation_scale: [1.0; Observation::LEN],
            action_scale: [0.1; 2],
            step_period_s: 0.5,
            delta_anchor: DeltaAnchor::LastTarget,
            steps: 16,
            goal: None,
            arm: Some(arm),
            start_speed_m_s: None,
        }
    }

    #[test]
    fn an_arm_that_tells_nothing_gets_a_warning_and_another_or_an_unclear_one_a_refusal() {
        let policy = policy(lag(0.16));
        assert_eq!(compare(&policy, &Told::Law(lag(0.16)), false).unwrap(), None);
        for any_arm in [false, true] {
            let warning = compare(&policy, &Told::Nobody, any_arm).unwrap().expect("a warning");
            let start = "the arm does not tell its law, so that it is not compared with that of the policy (nobody";
            assert!(warning.starts_with(start), "{warning}");
        }
        for (told, part) in [(Told::Law(lag(0.08)), "--any-arm"), (Told::Several(Vec::new()), "ROS_DOMAIN_ID")] {
            let error = compare(&policy, &told, false).unwrap_err();
            let words = error.to_string();
            assert!(WrongInput::is(&error) && words.contains(part) && words.ends_with("nothing was sent"), "{words}");
            let warning = compare(&policy, &told, true).unwrap().expect("a warning");
            assert!(!warning.contains("nothing was sent"), "{warning}");
        }
    }
}
