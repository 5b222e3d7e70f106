//! scratch
use catenary_msgs::action::{MoveToStart, MoveToStartGoal};
use catenary_msgs::std_srvs::srv::{SetBool, SetBoolRequest};
use catenary_shell::NodeBuilder;
use std::process::ExitCode;
use std::time::Duration;
fn main() -> ExitCode { catenary_shell::main("rs_client", std::env::args().skip(1), run) }
fn run(setup: NodeBuilder) -> anyhow::Result<()> {
    let node = setup.build()?;
    let s = node.client::<SetBool>("py/enable")?;
    let t0 = std::time::Instant::now();
    for i in 0..100 { let r = s.call(SetBoolRequest { data: i % 2 == 0 }, Duration::from_secs(10))?; assert_eq!(r.success, i % 2 == 0); if i == 0 { eprintln!("first call after {:?}", t0.elapsed()); } }
    eprintln!("100 calls {:?}", t0.elapsed());
    let c = node.action_client::<MoveToStart>("py/move")?;
    let goal = |settle_time| MoveToStartGoal { settle_time, ..Default::default() };
    let g = c.send(goal(0.5), Duration::from_secs(20), |f| eprintln!("feedback {:?}", f.distance))?;
    eprintln!("result {:?}", g.wait(Duration::from_secs(10))?); drop(g);
    let g = c.send(goal(50.0), Duration::from_secs(5), |_| {})?;
    std::thread::sleep(Duration::from_millis(300));
    eprintln!("cancel {:?}", g.cancel(Duration::from_secs(5))?);
    eprintln!("result {:?}", g.wait(Duration::from_secs(10)).map(|(s, r)| (s, r.message))); drop(g);
    eprintln!("reject {:?}", c.send(goal(-1.0), Duration::from_secs(5), |_| {}).err());
    Ok(())
}
