//! The nodes `recorder` and `replayer`: parameters in, a bag or its messages out.
#![allow(clippy::disallowed_methods, reason = "a recording without a name is called after the wall clock")]

use crate::record::{RecordSettings, record};
use crate::replay::{ReplaySettings, replay};
use crate::writer::Compression;
use anyhow::{Context, Result, ensure};
use catenary_shell::{Misconfigured, NodeBuilder, ParamSpec, wall_now};
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

/// Runs the node `recorder` from the arguments after the program's name.
pub fn recorder(args: Vec<String>) -> ExitCode {
    catenary_shell::main("recorder", args, run_recorder)
}

/// Runs the node `replayer` from the arguments after the program's name.
pub fn replayer(args: Vec<String>) -> ExitCode {
    catenary_shell::main("replayer", args, run_replayer)
}

fn run_recorder(builder: NodeBuilder) -> Result<()> {
    let out = "Folder of the bag to make; empty: rosbag2_ and the time, in the present folder.";
    let out = builder.declare_string("output", "", ParamSpec::new(out).read_only())?.get();
    let topics = "Topics of the contract, `*` at the end for all that begin so; empty: all but /clock.";
    let topics = builder.declare("topics", Vec::<String>::new(), ParamSpec::new(topics).read_only())?.get();
    let images = ParamSpec::new("Record the camera's images, too, where topics is empty.").read_only();
    let images = builder.declare_bool("images", false, images)?.get();
    let compression = ParamSpec::new("Compression of the chunks.").choices(&["none", "zstd"]).read_only();
    let compression = builder.declare_string("compression", Compression::default().name(), compression)?.get();
    let compression = Compression::from_name(&compression).context("parameter compression")?;
    let out = if out.is_empty() { PathBuf::from(name_after(wall_now().nanos())) } else { PathBuf::from(out) };
    let settings = RecordSettings { out, topics, images, compression };
    let node = builder.build()?;
    settings.check().map_err(Misconfigured::new)?;
    let summary = record(&node, &settings)?;
    tracing::info!("{}: {} messages", summary.path.display(), summary.messages);
    Ok(())
}

fn run_replayer(builder: NodeBuilder) -> Result<()> {
    let bag = builder.declare_string("bag", "", ParamSpec::new("Bag folder or .mcap file.").read_only())?.get();
    let d = ReplaySettings::new(PathBuf::from(&bag));
    let topics = ParamSpec::new("Topics of the bag; empty: all.").read_only();
    let rate = "Speed; 2 is twice as fast as recorded, 0 as fast as possible.";
    let rate = builder.declare_f64("rate", d.rate, ParamSpec::new(rate).range(0.0..=1000.0).read_only())?.get();
    let offset = ParamSpec::new("Part of the bag to skip.").unit("s").range(0.0..=1e9).read_only();
    let repeat = ParamSpec::new("Begin anew at the end.").read_only();
    let clock = ParamSpec::new("Publish /clock in step with the bag.").read_only();
    let allow = "Replay commands to the arm, too, where no arm or a simulated one follows them.";
    let others = "Replay what the arm and the camera measure even where others publish it, too.";
    let wait = ParamSpec::new("How long to wait until every topic has a subscriber.").unit("s").range(0.0..=600.0);
    let settings = ReplaySettings {
        topics: builder.declare("topics", d.topics.clone(), topics)?.get(),
        rate: if rate == 0.0 { f64::INFINITY } else { rate },
        start_offset_s: builder.declare_f64("start_offset_s", d.start_offset_s, offset)?.get(),
        repeat: builder.declare_bool("loop", d.repeat, repeat)?.get(),
        clock: builder.declare_bool("clock", d.clock, clock)?.get(),
        allow_replay: builder.declare_bool("allow_replay", d.allow_replay, ParamSpec::new(allow).read_only())?.get(),
        allow_others: builder.declare_bool("allow_others", d.allow_others, ParamSpec::new(others).read_only())?.get(),
        wait: Duration::from_secs_f64(builder.declare_f64("wait_s", d.wait.as_secs_f64(), wait.read_only())?.get()),
        ..d
    };
    let node = builder.build()?;
    let given = || -> Result<()> {
        ensure!(!bag.is_empty(), "parameter bag: expected a bag folder or an .mcap file, got nothing");
        settings.open()?;
        Ok(())
    };
    given().map_err(Misconfigured::new)?;
    let summary = replay(&node, &settings)?;
    tracing::info!("{} messages published, {} failed", summary.published, summary.failed);
    Ok(())
}

/// The name that `ros2 bag record` would give a bag that begins at `ns` since 1970, in UTC.
fn name_after(ns: i64) -> String {
    let seconds = ns.div_euclid(1_000_000_000);
    let (days, second) = (seconds.div_euclid(86_400), seconds.rem_euclid(86_400));
    // Gregorian calendar with years that begin in March, after which all months but the last have a fixed length.
    let from_march_0000 = days + 719_468;
    let era = from_march_0000.div_euclid(146_097);
    let day_of_era = from_march_0000.rem_euclid(146_097);
    let year_of_era = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month_from_march = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = (month_from_march + 2) % 12 + 1;
    let year = 400 * era + year_of_era + i64::from(month <= 2);
    let (hour, minute, second) = (second / 3600, second / 60 % 60, second % 60);
    format!("rosbag2_{year:04}_{month:02}_{day:02}-{hour:02}_{minute:02}_{second:02}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bags_are_called_after_the_time() {
        let name = |seconds: i64| name_after(seconds * 1_000_000_000);
        assert_eq!(name(0), "rosbag2_1970_01_01-00_00_00");
        assert_eq!(name(951_782_399), "rosbag2_2000_02_28-23_59_59");
        assert_eq!(name(951_782_400), "rosbag2_2000_02_29-00_00_00");
        assert_eq!(name(1_763_692_806), "rosbag2_2025_11_21-02_40_06");
        assert_eq!(name(1_798_761_599), "rosbag2_2026_12_31-23_59_59");
    }
}
