//! Scratch.
#![allow(warnings, clippy::all)]
use catenary_bag::*;
use catenary_msgs::sensor_msgs::msg::Image;
use catenary_msgs::geometry_msgs::msg::PoseStamped;
use catenary_shell::*;
use std::time::{Duration, Instant};
fn main() {
    let a: Vec<String> = std::env::args().collect();
    match a[1].as_str() {
        "info" => for p in &a[2..] {
            match BagReader::open(std::path::Path::new(p)) {
                Ok(b) => {
                    println!("{p}: {} messages; {}; notes {:?}", b.message_count(), b.describe_topics(), b.notes());
                    for t in b.topics() { println!("   {} {:?} {:?}", t.topic.name, t.topic.qos, t.topic.type_hash); }
                    let start = Instant::now();
                    let (mut n, mut bad, mut bytes) = (0, 0, 0);
                    for m in b.messages() { match m { Ok(m) => { n += 1; bytes += m.data.len(); if m.topic.type_name == "geometry_msgs/msg/PoseStamped" { m.decode::<PoseStamped>().unwrap(); } } Err(e) => { bad += 1; println!("   {e}"); } } }
                    println!("   read {n} good {bad} bad, {:.1} MB in {:?}, rss {:?}", bytes as f64 / 1e6, start.elapsed(), resident_bytes());
                }
                Err(e) => println!("{e}"),
            }
        },
        "load" => {
            let (args, _) = RosArgs::parse(Vec::<String>::new()).unwrap();
            let node = NodeBuilder::new("load", &args).unwrap().build().unwrap();
            let images = node.publisher::<Image>(contract::IMAGE.name, contract::IMAGE.qos).unwrap();
            let poses = node.publisher::<PoseStamped>(contract::CURRENT_POSE.name, contract::CURRENT_POSE.qos).unwrap();
            assert!(images.wait_for_subscriber(Duration::from_secs(10)));
            std::thread::sleep(Duration::from_millis(500));
            let secs: u64 = a[2].parse().unwrap();
            let mut rate = node.clock().rate(Duration::from_micros(1_000_000 / 240));
            let mut data = vec![0u8; 640 * 480 * 3];
            let mut r = 1u32;
            for i in 0..secs * 240 {
                rate.tick();
                poses.send(PoseStamped { header: node.header("panda_link0"), ..Default::default() });
                if i % 4 == 0 {
                    for k in 0..data.len() { r ^= r << 13; r ^= r >> 17; r ^= r << 5; data[k] = ((k / 640) as u8).wrapping_add((r & 3) as u8); }
                    images.send(Image { header: node.header("cam"), width: 640, height: 480, step: 1920, encoding: "rgb8".into(), data: data.clone(), ..Default::default() });
                }
            }
            std::thread::sleep(Duration::from_millis(500));
            println!("sent {} images {} poses", images.published(), poses.published());
        }
        _ => {}
    }
}
