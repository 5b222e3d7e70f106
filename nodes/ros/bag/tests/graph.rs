//! Recorder and replayer over the loopback interface. A failure here would lose measurements, or move an arm.
#![allow(
    clippy::disallowed_methods,
    clippy::unwrap_used,
    reason = "a test of threads, processes and sockets waits for them, and a failure is a panic"
)]

use catenary_bag::{
    BagError, BagReader, BagSummary, BagWriter, RecordSettings, ReplaySettings, TopicFilter, WriterOptions, record,
    replay,
};
use catenary_msgs::geometry_msgs::msg::PoseStamped;
use catenary_msgs::msg::{ArmState, EpisodeEvent, Keypoints};
use catenary_msgs::rosgraph_msgs::msg::Clock;
use catenary_msgs::std_srvs::srv::{Trigger, TriggerResponse};
use catenary_shell::contract::{ARM_STATE, CURRENT_POSE, EPISODE_EVENT, HOLD, KEYPOINTS, TARGET_POSE};
use catenary_shell::{Discovery, DomainClaim, Node, NodeBuilder, Qos, RosArgs, Time, stamp};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Mutex;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

// Discovery takes less than a second; a busy machine needs more.
const SOON: Duration = Duration::from_secs(5);

/// ROS domain of test `number`, which no other process uses.
fn domain(number: u16) -> u16 {
    static CLAIMS: Mutex<BTreeMap<u16, DomainClaim>> = Mutex::new(BTreeMap::new());
    let mut claims = CLAIMS.lock().unwrap();
    claims.entry(number).or_insert_with(|| DomainClaim::any(|_| Ok(true)).unwrap()).id()
}

fn builder(name: &str, number: u16, args: &[&str]) -> NodeBuilder {
    let all = std::iter::once("--ros-args").chain(args.iter().copied());
    let (args, _) = RosArgs::parse(all).unwrap();
    NodeBuilder::new(name, &args).unwrap().domain(domain(number), Discovery::Localhost)
}

fn node(name: &str, number: u16) -> Node {
    builder(name, number, &[]).build().unwrap()
}

fn sample() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../bags/swing")
}

fn pose(index: i64) -> PoseStamped {
    let header = stamp::header(Time::from_nanos(index), "panda_link0");
    let mut pose = PoseStamped { header, ..PoseStamped::default() };
    pose.pose.position.x = index as f64;
    pose
}

