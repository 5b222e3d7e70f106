//! Nodes `recorder` and `replayer`: parameters in, a bag or its messages out.
#![allow(clippy::disallowed_methods, reason = "a recording without a name is called after the wall clock")]

mod backlog;
mod definitions;
mod kinds;
mod overrides;
mod record;
mod replay;

use crate::error::BagError;
use crate::filter::{Pattern, TopicFilter};
use crate::writer::{Compression, Split};
use anyhow::{Context, Result, ensure};
use catenary_shell::{Misconfigured, NodeBuilder, ParamSpec, wall_now};
pub use overrides::QosOverrides;
pub use record::{RecordSettings, record};
pub use replay::{ReplaySettings, ReplaySummary, replay};
use std::path::{Path, PathBuf};
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
    let out = "Folder of the new bag; empty for rosbag2_ and the time, in the current folder.";
    let out = builder.declare_string("output", "", ParamSpec::new(out).read_only())?.get();
    let images = ParamSpec::new("Record the camera's images, too, if no topics are chosen.").read_only();
    let images = builder.declare_bool("images", false, images)?.get();
    let choices = Compression::ALL.map(Compression::name);
    let compression = ParamSpec::new("Compression of the chunks.").choices(&choices).read_only();
    let compression = builder.declare_string("compression", Compression::default().name(), compression)?.get();
    let compression = Compression::from_name(&compression).context("parameter compression")?;
    let size = ParamSpec::new("Size after which a new file begins; 0 for never.").unit("B").read_only();
    let size = builder.declare_i64("max_bag_size", 0, size)?.get();
    let duration = "Log time after which a new file begins; 0 for never.";
    let duration = ParamSpec::new(duration).unit("s").range(0.0..=1e9).read_only();
    let duration = builder.declare_f64("max_bag_duration_s", 0.0, duration)?.get();
    let choice = Choice::declare(&builder, "containing a match of")?;
    let all = "Record every topic of the graph that is not hidden, also those beyond the contract.";
    let all = builder.declare_bool("all", false, ParamSpec::new(all).read_only())?.get();
    let out = if out.is_empty() { PathBuf::from(name_after(wall_now().nanos())) } else { PathBuf::from(out) };
    // Settings are checked after the node exists, so its log and its parameters show the error.
    let given = || -> Result<RecordSettings> {
        let bytes = u64::try_from(size).context("parameter max_bag_size: expected a number of at least zero")?;
        let (filter, overrides) = choice.read(Pattern::within)?;
        let filter = TopicFilter { all, ..filter };
        let split = Split {
            bytes: (bytes > 0).then_some(bytes),
            duration: (duration > 0.0).then(|| Duration::from_secs_f64(duration)),
        };
        let settings = RecordSettings { out, filter, images, compression, split, overrides };
        settings.check()?;
        Ok(settings)
    };
    let node = builder.build()?;
    let settings = given().map_err(Misconfigured::new)?;
    let summary = record(&node, &settings)?;
    tracing::info!("{}: {} messages", summary.path.display(), summary.messages);
    Ok(())
}

