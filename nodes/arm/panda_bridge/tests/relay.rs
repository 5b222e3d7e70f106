//! Tests of the relay with a controller that the test plays. A failure here means an arm that moves when it should stand, or
//! an arm that stands while a policy believes that it moves.
#![allow(
    clippy::disallowed_methods,
    clippy::unwrap_used,
    reason = "a test of threads, processes and sockets waits for them, and a failure is a panic"
)]

use catenary_msgs::action::{MoveToStart, MoveToStartGoal};
use catenary_msgs::geometry_msgs::msg::{Point, Pose, PoseStamped, Quaternion};
use catenary_msgs::msg::{AcceptedTarget, ArmState, EpisodeEvent};
use catenary_msgs::rosgraph_msgs::msg::Clock;
use catenary_msgs::sensor_msgs::msg::JointState;
use catenary_msgs::srv::{SetCompliance, SetComplianceRequest};
use catenary_msgs::std_msgs::msg::String as Text;
use catenary_msgs::std_srvs::srv::{SetBool, SetBoolRequest, SetBoolResponse};
use catenary_shell::contract::{
    ACCEPTED_TARGET, ARM_LAW, ARM_STATE, CURRENT_POSE, ENABLE, EPISODE_EVENT, JOINT_STATES, MOVE_TO_START,
    SET_COMPLIANCE, TARGET_POSE,
};
use catenary_shell::{
    Discovery, DomainClaim, Latest, Node, NodeBuilder, Param, ParamSpec, Publisher, Qos, Queue, RosArgs, Status,
    Subscription, stamp,
};
use std::collections::BTreeMap;
use std::process::{Child, Command, Output, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

const SOON: Duration = Duration::from_secs(10);
const BASE: &str = "panda_link0";

/// Returns the domain of test `number`, which no other process uses.
fn domain(number: u16) -> u16 {
    static CLAIMS: Mutex<BTreeMap<u16, DomainClaim>> = Mutex::new(BTreeMap::new());
    let mut claims = CLAIMS.lock().unwrap();
    claims.entry(number).or_insert_with(|| DomainClaim::any(|_| Ok(true)).unwrap()).id()
}

fn builder(name: &str, number: u16) -> NodeBuilder {
    let (args, _) = RosArgs::parse(["--ros-args"]).unwrap();
    NodeBuilder::new(name, &args).unwrap().domain(domain(number), Discovery::Localhost)
}

fn pose(x: f64, z: f64) -> Pose {
    Pose { position: Point { x, y: 0.0, z }, orientation: Quaternion { x: 1.0, y: 0.0, z: 0.0, w: 0.0 } }
}

fn wait_for(what: &str, mut holds: impl FnMut() -> bool) {
    let start = Instant::now();
    while !holds() {
        assert!(start.elapsed() < SOON, "{what} within {SOON:?}");
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// Controller that follows `target_pose` with a lag and publishes `current_pose` at 100 Hz.
struct Controller {
    node: Node,
    speaks: Arc<AtomicBool>,
    /// True: an obstacle holds the arm where it is.
    held: Arc<AtomicBool>,
    /// Pose of the arm, and the received targets.
    state: Arc<Mutex<(Pose, Vec<Pose>)>>,
    stiffness: Param<f64>,
    clip: Param<f64>,
    _targets: Subscription,
}

impl Controller {
    fn start(number: u16) -> Self {
        let b = builder("cartesian_impedance_controller", number);
        // crisp_controllers take -1 for critical damping; 2500 N/m lies below the bridge's own limit, on purpose.
        let free = || ParamSpec::new("A gain.").range(-1.0..=2500.0);
        let mut kept = Vec::new();
        for axis in ["pos_x", "pos_y", "pos_z", "rot_x", "rot_y", "rot_z"] {
            kept.push(b.declare_f64(&format!("task.k_{axis}"), 500.0, free()).unwrap());
            b.declare_f64(&format!("task.d_{axis}"), -1.0, free()).unwrap();
        }
        let clips = ["x", "y", "z"].map(|axis| b.declare_f64(&format!("task.error_clip.{axis}"), 0.1, free()).unwrap());
        b.declare_bool("limit_error", false, ParamSpec::new("Whether the clips act.")).unwrap();
        let node = b.build().unwrap();
        let state = Arc::new(Mutex::new((pose(0.4, 0.4), Vec::new())));
        let seen = Arc::clone(&state);
        let targets = node
            .subscription::<PoseStamped>("target_pose", Qos::Reliable { depth: 500 }, move |received| {
                seen.lock().unwrap().1.push(received.message.pose.clone());
            })
            .unwrap();
        let poses = node.publisher::<PoseStamped>("current_pose", Qos::Reliable { depth: 1 }).unwrap();
        let joints = node.publisher::<JointState>("joint_states", Qos::Reliable { depth: 10 }).unwrap();
        let speaks = Arc::new(AtomicBool::new(true));
        let held = Arc::new(AtomicBool::new(false));
        let (inner, speaking, moving) = (node.clone(), Arc::clone(&speaks), Arc::clone(&state));
        let holding = Arc::clone(&held);
        node.spawn("arm", move || {
            while !inner.shutdown().wait_timeout(Duration::from_millis(10)) {
                let at = {
                    let (at, targets) = &mut *moving.lock().unwrap();
                    if let (false, Some(to)) = (holding.load(Ordering::Relaxed), targets.last()) {
                        at.position.x += 0.2 * (to.position.x - at.position.x);
                        at.position.z += 0.2 * (to.position.z - at.position.z);
                    }
                    at.clone()
                };
                if speaking.load(Ordering::Relaxed) {
                    poses.send(PoseStamped { header: inner.header(BASE), pose: at });
                    joints.send(JointState { name: vec!["panda_joint1".into()], ..JointState::default() });
                }
            }
        })
        .unwrap();
        let (stiffness, [clip, ..]) = (kept.remove(0), clips);
        Self { node, speaks, held, state, stiffness, clip, _targets: targets }
    }

    fn last_target(&self) -> Option<Pose> {
        self.state.lock().unwrap().1.last().cloned()
    }

    fn received(&self) -> usize {
        self.state.lock().unwrap().1.len()
    }
}

/// Process of the relay.
struct Relay(Child);

impl Drop for Relay {
    fn drop(&mut self) {
        let _gone = self.0.kill();
        let _gone = self.0.wait();
    }
}

fn command(number: u16, parameters: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_panda_bridge"));
    command.arg("--ros-args").args(parameters.iter().flat_map(|p| ["-p", p]));
    command.env("ROS_DOMAIN_ID", domain(number).to_string()).env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST");
    command.env("ROS_HOME", env!("CARGO_TARGET_TMPDIR")).env_remove("ROS_LOG_DIR");
    command
}

fn relay(number: u16, parameters: &[&str]) -> Relay {
    Relay(command(number, parameters).stderr(Stdio::null()).spawn().unwrap())
}

/// Client of the arm's topics and services.
struct Client {
    node: Node,
    state: Latest<ArmState>,
    pose: Latest<PoseStamped>,
    joints: Latest<JointState>,
    target: Publisher<PoseStamped>,
    answers: Queue<AcceptedTarget>,
}

impl Client {
    /// Joins the graph, and waits until the arm is in `mode` and all endpoints are matched.
    fn join(number: u16, mode: u8) -> Self {
        let node = builder("client", number).build().unwrap();
        let client = Self {
            state: node.latest(ARM_STATE.name, ARM_STATE.qos).unwrap(),
            pose: node.latest(CURRENT_POSE.name, CURRENT_POSE.qos).unwrap(),
            joints: node.latest(JOINT_STATES.name, JOINT_STATES.qos).unwrap(),
            target: node.publisher(TARGET_POSE.name, TARGET_POSE.qos).unwrap(),
            answers: node.queue(ACCEPTED_TARGET.name, ACCEPTED_TARGET.qos, 10).unwrap(),
            node,
        };
        client.wait_mode(mode);
        assert!(client.target.wait_for_subscriber(SOON));
        // Matches are mutual but not simultaneous: the relay may still have to discover this client's readers.
        // Longer than the 0.15 s in which participants meet.
        std::thread::sleep(Duration::from_millis(300));
        client
    }

    fn wait_mode(&self, mode: u8) {
        wait_for("the mode", || self.state.get().is_some_and(|s| s.message.mode == mode));
    }

    fn enable(&self, on: bool) -> SetBoolResponse {
        self.node.client::<SetBool>(ENABLE.name).unwrap().call(SetBoolRequest { data: on }, SOON).unwrap()
    }

    fn ask(&self, x: f64, z: f64) -> AcceptedTarget {
        self.target.publish(PoseStamped { header: self.node.header(BASE), pose: pose(x, z) }).unwrap();
        AcceptedTarget::clone(&self.answers.next(SOON).expect("an answer").message)
    }
}

#[test]
fn targets_are_relayed_and_a_jump_keeps_the_old_one() {
    let controller = Controller::start(0);
    let mut process = relay(0, &[]);
    let client = Client::join(0, ArmState::MODE_IDLE);
    let refused = client.ask(0.42, 0.4);
    assert!(!refused.accepted && refused.reason.contains("not enabled"), "{}", refused.reason);
    assert_eq!(controller.received(), 0, "nothing reaches a controller before the arm is enabled");

    let answer = client.enable(true);
    assert!(answer.success, "{}", answer.message);
    wait_for("the measured pose as the first target", || controller.last_target() == Some(pose(0.4, 0.4)));
    let accepted = client.ask(0.45, 0.42);
    assert!(accepted.accepted, "{}", accepted.reason);
    wait_for("the target", || controller.last_target() == Some(pose(0.45, 0.42)));
    client.wait_mode(ArmState::MODE_TRACKING);
    wait_for("the arm", || {
        client.pose.get().is_some_and(|p| {
            assert_eq!(p.message.header.frame_id, BASE);
            (p.message.pose.position.x - 0.45).abs() < 1e-4
        })
    });
    assert!(!client.state.get().unwrap().message.is_sim);
    assert_eq!(client.joints.get().unwrap().message.name, ["panda_joint1"]);

    let jump = client.ask(0.57, 0.42);
    assert!(!jump.accepted && jump.reason.contains("from the measured pose"), "{}", jump.reason);
    assert_eq!((jump.pose.position.x, jump.accepted_count, jump.rejected_count), (0.45, 1, 1));
    let before = controller.received();
    std::thread::sleep(Duration::from_secs(1));
    let rate = controller.received() - before;
    // The relay repeats at 50 Hz; a loaded test machine loses some.
    assert!((30..=55).contains(&rate), "{rate} targets a second");
    assert_eq!(controller.last_target(), Some(pose(0.45, 0.42)));

    // At its end the relay sends one hold at the measured pose, and then nothing more.
    client.ask(0.5, 0.42);
    Command::new("kill").arg(process.0.id().to_string()).status().unwrap();
    assert!(process.0.wait().unwrap().success());
    std::thread::sleep(Duration::from_millis(100));
    let (held, count) = (controller.last_target().unwrap(), controller.received());
    assert!(held.position.x < 0.5 - 1e-6, "held at {} m, where the target was 0.5 m", held.position.x);
    std::thread::sleep(Duration::from_millis(300));
    assert_eq!(controller.received(), count);
}

#[test]
fn an_arm_that_is_pushed_away_is_latched_and_its_target_not_repeated() {
    let controller = Controller::start(8);
    let _process = relay(8, &[]);
    let client = Client::join(8, ArmState::MODE_IDLE);
    assert!(client.enable(true).success);
    wait_for("the target", || controller.last_target() == Some(pose(0.4, 0.4)));
    controller.held.store(true, Ordering::Relaxed);
    // 0.2 m below the target, beyond 1.5 times the jump limit.
    controller.state.lock().unwrap().0 = pose(0.4, 0.2);
    client.wait_mode(ArmState::MODE_REFLEX);
    assert!(client.state.get().unwrap().message.fault.contains("pushed or blocked"));
    wait_for("the pose where it was pushed to", || controller.last_target() == Some(pose(0.4, 0.2)));
    let count = controller.received();
    std::thread::sleep(Duration::from_millis(200));
    assert_eq!(controller.received(), count);
    assert!(!client.enable(true).success);
}

#[test]
fn a_silent_controller_is_disconnected_and_comes_back_idle() {
    let controller = Controller::start(1);
    let _process = relay(1, &[]);
    let client = Client::join(1, ArmState::MODE_IDLE);
    assert!(client.enable(true).success);
    client.wait_mode(ArmState::MODE_HOLD);
    let silent = Instant::now();
    controller.speaks.store(false, Ordering::Relaxed);
    // The relay stays up: it must notice the silence by itself.
    client.wait_mode(ArmState::MODE_DISCONNECTED);
    let took = silent.elapsed();
    // The default silence is 0.5 s.
    assert!(took > Duration::from_millis(450) && took < Duration::from_secs(2), "{took:?}");
    std::thread::sleep(Duration::from_millis(100));
    let count = controller.received();
    let refused = client.ask(0.41, 0.4);
    assert!(!refused.accepted && refused.reason.contains("no connection"), "{}", refused.reason);
    assert!(!client.enable(true).success);
    std::thread::sleep(Duration::from_millis(200));
    assert_eq!(controller.received(), count, "a lost arm is told nothing");
    controller.speaks.store(true, Ordering::Relaxed);
    client.wait_mode(ArmState::MODE_IDLE);
}

#[test]
fn the_move_to_the_start_pose_reaches_it() {
    let controller = Controller::start(2);
    let start = "start_pose:=[0.5, 0.0, 0.3, 1.0, 0.0, 0.0, 0.0]";
    let _process = relay(2, &[start, "start_speed_m_s:=0.3", "settle_time_s:=0.3"]);
    let client = Client::join(2, ArmState::MODE_IDLE);
    let mover = client.node.action_client::<MoveToStart>(MOVE_TO_START.name).unwrap();
    let goal = mover.send(MoveToStartGoal::default(), SOON, |_| {}).unwrap();
    let (status, result) = goal.wait(SOON).unwrap();
    assert_eq!((status, result.success), (Status::Succeeded, true), "{}", result.message);
    assert!((result.pose.position.x - 0.5).abs() < 1e-3 && (result.pose.position.z - 0.3).abs() < 1e-3);
    assert_eq!(controller.last_target(), Some(pose(0.5, 0.3)));
    client.wait_mode(ArmState::MODE_IDLE);
    let refused = client.ask(0.51, 0.3);
    assert!(!refused.accepted && refused.reason.contains("not enabled"), "a move enabled the arm: {}", refused.reason);
    let targets = controller.state.lock().unwrap().1.clone();
    let largest = targets.windows(2).map(|w| (w[1].position.x - w[0].position.x).abs()).fold(0.0, f64::max);
    // Half of the gate's limit of 0.1 m for a jump.
    assert!(largest < 0.05, "a step of {largest} m");
}

#[test]
fn a_replay_moves_no_real_arm() {
    let controller = Controller::start(3);
    let _process = relay(3, &["use_sim_time:=true"]);
    let clocks = controller.node.publisher::<Clock>("/clock", Qos::CLOCK).unwrap();
    let client = Client::join(3, ArmState::MODE_IDLE);
    clocks.send(Clock { clock: stamp::to_msg(client.node.now()) });
    let refused = client.enable(true);
    assert!(!refused.success && refused.message.contains("allow_replay"), "{}", refused.message);
    let mover = client.node.action_client::<MoveToStart>(MOVE_TO_START.name).unwrap();
    let goal = MoveToStartGoal { use_pose: true, pose: pose(0.42, 0.4), settle_time: 0.0 };
    let (status, result) = mover.send(goal, SOON, |_| {}).unwrap().wait(SOON).unwrap();
    assert_eq!(status, Status::Aborted);
    assert!(result.message.contains("allow_replay"), "{}", result.message);
    assert_eq!(controller.received(), 0);
}

#[test]
fn a_clock_that_stands_still_does_not_disable_the_silence_timeout() {
    let controller = Controller::start(7);
    let _process = relay(7, &["use_sim_time:=true", "is_real:=false", "gate.max_age_s:=5.0"]);
    let clocks = controller.node.publisher::<Clock>("/clock", Qos::CLOCK).unwrap();
    let client = Client::join(7, ArmState::MODE_IDLE);
    let events = client.node.publisher::<EpisodeEvent>(EPISODE_EVENT.name, EPISODE_EVENT.qos).unwrap();
    assert!(events.wait_for_subscriber(SOON) && clocks.wait_for_subscriber(SOON));
    clocks.send(Clock { clock: stamp::to_msg(client.node.now()) });
    wait_for("the enabled arm", || client.enable(true).success);
    // Silence counts only within an episode.
    let started = EpisodeEvent { event: EpisodeEvent::STARTED, step_period: 0.1, ..EpisodeEvent::default() };
    events.publish(started).unwrap();
    let answer = client.ask(0.45, 0.4);
    assert!(answer.accepted, "{}", answer.reason);
    let fault = || client.state.get().map(|s| s.message.fault.clone()).unwrap_or_default();
    wait_for("the end of the motion", || fault().contains("motion ended"));
    client.wait_mode(ArmState::MODE_IDLE);
}

#[test]
fn another_publisher_on_the_controllers_topic_ends_the_motion_and_prevents_enabling() {
    let _controller = Controller::start(4);
    let _process = relay(4, &[]);
    let client = Client::join(4, ArmState::MODE_IDLE);
    assert!(client.enable(true).success);
    client.wait_mode(ArmState::MODE_HOLD);
    let other = client.node.publisher::<PoseStamped>("target_pose", Qos::Reliable { depth: 1 }).unwrap();
    client.wait_mode(ArmState::MODE_IDLE);
    let fault = client.state.get().unwrap().message.fault.clone();
    assert!(fault.contains("1 more on /target_pose"), "{fault}");
    let answer = client.enable(true);
    assert!(!answer.success && answer.message.contains("1 more on /target_pose"), "{}", answer.message);
    drop(other);
    wait_for("the arm, enabled again", || client.enable(true).success);
    client.wait_mode(ArmState::MODE_HOLD);
    let _second = client.node.publisher::<PoseStamped>(TARGET_POSE.name, TARGET_POSE.qos).unwrap();
    client.wait_mode(ArmState::MODE_IDLE);
    let fault = client.state.get().unwrap().message.fault.clone();
    assert!(fault.contains("2 publishers"), "{fault}");
}

#[test]
fn a_pose_of_a_second_controller_is_not_used_and_ends_the_motion() {
    let controller = Controller::start(9);
    let _process = relay(9, &[]);
    let client = Client::join(9, ArmState::MODE_IDLE);
    assert!(client.enable(true).success);
    client.wait_mode(ArmState::MODE_HOLD);
    let other = client.node.publisher::<PoseStamped>("current_pose", Qos::Reliable { depth: 1 }).unwrap();
    assert!(other.wait_for_subscriber(SOON));
    let fault = || client.state.get().map(|s| s.message.fault.clone()).unwrap_or_default();
    // 0.05 m from the arm: a target from there would be no jump.
    wait_for("the end of the motion", || {
        other.send(PoseStamped { header: client.node.header(BASE), pose: pose(0.35, 0.4) });
        fault().contains("a pose of the controller came from /client")
    });
    client.wait_mode(ArmState::MODE_IDLE);
    assert!(fault().contains("the controller is /cartesian_impedance_controller"), "{}", fault());
    assert!((client.pose.get().unwrap().message.pose.position.x - 0.4).abs() < 1e-3, "it is not told on");
    assert!(controller.state.lock().unwrap().1.iter().all(|target| (target.position.x - 0.4).abs() < 1e-3));
}

#[test]
fn a_target_reaches_the_controller_no_faster_than_the_speed_limit() {
    let controller = Controller::start(10);
    let _process = relay(10, &["follow_speed_m_s:=0.1"]);
    let client = Client::join(10, ArmState::MODE_IDLE);
    assert!(client.enable(true).success);
    assert!(client.ask(0.46, 0.4).accepted);
    wait_for("the target", || controller.last_target() == Some(pose(0.46, 0.4)));
    let targets = controller.state.lock().unwrap().1.clone();
    let largest = targets.windows(2).map(|w| (w[1].position.x - w[0].position.x).abs()).fold(0.0, f64::max);
    // A step makes good for at most 60 ms. A message that was lost doubles it.
    assert!(largest <= 2.0 * 0.1 * 0.06 + 1e-9, "a step of {largest} m");
}

#[test]
fn compliance_becomes_the_controllers_parameters() {
    let controller = Controller::start(5);
    let process = relay(5, &[]);
    let client = Client::join(5, ArmState::MODE_IDLE);
    let setter = client.node.client::<SetCompliance>(SET_COMPLIANCE.name).unwrap();
    let law: Latest<Text> = client.node.latest(ARM_LAW.name, ARM_LAW.qos).unwrap();
    assert!(client.node.publishers(ARM_LAW.name).unwrap().is_empty(), "a relay that knows no law offers no topic");
    let wanted = SetComplianceRequest {
        stiffness: [1500.0, 1500.0, 1500.0, 100.0, 100.0, 100.0],
        damping: [70.0, 70.0, 70.0, 6.0, 6.0, 6.0],
        error_clip: 0.02,
    };
    let answer = setter.call(wanted.clone(), SOON).unwrap();
    assert!(answer.success, "{}", answer.message);
    assert_eq!((controller.stiffness.get(), controller.clip.get()), (1500.0, 0.02));
    let announced = law.wait_newer(0, SOON).expect("the law of the new gains").message.data.clone();
    for part in ["\"stiffness_n_m\":1500.0", "\"max_speed_m_s\":0.5"] {
        assert!(announced.contains(part), "{announced}");
    }
    // The bridge accepts 2900 N/m, this controller does not: it must set none of the values.
    let stiff = SetComplianceRequest { stiffness: [2900.0, 1.0, 1.0, 1.0, 1.0, 1.0], ..wanted.clone() };
    let answer = setter.call(stiff, SOON).unwrap();
    assert!(!answer.success && answer.message.contains("2900"), "{}", answer.message);
    assert_eq!(controller.stiffness.get(), 1500.0);
    let bad = SetComplianceRequest { error_clip: -1.0, ..wanted.clone() };
    assert!(setter.call(bad, SOON).unwrap().message.contains("error_clip"));
    drop(process);
    let _nameless = relay(5, &["controller.node:=''"]);
    wait_for("the refusal", || {
        let answer = setter.call(wanted.clone(), Duration::from_secs(2));
        answer.is_ok_and(|a| !a.success && a.message.contains("controller.node is empty"))
    });
}

/// Starts a relay that must refuse a parameter, and returns what it says.
fn refused(parameter: &str) -> String {
    let Output { status, stderr, .. } = command(6, &[parameter]).output().unwrap();
    assert!(!status.success());
    String::from_utf8(stderr).unwrap()
}

#[test]
fn a_start_pose_outside_the_workspace_is_refused() {
    for place in ["3.0, 0.0, 0.3", "0.4, 0.0, -3.0"] {
        let line = refused(&format!("start_pose:=[{place}, 1.0, 0.0, 0.0, 0.0]"));
        assert!(line.contains("start_pose: expected a place inside the workspace (x ["), "{line}");
    }
}

#[test]
fn names_that_collide_are_refused() {
    let line = refused("controller.target_pose_topic:=/panda/target_pose");
    assert!(line.contains("/panda/target_pose is the bridge's own topic"), "{line}");
    let line = refused("controller.current_pose_topic:=panda/current_pose");
    assert!(line.contains("controller.current_pose_topic"), "{line}");
}
