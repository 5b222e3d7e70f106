//! scratch
use catenary_msgs::geometry_msgs::msg::PoseStamped;
use catenary_msgs::sensor_msgs::msg::Image;
use catenary_shell::{NodeBuilder, Qos, ParamSpec, stamp, wall_now, resident_bytes};
use std::process::ExitCode;
use std::sync::{Arc, Mutex};
use std::time::Duration;
fn main() -> ExitCode { catenary_shell::main("perf", std::env::args().skip(1), run) }
fn cpu() -> f64 { let s = std::fs::read_to_string("/proc/self/stat").unwrap(); let f: Vec<&str> = s.rsplit(')').next().unwrap().split_whitespace().collect(); (f[11].parse::<f64>().unwrap() + f[12].parse::<f64>().unwrap()) / 100.0 }
fn run(setup: NodeBuilder) -> anyhow::Result<()> {
    let role = setup.declare_string("role", "pub", ParamSpec::new(""))?.get();
    let secs = setup.declare_f64("secs", 10.0, ParamSpec::new(""))?.get();
    let img = setup.declare_bool("image", false, ParamSpec::new(""))?.get();
    let reliable = setup.declare_bool("reliable", true, ParamSpec::new(""))?.get();
    let node = setup.build()?;
    let q = if reliable { Qos::Reliable { depth: 1 } } else { Qos::BestEffort { depth: 5 } };
    let lat = Arc::new(Mutex::new(Vec::<f64>::new()));
    let l2 = lat.clone();
    let rec = move |s: &catenary_msgs::builtin_interfaces::msg::Time| l2.lock().unwrap().push(wall_now().secs_since(stamp::from_msg(s)) * 1e3);
    if role == "pub" {
        let start = std::time::Instant::now();
        let c0;
        let n;
        if img {
            let p = node.publisher::<Image>("perf/image", q)?; p.wait_for_subscriber(Duration::from_secs(20)); std::thread::sleep(Duration::from_millis(300)); c0 = cpu();
            let mut rate = node.clock().rate(Duration::from_micros(16667)); let t = std::time::Instant::now();
            while t.elapsed().as_secs_f64() < secs { let Some(tick) = rate.tick() else { break };
                p.send(Image { header: stamp::header(tick.now, ""), height: 480, width: 640, encoding: "rgb8".into(), step: 1920, data: vec![7; 921600], ..Default::default() }); }
            n = p.published();
        } else {
            let p = node.publisher::<PoseStamped>("perf/pose", q)?; p.wait_for_subscriber(Duration::from_secs(20)); std::thread::sleep(Duration::from_millis(300)); c0 = cpu();
            let mut rate = node.clock().rate(Duration::from_millis(1)); let t = std::time::Instant::now();
            while t.elapsed().as_secs_f64() < secs { let Some(tick) = rate.tick() else { break };
                p.send(PoseStamped { header: stamp::header(tick.now, ""), ..Default::default() }); }
            n = p.published();
        }
        eprintln!("pub: {n} in {:.1} s, cpu {:.1} %, rss {:.1} MB", start.elapsed().as_secs_f64(), (cpu() - c0) / secs * 100.0, resident_bytes().unwrap() as f64 / 1e6);
    } else {
        let c0 = cpu();
        let _a; let _b;
        if img { _a = node.subscription::<Image>("perf/image", Qos::BestEffort { depth: 5 }, move |r| rec(&r.message.header.stamp))?; }
        else { _b = node.subscription::<PoseStamped>("perf/pose", q, move |r| rec(&r.message.header.stamp))?; }
        node.wait_for_shutdown()?;
        let mut v = lat.lock().unwrap().clone(); v.sort_by(f64::total_cmp);
        eprintln!("sub: {} messages, p50 {:.2} p99 {:.2} max {:.2} ms, cpu {:.1} %, rss {:.1} MB", v.len(), v[v.len()/2], v[v.len()*99/100], v[v.len()-1], (cpu() - c0) / secs * 100.0, resident_bytes().unwrap() as f64 / 1e6);
    }
    Ok(())
}
