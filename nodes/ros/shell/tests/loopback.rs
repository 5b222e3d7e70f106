//! Tests of two nodes over the loopback interface. A failure here is a fault between a node and DDS.
#![allow(
    clippy::disallowed_methods,
    clippy::unwrap_used,
    reason = "a test of threads and sockets waits for them, and a failure is a panic"
)]

use catenary_msgs::action::{MoveToStart, MoveToStartFeedback, MoveToStartGoal, MoveToStartResult};
use catenary_msgs::geometry_msgs::msg::PoseStamped;
use catenary_msgs::msg::Track;
use catenary_msgs::srv::{Simulate, SimulateRequest, SimulateResponse};
use catenary_msgs::std_srvs::srv::{SetBool, SetBoolRequest, SetBoolResponse};
use catenary_shell::{
    CallError, Concurrency, Decision, Discovery, DomainClaim, Node, NodeBuilder, Outcome, ParamSpec, Qos, RosArgs,
    Status, Value,
};
use rustdds::{DomainParticipantBuilder, DomainParticipantStatusEvent, RTPSEntity, StatusEvented};
use std::collections::BTreeMap;
use std::sync::Mutex;
use std::sync::mpsc::channel;
use std::time::{Duration, Instant};

const SOON: Duration = Duration::from_secs(4);
const TARGET: Qos = Qos::Reliable { depth: 10 };

/// Returns the domain of test `number`, which no other process uses.
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

fn pose(x: f64) -> PoseStamped {
    let mut pose = PoseStamped::default();
    pose.pose.position.x = x;
    pose
}

#[test]
fn a_reliable_stream_arrives_complete_and_in_order() {
    let (sender, receiver) = (node("sender", 101), node("receiver", 101));
    let queue = receiver.queue::<PoseStamped>("target", TARGET, 100).unwrap();
    let latest = receiver.latest::<PoseStamped>("target", TARGET).unwrap();
    let publisher = sender.publisher::<PoseStamped>("target", TARGET).unwrap();
    assert!(publisher.wait_for_subscriber(SOON));
    assert!(latest.get().is_none());
    // The writer has matched the reader, but the reader may still have to match the writer.
    std::thread::sleep(Duration::from_millis(200));
    for index in 0..50 {
        publisher.publish(pose(f64::from(index))).unwrap();
    }
    let got: Vec<f64> = (0..50).map(|_| queue.next(SOON).unwrap().message.pose.position.x).collect();
    assert_eq!(got, (0..50).map(f64::from).collect::<Vec<_>>());
    let newest = latest.wait_newer(49, SOON).unwrap();
    assert_eq!((newest.message.pose.position.x, newest.count), (49.0, 50));
    assert_eq!((queue.dropped(), publisher.published()), (0, 50));
    assert_eq!(receiver.publisher_count("target").unwrap(), 1);
    assert_eq!(receiver.other_publisher_count("target").unwrap(), 1);
    assert_eq!(sender.other_publisher_count("target").unwrap(), 0);
}

/// Fast DDS may miss endpoints that are announced before it has discovered the node: see `settle.rs`.
#[test]
fn a_node_has_no_endpoints_before_others_have_met_it() {
    let networks = [std::net::Ipv4Addr::LOCALHOST];
    let other = DomainParticipantBuilder::new(domain(117)).with_only_networks(networks).build().unwrap();
    let watcher = std::thread::spawn(move || {
        let (listener, start, mut met) = (other.status_listener(), Instant::now(), None);
        while start.elapsed() < SOON {
            match listener.try_recv_status() {
                Some(DomainParticipantStatusEvent::ParticipantDiscovered { dpd }) if dpd.guid != other.guid() => {
                    met = Some((dpd.guid.prefix, Instant::now()));
                }
                Some(
                    DomainParticipantStatusEvent::ReaderDetected { reader: endpoint }
                    | DomainParticipantStatusEvent::WriterDetected { writer: endpoint },
                ) if met.is_some_and(|(prefix, _)| prefix == endpoint.guid.prefix) => {
                    return met.map(|(_, at)| at.elapsed());
                }
                Some(_) => {}
                None => std::thread::sleep(Duration::from_millis(1)),
            }
        }
        None
    });
    let node = node("late", 117);
    let between = watcher.join().unwrap().unwrap();
    // The pause is 150 ms; the rest is tolerance for a busy machine.
    assert!(between > Duration::from_millis(100), "{} announced an endpoint after {between:?}", node.name());
}

