//! The command lines of `record`, `replay` and `reindex`, in the words of `ros2 bag`.

use super::named::Bags;
use crate::cli::Output;
use anyhow::{Context, Result};
use catenary_bag::{BagError, Compression, Pattern, QosOverrides, RecordSettings, ReplaySettings, Split, TopicFilter};
use clap::Args;
use std::path::PathBuf;
use std::time::Duration;

/// `catenary record`.
#[derive(Debug, Args)]
pub struct RecordArgs {
    /// Folder of the bag to make
    #[arg(value_name = "BAG", required_unless_present = "out", conflicts_with = "out")]
    bag: Option<PathBuf>,
    /// The same as BAG
    #[arg(short, long, visible_aliases = ["output", "bag"], value_name = "BAG")]
    out: Option<PathBuf>,
    /// Topics, with `*` at the end for all that begin so; none chosen: those of the contract without the camera's images
    #[arg(long, num_args = 1.., conflicts_with = "all")]
    topics: Vec<String>,
    /// Topics of these types
    #[arg(long, num_args = 1.., value_name = "TYPE")]
    topic_types: Vec<String>,
    /// Every topic of the graph that is not hidden
    #[arg(short, long, visible_alias = "all-topics")]
    all: bool,
    /// Topics whose names contain a match of this regular expression
    #[arg(short = 'e', long, conflicts_with = "all")]
    regex: Option<String>,
    /// Leave these topics out
    #[arg(long, num_args = 1.., value_name = "TOPICS")]
    exclude_topics: Vec<String>,
    /// Leave topics of these types out
    #[arg(long, num_args = 1.., value_name = "TYPE")]
    exclude_topic_types: Vec<String>,
    /// Leave topics out whose names contain a match of this regular expression
    #[arg(long, value_name = "REGEX")]
    exclude_regex: Option<String>,
    /// Record the camera's images too, where no topics are chosen
    #[arg(long)]
    images: bool,
    /// YAML file with QoS profiles for subscriptions, by topic
    #[arg(long, value_name = "FILE")]
    qos_profile_overrides_path: Option<PathBuf>,
    /// Go on in a new file after this many bytes; 0: never
    #[arg(short = 'b', long, default_value_t = 0, value_name = "BYTES")]
    max_bag_size: u64,
    /// Go on in a new file after this many seconds; 0: never
    #[arg(short = 'd', long, default_value_t = 0.0, value_name = "SECONDS", value_parser = seconds)]
    max_bag_duration: f64,
    /// How chunks are compressed: none, lz4 or zstd
    #[arg(long, default_value = Compression::default().name(), value_parser = compression)]
    compression: Compression,
    /// Machine-readable output
    #[command(flatten)]
    pub output: Output,
}

/// `catenary replay`.
#[derive(Debug, Args)]
pub struct ReplayArgs {
    /// The bag
    #[command(flatten)]
    bags: Bags,
    /// Topics of the bag, with `*` at the end for all that begin so; none chosen: all
    #[arg(long, num_args = 1..)]
    topics: Vec<String>,
    /// Topics whose whole names match this regular expression
    #[arg(short = 'e', long)]
    regex: Option<String>,
    /// Leave these topics out
    #[arg(long, num_args = 1.., value_name = "TOPICS")]
    exclude_topics: Vec<String>,
    /// Leave topics out whose whole names match this regular expression
    #[arg(short = 'x', long, value_name = "REGEX")]
    exclude_regex: Option<String>,
    /// Speed: 2 is twice as fast as recorded, inf as fast as subscribers can take it
    #[arg(short, long, default_value_t = 1.0, allow_negative_numbers = true)]
    rate: f64,
    /// Begin anew at the end, until Ctrl-C
    #[arg(short = 'l', long = "loop")]
    repeat: bool,
    /// Seconds of the bag to skip
    #[arg(long, visible_alias = "start-offset", default_value_t = 0.0, allow_negative_numbers = true)]
    start_offset_s: f64,
    /// Seconds of the bag to play; none, or less than zero: all
    #[arg(long, visible_alias = "playback-duration", allow_negative_numbers = true)]
    playback_duration_s: Option<f64>,
    /// Seconds to wait before the bag, each time
    #[arg(short = 'd', long = "delay", default_value_t = 0.0, allow_negative_numbers = true)]
    delay_s: f64,
    /// Publish under another name, as OLD:=NEW
    #[arg(short = 'm', long, num_args = 1.., value_name = "OLD:=NEW")]
    pub remap: Vec<String>,
    /// Publish /clock in step with the bag, this many times per second (200 where none is given)
    #[arg(long, num_args = 0..=1, value_name = "HZ", default_missing_value = "200", allow_negative_numbers = true)]
    clock: Option<f64>,
    /// YAML file with QoS profiles to offer, by topic
    #[arg(long, value_name = "FILE")]
    qos_profile_overrides_path: Option<PathBuf>,
    /// Replay commands too, even where an arm may follow them
    #[arg(long)]
    allow_replay: bool,
    /// Replay what the arm and the camera measure even where others publish it too
    #[arg(long)]
    allow_others: bool,
    /// Machine-readable output
    #[command(flatten)]
    pub output: Output,
}

