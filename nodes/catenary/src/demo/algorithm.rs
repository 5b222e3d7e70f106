//! Stages of the demo: trainings, episodes on the cell, inference, and score.

use super::film::{self, Film};
use super::observe::{Observer, Seen};
use super::recording;
use super::setup::{Demo, stream};
use super::stage::Stages;
use super::summary::{Episode, Inference, Progress, Summary, Training};
use crate::deploy::show_episode;
use crate::infer::on_graph::show_inference;
use crate::launch::{Process, Supervisor};
use crate::train::on_graph::show_training;
use anyhow::{Context, Result, bail, ensure};
use catenary_core::model::DriveKind;
use catenary_core::task::{Moment, Phase};
use catenary_core::{Camera, Policy, Posterior, seed};
use catenary_msgs::action::{
    Infer, InferGoal, InferResult, MoveToStart, RunEpisode, RunEpisodeGoal, Train, TrainGoal, TrainResult,
};
use catenary_msgs::srv::SimulateRequest;
use catenary_shell::{ActionClient, DEAD_NODE, Node, Qos, contract, convert, files};
use ppo_trainer::convert as convert_training;
use std::time::{Duration, Instant};

/// Result of one training.
struct Trained {
    /// Policy, parsed.
    policy: Policy,
    /// Policy file.
    bytes: Vec<u8>,
    training: Training,
    /// Thetas that were trained on; empty if each episode drew its own.
    domains: Vec<Vec<f64>>,
}

/// Clients of the actions that the demo calls.
struct Clients {
    train: ActionClient<Train>,
    infer: ActionClient<Infer>,
    run_episode: ActionClient<RunEpisode>,
    move_to_start: ActionClient<MoveToStart>,
}

impl Demo {
    /// Runs all stages, and returns their results. `progress` gets each as soon as it is there.
    pub fn algorithm(&self, node: &Node, stages: &mut Stages<'_>, progress: &mut Progress) -> Result<Summary> {
        let clients = stages.run("start the graph", 4, |stages, bar| {
            let clients = Clients {
                train: node.action_client("ppo_trainer/train")?,
                infer: node.action_client("bayes_sim/infer")?,
                run_episode: node.action_client("policy_runner/run_episode")?,
                move_to_start: node.action_client("panda/move_to_start")?,
            };
            stages.graph.wait_for(&clients.train)?;
            bar.inc(1);
            stages.graph.wait_for(&clients.infer)?;
            bar.inc(1);
            stages.graph.wait_for(&clients.run_episode)?;
            bar.inc(1);
            stages.graph.wait_for(&clients.move_to_start)?;
            bar.inc(1);
            Ok(clients)
        })?;
        let pi0 = self.train(stages, &clients, "pi0", None)?;
        progress.training.push(pi0.training.clone());
        let (episode0, film0) = self.episode(stages, &clients, &pi0.bytes, "pi0")?;
        progress.episodes.push(episode0.clone());
        let inferred = self.infer(stages, &clients, &episode0, &pi0.bytes)?;
        let posterior = convert::posterior_from_msg(&inferred.posterior)?;
        progress.inference = Some(self.inference(posterior.clone(), &inferred, &[])?);
        let pi1 = self.train(stages, &clients, "pi1", Some(&inferred))?;
        progress.training.push(pi1.training.clone());
        let (episode1, film1) = self.episode(stages, &clients, &pi1.bytes, "pi1")?;
        progress.episodes.push(episode1.clone());
        let evaluation = self.score(stages, [("pi0", &pi0.policy), ("pi1", &pi1.policy)])?;
        let film = self.film(&film0, &film1)?;
        Ok(Summary {
            seed: self.seed,
            preset: self.sizes.preset,
            cell: self.cell,
            parameters: self.model.theta.parameters().iter().map(|p| p.name.clone()).collect(),
            truth: self.truth.clone(),
            task: *self.judge.task(),
            success_distance_m: self.judge.success_distance_m(),
            inference: self.inference(posterior, &inferred, &pi1.domains)?,
            training: vec![pi0.training, pi1.training],
            episodes: vec![episode0, episode1],
            film,
            evaluation,
            stages: stages.done.clone(),
        })
    }

