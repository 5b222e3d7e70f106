//! ROS node: an action that trains a policy in the environments of the simulator pool.
#![allow(clippy::disallowed_methods, reason = "the node measures how long a training took")]

use crate::convert;
use crate::trainer::{TrainError, train};
use anyhow::{Context, Result, ensure};
use catenary_core::{Env, EnvError, Model, Observation, Transition, seed};
use catenary_msgs::action::{Train, TrainResult};
use catenary_msgs::srv::{CloseEnvs, CloseEnvsRequest, OpenEnvs, OpenEnvsRequest, StepEnvs, StepEnvsRequest};
use catenary_shell::{
    CallError, Client, Concurrency, Decision, GoalHandle, Health, NodeBuilder, Outcome, Srv, contract,
};
use std::ops::ControlFlow;
use std::process::ExitCode;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Time limit for opening environments.
const OPEN: Duration = Duration::from_secs(60);
/// Time limit for one step of all environments, and for closing them.
const STEP: Duration = Duration::from_secs(30);
/// Time without an answer of the pool after which the diagnostics report a fault.
const SLOW: Duration = Duration::from_secs(10);
/// Random stream of a goal's seed for the domains.
const DOMAIN_STREAM: u64 = 1;
/// Random stream of a goal's seed for the environments.
const ENV_STREAM: u64 = 2;

/// Runs the node from the arguments after the program's name.
pub fn main(args: Vec<String>) -> ExitCode {
    catenary_shell::main("ppo_trainer", args, run)
}

/// Name of the service whose answer is awaited, and the time of the request.
type Awaited = Arc<Mutex<Option<(&'static str, Instant)>>>;

/// Clients of the pool's services.
struct Pool {
    open: Client<OpenEnvs>,
    step: Client<StepEnvs>,
    close: Client<CloseEnvs>,
    awaited: Awaited,
}

impl Pool {
    /// Calls a service. `awaited` names it until it answers.
    fn ask<S: Srv>(
        &self,
        client: &Client<S>,
        name: &'static str,
        request: S::Request,
        timeout: Duration,
    ) -> Result<S::Response, CallError> {
        *lock(&self.awaited) = Some((name, Instant::now()));
        let answer = client.call(request, timeout);
        *lock(&self.awaited) = None;
        answer
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn run(builder: NodeBuilder) -> Result<()> {
    let node = builder.build()?;
    let pool = Pool {
        open: node.client(contract::OPEN_ENVS.name)?,
        step: node.client(contract::STEP_ENVS.name)?,
        close: node.client(contract::CLOSE_ENVS.name)?,
        awaited: Awaited::default(),
    };
    let awaited = Arc::clone(&pool.awaited);
    let _server = node.serve_action::<Train>(
        contract::TRAIN.name,
        Concurrency::One,
        |_| Decision::Accept,
        move |handle| serve(&handle, &pool),
    )?;
    node.report_diagnostics(move |report| {
        if let Some((name, asked)) = *lock(&awaited)
            && asked.elapsed() > SLOW
        {
            let waited_s = asked.elapsed().as_secs_f64();
            report.problem(Health::Error, &format!("a training has waited {waited_s:.0} s for an answer of {name}"));
        }
    })?;
    node.wait_for_shutdown()
}

/// Environments of the pool, closed on drop.
struct PoolEnv<'a> {
    pool: &'a Pool,
    handle: u64,
    count: usize,
    /// First observations, until [`Env::reset`] takes them.
    first: Option<Vec<Observation>>,
}

impl<'a> PoolEnv<'a> {
    fn open(pool: &'a Pool, request: OpenEnvsRequest) -> Result<Self> {
        let count = request.count as usize;
        let answer = pool.ask(&pool.open, contract::OPEN_ENVS.name, request, OPEN)?;
        ensure!(answer.success, "{}: {}", contract::OPEN_ENVS.name, answer.message);
        let mut env = Self { pool, handle: answer.handle, count, first: None };
        env.first = Some(convert::observations(&answer.observations, count)?);
        Ok(env)
    }
}

impl Drop for PoolEnv<'_> {
    fn drop(&mut self) {
        if let Err(error) = self.pool.close.call(CloseEnvsRequest { handle: self.handle }, STEP) {
            tracing::warn!("environments were not closed: {error}");
        }
    }
}

impl Env for PoolEnv<'_> {
    fn count(&self) -> usize {
        self.count
    }

    fn reset(&mut self) -> Result<Vec<Observation>, EnvError> {
        let again =
            || EnvError::Backend("environments of the pool can be reset once, after they are opened".to_owned());
        self.first.take().ok_or_else(again)
    }

    fn step(&mut self, actions: &[[f64; 2]]) -> Result<Vec<Transition>, EnvError> {
        let request = StepEnvsRequest { handle: self.handle, actions: actions.concat() };
        let asked = self.pool.ask(&self.pool.step, contract::STEP_ENVS.name, request, STEP);
        let answer = asked.map_err(|e| EnvError::Backend(e.to_string()))?;
        convert::transitions(&answer, self.count)
    }
}

/// Runs a goal and reports its outcome.
fn serve(handle: &GoalHandle<Train>, pool: &Pool) -> Outcome<TrainResult> {
    match train_goal(handle, pool) {
        // A cancelled training returns the policy learnt so far.
        Ok(result) if handle.is_cancelled() => Outcome::Canceled(result),
        Ok(result) => Outcome::Succeeded(result),
        Err(error) => {
            tracing::error!("training: {error:#}");
            Outcome::Aborted(TrainResult { message: format!("{error:#}"), ..TrainResult::default() })
        }
    }
}

/// Trains as the goal asks.
fn train_goal(handle: &GoalHandle<Train>, pool: &Pool) -> Result<TrainResult> {
    let goal = handle.goal();
    let model = Model::from_yaml(&goal.model_yaml)?;
    let task = model.task.with_context(|| format!("model `{}` has no task", model.name))?;
    let settings = convert::settings(goal, &task)?;
    let rows = convert::domains(goal, &model)?.rows(settings.environments, seed::derive(goal.seed, DOMAIN_STREAM))?;
    let request = OpenEnvsRequest {
        model_yaml: goal.model_yaml.clone(),
        count: u32::try_from(settings.environments)?,
        domains: rows.concat(),
        fidelity: goal.fidelity,
        seed: seed::derive(goal.seed, ENV_STREAM),
    };
    let mut env = PoolEnv::open(pool, request)?;
    let started = Instant::now();
    let mut trained = train(&mut env, &task, &settings, goal.seed, &mut |progress| {
        handle.feedback(convert::feedback(progress));
        if handle.is_cancelled() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    })
    .map_err(|e: TrainError| anyhow::anyhow!(e))?;
    trained.policy.arm = Some(model.arm.law);
    Ok(convert::result(&trained, &rows, started.elapsed().as_secs_f64()))
}