#[test]
fn a_late_subscriber_gets_the_latched_state_alone() {
    let sender = node("sender", 102);
    let latched = Qos::ReliableTransientLocal { depth: 1 };
    let publisher = sender.publisher::<PoseStamped>("state", latched).unwrap();
    // More than the depth of 1: RustDDS keeps them all for a while.
    for index in 0..200 {
        publisher.publish(pose(f64::from(index))).unwrap();
    }
    let receiver = node("receiver", 102);
    let queue = receiver.queue::<PoseStamped>("state", latched, 1000).unwrap();
    assert_eq!(queue.next(SOON).unwrap().message.pose.position.x, 199.0);
    publisher.publish(pose(200.0)).unwrap();
    assert_eq!(queue.next(SOON).unwrap().message.pose.position.x, 200.0);
}

#[test]
fn names_follow_namespace_and_remaps() {
    let args = ["-r", "__ns:=/lab", "-r", "target:=/arm/goal", "-r", "__node:=eye"];
    let sender = builder("sender", 103, &args).build().unwrap();
    assert_eq!(sender.path(), "/lab/eye");
    let publisher = sender.publisher::<PoseStamped>("target", TARGET).unwrap();
    assert_eq!(publisher.topic(), "/arm/goal");
    assert_eq!(sender.resolve("other").unwrap(), "/lab/other");
    let receiver = node("receiver", 103);
    let latest = receiver.latest::<PoseStamped>("arm/goal", TARGET).unwrap();
    assert!(publisher.wait_for_subscriber(SOON));
    std::thread::sleep(Duration::from_millis(200));
    publisher.publish(pose(3.0)).unwrap();
    assert_eq!(latest.wait_newer(0, SOON).unwrap().message.pose.position.x, 3.0);
}

#[test]
fn a_topic_of_the_contract_keeps_its_type() {
    let node = node("sender", 104);
    let error = node.publisher::<PoseStamped>("dlo/keypoints", TARGET).err().unwrap().to_string();
    assert!(error.contains("catenary_msgs/msg/Keypoints"), "{error}");
}

#[test]
fn a_service_answers_and_its_absence_is_an_error_in_time() {
    let (server, caller) = (node("server", 105), node("caller", 105));
    let service = server
        .serve::<SetBool>("enable", |request| SetBoolResponse { success: request.data, message: "seen".to_owned() })
        .unwrap();
    let client = caller.client::<SetBool>("enable").unwrap();
    for data in [true, false, true] {
        let answer = client.call(SetBoolRequest { data }, SOON).unwrap();
        assert_eq!((answer.success, answer.message.as_str()), (data, "seen"));
    }
    assert_eq!(service.name(), "/enable");
    let absent = caller.client::<SetBool>("absent").unwrap();
    let start = Instant::now();
    let error = absent.call(SetBoolRequest { data: true }, Duration::from_millis(100)).unwrap_err();
    assert!(matches!(error, CallError::NoServer { .. }), "{error}");
    assert!(start.elapsed() < Duration::from_secs(1));
}

#[test]
fn every_new_client_of_a_process_gets_its_first_answer() {
    let (server, caller) = (node("server", 112), node("caller", 112));
    let _service = server
        .serve::<SetBool>("enable", |request| SetBoolResponse { success: request.data, message: String::new() })
        .unwrap();
    let clients: Vec<_> = (0..8).map(|_| caller.client::<SetBool>("enable").unwrap()).collect();
    for client in &clients {
        assert!(client.call(SetBoolRequest { data: true }, SOON).unwrap().success);
    }
    let last = caller.client::<SetBool>("enable").unwrap();
    assert!(last.call(SetBoolRequest { data: true }, SOON).unwrap().success);
}

