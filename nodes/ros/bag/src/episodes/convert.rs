//! Conversion of wire messages to records of an [`EpisodeLog`], for bag readers and live subscriptions.
//!
//! It knows neither files nor the graph. Conversions for all nodes are in [`catenary_shell::convert`].

use catenary_core::episode::{EpisodeStart, MeasuredPose, is_base_frame};
use catenary_core::{EpisodeLog, Observation};
use catenary_msgs::Interface;
use catenary_msgs::builtin_interfaces::msg::Time as Stamp;
use catenary_msgs::geometry_msgs::msg::{PoseStamped, WrenchStamped};
use catenary_msgs::msg::{EefDelta, EpisodeEvent, Keypoints, Observation as ObservationMsg};
use catenary_shell::convert::{ConvertError, anchor_from_msg, grip_pose_from_msg, keypoints_from_msg};
use catenary_shell::stamp;

/// Greatest deviation of the norm of a quaternion from 1: drivers that send single precision stay far below it.
const NORM_TOLERANCE: f64 = 0.01;

/// Message that gives an [`EpisodeLog`] a record.
pub trait Feed: Interface {
    /// Stamp of the message in ns.
    fn stamp_ns(&self) -> i64;

    /// Adds the message to the log at its own stamp.
    ///
    /// # Errors
    /// [`ConvertError`] names the field that makes no sense. The log is then unchanged.
    fn feed(&self, log: &mut EpisodeLog) -> Result<(), ConvertError>;
}

fn stamp_ns(stamp: &Stamp) -> i64 {
    stamp::from_msg(stamp).nanos()
}

fn finite(field: &'static str, numbers: impl IntoIterator<Item = f64>) -> Result<(), ConvertError> {
    match numbers.into_iter().find(|v| !v.is_finite()) {
        Some(bad) => Err(ConvertError { field, expected: "finite numbers".into(), got: bad.to_string() }),
        None => Ok(()),
    }
}

impl Feed for Keypoints {
    fn stamp_ns(&self) -> i64 {
        stamp_ns(&self.header.stamp)
    }

    fn feed(&self, log: &mut EpisodeLog) -> Result<(), ConvertError> {
        log.push_keypoints(self.stamp_ns(), keypoints_from_msg(self)?);
        Ok(())
    }
}

impl Feed for PoseStamped {
    fn stamp_ns(&self) -> i64 {
        stamp_ns(&self.header.stamp)
    }

    fn feed(&self, log: &mut EpisodeLog) -> Result<(), ConvertError> {
        let (p, q) = (&self.pose.position, &self.pose.orientation);
        finite("pose", [p.x, p.y, p.z, q.x, q.y, q.z, q.w])?;
        let norm = [q.x, q.y, q.z, q.w].iter().map(|v| v * v).sum::<f64>().sqrt();
        if (norm - 1.0).abs() > NORM_TOLERANCE {
            let expected = "a unit quaternion".to_owned();
            return Err(ConvertError { field: "pose.orientation", expected, got: format!("one of norm {norm:.3}") });
        }
        // Nothing is added before the last check: a refused message must leave no trace.
        log.push_frame(self.stamp_ns(), &self.header.frame_id);
        log.push_pose(self.stamp_ns(), MeasuredPose { grip: grip_pose_from_msg(&self.pose), y_m: p.y });
        Ok(())
    }
}

impl Feed for WrenchStamped {
    fn stamp_ns(&self) -> i64 {
        stamp_ns(&self.header.stamp)
    }

    fn feed(&self, log: &mut EpisodeLog) -> Result<(), ConvertError> {
        let wrench = [self.wrench.force.x, self.wrench.force.z, self.wrench.torque.y];
        finite("wrench", wrench)?;
        let frame = &self.header.frame_id;
        if !is_base_frame(frame) {
            // In the hand's own frame the components along x and z are others.
            let expected = "panda_link0".to_owned();
            return Err(ConvertError { field: "header.frame_id", expected, got: frame.clone() });
        }
        log.push_wrench(self.stamp_ns(), wrench);
        Ok(())
    }
}

impl Feed for ObservationMsg {
    fn stamp_ns(&self) -> i64 {
        stamp_ns(&self.header.stamp)
    }

    fn feed(&self, log: &mut EpisodeLog) -> Result<(), ConvertError> {
        finite("values", self.values)?;
        log.push_observation(self.stamp_ns(), self.episode, self.step, Observation(self.values));
        Ok(())
    }
}