    /// Trains over the prior, or over a posterior if one is given.
    fn train(
        &self,
        stages: &mut Stages<'_>,
        clients: &Clients,
        name: &str,
        inferred: Option<&InferResult>,
    ) -> Result<Trained> {
        let (over, domains) = match inferred {
            None => ("the prior", TrainGoal::DOMAINS_PRIOR),
            Some(_) => ("the posterior", TrainGoal::DOMAINS_MIXTURE),
        };
        let goal = TrainGoal {
            model_yaml: self.model_yaml.clone(),
            domains,
            mixture: inferred.map(|r| r.posterior.clone()).unwrap_or_default(),
            preset: self.sizes.training_preset.name().to_owned(),
            total_steps: self.sizes.training_steps,
            fidelity: SimulateRequest::FIDELITY_FAST,
            seed: seed::derive(self.seed, stream::TRAINING),
            ..TrainGoal::default()
        };
        let inputs = catenary_msgs::to_cdr(&goal)?;
        let result: TrainResult =
            stages.run_or_keep(&format!("train {name} over {over}"), &inputs, 1, |stages, bar| {
                let shown = bar.clone();
                let mut goal = goal;
                if self.sizes.training_preset.settings().searches_plan {
                    let domains = convert_training::domains(&goal, &self.model)?;
                    let rows = |n, draws| Ok(domains.rows(n, draws)?);
                    goal.plan = self.plan(stages, &rows, goal.seed, &mut |_| {})?.to_bytes();
                }
                let result =
                    stages.graph.goal(&clients.train, goal, move |feedback| show_training(&shown, &feedback))?;
                ensure!(result.success, "{}", result.message);
                Ok(result)
            })?;
        let policy = Policy::from_bytes(&result.policy).context("the trained policy")?;
        let path = self.folder.join(format!("{name}.safetensors"));
        files::write(&path, &result.policy)?;
        let training = Training {
            policy: name.to_owned(),
            curve: convert_training::curve(&result)?.iter().map(|p| (p.steps, p.mean_return)).collect(),
            steps_per_second: result.steps_per_second,
        };
        Ok(Trained { policy, bytes: result.policy, training, domains: self.model.theta.rows(&result.domains)? })
    }

    /// Moves the arm to its start, starts the recorder, and runs one episode of a policy.
    fn episode(
        &self,
        stages: &mut Stages<'_>,
        clients: &Clients,
        policy: &[u8],
        name: &str,
    ) -> Result<(Episode, Film)> {
        let steps = self.model.task.map_or(1, |t| t.steps as u64);
        stages.run(&format!("run {name} on the cell"), steps, |stages, bar| {
            stages.graph.move_to_start(&clients.move_to_start)?;
            let bag = format!("bags/{name}");
            // Only an interrupted run leaves one: its episode is run again.
            match std::fs::remove_dir_all(self.folder.join(&bag)) {
                Err(e) if e.kind() != std::io::ErrorKind::NotFound => return Err(e).context(bag),
                _ => {}
            }
            let mut recorder = self.start_recorder(stages, &bag)?;
            // Recorder and observer need time to discover the publishers.
            let mut observer = Observer::start(stages.graph.node, &self.folder, name, &self.model)?;
            stages.graph.pause(Duration::from_secs(1))?;
            let goal = RunEpisodeGoal {
                policy: policy.to_vec(),
                policy_name: name.to_owned(),
                seed: seed::derive(self.seed, stream::EPISODE),
                // Without it, the episode of a reaching task ends at its first success.
                run_all_steps: true,
                ..RunEpisodeGoal::default()
            };
            let shown = bar.clone();
            let (stop, stopped) = std::sync::mpsc::channel::<()>();
            let watcher = std::thread::spawn(move || {
                while stopped.try_recv().is_err() {
                    observer.look(Duration::from_millis(100))?;
                }
                observer.finish()
            });
            let result = stages.graph.goal(&clients.run_episode, goal, move |feedback| {
                show_episode(&shown, &feedback, steps as usize);
            });
            // Time for the last messages of the episode to reach the recorder.
            stages.graph.pause(Duration::from_millis(500))?;
            let _ = stop.send(());
            // Joined before the result is checked: a failed episode must not leave the thread behind.
            let seen: Seen = watcher.join().map_err(|_| anyhow::anyhow!("the observer panicked"))??;
            recorder.shut_down();
            let result = result?;
            ensure!(result.success, "{}", result.message);
            let recording = recording::fingerprint(&self.folder.join(&bag), self.cell.is_in_lock_step())?;
            let Seen { observations, frames, latency_ms, film } = seen;
            let (task, mut referee) = (self.judge.task(), self.judge.referee());
            for (step, observation) in observations.iter().enumerate().skip(1) {
                let phase = Phase::of(step, task.steps, task.rest_steps);
                referee.verdict(&Moment::of(observation, false, phase));
            }
            let episode = Episode {
                policy: name.to_owned(),
                end: result.end,
                rewards: result.rewards,
                episode_return: result.episode_return,
                distance_m: referee.distance_m(),
                path_m: observations.iter().map(catenary_core::Observation::eef_m).collect(),
                bag,
                recording,
                frames,
                keypoint_latency_ms: latency_ms,
            };
            Ok((episode, film))
        })
    }