fn wait_for(what: &str, mut holds: impl FnMut() -> bool) {
    let start = Instant::now();
    while !holds() {
        assert!(start.elapsed() < SOON, "{what} within {SOON:?}");
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// Records on its own thread until the node is told to shut down.
fn recording(recorder: &Node, settings: RecordSettings) -> JoinHandle<Result<BagSummary, BagError>> {
    let recorder = recorder.clone();
    std::thread::spawn(move || record(&recorder, &settings))
}

#[test]
fn published_messages_are_in_the_bag() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("bag");
    let sender = node("sender", 1);
    let events = sender.publisher::<EpisodeEvent>(EPISODE_EVENT.name, EPISODE_EVENT.qos).unwrap();
    let latched = EpisodeEvent { episode: 4, policy: "pi0".into(), ..EpisodeEvent::default() };
    events.publish(latched.clone()).unwrap();
    let recorder = node("recorder", 1);
    let settings =
        RecordSettings { filter: TopicFilter::of(&["panda/*", "/episode/event"]), ..RecordSettings::new(out.clone()) };
    let recording = recording(&recorder, settings);
    let poses = sender.publisher::<PoseStamped>(CURRENT_POSE.name, CURRENT_POSE.qos).unwrap();
    let targets = sender.publisher::<PoseStamped>(TARGET_POSE.name, TARGET_POSE.qos).unwrap();
    wait_for("the bag", || out.join("metadata.yaml").exists());
    assert!(poses.wait_for_subscriber(SOON) && targets.wait_for_subscriber(SOON));
    std::thread::sleep(Duration::from_millis(300));
    let before = catenary_shell::wall_now().nanos();
    for index in 0..100 {
        poses.publish(pose(index)).unwrap();
        targets.publish(pose(-index)).unwrap();
        std::thread::sleep(Duration::from_millis(5));
    }
    std::thread::sleep(Duration::from_millis(300));
    recorder.shutdown().trigger();
    let summary = recording.join().unwrap().unwrap();
    let bag = BagReader::open(&out).unwrap();
    assert_eq!((bag.notes().len(), bag.message_count()), (0, summary.messages));
    let targets: Vec<PoseStamped> =
        bag.messages_of(&["/panda/target_pose"]).map(|m| m.unwrap().decode().unwrap()).collect();
    assert_eq!(targets, (0..100).map(|i| pose(-i)).collect::<Vec<_>>());
    // Best effort: a busy machine loses some messages.
    assert!(bag.topic("/panda/current_pose").unwrap().messages >= 50, "{}", bag.describe_topics());
    let topic = &bag.topic("/panda/current_pose").unwrap().topic;
    assert_eq!(topic.qos, [CURRENT_POSE.qos]);
    let events: Vec<EpisodeEvent> =
        bag.messages_of(&["/episode/event"]).map(|m| m.unwrap().decode().unwrap()).collect();
    assert_eq!(events, [latched]);
    for message in bag.messages_of(&["/panda/target_pose"]).map(Result::unwrap) {
        assert!(message.publish_time_ns >= before && message.publish_time_ns <= message.log_time_ns);
        assert!(message.log_time_ns - message.publish_time_ns < 1_000_000_000);
    }
}

/// A script that waits for the end of an episode and then interrupts the recorder is faster than the end event.
#[test]
fn a_message_just_after_the_shutdown_request_is_in_the_bag() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("bag");
    let sender = node("sender", 10);
    let events = sender.publisher::<EpisodeEvent>(EPISODE_EVENT.name, EPISODE_EVENT.qos).unwrap();
    let recorder = node("recorder", 10);
    let settings = RecordSettings { filter: TopicFilter::of(&["/episode/event"]), ..RecordSettings::new(out.clone()) };
    let recording = recording(&recorder, settings);
    wait_for("the bag", || out.join("metadata.yaml").exists());
    assert!(events.wait_for_subscriber(SOON));
    events.publish(EpisodeEvent { episode: 4, event: EpisodeEvent::STARTED, ..EpisodeEvent::default() }).unwrap();
    std::thread::sleep(Duration::from_millis(300));
    recorder.shutdown().trigger();
    std::thread::sleep(Duration::from_millis(20));
    let ended = EpisodeEvent { episode: 4, event: EpisodeEvent::ENDED, ..EpisodeEvent::default() };
    events.publish(ended.clone()).unwrap();
    assert_eq!(recording.join().unwrap().unwrap().messages, 2);
    let bag = BagReader::open(&out).unwrap();
    let last = bag.messages_of(&["/episode/event"]).last().unwrap().unwrap();
    assert_eq!(last.decode::<EpisodeEvent>().unwrap(), ended);
}

#[test]
fn simulated_time_is_the_bags_time() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("bag");
    let recorder = builder("recorder", 2, &["-p", "use_sim_time:=true"]).build().unwrap();
    let settings = RecordSettings { filter: TopicFilter::of(&["dlo/keypoints"]), ..RecordSettings::new(out.clone()) };
    let recording = recording(&recorder, settings);
    let simulator = node("simulator", 2);
    let clock = simulator.publisher::<Clock>("/clock", Qos::CLOCK).unwrap();
    let keypoints = simulator.publisher::<Keypoints>(KEYPOINTS.name, KEYPOINTS.qos).unwrap();
    assert!(clock.wait_for_subscriber(SOON));
    assert!(!out.exists());
    let tick = |seconds: i64| {
        clock.publish(Clock { clock: stamp::to_msg(Time::from_nanos(seconds * 1_000_000_000)) }).unwrap();
        std::thread::sleep(Duration::from_millis(20));
    };
    wait_for("the bag", || {
        tick(40);
        out.exists()
    });
    assert!(keypoints.wait_for_subscriber(SOON));
    std::thread::sleep(Duration::from_millis(200));
    for seconds in 50..60 {
        tick(seconds);
        wait_for("the recorder's clock", || recorder.now() == Time::from_nanos(seconds * 1_000_000_000));
        keypoints.publish(Keypoints::default()).unwrap();
        std::thread::sleep(Duration::from_millis(20));
    }
    std::thread::sleep(Duration::from_millis(200));
    recorder.shutdown().trigger();
    let summary = recording.join().unwrap().unwrap();
    let (first, last) = summary.span_ns.unwrap();
    assert!(summary.messages >= 9, "{}", summary.messages);
    assert!(first >= 50_000_000_000 && last == 59_000_000_000, "{first} {last}");
}

