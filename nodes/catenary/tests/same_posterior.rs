//! Equality of posteriors over paths: `catenary infer` on a bag, and the inference node on the topics of the replayed
//! bag. The replay has its own clock, runs at recorded speed and as fast as possible, and the pool node runs the
//! simulations, while the next episode has already begun. A mishandled stamp, a lost frame or a request that changes on
//! the wire would show here.
#![allow(
    clippy::disallowed_methods,
    clippy::unwrap_used,
    reason = "a test of processes reads files, and a failure is a panic"
)]

use catenary_msgs::action::{Infer, InferGoal};
use catenary_msgs::msg::EpisodeEvent;
use catenary_msgs::srv::SimulateRequest;
use catenary_shell::{ActionClient, Discovery, DomainClaim, Node, NodeBuilder, RosArgs, Status, Time, contract, stamp};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::{LazyLock, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

const PROGRAM: &str = env!("CARGO_BIN_EXE_catenary");
// Small sizes: the test compares bits, and does not need accuracy.
const ITERATIONS: u32 = 3;
const SIMULATIONS: u32 = 40;
const SEED: u64 = 7;
/// Number of replays. Keypoints and poses are best effort: a frame lost in one replay arrives in the next.
const REPLAYS: usize = 2;
/// Stamp of an episode that starts a minute after the replayed one.
const NEXT_START_NS: i64 = 160_000_000_000;
/// Longer than the inference node takes to drop data of earlier episodes.
const FORGETTING: Duration = Duration::from_secs(6);

/// DDS domain of this test, without other participants.
fn domain() -> u16 {
    static CLAIM: LazyLock<DomainClaim> = LazyLock::new(|| DomainClaim::any(|_| Ok(true)).unwrap());
    CLAIM.id()
}

/// Lock of the graph, in which two tests would find each other's nodes.
fn alone() -> MutexGuard<'static, ()> {
    static ALONE: Mutex<()> = Mutex::new(());
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn command(arguments: &[&str]) -> Command {
    let mut command = Command::new(PROGRAM);
    command.args(arguments).env("ROS_DOMAIN_ID", domain().to_string());
    command.env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST");
    // Keeps states and logs of the test apart from the user's.
    command.env("ROS_HOME", env!("CARGO_TARGET_TMPDIR")).env_remove("ROS_LOG_DIR");
    command
}

/// Process of a node, killed at the end of the test.
struct Process(Child);

impl Process {
    fn node(name: &str) -> Self {
        // In the bag's time, as `replay.launch.xml` starts it.
        Self(command(&["node", name, "--ros-args", "-p", "use_sim_time:=true"]).stdin(Stdio::null()).spawn().unwrap())
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn finished(output: Output) -> String {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(rows) => rows.iter().flat_map(numbers).collect(),
        number => vec![number.as_f64().unwrap()],
    }
}

/// Weights, means and covariances from `catenary infer` with further `options`.
fn by_command(bag: &Path, model: &Path, out: &Path, options: &[&str]) -> [Vec<f64>; 3] {
    let [bag, model, out] = [bag, model, out].map(|p| p.to_str().unwrap());
    let sizes = [ITERATIONS.to_string(), SIMULATIONS.to_string(), SEED.to_string()];
    let [iterations, simulations, seed] = sizes.each_ref().map(String::as_str);
    let mut infer = command(&["infer", "--json", "--bag", bag, "--model", model, "--out", out]);
    infer
        .args(["--preset", "networks", "--iterations", iterations, "--simulations", simulations, "--seed", seed])
        .args(options);
    let report: Value = serde_json::from_str(&finished(infer.output().unwrap())).unwrap();
    let mixture = &report["posterior"]["mixture"];
    ["weights", "means", "covariances"].map(|name| numbers(&mixture[name]))
}

/// Announces another episode after the replayed one, and waits until the nodes drop older data.
fn begin_another(node: &Node) {
    let topic = contract::EPISODE_EVENT;
    let events = node.publisher::<EpisodeEvent>(topic.name, topic.qos).unwrap();
    assert!(events.wait_for_subscriber(Duration::from_secs(20)));
    events.send(EpisodeEvent {
        header: stamp::header(Time::from_nanos(NEXT_START_NS), ""),
        episode: 9,
        event: EpisodeEvent::STARTED,
        step_period: 0.5,
        ..EpisodeEvent::default()
    });
    std::thread::sleep(FORGETTING);
}

/// Weights, means and covariances from the inference node, from the topics of a bag replayed at `rate`.
fn by_topics(bag: &Path, model: &Path, rate: &str) -> [Vec<f64>; 3] {
    let _nodes = ["simulator_pool", "bayes_sim"].map(Process::node);
    let builder = NodeBuilder::new("asker", &RosArgs::default()).unwrap().domain(domain(), Discovery::Localhost);
    let node: Node = builder.build().unwrap();
    let client: ActionClient<Infer> = node.action_client("bayes_sim/infer").unwrap();
    assert!(client.wait_for_server(Duration::from_secs(20)));
    for _ in 0..REPLAYS {
        finished(command(&["replay", bag.to_str().unwrap(), "--clock", "--rate", rate]).output().unwrap());
    }
    begin_another(&node);
    let goal = InferGoal {
        source: InferGoal::SOURCE_LIVE,
        model_yaml: std::fs::read_to_string(model).unwrap(),
        iterations: ITERATIONS,
        simulations: SIMULATIONS,
        drive: SimulateRequest::DRIVE_GRIP,
        seed: SEED,
        // A refinement asks the pool for some 20,000 simulations more.
        preset: "networks".to_owned(),
        ..InferGoal::default()
    };
    let running = client.send(goal, Duration::from_secs(20), |_| {}).unwrap();
    let (status, result) = running.wait(Duration::from_secs(120)).unwrap();
    assert_eq!(status, Status::Succeeded, "{}", result.message);
    node.stop();
    [result.posterior.weights, result.posterior.means, result.posterior.covariances]
}

/// Bounds of the parameters, moves of the support, and mixture of an inference with a support that may move, by the
/// inference node.
fn by_node(bag: &Path, model_yaml: &str) -> (Vec<[f64; 2]>, Value, [Vec<f64>; 3]) {
    let _nodes = ["simulator_pool", "bayes_sim"].map(Process::node);
    let builder = NodeBuilder::new("asker", &RosArgs::default()).unwrap().domain(domain(), Discovery::Localhost);
    let node: Node = builder.build().unwrap();
    let client: ActionClient<Infer> = node.action_client("bayes_sim/infer").unwrap();
    assert!(client.wait_for_server(Duration::from_secs(20)));
    let goal = InferGoal {
        source: InferGoal::SOURCE_BAG,
        bags: vec![bag.display().to_string()],
        model_yaml: model_yaml.to_owned(),
        iterations: ITERATIONS,
        simulations: SIMULATIONS,
        drive: SimulateRequest::DRIVE_GRIP,
        seed: SEED,
        prior_support: "adaptive".to_owned(),
        // A refinement asks the pool for some 20,000 simulations more.
        preset: "networks".to_owned(),
        ..InferGoal::default()
    };
    let running = client.send(goal, Duration::from_secs(20), |_| {}).unwrap();
    let (status, result) = running.wait(Duration::from_secs(120)).unwrap();
    assert_eq!(status, Status::Succeeded, "{}", result.message);
    node.stop();
    assert!(result.warnings.iter().any(|w| w.contains("the prior's support moved from")), "{:?}", result.warnings);
    let bounds = result.posterior.parameters.iter().map(|p| [p.low, p.high]).collect();
    let moves = serde_json::to_value(bayes_sim::convert::support_moves(&result)).unwrap();
    (bounds, moves, [result.posterior.weights, result.posterior.means, result.posterior.covariances])
}

/// The node learns the physical limits of the support from the pool's answers.
#[test]
fn a_support_that_moves_is_the_same_in_this_process_and_on_the_graph() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let shipped = std::fs::read_to_string(root().join("launch_configs/models/soft_bar.yaml")).unwrap();
    // The bar of the recording is longer.
    let short = shipped.replace("{uniform: {low: 0.195, high: 0.305}}", "{uniform: {low: 0.1, high: 0.15}}");
    assert_ne!(short, shipped);
    let (bag, model) = (root().join("bags/swing"), folder.path().join("short.yaml"));
    std::fs::write(&model, &short).unwrap();
    let file = by_command(&bag, &model, folder.path(), &["--prior-support", "adaptive"]);
    let posterior: Value =
        serde_json::from_str(&std::fs::read_to_string(folder.path().join("posterior.json")).unwrap()).unwrap();
    let bounds = |i: usize, family: &str| {
        let prior = &posterior["parameters"][i]["prior"][family];
        ["low", "high"].map(|end| prior[end].as_f64().unwrap())
    };
    let (used, moves, mixture) = by_node(&bag, &short);
    assert_eq!(used, [bounds(0, "uniform"), bounds(1, "log_uniform")]);
    assert_ne!(used, [[0.1, 0.15], [1e3, 5e4]], "no support moved");
    assert_eq!((moves, mixture), (posterior["support_moves"].clone(), file));
}

#[test]
fn file_and_replayed_topics_give_the_same_posterior() {
    let _alone = alone();
    let (bag, model) = (root().join("bags/swing"), root().join("launch_configs/models/soft_bar.yaml"));
    let folder = tempfile::tempdir().unwrap();
    let file = by_command(&bag, &model, folder.path(), &[]);
    assert!(!file[0].is_empty() && file[1].len() == 2 * file[0].len(), "{file:?}");
    for rate in ["1", "inf"] {
        assert_eq!(by_topics(&bag, &model, rate), file, "replayed at {rate}");
    }
}