    /// Writes the looping GIF of both episodes and returns its file name.
    fn film(&self, before: &Film, after: &Film) -> Result<String> {
        const FILE: &str = "episodes.gif";
        let Camera::Pinhole(camera) = self.model.camera.view else { bail!("the demo's model needs a pinhole camera") };
        film::write(&self.folder.join(FILE), [before, after], &camera, &self.judge)?;
        Ok(FILE.to_owned())
    }

    /// Starts `catenary record` as a process and waits until its bag exists.
    fn start_recorder(&self, stages: &mut Stages<'_>, bag: &str) -> Result<Supervisor> {
        let path = self.folder.join(bag);
        let own = std::env::current_exe().context("path of this program")?;
        let mut words = vec![own.as_os_str(), "record".as_ref(), "--out".as_ref(), path.as_os_str()];
        let profiles = self.folder.join("config/recorder_qos.yaml");
        if self.cell.is_in_lock_step() {
            std::fs::write(&profiles, lossless()).with_context(|| profiles.display().to_string())?;
            let option = "--qos-profile-overrides-path".as_ref();
            words.extend(["--use-sim-time".as_ref(), option, profiles.as_os_str()]);
        }
        let name = format!("recorder_{}", bag.replace('/', "_"));
        let mut process = Process::new(name, words.iter().map(|w| w.to_string_lossy().into_owned()).collect());
        process.environment.extend(self.domain.environment());
        let mut recorder = Supervisor::start(vec![process], &self.folder.join("log"), false)?;
        let deadline = Instant::now() + DEAD_NODE;
        while Instant::now() < deadline {
            stages.graph.pause(Duration::from_millis(100))?;
            if let Some(event) = recorder.poll()?.first() {
                bail!("{}", event.describe());
            }
            if path.exists() {
                return Ok(recorder);
            }
        }
        bail!("the recorder did not start its bag within {} s: {}", DEAD_NODE.as_secs(), path.display())
    }

    fn infer(
        &self,
        stages: &mut Stages<'_>,
        clients: &Clients,
        episode: &Episode,
        policy: &[u8],
    ) -> Result<InferResult> {
        // A policy that the drive does not use would only cause a warning.
        let by_policy = self.model.observation.drive == DriveKind::Policy;
        let goal = InferGoal {
            source: InferGoal::SOURCE_BAG,
            bags: vec![self.folder.join(&episode.bag).display().to_string()],
            model_yaml: self.model_yaml.clone(),
            preset: self.sizes.preset.name().to_owned(),
            drive: convert::drive_to_msg(self.model.observation.drive),
            policy: if by_policy { policy.to_vec() } else { Vec::new() },
            seed: seed::derive(self.seed, stream::INFERENCE),
            ..InferGoal::default()
        };
        let inputs = (&episode.recording, catenary_msgs::to_cdr(&InferGoal { bags: Vec::new(), ..goal.clone() })?);
        stages.run_or_keep("infer the parameters", &inputs, 1, |stages, bar| {
            let shown = bar.clone();
            let result = stages.graph.goal(&clients.infer, goal, move |feedback| {
                show_inference(&shown, &feedback);
            })?;
            ensure!(result.success, "{}", result.message);
            Ok(result)
        })
    }

    fn inference(&self, posterior: Posterior, result: &InferResult, domains: &[Vec<f64>]) -> Result<Inference> {
        let path = self.folder.join("posterior.json");
        files::write(&path, serde_json::to_string_pretty(&posterior)?)?;
        Ok(Inference {
            marginals: posterior.marginals()?,
            posterior,
            domains: domains.to_vec(),
            losses: result.losses.clone(),
            effective_sample_size: result.effective_sample_size,
            mass_outside: result.mass_outside,
            simulations: result.simulations,
            warnings: result.warnings.clone(),
            // In a successful result, the message gives the reason why the posterior does not fit.
            misfit: (!result.message.is_empty()).then(|| result.message.clone()),
        })
    }
}

/// Profiles of a recorder in lock step: no message of the cell or of the perception is lost, however busy the machine is.
fn lossless() -> String {
    /// An episode of 20 s at 200 Hz.
    const DEPTH: u16 = 4096;
    let lossy = contract::TOPICS.iter().filter(|topic| matches!(topic.qos, Qos::BestEffort { .. }));
    let taken = lossy.filter(|topic| **topic != contract::IMAGE && **topic != contract::CLOCK);
    let profile = |topic: &contract::Topic| {
        let name = topic.name.trim_start_matches('/');
        format!("/{name}: {{reliability: reliable, history: keep_last, depth: {DEPTH}}}\n")
    };
    taken.map(profile).collect()
}
