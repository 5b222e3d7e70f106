//! Node of the pool: services that simulate batches of episodes and step vectorised environments.
#![allow(clippy::disallowed_methods, reason = "the ROS side asks for the time and the number of processors")]

use crate::convert;
use crate::environments::{Environments, IDLE};
use crate::simulators::{Simulators, Unconverged};
use anyhow::Result;
use catenary_core::{Env, Simulator};
use catenary_msgs::srv::{
    CloseEnvs, CloseEnvsRequest, CloseEnvsResponse, OpenEnvs, OpenEnvsRequest, OpenEnvsResponse, Simulate,
    SimulateRequest, SimulateResponse, StepEnvs, StepEnvsRequest, StepEnvsResponse,
};
use catenary_shell::convert as wire;
use catenary_shell::{NodeBuilder, Param, ParamSpec, contract};
use catenary_simulator::{VectorEnv, model_text, workers};
use std::process::ExitCode;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// Program version in the answers. Nodes of one build have equal versions.
const VERSION: &str = env!("CARGO_PKG_VERSION");

/// Runs the node from the arguments after the program's name.
pub fn main(args: Vec<String>) -> ExitCode {
    catenary_shell::main("simulator_pool", args, run)
}

/// State that the services share.
struct Pool {
    workers: Param<i64>,
    simulators: Mutex<Simulators>,
    opened: Mutex<Environments>,
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
        pool.close_idle();
        report.value("open_environments", lock(&pool.opened).count());
        let Unconverged { steps, equilibria } = lock(&pool.simulators).unconverged();
        report.value("unconverged_steps", steps).value("unconverged_equilibria", equilibria);
    })?;
    node.wait_for_shutdown()
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // A panic in one request must not end the service for the others.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Pool {
    fn worker_count(&self) -> usize {
        workers::asked_for(self.workers.get())
    }

    fn simulate(&self, request: &SimulateRequest) -> SimulateResponse {
        let answer = || -> Result<SimulateResponse> {
            let (simulator, fingerprint) = lock(&self.simulators).get(&request.model_yaml, self.worker_count())?;
            // Counters of a simulator sum over all its requests. The difference therefore includes concurrent requests.
            let before = Unconverged::of(&simulator);
            let batch = convert::simulation_request(request, simulator.model().theta.dimension())?;
            let tracks = simulator.simulate(&batch)?;
            let now = Unconverged::of(&simulator);
            if now.equilibria > before.equilibria {
                let count = now.equilibria - before.equilibria;
                tracing::warn!("{count} shapes at the start of an episode had not come to rest");
            }
            let ranges = simulator.model().theta.parameters().iter().map(|p| simulator.range_of(&p.name));
            // A simulator is only made of known parameters, so that each has a range.
            let (theta_low, theta_high) = ranges.flatten().map(|[low, high]| (low, high)).unzip();
            Ok(SimulateResponse {
                success: true,
                message: String::new(),
                tracks: tracks.iter().map(wire::track_to_msg).collect(),
                unconverged_steps: now.steps - before.steps,
                version: VERSION.to_owned(),
                theta_low,
                theta_high,
                fingerprint,
            })
        };
        answer().unwrap_or_else(|e| SimulateResponse {
            message: format!("{e:#}"),
            version: VERSION.to_owned(),
            ..SimulateResponse::default()
        })
    }

    fn open(&self, request: &OpenEnvsRequest) -> OpenEnvsResponse {
        let answer = || -> Result<OpenEnvsResponse> {
            let model = model_text::read(&request.model_yaml)?;
            let domains = model.theta.rows(&request.domains)?;
            let fidelity = wire::fidelity_from_msg(request.fidelity)?;
            let count = request.count as usize;
            let mut env = VectorEnv::open(&model, count, domains, fidelity, request.seed, self.worker_count())?;
            let observations = convert::observations(&env.reset()?);
            self.close_idle();
            // Sets of dead trainers are closed first: they would keep a new trainer out.
            let handle = lock(&self.opened).insert(env, Instant::now())?;
            Ok(OpenEnvsResponse { success: true, message: String::new(), handle, observations })
        };
        answer().unwrap_or_else(|e| OpenEnvsResponse { message: format!("{e:#}"), ..OpenEnvsResponse::default() })
    }

    fn step(&self, request: &StepEnvsRequest) -> StepEnvsResponse {
        let answer = || -> Result<StepEnvsResponse> {
            let env = lock(&self.opened).get(request.handle, Instant::now())?;
            // Only this set is locked while it steps; other callers go on.
            let transitions = lock(&env).step(&convert::actions(&request.actions)?)?;
            Ok(convert::transitions(&transitions))
        };
        answer().unwrap_or_else(|e| StepEnvsResponse { message: format!("{e:#}"), ..StepEnvsResponse::default() })
    }

    fn close_idle(&self) {
        for handle in lock(&self.opened).close_idle(Instant::now()) {
            tracing::warn!("handle {handle}: closed, as nobody has stepped its environments for {} s", IDLE.as_secs());
        }
    }

    fn close(&self, request: &CloseEnvsRequest) -> CloseEnvsResponse {
        match lock(&self.opened).close(request.handle) {
            Ok(()) => CloseEnvsResponse { success: true, message: String::new() },
            Err(e) => CloseEnvsResponse { success: false, message: e.to_string() },
        }
    }
}
