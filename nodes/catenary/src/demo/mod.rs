//! `catenary demo`: Algorithm 1 by itself, on a cell whose parameters nobody else is told.

mod config;
mod domain;
mod film;
mod observe;
pub mod page;
mod score;
mod stage;
mod story;
pub mod summary;

use crate::cli::DemoArgs;
use crate::interrupted::Interrupted;
use crate::launch::{self, Process, Supervisor};
use crate::misfit::Misfit;
use crate::served::{show_inference, show_training};
use crate::wrong_input::Given;
use crate::{output, progress};
use anyhow::{Context, Result, bail, ensure};
use catenary_core::model::DriveKind;
use catenary_core::task::Moment;
use catenary_core::{Camera, Judge, Model, Policy, Posterior, seed};
use catenary_msgs::action::{
    Infer, InferGoal, InferResult, MoveToStart, MoveToStartGoal, RunEpisode, RunEpisodeGoal, Train, TrainGoal,
    TrainResult,
};
use catenary_msgs::srv::SimulateRequest;
use catenary_shell::{ActionClient, Discovery, Node, NodeBuilder, RosArgs, convert};
use domain::OwnDomain;
use film::Film;
use observe::{Observer, Seen};
use rand::RngExt;
use stage::Stages;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::Duration;
use summary::{Episode, Inference, Summary, Training};

/// Random streams of the demo's seed.
mod stream {
    pub const TRUTH: u64 = 1;
    pub const TRAINING: u64 = 2;
    pub const INFERENCE: u64 = 3;
    pub const EPISODE: u64 = 4;
    pub const CELL: u64 = 5;
    pub const SCORE: u64 = 6;
}

/// Sizes of a demo.
struct Sizes {
    name: &'static str,
    training_preset: &'static str,
    /// Environment steps of each training; 0: the preset's.
    training_steps: u64,
}

const DEFAULT: Sizes = Sizes { name: "default", training_preset: "default", training_steps: 61_440 };
const PAPER: Sizes = Sizes { name: "paper", training_preset: "sb3", training_steps: 120_000 };

/// Everything that stays the same during a demo.
struct Demo {
    model: Model,
    judge: Judge,
    folder: PathBuf,
    seed: u64,
    sizes: Sizes,
    truth: Vec<f64>,
    domain: OwnDomain,
}

/// What a training gave.
struct Trained {
    /// The policy.
    policy: Policy,
    /// Its file.
    bytes: Vec<u8>,
    training: Training,
    /// Thetas trained on; none where they were drawn anew.
    domains: Vec<Vec<f64>>,
}

/// The actions that the demo calls.
struct Clients {
    train: ActionClient<Train>,
    infer: ActionClient<Infer>,
    run_episode: ActionClient<RunEpisode>,
    move_to_start: ActionClient<MoveToStart>,
}

/// Runs the demo and prints where the report is.
pub fn run(arguments: &DemoArgs) -> Result<()> {
    // A wrong environment is refused before anything is written.
    catenary_shell::domain_id()?;
    let folder = config::fresh_folder(&arguments.out)?;
    let taken = match folder == arguments.out {
        true => String::new(),
        false => format!(", because {} exists already", arguments.out.display()),
    };
    let folder = folder.canonicalize().with_context(|| folder.display().to_string())?;
    let launch_file = config::write(&folder.join("config"))?;
    let model = Model::from_yaml(config::MODEL)?;
    let judge = Judge::of(&model).context("the demo's model needs a task")?;
    let truth = hidden_truth(&model, arguments.seed);
    let sizes = if arguments.paper { PAPER } else { DEFAULT };
    let builder = NodeBuilder::new("demo", &RosArgs::default())?;
    catenary_shell::end_on_signals(builder.shutdown())?;
    let domain = OwnDomain::claim()?;
    if builder.shutdown().is_triggered() {
        return Err(Interrupted(String::new()).into());
    }
    let demo = Demo { model, judge, folder, seed: arguments.seed, sizes, truth, domain };
    let node = builder.domain(demo.domain.id(), Discovery::Localhost).build()?;
    output::tell(&format!("catenary demo: results go to {}{taken}", demo.folder.display()));
    output::tell(&format!("catenary demo: {}", demo.domain.words()));
    let supervisor = demo.launch(&launch_file)?;
    let mut stages = Stages::new(&node, supervisor);
    let outcome = demo.algorithm(&node, &mut stages);
    stages.supervisor.shut_down();
    let summary = outcome?;
    summary.write(&demo.folder)?;
    let page = page::write(&demo.folder, &summary)?;
    output::tell(&format!("report: {}", page.display()));
    output::result(&arguments.output, &summary, Summary::words)?;
    Misfit::check(summary.inference.misfit.as_ref(), &demo.folder)
}