/// `catenary info`.
#[derive(Debug, Args)]
pub struct InfoArgs {
    /// The bags
    #[command(flatten)]
    pub bags: Bags,
    /// Believe the index, and read no messages: quick, and blind to damage
    #[arg(long)]
    pub index_only: bool,
    /// Machine-readable output
    #[command(flatten)]
    pub output: Output,
}

/// `catenary reindex`.
#[derive(Debug, Args)]
pub struct ReindexArgs {
    /// The bags
    #[command(flatten)]
    pub bags: Bags,
    /// Machine-readable output
    #[command(flatten)]
    pub output: Output,
}

fn compression(text: &str) -> Result<Compression, String> {
    let names = Compression::ALL.map(Compression::name);
    Compression::from_name(text).ok_or_else(|| format!("expected {}", names.join(", ")))
}

fn seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if (0.0..=1e9).contains(&seconds) => Ok(seconds),
        _ => Err("expected a number of seconds of at least zero".to_owned()),
    }
}

fn overrides(path: Option<&PathBuf>) -> Result<QosOverrides, BagError> {
    path.map_or_else(|| Ok(QosOverrides::default()), |path| QosOverrides::read(path))
}

impl RecordArgs {
    /// What is to be recorded.
    pub fn settings(&self) -> Result<RecordSettings> {
        let folder = self.bag.as_ref().or(self.out.as_ref()).context("expected the folder of the bag to make")?;
        let pattern = |name, text: &Option<String>| text.as_ref().map(|t| Pattern::within(name, t)).transpose();
        let filter = TopicFilter {
            all: self.all,
            topics: self.topics.clone(),
            types: self.topic_types.clone(),
            regex: pattern("regex", &self.regex)?,
            exclude_topics: self.exclude_topics.clone(),
            exclude_types: self.exclude_topic_types.clone(),
            exclude_regex: pattern("exclude_regex", &self.exclude_regex)?,
        };
        let split = Split {
            bytes: (self.max_bag_size > 0).then_some(self.max_bag_size),
            duration: (self.max_bag_duration > 0.0).then(|| Duration::from_secs_f64(self.max_bag_duration)),
        };
        let settings = RecordSettings {
            filter,
            images: self.images,
            compression: self.compression,
            split,
            overrides: overrides(self.qos_profile_overrides_path.as_ref())?,
            ..RecordSettings::new(folder.clone())
        };
        settings.check()?;
        Ok(settings)
    }
}

impl ReplayArgs {
    /// What is to be replayed, from a bag that can be opened.
    pub fn settings(&self) -> Result<ReplaySettings> {
        let bag = self.bags.one("replay")?;
        let pattern = |name, text: &Option<String>| text.as_ref().map(|t| Pattern::whole(name, t)).transpose();
        let filter = TopicFilter {
            topics: self.topics.clone(),
            regex: pattern("regex", &self.regex)?,
            exclude_topics: self.exclude_topics.clone(),
            exclude_regex: pattern("exclude_regex", &self.exclude_regex)?,
            ..TopicFilter::default()
        };
        let settings = ReplaySettings {
            filter,
            rate: self.rate,
            repeat: self.repeat,
            start_offset_s: self.start_offset_s,
            duration_s: self.playback_duration_s,
            delay_s: self.delay_s,
            clock_hz: self.clock,
            overrides: overrides(self.qos_profile_overrides_path.as_ref())?,
            allow_replay: self.allow_replay,
            allow_others: self.allow_others,
            ..ReplaySettings::new(bag.to_owned())
        };
        settings.open()?;
        Ok(settings)
    }
}

#[cfg(test)]
mod tests {
    use crate::cli::Cli;
    use clap::CommandFactory;

    #[test]
    fn no_two_arguments_have_the_same_name() {
        Cli::command().debug_assert();
    }
}
