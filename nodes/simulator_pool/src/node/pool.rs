//! The pool: batches of episodes, and vectorised environments, for whoever asks.
#![allow(clippy::disallowed_methods, reason = "the ROS side asks for the time and the number of processors")]

use crate::simulator::BeamSimulator;
use crate::vector_env::VectorEnv;
use crate::{convert, fingerprint, model_text, workers};
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
use std::time::{Duration, Instant};

/// Sets of environments that may be open at once.
const MAX_OPEN: usize = 16;
/// Time without a step after which environments are closed: their trainer died. A living one is back within the minutes of
/// an update of its networks.
const IDLE: Duration = Duration::from_secs(1800);
/// Simulators that are kept for the next request of the same model.
const KEPT_SIMULATORS: usize = 4;

/// Runs the node from the arguments after the program's name.
pub fn main(args: Vec<String>) -> ExitCode {
    catenary_shell::main("simulator_pool", args, run)
}

/// Environments of one caller.
struct Entry {
    env: Arc<Mutex<VectorEnv>>,
    /// When they were opened or stepped last.
    used: Instant,
}

/// Environments by handle, and the newest handle.
#[derive(Default)]
struct Opened {
    envs: BTreeMap<u64, Entry>,
    newest: u64,
}

impl Opened {
    /// Closes what nobody has used for [`IDLE`]; returns the handles.
    fn close_idle(&mut self, now: Instant) -> Vec<u64> {
        let idle = |entry: &Entry| now.saturating_duration_since(entry.used) > IDLE;
        let closed = self.envs.iter().filter(|(_, entry)| idle(entry)).map(|(handle, _)| *handle).collect();
        self.envs.retain(|_, entry| !idle(entry));
        closed
    }

    /// Keeps environments under a new handle, where there is room.
    fn insert(&mut self, env: VectorEnv, now: Instant) -> Result<u64> {
        anyhow::ensure!(
            self.envs.len() < MAX_OPEN,
            "{MAX_OPEN} sets of environments are open already: close one first"
        );
        self.newest += 1;
        self.envs.insert(self.newest, Entry { env: Arc::new(Mutex::new(env)), used: now });
        Ok(self.newest)
    }

    /// The environments under a handle, which are in use now.
    fn get(&mut self, handle: u64, now: Instant) -> Result<Arc<Mutex<VectorEnv>>> {
        let entry = self.envs.get_mut(&handle).ok_or_else(|| unknown(handle))?;
        entry.used = entry.used.max(now);
        Ok(Arc::clone(&entry.env))
    }
}

/// One simulator of the newest requests.
struct Kept {
    yaml: String,
    workers: usize,
    simulator: Arc<BeamSimulator>,
    fingerprint: u64,
}

/// What the answer says that it was simulated by. Nodes of one build have the same.
const VERSION: &str = env!("CARGO_PKG_VERSION");

/// The simulators of the newest requests.
#[derive(Default)]
struct Simulators {
    kept: Vec<Kept>,
    /// What did not converge in those that are not kept any more: steps and equilibria.
    unconverged_before: [u64; 2],
}

impl Simulators {
    /// The simulator of a model file's text with so many workers, and its fingerprint, kept from an earlier request where
    /// there was one.
    fn get(&mut self, yaml: &str, workers: usize) -> Result<(Arc<BeamSimulator>, u64)> {
        if let Some(kept) = self.kept.iter().find(|kept| kept.yaml == yaml && kept.workers == workers) {
            return Ok((Arc::clone(&kept.simulator), kept.fingerprint));
        }
        let model = model_text::read(yaml)?;
        let (simulator, fingerprint) = (Arc::new(BeamSimulator::new(&model, workers)?), fingerprint(&model));
        if self.kept.len() == KEPT_SIMULATORS {
            let gone = unconverged(&self.kept.remove(0).simulator);
            self.unconverged_before = sum(self.unconverged_before, gone);
        }
        self.kept.push(Kept { yaml: yaml.to_owned(), workers, simulator: Arc::clone(&simulator), fingerprint });
        Ok((simulator, fingerprint))
    }

    /// Steps and equilibria that did not converge, in all requests.
    fn unconverged(&self) -> [u64; 2] {
        self.kept.iter().map(|kept| unconverged(&kept.simulator)).fold(self.unconverged_before, sum)
    }
}

fn unconverged(simulator: &BeamSimulator) -> [u64; 2] {
    [simulator.unconverged_steps(), simulator.unconverged_equilibria()]
}

