//! Plan of a study: objects, tasks, policies, and the files of the work.

use super::args::StudyArgs;
use super::evidence::Evidence;
use super::further::Further;
use crate::exit::{Given, WrongInput};
use crate::graph::own::Cell;
use crate::inputs::model_file;
use crate::options::{ArmOption, TaskOption};
use crate::plan::is_searched;
use crate::terminal::output;
use anyhow::{Context, Result, ensure};
use catenary_core::Model;
use catenary_core::policy::Observes;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// File of the plan in the folder of a study.
const FILE: &str = "plan.json";

/// Hidden object. Laboratory, scoring, the oracle policies and the report read `truth`; inference and the other trainings do not.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Object {
    /// Name of its model.
    pub name: String,
    /// Values of the inferred parameters, in the order of the model.
    pub truth: Vec<f64>,
}

/// Object that a policy is trained for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Knowledge {
    /// Nothing: the prior.
    Prior,
    /// The middle of the prior in each parameter, as one object.
    Median,
    /// Posterior of an object.
    Posterior {
        /// Index of the object.
        object: usize,
        /// Index of the evidence.
        evidence: usize,
    },
    /// True parameters of an object, by its index: what no inference can exceed.
    Truth(usize),
}

impl Knowledge {
    /// Knowledge of an object's matched policy: its posterior from the first evidence.
    pub fn own(object: usize) -> Self {
        Self::Posterior { object, evidence: 0 }
    }
}

/// Chain of work: one training of a policy for a task, and its scores.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Chain {
    /// Index of the task.
    pub task: usize,
    /// Knowledge of the policy.
    pub knowledge: Knowledge,
    /// Number of the training, from 0.
    pub training: u64,
}

/// Place of a deployment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// Hidden object, by its index.
    Object(usize),
    /// Simulation as in the policy's training: a sample of what it was trained over, at the training's fidelity.
    OwnSimulation,
}

/// Everything that the results of a study depend on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    /// Version of the program: another one may give other bits.
    pub program: String,
    /// Text of the model.
    pub model_yaml: String,
    /// Names of the tasks.
    pub tasks: Vec<String>,
    /// Text of the model of each task.
    pub task_yamls: Vec<String>,
    /// Hidden objects.
    pub objects: Vec<Object>,
    /// Policies beside U and those of the posteriors.
    pub policies: Vec<Further>,
    /// Trainings of each policy.
    pub seeds: u64,
    /// Most environment steps of a training.
    pub steps: u64,
    /// What the policies observe.
    pub observes: Observes,
    /// True if plans are searched: trainings begin with one, and the best plan for each object is scored.
    pub searches_plans: bool,
    /// Preset of the trainings.
    pub preset: String,
    /// Episodes that score a training on an object.
    pub episodes: u64,
    /// Deployments of the first training of a policy on an object.
    pub repeats: u64,
    /// Evidence of the posteriors of each object.
    pub evidence: Vec<Evidence>,
    /// Seed of every draw.
    pub seed: u64,
}

/// Arm of the trainings: the one that was asked for, or that of the cell. None: those of the model and of the tasks.
fn arm(arguments: &StudyArgs) -> Option<ArmOption> {
    let of_the_cell = || (arguments.cell == Some(Cell::Emulated)).then(|| Cell::Emulated.name().into());
    arguments.arm.arm.clone().or_else(of_the_cell).map(|arm| ArmOption { arm: Some(arm) })
}

impl Plan {
    /// Plan of the arguments. Returns an error for models and tasks that cannot be read, or objects that are not of the model.
    pub fn of(arguments: &StudyArgs) -> Result<(Self, Models)> {
        Self::read(arguments).given()
    }

