//! Test of memory, alone in its process: tests beside it would be measured, too.
#![allow(clippy::disallowed_methods, clippy::unwrap_used, reason = "a test reads /proc, and a failure is a panic")]

use catenary_msgs::std_srvs::srv::{SetBool, SetBoolRequest, SetBoolResponse};
use catenary_shell::{Discovery, DomainClaim, NodeBuilder, RosArgs};
use std::time::Duration;

const SOON: Duration = Duration::from_secs(4);

/// Returns the resident memory of this process, kB.
fn resident_kb() -> usize {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|line| line.starts_with("VmRSS:")).unwrap();
    line.split_whitespace().nth(1).unwrap().parse().unwrap()
}

#[test]
fn asking_a_service_often_takes_no_memory() {
    let domain = DomainClaim::any(|_| Ok(true)).unwrap();
    let node = |name: &str| {
        let (args, _) = RosArgs::parse(["--ros-args"]).unwrap();
        NodeBuilder::new(name, &args).unwrap().domain(domain.id(), Discovery::Localhost).build().unwrap()
    };
    let (server, caller) = (node("server"), node("caller"));
    let _service = server
        .serve::<SetBool>("enable", |request| SetBoolResponse { success: request.data, message: String::new() })
        .unwrap();
    let client = caller.client::<SetBool>("enable").unwrap();
    let call = |times| (0..times).for_each(|_| drop(client.call(SetBoolRequest { data: true }, SOON).unwrap()));
    // Buffers reach their final size in these calls.
    call(200);
    let before = resident_kb();
    call(4000);
    let grown = resident_kb().saturating_sub(before);
    assert!(grown < 8000, "{grown} kB for 4000 calls");
}
