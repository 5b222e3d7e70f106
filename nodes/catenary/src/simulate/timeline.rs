//! What happens when in an episode.

use super::player::Motion;
use anyhow::{Result, ensure};

/// Measurements of the arm per second, as of a real one.
const ARM_HZ: f64 = 200.0;
/// Longest episode, s.
const LONGEST_S: f64 = 3600.0;

/// Something that happens at a moment. Those of one moment happen in this order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Tick {
    /// The arm is measured.
    Arm,
    /// The camera sees frame number n.
    Camera(u64),
    /// Observation number n, and the action after it.
    Step(usize),
    /// The measured track has its frame number n.
    Compare(usize),
    /// Frame number n of the video.
    Frame(u64),
    /// A moment for the picture.
    Moment,
}

/// How often things happen.
pub struct Rates {
    /// Frames of the camera per second.
    pub camera_hz: f64,
    /// Frames of the video per second, where there is one.
    pub video_hz: Option<f64>,
    /// Moments of the picture, from the first to the last of the episode.
    pub moments: u32,
}

/// Everything that happens, with its time in ns.
///
/// # Errors
/// An episode that is too long.
pub fn ticks(motion: &Motion, rates: &Rates) -> Result<Vec<(i64, Tick)>> {
    let duration_s = motion.duration_s();
    ensure!(duration_s <= LONGEST_S, "the episode takes {duration_s} s: expected at most {LONGEST_S} s");
    let mut ticks = Vec::new();
    let ns = |s: f64| (1e9 * s).round() as i64;
    let mut every = |hz: f64, tick: &dyn Fn(u64) -> Tick| {
        let times = (0u64..).map(|i| (i, i as f64 / hz)).take_while(|(_, t)| *t <= duration_s + 1e-9);
        ticks.extend(times.map(|(i, t)| (ns(t), tick(i))));
    };
    every(ARM_HZ, &|_| Tick::Arm);
    every(rates.camera_hz, &Tick::Camera);
    if let Some(hz) = rates.video_hz {
        every(hz, &Tick::Frame);
    }
    match motion {
        Motion::Actions { task, actions } => {
            ticks.extend((0..=actions.len()).map(|k| (ns(k as f64 * task.step_period_s), Tick::Step(k))));
        }
        Motion::Measured(m) => {
            let frames = m.track.frames.iter().enumerate().filter(|(_, f)| f.time_s >= 0.0 && f.time_s <= duration_s);
            ticks.extend(frames.map(|(i, f)| (ns(f.time_s), Tick::Compare(i))));
        }
    }
    let last = rates.moments.max(2) - 1;
    let moments = (0..rates.moments).map(|i| duration_s * f64::from(i) / f64::from(last));
    ticks.extend(moments.map(|t| (ns(t), Tick::Moment)));
    ticks.sort_unstable();
    Ok(ticks)
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::Model;

    #[test]
    fn an_observation_comes_after_the_frame_that_it_is_made_from() {
        let model = Model::from_yaml(crate::model_file::SOFT_BAR).unwrap();
        let motion = Motion::Actions { task: model.task.unwrap(), actions: vec![[0.0; 2]; 16] };
        let all = ticks(&motion, &Rates { camera_hz: 60.0, video_hz: Some(25.0), moments: 5 }).unwrap();
        let count = |f: fn(&Tick) -> bool| all.iter().filter(|(_, t)| f(t)).count();
        assert_eq!(count(|t| matches!(t, Tick::Arm)), 1601);
        assert_eq!(count(|t| matches!(t, Tick::Camera(_))), 481);
        assert_eq!(count(|t| matches!(t, Tick::Frame(_))), 201);
        assert_eq!((count(|t| matches!(t, Tick::Step(_))), count(|t| matches!(t, Tick::Moment))), (17, 5));
        let half: Vec<Tick> = all.iter().filter(|(at, _)| *at == 500_000_000).map(|(_, t)| *t).collect();
        assert_eq!(half, [Tick::Arm, Tick::Camera(30), Tick::Step(1)]);
        assert!(all.windows(2).all(|w| w[0].0 <= w[1].0));
        assert_eq!(all.last().map(|(at, _)| *at), Some(8_000_000_000));
    }
}