#[test]
fn several_threads_share_one_client_without_losing_answers() {
    let (server, caller) = (node("server", 106), node("caller", 106));
    let _service = server
        .serve::<SetBool>("enable", |request| SetBoolResponse { success: request.data, message: String::new() })
        .unwrap();
    let client = caller.client::<SetBool>("enable").unwrap();
    std::thread::scope(|scope| {
        for data in [true, false, true, false] {
            let client = client.clone();
            scope.spawn(move || {
                for _ in 0..20 {
                    let answer = client.call(SetBoolRequest { data }, SOON).unwrap();
                    assert_eq!(answer.success, data);
                }
            });
        }
    });
}

fn serve_move(server: &Node) -> catenary_shell::ActionServer {
    let decide = |goal: &MoveToStartGoal| {
        if goal.settle_time < 0.0 {
            Decision::Reject(format!("expected a settle time of at least 0, got {}", goal.settle_time))
        } else {
            Decision::Accept
        }
    };
    server
        .serve_action::<MoveToStart>("move", Concurrency::One, decide, |goal| {
            let steps = 10;
            for step in 0..steps {
                goal.feedback(MoveToStartFeedback { distance: f64::from(steps - step) });
                let pause = Duration::from_secs_f64(goal.goal().settle_time / f64::from(steps));
                if goal.wait_cancelled(pause) {
                    let message = "stopped".to_owned();
                    return Outcome::Canceled(MoveToStartResult { message, ..Default::default() });
                }
            }
            Outcome::Succeeded(MoveToStartResult { success: true, ..Default::default() })
        })
        .unwrap()
}

#[test]
fn an_action_is_accepted_reports_and_succeeds_or_is_rejected_or_cancelled() {
    let (server, caller) = (node("server", 107), node("caller", 107));
    let _action = serve_move(&server);
    let client = caller.action_client::<MoveToStart>("move").unwrap();
    let goal = |settle_time| MoveToStartGoal { settle_time, ..Default::default() };

    let (sender, feedback) = channel();
    let running = client
        .send(goal(0.3), SOON, move |feedback: MoveToStartFeedback| {
            sender.send(feedback.distance).unwrap();
        })
        .unwrap();
    let (status, result) = running.wait(SOON).unwrap();
    assert_eq!((status, result.success), (Status::Succeeded, true));
    assert!(!running.cancel(SOON).unwrap(), "a goal that is over was cancelled");
    drop(running);
    let distances: Vec<f64> = feedback.iter().collect();
    assert!(distances.len() >= 8, "{distances:?}");
    assert_eq!(distances.last(), Some(&1.0));

    let rejected = client.send(goal(-1.0), SOON, |_| {}).err().unwrap();
    assert!(matches!(rejected, CallError::Rejected { .. }), "{rejected}");

    let long = client.send(goal(60.0), SOON, |_| {}).unwrap();
    let other = caller.action_client::<MoveToStart>("move").unwrap();
    let second = other.send(goal(0.1), SOON, |_| {}).err().unwrap();
    assert!(matches!(second, CallError::Rejected { .. }), "{second}");
    // A wait that timed out must not lose the result.
    let early = long.wait(Duration::from_millis(50)).unwrap_err();
    assert!(matches!(early, CallError::Timeout { .. }), "{early}");
    assert!(long.cancel(SOON).unwrap());
    let (status, result) = long.wait(SOON).unwrap();
    assert_eq!((status, result.message.as_str()), (Status::Canceled, "stopped"));
}

#[test]
fn shutdown_ends_a_running_goal_and_every_thread_in_time() {
    let (server, caller) = (node("server", 108), node("caller", 108));
    let action = serve_move(&server);
    let client = caller.action_client::<MoveToStart>("move").unwrap();
    let goal = MoveToStartGoal { settle_time: 60.0, ..Default::default() };
    let running = client.send(goal, SOON, |_| {}).unwrap();
    let start = Instant::now();
    server.shutdown().trigger();
    assert_eq!(running.wait(SOON).unwrap().0, Status::Aborted);
    server.stop();
    drop(action);
    assert!(start.elapsed() < Duration::from_secs(2), "{:?}", start.elapsed());
    assert_eq!(server.panicked(), None);
}

