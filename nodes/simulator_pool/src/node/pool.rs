//! The pool: batches of episodes, and vectorised environments, for whoever asks.
#![allow(clippy::disallowed_methods, reason = "the ROS side asks for the number of processors")]

use crate::simulator::BeamSimulator;
use crate::vector_env::VectorEnv;
use crate::{convert, model_text, workers};
use anyhow::Result;
use catenary_core::{Env, Simulator};
use catenary_msgs::srv::{
    CloseEnvs, CloseEnvsRequest, CloseEnvsResponse, OpenEnvs, OpenEnvsRequest, OpenEnvsResponse, Simulate,
    SimulateRequest, SimulateResponse, StepEnvs, StepEnvsRequest, StepEnvsResponse,
};
use catenary_shell::convert as wire;
use catenary_shell::{NodeBuilder, Param, ParamSpec, contract};
use std::collections::BTreeMap;
use std::process::ExitCode;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Sets of environments that may be open at once.
const MAX_OPEN: usize = 16;
/// Simulators that are kept for the next request of the same model.
const KEPT_SIMULATORS: usize = 4;

/// Runs the node from the arguments after the program's name.
pub fn main(args: Vec<String>) -> ExitCode {
    catenary_shell::main("simulator_pool", args, run)
}

/// Environments by handle, and the next handle.
#[derive(Default)]
struct Opened {
    envs: BTreeMap<u64, Arc<Mutex<VectorEnv>>>,
    next: u64,
}

/// What the services share.
struct Pool {
    workers: Param<i64>,
    simulators: Mutex<Vec<(String, Arc<BeamSimulator>)>>,
    opened: Mutex<Opened>,
}

fn run(builder: NodeBuilder) -> Result<()> {
    let spec =
        ParamSpec::new("Threads that simulate; 0: as many as the machine has processors. Results do not depend on it.");
    let workers = builder.declare_i64("workers", 0, spec.integer_range(0..=1024))?;
    let node = builder.build()?;
    let pool = Arc::new(Pool { workers, simulators: Mutex::default(), opened: Mutex::default() });
    let p = Arc::clone(&pool);
    let _simulate = node.serve::<Simulate>(contract::SIMULATE.name, move |r| p.simulate(&r))?;
    let p = Arc::clone(&pool);
    let _open = node.serve::<OpenEnvs>(contract::OPEN_ENVS.name, move |r| p.open(&r))?;
    let p = Arc::clone(&pool);
    let _step = node.serve::<StepEnvs>(contract::STEP_ENVS.name, move |r| p.step(&r))?;
    let p = Arc::clone(&pool);
    let _close = node.serve::<CloseEnvs>(contract::CLOSE_ENVS.name, move |r| p.close(&r))?;
    node.report_diagnostics(move |report| {
        report.value("open_environments", lock(&pool.opened).envs.len());
    })?;
    node.wait_for_shutdown()
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Pool {
    fn worker_count(&self) -> usize {
        match usize::try_from(self.workers.get()) {
            Ok(0) | Err(_) => workers::available(),
            Ok(n) => n,
        }
    }

    /// The simulator of a model file's text, kept from an earlier request where there was one.
    fn simulator(&self, yaml: &str) -> Result<Arc<BeamSimulator>> {
        let mut kept = lock(&self.simulators);
        if let Some((_, simulator)) = kept.iter().find(|(text, _)| text == yaml) {
            return Ok(Arc::clone(simulator));
        }
        let simulator = Arc::new(BeamSimulator::new(&model_text::read(yaml)?, self.worker_count())?);
        if kept.len() == KEPT_SIMULATORS {
            kept.remove(0);
        }
        kept.push((yaml.to_owned(), Arc::clone(&simulator)));
        Ok(simulator)
    }

    fn simulate(&self, request: &SimulateRequest) -> SimulateResponse {
        let answer = || -> Result<SimulateResponse> {
            let simulator = self.simulator(&request.model_yaml)?;
            let before = simulator.unconverged_steps();
            let batch = convert::simulation_request(request, simulator.model().theta.dimension())?;
            let tracks = simulator.simulate(&batch)?;
            Ok(SimulateResponse {
                success: true,
                message: String::new(),
                tracks: tracks.iter().map(wire::track_to_msg).collect(),
                unconverged_steps: simulator.unconverged_steps() - before,
            })
        };
        answer().unwrap_or_else(|e| SimulateResponse { message: format!("{e:#}"), ..SimulateResponse::default() })
    }

    fn open(&self, request: &OpenEnvsRequest) -> OpenEnvsResponse {
        let answer = || -> Result<OpenEnvsResponse> {
            let model = model_text::read(&request.model_yaml)?;
            let domains = model.theta.rows(&request.domains)?;
            let fidelity = wire::fidelity_from_msg(request.fidelity)?;
            let count = request.count as usize;
            let mut env = VectorEnv::open(&model, count, domains, fidelity, request.seed, self.worker_count())?;
            let observations = convert::observations(&env.reset()?);
            let mut opened = lock(&self.opened);
            anyhow::ensure!(
                opened.envs.len() < MAX_OPEN,
                "{MAX_OPEN} sets of environments are open already: close one first"
            );
            opened.next += 1;
            let handle = opened.next;
            opened.envs.insert(handle, Arc::new(Mutex::new(env)));
            Ok(OpenEnvsResponse { success: true, message: String::new(), handle, observations })
        };
        answer().unwrap_or_else(|e| OpenEnvsResponse { message: format!("{e:#}"), ..OpenEnvsResponse::default() })
    }

    fn step(&self, request: &StepEnvsRequest) -> StepEnvsResponse {
        let answer = || -> Result<StepEnvsResponse> {
            let env = lock(&self.opened).envs.get(&request.handle).cloned();
            let env = env.ok_or_else(|| unknown(request.handle))?;
            let transitions = lock(&env).step(&convert::actions(&request.actions)?)?;
            Ok(convert::transitions(&transitions))
        };
        answer().unwrap_or_else(|e| StepEnvsResponse { message: format!("{e:#}"), ..StepEnvsResponse::default() })
    }

    fn close(&self, request: &CloseEnvsRequest) -> CloseEnvsResponse {
        match lock(&self.opened).envs.remove(&request.handle) {
            Some(_) => CloseEnvsResponse { success: true, message: String::new() },
            None => CloseEnvsResponse { success: false, message: unknown(request.handle).to_string() },
        }
    }
}

fn unknown(handle: u64) -> anyhow::Error {
    anyhow::anyhow!("handle {handle}: no environments are open under it")
}
