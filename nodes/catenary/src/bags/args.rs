//! Arguments of `record`, `replay`, `info` and `reindex`. Their names are those of `ros2 bag`.

use super::order::{TOPICS_AND_BAG, is_like_topic};
use crate::options::{Bags, Output};
use anyhow::{Context, Result, ensure};
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
    /// BAG, given as an option
    #[arg(short, long, visible_aliases = ["output", "bag"], value_name = "BAG")]
    out: Option<PathBuf>,
    /// Topics; `*` at the end of a name matches every topic with this prefix; default: the topics of the contract
    /// without the camera's images
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
    /// Record the camera's images too; applies if no topics are chosen
    #[arg(long)]
    images: bool,
    /// YAML file with QoS profiles for subscriptions, by topic
    #[arg(long, value_name = "FILE")]
    qos_profile_overrides_path: Option<PathBuf>,
    /// Log times from /clock instead of the wall clock
    #[arg(long)]
    pub use_sim_time: bool,
    /// Start a new file after this many bytes; 0: never
    #[arg(short = 'b', long, default_value_t = 0, value_name = "BYTES")]
    max_bag_size: u64,
    /// Start a new file after this many seconds; 0: never
    #[arg(short = 'd', long, default_value_t = 0.0, value_name = "SECONDS", value_parser = seconds)]
    max_bag_duration: f64,
    /// Compression of the chunks: none, lz4 or zstd
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
    /// Topics of the bag; `*` at the end of a name matches every topic with this prefix; default: all
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
    /// Playback speed: 2 is twice as fast as recorded, inf as fast as subscribers can take it
    #[arg(short, long, default_value_t = 1.0, allow_negative_numbers = true)]
    rate: f64,
    /// Start again at the end, until Ctrl-C
    #[arg(short = 'l', long = "loop")]
    repeat: bool,
    /// Seconds of the bag to skip
    #[arg(long, visible_alias = "start-offset", default_value_t = 0.0, allow_negative_numbers = true)]
    start_offset_s: f64,
    /// Seconds of the bag to play; default, or below zero: all
    #[arg(long, visible_alias = "playback-duration", allow_negative_numbers = true)]
    playback_duration_s: Option<f64>,
    /// Seconds to wait before each start of the bag
    #[arg(short = 'd', long = "delay", default_value_t = 0.0, allow_negative_numbers = true)]
    delay_s: f64,
    /// Publish under another name, as OLD:=NEW
    #[arg(short = 'm', long, num_args = 1.., value_name = "OLD:=NEW")]
    pub remap: Vec<String>,
    /// Publish /clock in step with the bag, this many times per second (200 if no number is given)
    #[arg(long, num_args = 0..=1, value_name = "HZ", default_missing_value = "200", allow_negative_numbers = true)]
    clock: Option<f64>,
    /// YAML file with QoS profiles to offer, by topic
    #[arg(long, value_name = "FILE")]
    qos_profile_overrides_path: Option<PathBuf>,
    /// Replay commands too, even if an arm may follow them
    #[arg(long)]
    allow_replay: bool,
    /// Replay the measurements of arm and camera even if other nodes publish them too
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
    /// Trust the index and read no messages: fast, but damage is not seen
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
        // The upper limit, 30 years, keeps `Duration::from_secs_f64` from a panic.
        Ok(seconds) if (0.0..=1e9).contains(&seconds) => Ok(seconds),
        _ => Err("expected seconds from 0 to 1e9".to_owned()),
    }
}

fn overrides(path: Option<&PathBuf>) -> Result<QosOverrides, BagError> {
    path.map_or_else(|| Ok(QosOverrides::default()), |path| QosOverrides::read(path))
}

impl RecordArgs {
    /// Settings of the recording. Returns an error for a bad pattern, an unreadable QoS file or an impossible
    /// combination.
    pub fn settings(&self) -> Result<RecordSettings> {
        let folder = self.bag.as_ref().or(self.out.as_ref()).context("no folder for the bag: give BAG or --out BAG")?;
        if let Some(bag) = &self.bag {
            let path = bag.display();
            ensure!(
                !is_like_topic(bag),
                "BAG: expected a folder for the bag, got {path}, a topic's name: {TOPICS_AND_BAG}"
            );
        }
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
        // Checked here, before a node exists: a wrong setting must not show up in the graph.
        settings.check()?;
        Ok(settings)
    }
}

impl ReplayArgs {
    /// Settings of the replay. Returns an error if the bag cannot be opened.
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
        // Opened here once, so that a wrong path is refused before the middleware starts.
        settings.open()?;
        Ok(settings)
    }
}
