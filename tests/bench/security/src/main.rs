//! `security_bench send|receive DOMAIN BYTES [KEYSTORE]`: samples of so many bytes between two participants of RustDDS, with DDS security if a
//! folder with the files of an SROS2 enclave is given.
//!
//! `send` sends 200 samples at 20 Hz. `receive` prints how many of them came, 15 s after its start.

use rustdds::policy::{History, Reliability};
use rustdds::{
    DomainParticipantBuilder, DomainParticipantSecurityConfigFiles, Duration as DdsDuration, QosPolicyBuilder, TopicKind,
};
use std::error::Error;
use std::net::Ipv4Addr;
use std::time::{Duration, Instant};

const SAMPLES: u32 = 200;
const PERIOD: Duration = Duration::from_millis(50);
const LISTENING: Duration = Duration::from_secs(15);

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [role, domain, bytes, keystore @ ..] = &arguments[..] else {
        return Err("expected send|receive DOMAIN BYTES [KEYSTORE]".into());
    };
    let sample = vec![7_u8; bytes.parse()?];
    let builder = DomainParticipantBuilder::new(domain.parse()?).with_only_networks([Ipv4Addr::LOCALHOST]);
    let builder = match keystore.first() {
        Some(folder) => {
            builder.builtin_security(DomainParticipantSecurityConfigFiles::with_ros_default_names(folder, String::new()))
        }
        None => builder,
    };
    let participant = builder.build()?;
    let qos = QosPolicyBuilder::new()
        .reliability(Reliability::Reliable { max_blocking_time: DdsDuration::from_millis(100) })
        .history(History::KeepLast { depth: 100 })
        .build();
    let topic = participant.create_topic("rt/bytes".into(), "example_msgs::msg::dds_::Bytes_".into(), &qos, TopicKind::NoKey)?;
    if role == "send" {
        let writer = participant.create_publisher(&qos)?.create_datawriter_no_key_cdr::<Vec<u8>>(&topic, None)?;
        for _ in 0..SAMPLES {
            // A sample that nobody takes is no fault of this program.
            let _lost = writer.write(sample.clone(), None);
            std::thread::sleep(PERIOD);
        }
    } else {
        let mut reader = participant.create_subscriber(&qos)?.create_datareader_no_key_cdr::<Vec<u8>>(&topic, None)?;
        let (begun, mut count) = (Instant::now(), 0);
        while begun.elapsed() < LISTENING {
            while let Ok(Some(_)) = reader.take_next_sample() {
                count += 1;
            }
            std::thread::sleep(PERIOD / 5);
        }
        println!("{count} of {SAMPLES}");
    }
    Ok(())
}