/// Builds the report of a demo's folder again.
pub fn rebuild(folder: &Path) -> Result<PathBuf> {
    let summary = Summary::read(folder).given()?;
    for bag in summary.episodes.iter().map(|e| folder.join(&e.bag)).filter(|bag| !bag.exists()) {
        tracing::warn!("{} is gone: the report names it all the same", bag.display());
    }
    page::write(folder, &summary)
}

/// Unit coordinates that hidden values are drawn from: away from the prior's edges.
const HIDDEN: Range<f64> = 0.1..0.9;
/// Those of the modulus: about 6 to 34 kPa. Softer bars, which the prior holds too, stretch down to the table, and no motion
/// brings their end to the target.
const HIDDEN_MODULUS: Range<f64> = 0.45..0.9;

/// The cell's parameters.
fn hidden_truth(model: &Model, demo_seed: u64) -> Vec<f64> {
    let mut rng = seed::rng(demo_seed, stream::TRUTH);
    let mut unit = |name: &str| rng.random_range(if name == "youngs_modulus_pa" { HIDDEN_MODULUS } else { HIDDEN });
    let u: Vec<f64> = model.theta.parameters().iter().map(|p| unit(&p.name)).collect();
    model.theta.from_unit(&u)
}

impl Demo {
    /// Starts the graph; the hidden values go to the cell's process alone.
    fn launch(&self, launch_file: &Path) -> Result<Supervisor> {
        let values: Vec<String> = self.truth.iter().map(|v| format!("{v:?}")).collect();
        let given = [
            ("model", launch_file.with_file_name(config::MODEL_FILE).display().to_string()),
            ("cell_theta", format!("[{}]", values.join(","))),
            ("cell_fidelity", "reference".to_owned()),
            ("seed", (seed::derive(self.seed, stream::CELL) >> 33).to_string()),
            ("respawn", "false".to_owned()),
        ]
        .map(|(k, v)| (k.to_owned(), v));
        let mut description = launch::read(launch_file, &given, &|name| std::env::var(name).ok())?;
        description.processes.iter_mut().for_each(|p| p.environment.extend(self.domain.environment()));
        Supervisor::start(description.processes, &self.folder.join("log"), false)
    }

