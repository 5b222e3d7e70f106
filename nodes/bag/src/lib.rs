//! rosbag2 MCAP files: record, read, replay, import.
//!
//! Does: write bags as `ros2 bag record` does, chunk by chunk, so that a killed process loses the last second at most
//! ([`BagWriter`]); read them, finished or not ([`BagReader`]); put episodes together from them ([`read_episodes`]); make
//! them from measured tracks ([`import_track`]). Bags of other recorders may be in sqlite3, and compressed in
//! any of rosbag2's ways. With the feature `node` also: record the graph, replay into it,
//! and follow its episodes ([`LiveEpisodes`]).
//! Does not: know any algorithm, or change what a message says. Writes no sqlite3 bags.

#[cfg(feature = "node")]
mod backlog;
mod clocks;
pub mod convert;
#[cfg(feature = "node")]
mod definitions;
mod episodes;
mod error;
mod filter;
mod import;
#[cfg(feature = "node")]
mod kinds;
#[cfg(feature = "node")]
mod live;
mod metadata;
#[cfg(feature = "node")]
pub mod node;
#[cfg(feature = "node")]
mod overrides;
mod profile;
mod reader;
#[cfg(feature = "node")]
mod record;
mod records;
#[cfg(feature = "node")]
mod replay;
mod reserve;
mod writer;

pub use convert::Feed;
pub use episodes::{EpisodeTopics, episode_notes, read_episodes, read_measured};
pub use error::BagError;
pub use filter::{Pattern, TopicFilter};
pub use import::import_track;
#[cfg(feature = "node")]
pub use live::LiveEpisodes;
#[cfg(feature = "node")]
pub use overrides::QosOverrides;
pub use reader::{BagMessage, BagReader, Messages, Topic, TopicCount, reindex};
#[cfg(feature = "node")]
pub use record::{RecordSettings, record};
#[cfg(feature = "node")]
pub use replay::{ReplaySettings, ReplaySummary, replay};
pub use writer::{BagSummary, BagWriter, Compression, Split, TopicId, TopicType, WriterOptions};