fn run_replayer(builder: NodeBuilder) -> Result<()> {
    let bag = builder.declare_string("bag", "", ParamSpec::new("Bag folder or file.").read_only())?.get();
    let d = ReplaySettings::new(PathBuf::from(&bag));
    let choice = Choice::declare(&builder, "that match")?;
    let rate = "Speed; 2 is twice as fast as recorded, 0 as fast as possible.";
    let rate = builder.declare_f64("rate", d.rate, ParamSpec::new(rate).range(0.0..=1000.0).read_only())?.get();
    let offset = ParamSpec::new("Part of the bag to skip.").unit("s").range(0.0..=1e9).read_only();
    let repeat = ParamSpec::new("Begin anew at the end.").read_only();
    let clock = ParamSpec::new("Publish /clock in step with the bag.").read_only();
    let clock = builder.declare_bool("clock", false, clock)?.get();
    let clock_hz = ParamSpec::new("Rate of /clock in wall time.").unit("Hz").range(0.1..=10_000.0).read_only();
    let clock_hz = builder.declare_f64("clock_hz", ReplaySettings::CLOCK_HZ, clock_hz)?.get();
    let duration = ParamSpec::new("Part of the bag to play; 0 for all.").unit("s").range(0.0..=1e9).read_only();
    let duration_s = builder.declare_f64("playback_duration_s", 0.0, duration)?.get();
    let delay = ParamSpec::new("Delay before each pass through the bag.").unit("s").range(0.0..=1e6).read_only();
    let allow = "Replay commands to the arm, too, if no arm or a simulated arm follows them.";
    let others = "Replay measurements of the arm and the camera even if other nodes publish them, too.";
    let wait = ParamSpec::new("Longest wait until every topic has a subscriber.").unit("s").range(0.0..=600.0);
    let settings = ReplaySettings {
        rate: if rate == 0.0 { f64::INFINITY } else { rate },
        start_offset_s: builder.declare_f64("start_offset_s", d.start_offset_s, offset)?.get(),
        repeat: builder.declare_bool("loop", d.repeat, repeat)?.get(),
        delay_s: builder.declare_f64("delay_s", d.delay_s, delay)?.get(),
        duration_s: (duration_s > 0.0).then_some(duration_s),
        clock_hz: clock.then_some(clock_hz),
        allow_replay: builder.declare_bool("allow_replay", d.allow_replay, ParamSpec::new(allow).read_only())?.get(),
        allow_others: builder.declare_bool("allow_others", d.allow_others, ParamSpec::new(others).read_only())?.get(),
        wait: Duration::from_secs_f64(builder.declare_f64("wait_s", d.wait.as_secs_f64(), wait.read_only())?.get()),
        ..d
    };
    let node = builder.build()?;
    let given = || -> Result<ReplaySettings> {
        ensure!(!bag.is_empty(), "parameter bag: expected a bag folder or a bag file, got nothing");
        let (filter, overrides) = choice.read(Pattern::whole)?;
        let settings = ReplaySettings { filter, overrides, ..settings };
        settings.open()?;
        Ok(settings)
    };
    let settings = given().map_err(Misconfigured::new)?;
    let summary = replay(&node, &settings)?;
    tracing::info!("{} messages published, {} failed", summary.published, summary.failed);
    Ok(())
}

/// Parameters that choose topics and profiles.
struct Choice {
    filter: TopicFilter,
    regex: String,
    exclude_regex: String,
    overrides: String,
}

impl Choice {
    /// Declares the parameters. `matching` describes for `--help` how a name is compared with a regular expression.
    fn declare(builder: &NodeBuilder, matching: &str) -> Result<Self> {
        let list = |name: &str, about: &str| -> Result<Vec<String>> {
            Ok(builder.declare(name, Vec::<String>::new(), ParamSpec::new(about).read_only())?.get())
        };
        let text = |name: &str, about: &str| -> Result<String> {
            Ok(builder.declare_string(name, "", ParamSpec::new(about).read_only())?.get())
        };
        let filter = TopicFilter {
            topics: list(
                "topics",
                "Names of topics, `*` at the end for all names with that beginning; empty for the usual topics.",
            )?,
            types: list("topic_types", "Types of topics.")?,
            exclude_topics: list("exclude_topics", "Names of topics to leave out.")?,
            exclude_types: list("exclude_topic_types", "Types of topics to leave out.")?,
            ..TopicFilter::default()
        };
        Ok(Self {
            filter,
            regex: text("regex", &format!("Topics with names {matching} this regular expression."))?,
            exclude_regex: text("exclude_regex", &format!("Leave out names {matching} this regular expression."))?,
            overrides: text("qos_overrides", "YAML file with QoS profiles by topic, as ros2 bag reads it.")?,
        })
    }

    fn read(self, pattern: fn(&'static str, &str) -> Result<Pattern, BagError>) -> Result<(TopicFilter, QosOverrides)> {
        let compiled = |name, text: &str| if text.is_empty() { Ok(None) } else { pattern(name, text).map(Some) };
        let overrides = match &self.overrides[..] {
            "" => QosOverrides::default(),
            path => QosOverrides::read(Path::new(path))?,
        };
        let regex = compiled("regex", &self.regex)?;
        let exclude_regex = compiled("exclude_regex", &self.exclude_regex)?;
        Ok((TopicFilter { regex, exclude_regex, ..self.filter }, overrides))
    }
}

/// Name that `ros2 bag record` gives a bag that begins at `ns` since 1970, in UTC.
fn name_after(ns: i64) -> String {
    let seconds = ns.div_euclid(1_000_000_000);
    let (days, second) = (seconds.div_euclid(86_400), seconds.rem_euclid(86_400));
    // Gregorian calendar with years that begin in March: the leap day is then the last day of the year. 719 468 is the
    // number of days from 0000-03-01 to 1970-01-01, and 146 097 the number of days in 400 years.
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