#[test]
fn parameters_are_set_and_refused_through_the_services() {
    use ros2_client::rcl_interfaces::{
        DescribeParametersRequest, DescribeParametersResponse, SetParametersRequest, SetParametersResponse,
    };
    struct Set;
    impl catenary_msgs::ServiceInterface for Set {
        const TYPE_NAME: &'static str = "rcl_interfaces/srv/SetParameters";
        const TYPE_HASH: &'static str = "";
        type Request = SetParametersRequest;
        type Response = SetParametersResponse;
    }
    struct Describe;
    impl catenary_msgs::ServiceInterface for Describe {
        const TYPE_NAME: &'static str = "rcl_interfaces/srv/DescribeParameters";
        const TYPE_HASH: &'static str = "";
        type Request = DescribeParametersRequest;
        type Response = DescribeParametersResponse;
    }
    let setup = builder("runner", 109, &["-p", "step_period_s:=1.0"]);
    let spec = ParamSpec::new("Time between two actions.").unit("s").range(0.05..=5.0);
    let step = setup.declare_f64("step_period_s", 0.5, spec).unwrap();
    let robot = setup.declare_string("robot", "fr3", ParamSpec::new("").read_only()).unwrap();
    let _runner = setup.build().unwrap();
    assert_eq!(step.get(), 1.0);
    let caller = node("caller", 109);
    let set = caller.client::<Set>("/runner/set_parameters").unwrap();
    let parameter = |name: &str, value: Value| ros2_client::Parameter { name: name.to_owned(), value }.into();
    let request = SetParametersRequest {
        parameter: vec![
            parameter("step_period_s", Value::Double(2.0)),
            parameter("step_period_s", Value::Double(f64::NAN)),
            parameter("step_period_s", Value::Double(9.0)),
            parameter("step_period_s", Value::Boolean(true)),
            parameter("robot", Value::String("panda".to_owned())),
            parameter("robto", Value::String("panda".to_owned())),
        ],
    };
    let results = set.call(request, SOON).unwrap().results;
    assert!(results[0].successful);
    for (result, part) in results[1..].iter().zip(["finite", "0.05 to 5 s", "a number", "read-only", "robto"]) {
        assert!(!result.successful && result.reason.contains(part), "{}", result.reason);
    }
    assert_eq!((step.get(), robot.get().as_str()), (2.0, "fr3"));
    let describe = caller.client::<Describe>("/runner/describe_parameters").unwrap();
    let request = DescribeParametersRequest { names: vec!["step_period_s".to_owned()] };
    let described = describe.call(request, SOON).unwrap().values.remove(0);
    assert_eq!(described.description, "Time between two actions.");
    assert_eq!(described.floating_point_range[0].to_value, 5.0);
}

#[test]
fn simulated_time_follows_the_clock_topic() {
    use catenary_msgs::builtin_interfaces::msg::Time as Stamp;
    use catenary_msgs::rosgraph_msgs::msg::Clock;
    let follower = builder("follower", 110, &["-p", "use_sim_time:=true"]).build().unwrap();
    assert!(follower.clock().is_simulated());
    assert_eq!(follower.now().nanos(), 0);
    let simulator = node("simulator", 110);
    let publisher = simulator.publisher::<Clock>("/clock", Qos::CLOCK).unwrap();
    assert!(publisher.wait_for_subscriber(SOON));
    let waiter = {
        let clock = follower.clock().clone();
        std::thread::spawn(move || clock.sleep(Duration::from_secs(100)))
    };
    let start = Instant::now();
    for sec in 0.. {
        publisher.publish(Clock { clock: Stamp { sec: sec * 50, nanosec: 7 } }).unwrap();
        std::thread::sleep(Duration::from_millis(10));
        if waiter.is_finished() || start.elapsed() > SOON {
            break;
        }
    }
    assert!(waiter.join().unwrap());
    assert_eq!(follower.now().nanos() % 1_000_000_000, 7);
}