#[test]
fn a_killed_recorder_loses_the_last_second_at_most() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("bag");
    let mut recorder = Command::new(env!("CARGO_BIN_EXE_recorder"))
        .args(["--ros-args", "-p", &format!("output:={}", out.display()), "-p", "topics:=[panda/target_pose]"])
        .env("ROS_DOMAIN_ID", domain(3).to_string())
        .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        .env("ROS_HOME", env!("CARGO_TARGET_TMPDIR"))
        .env_remove("ROS_LOG_DIR")
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let sender = node("sender", 3);
    let targets = sender.publisher::<PoseStamped>(TARGET_POSE.name, TARGET_POSE.qos).unwrap();
    assert!(targets.wait_for_subscriber(SOON));
    wait_for("the bag", || out.exists());
    std::thread::sleep(Duration::from_millis(300));
    for index in 0..250 {
        targets.publish(pose(index)).unwrap();
        std::thread::sleep(Duration::from_millis(10));
    }
    // SIGKILL: the recorder cannot finish its file.
    recorder.kill().unwrap();
    recorder.wait().unwrap();
    let bag = BagReader::open(&out).unwrap();
    assert!(bag.notes()[0].contains("was not finished"), "{:?}", bag.notes());
    let got: Vec<f64> = bag.messages().map(|m| m.unwrap().decode::<PoseStamped>().unwrap().pose.position.x).collect();
    assert_eq!(got, (0..got.len()).map(|i| i as f64).collect::<Vec<_>>());
    // A second at 100 Hz, and 0.3 s for a busy machine.
    assert!(got.len() >= 250 - 130, "{} of 250", got.len());
}

#[test]
fn a_replayed_bag_arrives_complete_in_time_and_without_commands() {
    let player = node("player", 4);
    let listener = node("listener", 4);
    let events = listener.queue::<EpisodeEvent>(EPISODE_EVENT.name, EPISODE_EVENT.qos, 100).unwrap();
    let states = listener.queue::<ArmState>(ARM_STATE.name, ARM_STATE.qos, 1000).unwrap();
    let poses = listener.queue::<PoseStamped>(CURRENT_POSE.name, CURRENT_POSE.qos.with_depth(100), 1000).unwrap();
    let targets = listener.queue::<PoseStamped>(TARGET_POSE.name, TARGET_POSE.qos, 1000).unwrap();
    let clocks = listener.queue::<Clock>("/clock", Qos::CLOCK.with_depth(100), 10_000).unwrap();
    let settings =
        ReplaySettings { rate: 2.0, start_offset_s: 0.6, clock_hz: Some(200.0), ..ReplaySettings::new(sample()) };
    let start = Instant::now();
    let summary = replay(&player, &settings).unwrap();
    let took = start.elapsed();
    // 4.1 s of bag without the first 0.6 s at twice the speed, after 1.5 s of listening for arms.
    assert!(took > Duration::from_millis(1500 + 1750), "{took:?}");
    assert_eq!(summary.failed, 0);
    assert_eq!(summary.left_out.len(), 1, "{:?}", summary.left_out);
    assert!(summary.left_out[0].contains("/panda/target_pose") && summary.left_out[0].contains("allow_replay"));
    let drained = |queue: &dyn Fn() -> Option<i64>| std::iter::from_fn(queue).collect::<Vec<i64>>();
    let stamp_ns = |s: &catenary_msgs::builtin_interfaces::msg::Time| stamp::from_msg(s).nanos();
    let events = drained(&|| events.try_next().map(|e| i64::from(e.message.event)));
    // The latched event from before the start comes first.
    assert_eq!(events, [EpisodeEvent::STARTED, EpisodeEvent::ENDED].map(i64::from));
    let states = drained(&|| states.try_next().map(|s| stamp_ns(&s.message.header.stamp)));
    assert_eq!(states.len(), 1 + 18, "{states:?}");
    let arrivals: Vec<_> = std::iter::from_fn(|| poses.try_next()).collect();
    // Best effort: a busy machine loses some messages.
    assert!(arrivals.len() > 90, "{} of 175 poses", arrivals.len());
    let (first, last) = (&arrivals[0], &arrivals[arrivals.len() - 1]);
    let wall_s = last.received.secs_since(first.received);
    let bag_s = 1e-9 * (stamp_ns(&last.message.header.stamp) - stamp_ns(&first.message.header.stamp)) as f64;
    assert!((bag_s / wall_s - 2.0).abs() < 0.1, "{bag_s} s of bag in {wall_s} s");
    let clocks = drained(&|| clocks.try_next().map(|c| stamp_ns(&c.message.clock)));
    assert!(clocks.len() > 300 && clocks.is_sorted(), "{} ticks", clocks.len());
    assert!(clocks[0] >= 100_500_000_000 && clocks[clocks.len() - 1] <= 104_001_000_000, "{clocks:?}");
    assert_eq!(drained(&|| targets.try_next().map(|_| 0)), [] as [i64; 0]);
}