fn sum(a: [u64; 2], b: [u64; 2]) -> [u64; 2] {
    [a[0] + b[0], a[1] + b[1]]
}

/// What the services share.
struct Pool {
    workers: Param<i64>,
    simulators: Mutex<Simulators>,
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
        pool.close_idle();
        report.value("open_environments", lock(&pool.opened).envs.len());
        let [steps, equilibria] = lock(&pool.simulators).unconverged();
        report.value("unconverged_steps", steps).value("unconverged_equilibria", equilibria);
    })?;
    node.wait_for_shutdown()
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Pool {
    fn worker_count(&self) -> usize {
        workers::asked_for(self.workers.get())
    }

    fn simulate(&self, request: &SimulateRequest) -> SimulateResponse {
        let answer = || -> Result<SimulateResponse> {
            let (simulator, fingerprint) = lock(&self.simulators).get(&request.model_yaml, self.worker_count())?;
            let before = unconverged(&simulator);
            let batch = convert::simulation_request(request, simulator.model().theta.dimension())?;
            let tracks = simulator.simulate(&batch)?;
            let now = unconverged(&simulator);
            if now[1] > before[1] {
                tracing::warn!("{} shapes at the start of an episode had not come to rest", now[1] - before[1]);
            }
            Ok(SimulateResponse {
                success: true,
                message: String::new(),
                tracks: tracks.iter().map(wire::track_to_msg).collect(),
                unconverged_steps: now[0] - before[0],
                version: VERSION.to_owned(),
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
            let handle = lock(&self.opened).insert(env, Instant::now())?;
            Ok(OpenEnvsResponse { success: true, message: String::new(), handle, observations })
        };
        answer().unwrap_or_else(|e| OpenEnvsResponse { message: format!("{e:#}"), ..OpenEnvsResponse::default() })
    }

    fn step(&self, request: &StepEnvsRequest) -> StepEnvsResponse {
        let answer = || -> Result<StepEnvsResponse> {
            let env = lock(&self.opened).get(request.handle, Instant::now())?;
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
        match lock(&self.opened).envs.remove(&request.handle) {
            Some(_) => CloseEnvsResponse { success: true, message: String::new() },
            None => CloseEnvsResponse { success: false, message: unknown(request.handle).to_string() },
        }
    }
}

fn unknown(handle: u64) -> anyhow::Error {
    anyhow::anyhow!("handle {handle}: no environments are open under it")
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::Fidelity;

    const SOFT_BAR: &str = include_str!("../../../../launch_configs/models/soft_bar.yaml");

    fn env() -> VectorEnv {
        let model = model_text::read(SOFT_BAR).unwrap();
        VectorEnv::open(&model, 1, vec![vec![0.25, 1e4]], Fidelity::Fast, 1, 1).unwrap()
    }

    #[test]
    fn environments_of_a_dead_trainer_make_room() {
        let (mut opened, start) = (Opened::default(), Instant::now());
        let handles: Vec<u64> = (0..MAX_OPEN).map(|_| opened.insert(env(), start).unwrap()).collect();
        assert!(opened.insert(env(), start).unwrap_err().to_string().contains("close one first"));
        let later = start + IDLE / 2;
        assert_eq!(opened.close_idle(later), [] as [u64; 0], "a trainer may think");
        opened.get(handles[3], later).unwrap();
        let closed = opened.close_idle(start + IDLE + Duration::from_secs(1));
        assert_eq!((closed.len(), closed.contains(&handles[3])), (MAX_OPEN - 1, false));
        assert!(opened.get(handles[0], later).map(drop).unwrap_err().to_string().contains("no environments are open"));
        let new = opened.insert(env(), later).unwrap();
        assert!(!handles.contains(&new), "handle {new} means something else to a trainer that lives on");
    }

    #[test]
    fn a_change_of_workers_reaches_the_next_batch() {
        let mut simulators = Simulators::default();
        let (one, fingerprint) = simulators.get(SOFT_BAR, 1).unwrap();
        assert!(Arc::ptr_eq(&one, &simulators.get(SOFT_BAR, 1).unwrap().0), "the same request builds nothing anew");
        let (two, same) = simulators.get(SOFT_BAR, 2).unwrap();
        assert!(!Arc::ptr_eq(&one, &two) && same == fingerprint, "bits do not depend on the workers");
    }
}