#[test]
fn a_value_for_an_undeclared_parameter_keeps_the_node_from_starting() {
    let error = builder("runner", 111, &["-p", "speed:=1"]).build().err().unwrap();
    assert!(error.is_usage());
    assert!(error.to_string().contains("speed"), "{error}");
}

#[test]
fn answers_of_any_size_reach_every_client_also_the_second_of_a_process_whose_first_is_gone() {
    let (pool, asker) = (node("pool", 115), node("asker", 115));
    // RustDDS corrupts a service reply of this size.
    let answer = |request: SimulateRequest| SimulateResponse {
        success: true,
        tracks: vec![Track { dlo: request.theta, ..Track::default() }; 40],
        ..SimulateResponse::default()
    };
    let _service = pool.serve::<Simulate>("simulate", answer).unwrap();
    for round in 0..3 {
        let client = asker.client::<Simulate>("simulate").unwrap();
        for count in [1, 1000, 1, 500] {
            let theta: Vec<f64> = (0..count).map(|i| f64::from(i) + 0.5).collect();
            let got =
                client.call(SimulateRequest { theta: theta.clone(), ..SimulateRequest::default() }, SOON).unwrap();
            assert_eq!(got.tracks.len(), 40, "round {round}");
            assert!(got.tracks.iter().all(|track| track.dlo == theta), "round {round}, {count} numbers");
        }
        let served = asker.services_of_type::<Simulate>().unwrap();
        assert_eq!(served.into_iter().collect::<Vec<_>>(), [("/simulate".to_owned(), 1)]);
    }
}

#[test]
fn an_answer_that_would_not_arrive_is_refused_and_those_after_it_arrive() {
    let (server, asker) = (node("server", 121), node("asker", 121));
    // A type without a topic for large replies.
    let answer = |request: SetBoolRequest| {
        let length = if request.data { 70_000 } else { 60_000 };
        SetBoolResponse { success: true, message: "a".repeat(length) }
    };
    let _service = server.serve::<SetBool>("tell", answer).unwrap();
    let client = asker.client::<SetBool>("tell").unwrap();
    for data in [true, false, true, false] {
        let got = client.call(SetBoolRequest { data }, SOON).unwrap();
        assert_eq!(got.success, !data);
        match data {
            // The message, its length, the flag and the header of the encoding.
            true => assert!(
                got.message.starts_with("the answer has 70013 bytes, and one of more than 65347"),
                "{}",
                got.message
            ),
            false => assert_eq!(got.message.len(), 60_000),
        }
    }
}

#[test]
fn a_call_ends_when_it_is_stopped_and_the_next_one_is_answered() {
    let (server, asker) = (node("server", 116), node("asker", 116));
    let (begun, begins) = channel();
    let _service = server
        .serve::<SetBool>("slow", move |request: SetBoolRequest| {
            begun.send(()).unwrap();
            std::thread::sleep(Duration::from_millis(if request.data { 500 } else { 0 }));
            SetBoolResponse { success: request.data, message: String::new() }
        })
        .unwrap();
    let client = asker.client::<SetBool>("slow").unwrap();
    let stop = asker.shutdown().child();
    let (told, asked) = (stop.clone(), client.clone());
    let call = std::thread::spawn(move || asked.call_until(SetBoolRequest { data: true }, SOON, &stop));
    begins.recv_timeout(SOON).unwrap();
    told.trigger();
    assert!(matches!(call.join().unwrap(), Err(CallError::Shutdown { .. })));
    assert!(
        !client.call(SetBoolRequest { data: false }, SOON).unwrap().success,
        "the late answer went to the next call"
    );
}

