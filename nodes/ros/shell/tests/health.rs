//! Test of a node's health over the loopback interface: losses of a subscription appear on `/diagnostics`.
#![allow(
    clippy::disallowed_methods,
    clippy::unwrap_used,
    reason = "a test of threads and sockets waits for them, and a failure is a panic"
)]

use catenary_msgs::diagnostic_msgs::msg::{DiagnosticArray, DiagnosticStatus};
use catenary_msgs::geometry_msgs::msg::PoseStamped;
use catenary_shell::{Discovery, Flaw, Names, Node, NodeBuilder, Qos, Queue, RosArgs, contract};
use std::time::{Duration, Instant};

const SOON: Duration = Duration::from_secs(8);
const TARGET: Qos = Qos::Reliable { depth: 10 };
const POSES: Names = Names { one: "pose", many: "poses" };

fn node(name: &str, domain: u16) -> Node {
    let (args, _) = RosArgs::parse(std::iter::empty::<String>()).unwrap();
    NodeBuilder::new(name, &args).unwrap().domain(domain, Discovery::Localhost).build().unwrap()
}

/// Waits for the first status of /receiver that `fits`.
fn status(reports: &Queue<DiagnosticArray>, fits: impl Fn(&DiagnosticStatus) -> bool) -> DiagnosticStatus {
    let deadline = Instant::now() + SOON;
    let mut newest = None;
    while Instant::now() < deadline {
        let Some(report) = reports.next(Duration::from_secs(1)) else { continue };
        let own = report.message.status.iter().find(|status| status.name == "/receiver").cloned();
        match own {
            Some(status) if fits(&status) => return status,
            other => newest = other,
        }
    }
    panic!("no such status; the newest: {newest:?}")
}

fn value(status: &DiagnosticStatus, key: &str) -> String {
    status.values.iter().find(|value| value.key == key).map(|value| value.value.clone()).unwrap_or_default()
}

#[test]
fn an_overflow_is_reported_while_the_queue_is_needed_and_a_refused_message_always() {
    let (sender, receiver) = (node("sender", 121), node("receiver", 121));
    let diagnostics = contract::DIAGNOSTICS;
    let reports = sender.queue::<DiagnosticArray>(diagnostics.name, diagnostics.qos, 100).unwrap();
    let intake = receiver.intake::<PoseStamped>("target", TARGET, POSES, Duration::MAX).unwrap();
    let queue = receiver.take_queue::<PoseStamped>(&intake, 2).unwrap();
    receiver.report_diagnostics(|_| {}).unwrap();
    let publisher = sender.publisher::<PoseStamped>("target", TARGET).unwrap();
    assert!(publisher.wait_for_subscriber(SOON));
    std::thread::sleep(Duration::from_millis(200));
    (0..5).for_each(|_| publisher.publish(PoseStamped::default()).unwrap());
    let idle = status(&reports, |status| value(status, "poses_received") == "5");
    assert_eq!((idle.level, &idle.message[..], queue.dropped()), (0, "ok", 3));
    intake.need(true);
    (0..5).for_each(|_| publisher.publish(PoseStamped::default()).unwrap());
    let lossy = status(&reports, |status| value(status, "poses_received") == "10");
    assert!(lossy.level == 1 && lossy.message.contains("queue of 2 messages is full"), "{lossy:?}");
    assert_eq!(value(&lossy, "poses_dropped_for_overflow"), "5");
    drop((queue, intake));

    let intake = receiver.intake::<PoseStamped>("target", TARGET, POSES, Duration::MAX).unwrap();
    let refusing = |_| Err(Flaw::new("frame", "expected another frame"));
    let _refused = receiver.take::<PoseStamped>(&intake, refusing).unwrap();
    // Published again with every report: the new subscription gets nothing before it is matched.
    let refused = status(&reports, |status| {
        publisher.publish(PoseStamped::default()).unwrap();
        !value(status, "poses_dropped_for_frame").is_empty()
    });
    assert!(refused.level == 1 && refused.message.contains("expected another frame"), "{refused:?}");
}
