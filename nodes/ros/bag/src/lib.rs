#![doc = include_str!("../README.md")]

mod episodes;
mod error;
mod filter;
mod format;
mod import;
mod latched;
#[cfg(feature = "node")]
pub mod node;
mod reader;
mod reindex;
mod writer;

#[cfg(feature = "node")]
pub use episodes::LiveEpisodes;
pub use episodes::{EpisodeTopics, Feed, episode_notes, read_episodes, read_measured, visit_episodes};
pub use error::BagError;
pub use filter::{Pattern, TopicFilter};
pub use import::{Imported, import_track};
pub use latched::latched_elsewhere;
#[cfg(feature = "node")]
pub use node::{QosOverrides, RecordSettings, ReplaySettings, ReplaySummary, record, replay};
pub use reader::{BagMessage, BagReader, Messages, Topic, TopicCount, Verified};
pub use reindex::reindex;
pub use writer::{BagSummary, BagWriter, Compression, Split, TopicId, TopicType, WriterOptions};