#[test]
fn a_node_leaves_at_its_end_even_if_clones_and_endpoints_still_exist() {
    let (leaving, staying) = (node("leaving", 120), node("staying", 120));
    let publisher = leaving.publisher::<PoseStamped>("target", TARGET).unwrap();
    // A cycle: the service holds the node, and the node's thread holds the service.
    let inside = leaving.clone();
    let service = leaving.serve::<SetBool>("enable", move |request| SetBoolResponse {
        success: request.data,
        message: inside.path().to_owned(),
    });
    let service = service.unwrap();
    let client = staying.client::<SetBool>("enable").unwrap();
    assert_eq!(client.call(SetBoolRequest { data: true }, SOON).unwrap().message, "/leaving");
    assert_eq!(staying.other_publisher_count("target").unwrap(), 1);
    leaving.stop();
    let start = Instant::now();
    while staying.other_publisher_count("target").unwrap() > 0 {
        assert!(start.elapsed() < Duration::from_secs(2), "a ghost publishes");
        std::thread::sleep(Duration::from_millis(10));
    }
    assert!(publisher.publish(pose(0.0)).unwrap_err().to_string().contains("left the graph"));
    let late = leaving.publisher::<PoseStamped>("target", TARGET).err().unwrap().to_string();
    assert!(late.contains("left the graph"), "{late}");
    drop(service);
}

#[test]
fn servers_publishers_and_requesters_are_named() {
    let (arm, asker) = (node("arm", 118), builder("asker", 118, &["-r", "__ns:=/lab"]).build().unwrap());
    let (told, tells) = channel();
    let inside = arm.clone();
    let _enable = arm
        .serve_to::<SetBool>("panda/enable", move |request, requester| {
            let told = told.clone();
            inside.identify(requester.endpoint(), move |peer| told.send(peer.to_string()).unwrap());
            SetBoolResponse { success: request.data, message: String::new() }
        })
        .unwrap();
    let _targets = asker.publisher::<PoseStamped>("/panda/target_pose", TARGET).unwrap();
    let client = asker.client::<SetBool>("/panda/enable").unwrap();
    assert!(client.call(SetBoolRequest { data: true }, SOON).unwrap().success);
    let here = std::process::id();
    assert_eq!(tells.recv_timeout(SOON).unwrap(), format!("/lab/asker (process {here})"));
    let _everybody = (arm.look_around(SOON / 8), asker.look_around(SOON / 8));
    let names = |peers: Vec<catenary_shell::Peer>| peers.iter().map(ToString::to_string).collect::<Vec<_>>();
    assert_eq!(names(asker.servers(&["/panda/enable"]).unwrap()), [format!("/arm (process {here})")]);
    assert_eq!(names(arm.publishers("panda/target_pose").unwrap()), [format!("/lab/asker (process {here})")]);
    assert!(asker.publishers("/panda/target_pose").unwrap().is_empty(), "a node is no peer of its own");
    assert_eq!(names(arm.peers()), [format!("/lab/asker (process {here})")]);
    drop((client, asker));
    let gone = Instant::now() + SOON;
    while !arm.peers().is_empty() {
        assert!(Instant::now() < gone, "{:?}", arm.peers());
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn a_service_of_two_nodes_is_called_on_neither_and_both_are_named() {
    let serve = |name: &str| {
        let node = node(name, 119);
        let moving = node.serve_action::<MoveToStart>(
            "panda/move_to_start",
            Concurrency::One,
            |_| panic!("a goal came"),
            |_| Outcome::Aborted(MoveToStartResult::default()),
        );
        let enabling = node.serve::<SetBool>("panda/enable", |_| SetBoolResponse::default());
        (moving.unwrap(), enabling.unwrap(), node)
    };
    let (_ours, _theirs) = (serve("simulated_cell"), serve("lab_arm"));
    let asker = node("asker", 119);
    let _everybody = asker.look_around(SOON / 8);
    let client = asker.action_client::<MoveToStart>("panda/move_to_start").unwrap();
    let refused = client.send(MoveToStartGoal::default(), SOON, |_: MoveToStartFeedback| {}).err().unwrap();
    let words = refused.to_string();
    assert!(matches!(refused, CallError::Ambiguous { .. }), "{words}");
    assert!(
        words.contains("/simulated_cell") && words.contains("/lab_arm") && words.contains("ROS_DOMAIN_ID"),
        "{words}"
    );
    let client = asker.client::<SetBool>("panda/enable").unwrap();
    assert!(client.wait_for_service(SOON));
    assert!(client.ensure_one_server().unwrap_err().to_string().contains("/lab_arm"));
}