/// Simulated or real arm: it serves one of an arm's services and publishes states at 50 Hz until it is stopped.
fn arm(number: u16, is_sim: bool) -> Node {
    let arm = node("arm", number);
    let hold = arm.serve::<Trigger>(HOLD.name, |_| TriggerResponse::default()).unwrap();
    let states = arm.publisher::<ArmState>(ARM_STATE.name, ARM_STATE.qos).unwrap();
    let ticking = arm.clone();
    arm.spawn("states", move || {
        let _served = hold;
        while !ticking.shutdown().wait_timeout(Duration::from_millis(20)) {
            states.send(ArmState { header: ticking.header(""), is_sim, ..ArmState::default() });
        }
    })
    .unwrap();
    arm
}

fn refusal(outcome: Result<catenary_bag::ReplaySummary, BagError>) -> String {
    match outcome {
        Err(BagError::Refused(reason)) => reason,
        other => panic!("{other:?}"),
    }
}

#[test]
fn nothing_is_replayed_while_a_real_arm_is_there() {
    let real = arm(5, false);
    let player = node("player", 5);
    let poses = real.queue::<PoseStamped>(CURRENT_POSE.name, CURRENT_POSE.qos, 10).unwrap();
    let settings = ReplaySettings { allow_replay: true, ..ReplaySettings::new(sample()) };
    let reason = refusal(replay(&player, &settings));
    assert!(reason.contains("a real arm") && reason.contains("/panda/arm_state"), "{reason}");
    assert!(poses.try_next().is_none());
    real.stop();
}

#[test]
fn a_real_arm_that_comes_ends_the_replay() {
    let player = node("player", 6);
    let comes = std::thread::spawn(|| {
        std::thread::sleep(Duration::from_millis(2500));
        arm(6, false)
    });
    let settings = ReplaySettings { wait: Duration::ZERO, repeat: true, ..ReplaySettings::new(sample()) };
    let start = Instant::now();
    let reason = refusal(replay(&player, &settings));
    assert!(reason.contains("a real arm"), "{reason}");
    assert!(start.elapsed() > Duration::from_millis(2400) && start.elapsed() < SOON, "{:?}", start.elapsed());
    comes.join().unwrap().stop();
}

#[test]
fn states_of_a_real_arm_in_the_bag_do_not_end_their_own_replay() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bag");
    let mut bag = BagWriter::create(&path, &WriterOptions::default()).unwrap();
    let states = bag.add_topic_of::<ArmState>("/panda/arm_state", ARM_STATE.qos).unwrap();
    for i in 1..=20 {
        let header = stamp::header(Time::from_nanos(i * 20_000_000), "");
        bag.write(states, i * 20_000_000, 0, &ArmState { header, is_sim: false, ..ArmState::default() }).unwrap();
    }
    bag.finish().unwrap();
    // A participant hears itself on networks, but not on the loopback interface alone.
    let player = builder("player", 9, &[]).domain(domain(9), Discovery::Subnet).build().unwrap();
    let listener = builder("listener", 9, &[]).domain(domain(9), Discovery::Subnet).build().unwrap();
    let heard = listener.queue::<ArmState>(ARM_STATE.name, ARM_STATE.qos, 100).unwrap();
    assert_eq!(replay(&player, &ReplaySettings::new(path)).unwrap().published, 20);
    assert_eq!(std::iter::from_fn(|| heard.try_next()).count(), 20);
}

