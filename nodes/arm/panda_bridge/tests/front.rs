//! Answers of the front end about an arm that begins late, or not at all. A failure here means a client that commands an arm which does
//! not move yet.
#![allow(
    clippy::disallowed_methods,
    clippy::unwrap_used,
    reason = "a test of threads and sockets waits for them, and a failure is a panic"
)]

use catenary_msgs::std_srvs::srv::{SetBool, SetBoolRequest, Trigger, TriggerRequest};
use catenary_shell::contract::{ENABLE, ERROR_RECOVERY, HOLD};
use catenary_shell::{Client, Discovery, DomainClaim, Node, NodeBuilder, RosArgs};
use panda_bridge::node::front::{Front, MoveParameters, Served};
use panda_bridge::{Arm, ArmPose, ArmSettings, GateSettings, Mode, Order, Plant};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

const SOON: Duration = Duration::from_secs(20);

/// Arm that stands still, and begins and can begin when the test says so.
#[derive(Clone, Default)]
struct Late {
    begun: Arc<AtomicBool>,
    ready: Arc<AtomicBool>,
    ended: Arc<AtomicBool>,
}

impl Plant for Late {
    fn time_s(&self) -> f64 {
        0.0
    }

    fn measured(&self) -> Option<ArmPose> {
        Some(ArmPose { position_m: [0.4, 0.0, 0.4], quaternion_xyzw: [1.0, 0.0, 0.0, 0.0] })
    }

    fn obey(&mut self, order: &Order) {
        self.ended.store(*order == Order::End, Ordering::SeqCst);
    }

    fn has_begun(&self) -> bool {
        self.begun.load(Ordering::SeqCst)
    }

    fn can_begin(&self) -> bool {
        self.ready.load(Ordering::SeqCst)
    }
}

fn builder(name: &str, claim: &DomainClaim) -> NodeBuilder {
    let (args, _) = RosArgs::parse(["--ros-args"]).unwrap();
    NodeBuilder::new(name, &args).unwrap().domain(claim.id(), Discovery::Localhost)
}

/// Front end of a late arm, and a client.
struct Cell {
    plant: Late,
    front: Arc<Front<Late>>,
    client: Node,
    _served: Served,
}

impl Cell {
    fn start(claim: &DomainClaim) -> Self {
        let builder_of_arm = builder("arm", claim);
        let moves = MoveParameters::declare(&builder_of_arm).unwrap();
        let node = builder_of_arm.build().unwrap();
        let plant = Late::default();
        let settings = ArmSettings { gate: GateSettings::default(), start: None, real: false, start_tolerance_m: 0.01 };
        let arm = Arm::new(plant.clone(), settings);
        let front = Front::new(&node, node.now(), moves, arm).unwrap();
        let served = front.serve(|_| Ok(String::new()), || Ok(())).unwrap();
        Self { plant, front, client: builder("client", claim).build().unwrap(), _served: served }
    }

    fn mode(&self) -> Mode {
        self.front.arm().mode()
    }

    fn wait_mode(&self, mode: Mode) {
        let start = Instant::now();
        while self.mode() != mode {
            assert!(start.elapsed() < SOON, "{mode:?} within {SOON:?}");
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}

fn trigger(client: &Client<Trigger>) -> (bool, String) {
    let answer = client.call(TriggerRequest::default(), SOON).unwrap();
    (answer.success, answer.message)
}

fn enable(client: &Client<SetBool>) -> (bool, String) {
    let answer = client.call(SetBoolRequest { data: true }, SOON).unwrap();
    (answer.success, answer.message)
}

#[test]
fn enabling_answers_when_the_motion_has_begun_and_other_services_meanwhile() {
    let claim = DomainClaim::any(|_| Ok(true)).unwrap();
    let cell = Cell::start(&claim);
    let (enabler, holder) = (cell.client.client(ENABLE.name).unwrap(), cell.client.client(HOLD.name).unwrap());
    trigger(&holder);
    // A motion that has not begun after 2 s is given up: on a busy machine the test may be too slow for that, and tries again.
    for _ in 0..10 {
        cell.plant.begun.store(false, Ordering::SeqCst);
        let client = enabler.clone();
        let asked = std::thread::spawn(move || enable(&client));
        cell.wait_mode(Mode::Hold);
        let held = trigger(&holder);
        let is_early = !asked.is_finished();
        cell.plant.begun.store(true, Ordering::SeqCst);
        let (success, message) = asked.join().unwrap();
        if success {
            assert!(is_early, "the answer came before the motion began");
            assert!(held.0, "{held:?}");
            return;
        }
        assert!(message.contains("has not begun"), "{message}");
    }
    panic!("no motion began within 2 s of its request");
}

#[test]
fn a_motion_that_does_not_begin_is_refused_with_the_reason_and_the_arm_is_disabled() {
    let claim = DomainClaim::any(|_| Ok(true)).unwrap();
    let cell = Cell::start(&claim);
    let (success, message) = enable(&cell.client.client(ENABLE.name).unwrap());
    assert!(!success && message.contains("the motion has not begun within 2 s"), "{message}");
    assert!(cell.plant.ended.load(Ordering::SeqCst));
    assert_eq!(cell.mode(), Mode::Idle);
}

#[test]
fn a_recovery_answers_when_the_arm_can_move() {
    let claim = DomainClaim::any(|_| Ok(true)).unwrap();
    let cell = Cell::start(&claim);
    let recoverer = cell.client.client::<Trigger>(ERROR_RECOVERY.name).unwrap();
    cell.front.arm().reflex("touched");
    let (success, message) = trigger(&recoverer);
    assert!(!success && message.contains("cannot move yet within 2 s"), "{message}");
    for _ in 0..10 {
        cell.plant.ready.store(false, Ordering::SeqCst);
        cell.front.arm().reflex("touched");
        let client = recoverer.clone();
        let asked = std::thread::spawn(move || trigger(&client));
        cell.wait_mode(Mode::Idle);
        let is_early = !asked.is_finished();
        cell.plant.ready.store(true, Ordering::SeqCst);
        if asked.join().unwrap().0 {
            assert!(is_early, "the answer came before the arm could move");
            return;
        }
    }
    panic!("no answer to a recovery within 2 s");
}