    fn read(arguments: &StudyArgs) -> Result<(Self, Models)> {
        let (model, model_yaml) = model_file::read_with_text(&arguments.model)?;
        let arm = arm(arguments);
        let with_arm =
            |model: Model| arm.as_ref().map_or_else(|| Ok(model.clone()), |arm| arm.applied_to(model.clone()));
        let own = model.clone();
        let model = with_arm(model)?;
        let model_yaml = if model == own { model_yaml } else { model.rewrite(&model_yaml)? };
        ensure!(model.task.is_some(), "--model {}: it has no task", arguments.model.display());
        let mut tasks = Vec::new();
        let mut models = Vec::new();
        for path in &arguments.task {
            let name = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
            ensure!(!tasks.contains(&name), "--task {name}: it is named twice");
            models.push(with_arm(TaskOption { task: Some(path.clone()) }.applied_to(model.clone())?)?);
            tasks.push(name);
        }
        let object = |path: &PathBuf| {
            let bar = model_file::read(path)?;
            let shown = path.display();
            let is_plain = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
            let is_taken = ["U", "mu"].contains(&bar.name.as_str()) || bar.name.starts_with("true_");
            ensure!(
                bar.name.chars().all(is_plain) && !bar.name.is_empty() && !is_taken,
                "--objects {shown}: expected a name of letters, digits, _ and - that is none of a policy (U, mu, true_...), got {}",
                bar.name
            );
            // Only the hidden values differ: the posterior is over those alone.
            for (what, differs) in
                [("object", bar.object != model.object), ("parameters", bar.parameters != model.parameters)]
            {
                ensure!(!differs, "--objects {shown}: {what}: expected that of --model {}, got another", model.name);
            }
            let value = |name: &str| {
                bar.nominal.get(name).copied().with_context(|| {
                    format!("--objects {}: expected a nominal value of {name}, got none", path.display())
                })
            };
            let truth = model.theta.parameters().iter().map(|p| value(&p.name)).collect::<Result<Vec<f64>>>()?;
            for (parameter, value) in model.theta.parameters().iter().zip(&truth) {
                if !parameter.prior.holds(*value) {
                    let (name, prior) = (&parameter.name, &parameter.prior);
                    output::warn(&format!(
                        "--objects {shown}: {name} {value} lies outside its prior, {prior}: inference cannot find it"
                    ));
                }
            }
            Ok(Object { name: bar.name, truth })
        };
        let objects = arguments.objects.iter().map(object).collect::<Result<Vec<Object>>>()?;
        for (i, object) in objects.iter().enumerate() {
            let twice = objects[..i].iter().any(|o| o.name == object.name);
            ensure!(!twice, "--objects: {} is named twice", object.name);
        }
        let mut training = arguments.observes.applied_to(arguments.preset.settings());
        training.total_steps = arguments.steps.unwrap_or(training.total_steps);
        training.check().context("--steps, --history")?;
        for (i, evidence) in arguments.evidence.iter().enumerate() {
            ensure!(!arguments.evidence[..i].contains(evidence), "--evidence {evidence}: it is named twice");
        }
        let plan = Self {
            program: env!("CATENARY_VERSION").to_owned(),
            model_yaml,
            tasks,
            task_yamls: models.iter().map(Model::to_yaml).collect::<Result<_, _>>()?,
            objects,
            policies: [Further::Mu, Further::Told].into_iter().filter(|p| arguments.policies.contains(p)).collect(),
            seeds: arguments.seeds,
            steps: training.total_steps,
            observes: training.observes,
            searches_plans: !arguments.no_plan && models.iter().all(is_searched),
            preset: arguments.preset.name().to_owned(),
            episodes: arguments.episodes,
            repeats: arguments.repeats,
            evidence: arguments.evidence.clone(),
            seed: arguments.seed,
        };
        Ok((plan, Models { model, tasks: models }))
    }

    /// Writes the plan to the folder of the study, or checks that the folder's plan is this one.
    pub fn keep(&self, folder: &Path) -> Result<()> {
        let path = folder.join(FILE);
        if !path.exists() {
            return super::files::write(&path, &serde_json::to_vec_pretty(self)?);
        }
        let text = catenary_shell::files::read_text("plan", &path).given()?;
        let kept: serde_json::Value =
            serde_json::from_str(&text).with_context(|| path.display().to_string()).given()?;
        let own = serde_json::to_value(self)?;
        let Some(field) =
            own.as_object().and_then(|own| own.iter().find(|(name, value)| kept.get(name) != Some(value)))
        else {
            return Ok(());
        };
        let short =
            |v: Option<&serde_json::Value>| v.map_or("none".to_owned(), |v| v.to_string().chars().take(60).collect());
        Err(WrongInput::error(format!(
            "{}: {}: expected {} as in this command, got {}: take another --out",
            path.display(),
            field.0,
            short(Some(field.1)),
            short(kept.get(field.0))
        )))
    }