    fn algorithm(&self, node: &Node, stages: &mut Stages<'_>) -> Result<Summary> {
        let clients = stages.run("start the graph", 4, |stages, bar| {
            let clients = Clients {
                train: node.action_client("ppo_trainer/train")?,
                infer: node.action_client("bayes_sim/infer")?,
                run_episode: node.action_client("policy_runner/run_episode")?,
                move_to_start: node.action_client("panda/move_to_start")?,
            };
            wait_for(stages, "ppo_trainer/train", |t| clients.train.wait_for_server(t))?;
            bar.inc(1);
            wait_for(stages, "bayes_sim/infer", |t| clients.infer.wait_for_server(t))?;
            bar.inc(1);
            wait_for(stages, "policy_runner/run_episode", |t| clients.run_episode.wait_for_server(t))?;
            bar.inc(1);
            wait_for(stages, "panda/move_to_start", |t| clients.move_to_start.wait_for_server(t))?;
            bar.inc(1);
            Ok(clients)
        })?;
        let pi0 = self.train(stages, &clients, "pi0", None)?;
        let (episode0, film0) = self.episode(stages, &clients, &pi0.bytes, "pi0")?;
        let inferred = self.infer(stages, &clients, &episode0, &pi0.bytes)?;
        let posterior = convert::posterior_from_msg(&inferred.posterior)?;
        let pi1 = self.train(stages, &clients, "pi1", Some(&inferred))?;
        let (episode1, film1) = self.episode(stages, &clients, &pi1.bytes, "pi1")?;
        let evaluation = self.score(stages, [("pi0", &pi0.policy), ("pi1", &pi1.policy)])?;
        let film = self.film(&film0, &film1)?;
        Ok(Summary {
            seed: self.seed,
            preset: self.sizes.name.to_owned(),
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

    /// Trains over the prior, or over a posterior.
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
            model_yaml: config::MODEL.to_owned(),
            domains,
            mixture: inferred.map(|r| r.posterior.clone()).unwrap_or_default(),
            preset: self.sizes.training_preset.to_owned(),
            total_steps: self.sizes.training_steps,
            fidelity: SimulateRequest::FIDELITY_FAST,
            seed: seed::derive(self.seed, stream::TRAINING),
            ..TrainGoal::default()
        };
        let result: TrainResult = stages.run(&format!("train {name} over {over}"), 1, |stages, bar| {
            let shown = bar.clone();
            let result = stages.goal(&clients.train, goal, move |feedback| show_training(&shown, &feedback))?;
            ensure!(result.success, "{}", result.message);
            Ok(result)
        })?;
        let policy = Policy::from_bytes(&result.policy).context("the trained policy")?;
        let path = self.folder.join(format!("{name}.safetensors"));
        std::fs::write(&path, &result.policy).with_context(|| path.display().to_string())?;
        let training = Training {
            policy: name.to_owned(),
            curve: result.curve_steps.iter().copied().zip(result.curve_returns.iter().copied()).collect(),
            steps_per_second: result.steps_per_second,
        };
        Ok(Trained { policy, bytes: result.policy, training, domains: self.model.theta.rows(&result.domains)? })
    }

    /// Moves to the start, records, and runs one episode of a policy.
    fn episode(
        &self,
        stages: &mut Stages<'_>,
        clients: &Clients,
        policy: &[u8],
        name: &str,
    ) -> Result<(Episode, Film)> {
        let steps = self.model.task.map_or(1, |t| t.steps as u64);
        stages.run(&format!("run {name} on the cell"), steps, |stages, bar| {
            domain::ensure_own_arm(stages.node, &stages.supervisor)?;
            let moved = stages.goal(&clients.move_to_start, MoveToStartGoal::default(), |_| {})?;
            ensure!(moved.success, "move to start: {}", moved.message);
            let bag = format!("bags/{name}");
            let mut recorder = self.start_recorder(stages, &bag)?;
            let mut observer = Observer::start(stages.node, &self.folder, name, &self.model)?;
            stages.pause(Duration::from_secs(1))?;
            let goal = RunEpisodeGoal {
                policy: policy.to_vec(),
                policy_name: name.to_owned(),
                seed: seed::derive(self.seed, stream::EPISODE),
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
            let result = stages.goal(&clients.run_episode, goal, move |feedback| {
                progress::advance(&shown, progress::share(feedback.step + 1, steps as f64));
                shown.set_message(format!("reward {:.3}", feedback.reward));
            });
            stages.pause(Duration::from_millis(500))?;
            let _ = stop.send(());
            let seen: Seen = watcher.join().map_err(|_| anyhow::anyhow!("the observer panicked"))??;
            recorder.shut_down();
            let result = result?;
            ensure!(result.success, "{}", result.message);
            let Seen { observations, frames, latency_ms, film } = seen;
            let moments = observations.iter().skip(1).map(|o| Moment::of(o, false, false));
            let episode = Episode {
                policy: name.to_owned(),
                end: result.end,
                rewards: result.rewards,
                episode_return: result.episode_return,
                distance_m: self.judge.achieved_m(moments),
                path_m: observations.iter().map(catenary_core::Observation::eef_m).collect(),
                bag,
                frames,
                keypoint_latency_ms: latency_ms,
            };
            Ok((episode, film))
        })
    }

    /// Writes both episodes as one looping picture.
    fn film(&self, before: &Film, after: &Film) -> Result<String> {
        const FILE: &str = "episodes.gif";
        let Camera::Pinhole(camera) = self.model.camera.view else { bail!("the demo's model needs a pinhole camera") };
        film::write(&self.folder.join(FILE), [before, after], &camera, &self.judge)?;
        Ok(FILE.to_owned())
    }

    /// Starts `catenary record` as a process of its own, and waits until its bag is there.
    fn start_recorder(&self, stages: &mut Stages<'_>, bag: &str) -> Result<Supervisor> {
        let path = self.folder.join(bag);
        let own = std::env::current_exe().context("path of this program")?;
        let words = [own.as_os_str(), "record".as_ref(), "--out".as_ref(), path.as_os_str()];
        let name = format!("recorder_{}", bag.replace('/', "_"));
        let mut process = Process::new(name, words.iter().map(|w| w.to_string_lossy().into_owned()).collect());
        process.environment.extend(self.domain.environment());
        let mut recorder = Supervisor::start(vec![process], &self.folder.join("log"), false)?;
        for _ in 0..100 {
            stages.pause(Duration::from_millis(100))?;
            if let Some(event) = recorder.poll()?.first() {
                bail!("{}", event.describe());
            }
            if path.exists() {
                return Ok(recorder);
            }
        }
        bail!("the recorder did not start its bag within 10 s: {}", path.display())
    }

    fn infer(
        &self,
        stages: &mut Stages<'_>,
        clients: &Clients,
        episode: &Episode,
        policy: &[u8],
    ) -> Result<InferResult> {
        let by_policy = self.model.observation.drive == DriveKind::Policy;
        let goal = InferGoal {
            source: InferGoal::SOURCE_BAG,
            bags: vec![self.folder.join(&episode.bag).display().to_string()],
            model_yaml: config::MODEL.to_owned(),
            preset: self.sizes.name.to_owned(),
            drive: convert::drive_to_msg(self.model.observation.drive),
            policy: if by_policy { policy.to_vec() } else { Vec::new() },
            seed: seed::derive(self.seed, stream::INFERENCE),
            ..InferGoal::default()
        };
        stages.run("infer the parameters", 1, |stages, bar| {
            let shown = bar.clone();
            let result = stages.goal(&clients.infer, goal, move |feedback| {
                show_inference(&shown, &feedback);
            })?;
            ensure!(result.success, "{}", result.message);
            Ok(result)
        })
    }

    fn inference(&self, posterior: Posterior, result: &InferResult, domains: &[Vec<f64>]) -> Result<Inference> {
        let path = self.folder.join("posterior.json");
        std::fs::write(&path, serde_json::to_string_pretty(&posterior)?).with_context(|| path.display().to_string())?;
        Ok(Inference {
            marginals: posterior.marginals()?,
            posterior,
            domains: domains.to_vec(),
            losses: result.losses.clone(),
            effective_sample_size: result.effective_sample_size,
            mass_outside: result.mass_outside,
            simulations: result.simulations,
            warnings: result.warnings.clone(),
            // With success, the message is why the posterior fits nothing.
            misfit: (!result.message.is_empty()).then(|| result.message.clone()),
        })
    }
}

/// Waits for a server, ready for Ctrl-C and for processes that end.
fn wait_for(stages: &mut Stages<'_>, name: &str, ready: impl Fn(Duration) -> bool) -> Result<()> {
    const PATIENCE: usize = 100;
    for _ in 0..PATIENCE {
        if ready(Duration::from_millis(200)) {
            return Ok(());
        }
        stages.pause(Duration::from_millis(10))?;
    }
    bail!("{name}: nobody offers it after 20 s")
}