impl Feed for EefDelta {
    fn stamp_ns(&self) -> i64 {
        stamp_ns(&self.header.stamp)
    }

    fn feed(&self, log: &mut EpisodeLog) -> Result<(), ConvertError> {
        finite("dx, dz", [self.dx, self.dz])?;
        log.push_action(self.stamp_ns(), self.episode, self.step, [self.dx, self.dz]);
        Ok(())
    }
}

impl Feed for EpisodeEvent {
    fn stamp_ns(&self) -> i64 {
        stamp_ns(&self.header.stamp)
    }

    fn feed(&self, log: &mut EpisodeLog) -> Result<(), ConvertError> {
        let at_ns = self.stamp_ns();
        match self.event {
            Self::STARTED => log.push_start(at_ns, self.episode, start_from_msg(self)?),
            Self::ENDED => log.push_end(at_ns, self.episode, self.reason.clone()),
            other => {
                let expected = "STARTED or ENDED".to_owned();
                return Err(ConvertError { field: "event", expected, got: other.to_string() });
            }
        }
        Ok(())
    }
}

/// Converts a STARTED event.
///
/// # Errors
/// [`ConvertError`] for a step period that is not positive, or an unknown anchor.
fn start_from_msg(message: &EpisodeEvent) -> Result<EpisodeStart, ConvertError> {
    let step_period_s = message.step_period;
    if !(step_period_s.is_finite() && step_period_s > 0.0) {
        let expected = "a positive number of seconds".to_owned();
        return Err(ConvertError { field: "step_period", expected, got: step_period_s.to_string() });
    }
    Ok(EpisodeStart {
        policy: message.policy.clone(),
        seed: message.seed,
        step_period_s,
        delta_anchor: anchor_from_msg(message.anchor)?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_without_meaning_are_named_and_leave_the_log_as_it_was() {
        let mut log = EpisodeLog::default();
        let untouched = log.summary();
        let wrong = |outcome: Result<(), ConvertError>| outcome.unwrap_err().to_string();
        let no_orientation = PoseStamped::default();
        let e = wrong(no_orientation.feed(&mut log));
        assert!(e.contains("pose.orientation") && e.contains("norm 0.000"), "{e}");
        let mut keypoints = Keypoints { image_width: 256, image_height: 256, ..Keypoints::default() };
        keypoints.dlo_v[2] = f64::NAN;
        assert!(wrong(keypoints.feed(&mut log)).contains("dlo_u"));
        assert!(wrong(EpisodeEvent { event: 7, ..EpisodeEvent::default() }.feed(&mut log)).contains('7'));
        assert!(wrong(EpisodeEvent::default().feed(&mut log)).contains("step_period"));
        assert!(wrong(EefDelta { dx: f64::INFINITY, ..EefDelta::default() }.feed(&mut log)).contains("inf"));
        let mut felt = WrenchStamped::default();
        felt.header.frame_id = "panda_hand".into();
        assert!(wrong(felt.feed(&mut log)).contains("header.frame_id"));
        felt.header.frame_id.clear();
        felt.wrench.torque.y = f64::NAN;
        assert!(wrong(felt.feed(&mut log)).contains("wrench"));
        assert_eq!((log.summary(), log.held()), (untouched, 0));
    }

    #[test]
    fn events_become_an_episode_with_their_values() {
        let mut log = EpisodeLog::default();
        let started = EpisodeEvent {
            header: stamp::header(catenary_shell::Time::from_nanos(5), ""),
            episode: 3,
            policy: "pi0".into(),
            seed: u64::MAX,
            step_period: 0.5,
            anchor: EefDelta::ANCHOR_MEASURED,
            ..EpisodeEvent::default()
        };
        let ended = EpisodeEvent {
            header: stamp::header(catenary_shell::Time::from_nanos(1_000_000_005), ""),
            event: EpisodeEvent::ENDED,
            reason: "step_limit".into(),
            ..started.clone()
        };
        ended.feed(&mut log).unwrap();
        started.feed(&mut log).unwrap();
        let episode = log.episode(Some(3)).unwrap();
        assert_eq!((episode.duration_s, episode.end.as_str()), (1.0, "step_limit"));
        assert_eq!((episode.start.policy.as_str(), episode.start.seed), ("pi0", u64::MAX));
        assert_eq!(episode.start.delta_anchor, catenary_core::task::DeltaAnchor::Measured);
    }
}