#[test]
fn commands_are_replayed_to_a_simulated_arm_and_to_nobody_else() {
    let simulated = arm(7, true);
    let targets = simulated.queue::<PoseStamped>(TARGET_POSE.name, TARGET_POSE.qos, 100).unwrap();
    let settings = ReplaySettings {
        filter: TopicFilter::of(&["/panda/target_pose"]),
        rate: f64::INFINITY,
        allow_replay: true,
        ..ReplaySettings::new(sample())
    };
    let player = node("player", 7);
    assert_eq!(replay(&player, &settings).unwrap().published, 8);
    let got = std::iter::from_fn(|| targets.next(Duration::from_millis(500))).count();
    assert_eq!(got, 8);
    simulated.stop();
    drop((simulated, targets, player));

    let unknown = node("controller", 8);
    let _targets = unknown.queue::<PoseStamped>(TARGET_POSE.name, TARGET_POSE.qos, 100).unwrap();
    let reason = refusal(replay(&node("player", 8), &settings));
    assert!(reason.contains("/controller") && reason.contains("listens on /panda/target_pose"), "{reason}");
}

#[test]
fn commands_are_replayed_to_no_arm_on_the_word_of_another_node() {
    let commands = ReplaySettings {
        filter: TopicFilter::of(&["/panda/target_pose"]),
        rate: f64::INFINITY,
        allow_replay: true,
        ..ReplaySettings::new(sample())
    };
    // The state comes from a node that serves no arm, so it proves nothing.
    let teller = node("teller", 10);
    let states = teller.publisher::<ArmState>(ARM_STATE.name, ARM_STATE.qos).unwrap();
    states.publish(ArmState { header: teller.header(""), is_sim: true, ..ArmState::default() }).unwrap();
    let controller = node("controller", 10);
    let targets = controller.queue::<PoseStamped>(TARGET_POSE.name, TARGET_POSE.qos, 100).unwrap();
    let reason = refusal(replay(&node("player", 10), &commands));
    assert!(reason.contains("/teller"), "{reason}");
    teller.stop();
    drop((states, teller));
    // A controller that publishes a pose counts as a second arm.
    let simulated = arm(10, true);
    let _pose = controller.publisher::<PoseStamped>(CURRENT_POSE.name, CURRENT_POSE.qos).unwrap();
    let reason = refusal(replay(&node("player", 10), &commands));
    assert!(reason.contains("/arm") && reason.contains("/controller"), "{reason}");
    assert!(targets.try_next().is_none());
    simulated.stop();
}

#[test]
fn measurements_are_not_replayed_over_those_of_a_live_arm_but_computed_topics_are() {
    let simulated = arm(0, true);
    let tracker = node("keypoint_tracker", 0);
    let _keypoints = tracker.publisher::<Keypoints>(KEYPOINTS.name, KEYPOINTS.qos).unwrap();
    let fast = ReplaySettings { rate: f64::INFINITY, wait: Duration::ZERO, ..ReplaySettings::new(sample()) };
    let reason = refusal(replay(&node("player", 0), &fast));
    assert!(reason.contains("others publish /panda/arm_state (/arm") && reason.contains("allow_others"), "{reason}");
    let allowed = ReplaySettings { allow_others: true, ..fast.clone() };
    assert!(replay(&node("player", 0), &allowed).unwrap().published > 500);
    simulated.stop();
    drop(simulated);
    let computed = ReplaySettings { filter: TopicFilter::of(&["/dlo/keypoints"]), ..fast };
    assert!(replay(&node("player", 0), &computed).unwrap().published > 50);
}

#[test]
fn a_pace_or_an_offset_without_sense_is_refused() {
    let player = node("player", 2);
    let words = |settings: ReplaySettings| replay(&player, &settings).unwrap_err().to_string();
    let sample = || ReplaySettings::new(sample());
    for rate in [0.0, -1.0, 1e-300, f64::NAN, 1e300] {
        let words = words(ReplaySettings { rate, ..sample() });
        assert!(words.starts_with("rate: expected a number from 0.001 to 1000000, or inf, got "), "{words}");
    }
    let words = words(ReplaySettings { start_offset_s: 1e9, ..sample() });
    assert!(
        words.starts_with("start_offset_s: expected at most the 4.") && words.ends_with("got 1000000000.0"),
        "{words}"
    );
}