    /// Knowledge of the policies that are deployed: those of the paper, in its order.
    pub fn deployed(&self) -> Vec<Knowledge> {
        let own = (0..self.objects.len()).map(Knowledge::own);
        let median = self.policies.contains(&Further::Mu).then_some(Knowledge::Median);
        [Knowledge::Prior].into_iter().chain(median).chain(own).collect()
    }

    /// Knowledge of all policies: those that are deployed, the oracle policies, and those of the additional evidence.
    pub fn knowledge(&self) -> Vec<Knowledge> {
        let n = self.objects.len();
        let further = (1..self.evidence.len())
            .flat_map(|evidence| (0..n).map(move |object| Knowledge::Posterior { object, evidence }));
        let told = if self.policies.contains(&Further::Told) { n } else { 0 };
        self.deployed().into_iter().chain((0..told).map(Knowledge::Truth)).chain(further).collect()
    }

    /// Places of the deployments of a policy: the objects, and at the end its own simulation.
    pub fn places(&self) -> Vec<Place> {
        (0..self.objects.len()).map(Place::Object).chain([Place::OwnSimulation]).collect()
    }

    /// Chains of work, in order. Those of one number of training stand together, so that a stopped study has whole trainings.
    pub fn chains(&self) -> Vec<Chain> {
        let knowledge = self.knowledge();
        let of = |training: u64| {
            let knowledge = knowledge.clone();
            (0..self.tasks.len()).flat_map(move |task| {
                knowledge.clone().into_iter().map(move |k| Chain { task, knowledge: k, training })
            })
        };
        (0..self.seeds).flat_map(of).collect()
    }

    /// Name of a policy: U and mu as in the paper, the object's name, "true" and the object's name, or the object's name and its further
    /// evidence.
    pub fn policy_name(&self, knowledge: Knowledge) -> String {
        match knowledge {
            Knowledge::Prior => "U".to_owned(),
            Knowledge::Median => "mu".to_owned(),
            Knowledge::Posterior { object, evidence: 0 } => self.objects[object].name.clone(),
            Knowledge::Posterior { object, evidence } => {
                format!("{}+{}", self.objects[object].name, self.evidence[evidence])
            }
            Knowledge::Truth(object) => format!("true {}", self.objects[object].name),
        }
    }

    /// File of the policy that records the objects.
    pub fn recorder_file(&self) -> PathBuf {
        "recorder.safetensors".into()
    }

    /// File of a posterior of an object.
    pub fn posterior_file(&self, object: usize, evidence: usize) -> PathBuf {
        format!("posteriors/{}.json", self.file_name(Knowledge::Posterior { object, evidence })).into()
    }

    /// File of the policy of a chain.
    pub fn training_file(&self, chain: &Chain) -> PathBuf {
        self.file("trainings", chain, "safetensors")
    }

    /// File of the scores of a chain.
    pub fn scores_file(&self, chain: &Chain) -> PathBuf {
        self.file("scores", chain, "json")
    }

    /// File of the scores of the best plan for an object.
    pub fn plan_scores_file(&self, task: usize, object: usize) -> PathBuf {
        format!("{}/plans/{}.json", self.tasks[task], self.objects[object].name).into()
    }

    /// File of a deployment in a folder of its task.
    pub fn deployment_file(&self, folder: &str, chain: &Chain, place: Place, number: u64) -> PathBuf {
        let on = match place {
            Place::Object(object) => self.objects[object].name.as_str(),
            Place::OwnSimulation => "+simulation",
        };
        let (task, policy) = (&self.tasks[chain.task], self.file_name(chain.knowledge));
        format!("{task}/{folder}/{policy}_on_{on}_{}.json", number + 1).into()
    }

    /// Name of a policy in the name of a file.
    fn file_name(&self, knowledge: Knowledge) -> String {
        self.policy_name(knowledge).replace([' ', ':'], "_")
    }

    fn file(&self, folder: &str, chain: &Chain, ending: &str) -> PathBuf {
        let (task, policy) = (&self.tasks[chain.task], self.file_name(chain.knowledge));
        format!("{task}/{folder}/{policy}_{}.{ending}", chain.training + 1).into()
    }
}

/// Models of a study.
pub struct Models {
    /// Model with its own task, in which the objects are recorded.
    pub model: Model,
    /// Model with each task.
    pub tasks: Vec<Model>,
}
