//! Writers of an episode's data: each topic of an episode has one writer, from the first message after the goal to the end.

use std::fmt;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Identifier of a writer of a topic (DDS GUID). A node that is started again has another one.
pub type Writer = [u8; 16];

/// Topic that an episode listens to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Source {
    /// Keypoints of the object and of the target.
    Keypoints,
    /// Pose of the end effector.
    Pose,
    /// State of the arm.
    ArmState,
    /// Answers of the arm to targets.
    AcceptedTarget,
}

impl Source {
    fn name(self) -> &'static str {
        match self {
            Self::Keypoints => "keypoints",
            Self::Pose => "a pose",
            Self::ArmState => "a state of the arm",
            Self::AcceptedTarget => "an answer to a target",
        }
    }
}

/// Message of a second writer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stranger {
    /// Topic of the message.
    pub source: Source,
    /// Writer of the message.
    pub writer: Writer,
    /// Writer that the episode is bound to.
    pub bound: Writer,
}

impl Stranger {
    /// Describes the message with the names of both nodes.
    #[must_use]
    pub fn text(&self, stranger: &str, bound: &str) -> String {
        let what = self.source.name();
        format!(
            "{what} came from {stranger}, and before from {bound}: an episode hears one node of each topic; end one of the two, or wait until the one that was started again runs"
        )
    }
}

impl fmt::Display for Stranger {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let hex = |writer: &Writer| writer.iter().map(|byte| format!("{byte:02x}")).collect::<String>();
        f.write_str(&self.text(&format!("writer {}", hex(&self.writer)), &format!("writer {}", hex(&self.bound))))
    }
}

/// Writers that an episode is bound to. Outside an episode every writer is heard.
#[derive(Debug, Clone, Default)]
pub struct Writers {
    is_bound: bool,
    bound: [Option<Writer>; 4],
    stranger: Option<Stranger>,
}

impl Writers {
    /// Begins an episode: the next message of each topic binds it to its writer.
    pub fn begin(&mut self) {
        *self = Self { is_bound: true, ..Self::default() };
    }

    /// Ends the episode.
    pub fn end(&mut self) {
        *self = Self::default();
    }

    /// Hears a message.
    ///
    /// # Errors
    /// [`Stranger`] for a message of a second writer, which must not be used.
    pub fn hear(&mut self, source: Source, writer: Writer) -> Result<(), Stranger> {
        if !self.is_bound {
            return Ok(());
        }
        let bound = *self.bound[source as usize].get_or_insert(writer);
        if bound == writer {
            return Ok(());
        }
        let stranger = Stranger { source, writer, bound };
        // The first one ends the episode, and is named.
        self.stranger.get_or_insert(stranger);
        Err(stranger)
    }

    /// Returns the first stranger of the episode.
    #[must_use]
    pub fn stranger(&self) -> Option<Stranger> {
        self.stranger
    }
}

/// Locks writers that the threads of several topics share.
pub fn lock(writers: &Mutex<Writers>) -> MutexGuard<'_, Writers> {
    writers.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [Source; 4] = [Source::Keypoints, Source::Pose, Source::ArmState, Source::AcceptedTarget];

    #[test]
    fn every_topic_of_an_episode_has_one_writer() {
        for source in ALL {
            let mut writers = Writers::default();
            writers.begin();
            // Each topic may have another writer.
            ALL.iter().enumerate().for_each(|(i, other)| writers.hear(*other, [i as u8; 16]).unwrap());
            assert_eq!((writers.hear(source, [source as u8; 16]), writers.stranger()), (Ok(()), None));
            let stranger = Stranger { source, writer: [9; 16], bound: [source as u8; 16] };
            assert_eq!(writers.hear(source, [9; 16]), Err(stranger));
            assert_eq!(writers.hear(source, [8; 16]), Err(Stranger { writer: [8; 16], ..stranger }));
            assert_eq!(writers.stranger(), Some(stranger), "the first one is named");
        }
    }

    #[test]
    fn writers_may_change_between_episodes_and_not_within_one() {
        let mut writers = Writers::default();
        for writer in [[1; 16], [2; 16]] {
            assert_eq!(writers.hear(Source::Pose, writer), Ok(()));
        }
        writers.begin();
        writers.hear(Source::Pose, [3; 16]).unwrap();
        assert!(writers.hear(Source::Pose, [4; 16]).is_err(), "a tracker that was started again is another writer");
        writers.end();
        assert_eq!((writers.hear(Source::Pose, [4; 16]), writers.stranger()), (Ok(()), None));
    }

    #[test]
    fn a_stranger_is_told_with_both_writers() {
        let stranger = Stranger { source: Source::ArmState, writer: [0xab; 16], bound: [0xcd; 16] };
        let words = stranger.to_string();
        assert!(words.contains("a state of the arm") && words.contains("abab") && words.contains("cdcd"), "{words}");
        let words = stranger.text("/lab (process 2)", "/cell (process 1)");
        assert!(words.contains("came from /lab (process 2), and before from /cell (process 1)"), "{words}");
    }
}
