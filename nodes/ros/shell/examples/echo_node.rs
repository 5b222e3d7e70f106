//! Example node with parameters, a subscription, a publisher, a service and an action: the pattern of every `node.rs`.
//!
//! While it is enabled, it publishes the newest pose of `echo/target` on `echo/pose` every `period_s`.

use catenary_msgs::action::{MoveToStart, MoveToStartFeedback, MoveToStartResult};
use catenary_msgs::geometry_msgs::msg::PoseStamped;
use catenary_msgs::std_srvs::srv::{SetBool, SetBoolResponse};
use catenary_shell::{Concurrency, Decision, NodeBuilder, Outcome, ParamSpec, Qos};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

const TARGET: Qos = Qos::Reliable { depth: 1 };
const POSE: Qos = Qos::BestEffort { depth: 1 };

#[allow(clippy::disallowed_methods, reason = "a main reads the command line")]
fn main() -> ExitCode {
    catenary_shell::main("echo", std::env::args().skip(1), run)
}

fn run(setup: NodeBuilder) -> anyhow::Result<()> {
    let spec = ParamSpec::new("Time between two poses.").unit("s").range(0.001..=10.0);
    let period = setup.declare_f64("period_s", 0.1, spec)?;
    let frame = setup.declare_string("frame_id", "panda_link0", ParamSpec::new("Frame.").read_only())?;
    let node = setup.build()?;

    let target = node.latest::<PoseStamped>("echo/target", TARGET)?;
    let publisher = node.publisher::<PoseStamped>("echo/pose", POSE)?;

    let enabled = Arc::new(AtomicBool::new(true));
    let switch = Arc::clone(&enabled);
    let _enable = node.serve::<SetBool>("echo/enable", move |request| {
        switch.store(request.data, Ordering::Release);
        tracing::info!("enabled: {}", request.data);
        SetBoolResponse { success: true, message: format!("enabled: {}", request.data) }
    })?;

    let _move = node.serve_action::<MoveToStart>(
        "echo/move",
        Concurrency::One,
        |goal| match goal.settle_time {
            // Also rejects NaN, which no comparison would.
            time if (0.0..=60.0).contains(&time) => Decision::Accept,
            time => Decision::Reject(format!("expected a settle time of 0 to 60 s, got {time}")),
        },
        |goal| {
            for step in (0..10).rev() {
                goal.feedback(MoveToStartFeedback { distance: f64::from(step) });
                if goal.wait_cancelled(Duration::from_secs_f64(goal.goal().settle_time / 10.0)) {
                    return Outcome::Canceled(MoveToStartResult::default());
                }
            }
            Outcome::Succeeded(MoveToStartResult { success: true, ..Default::default() })
        },
    )?;

    let counted = publisher.clone();
    node.report_diagnostics(move |report| {
        report.value("published", counted.published());
    })?;

    let mut rate = node.clock().rate(Duration::from_secs_f64(period.get()));
    while let Some(tick) = rate.tick() {
        rate.set_period(Duration::from_secs_f64(period.get()));
        if enabled.load(Ordering::Acquire) {
            let pose = target.get().map(|got| got.message.pose.clone()).unwrap_or_default();
            let header = catenary_shell::stamp::header(tick.now, &frame.get());
            publisher.send(PoseStamped { header, pose });
        }
    }
    Ok(())
}
