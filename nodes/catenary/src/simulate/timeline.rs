//! Timeline of an episode: all events with their times.

use super::player::Motion;
use anyhow::{Result, ensure};

/// Measurements of the arm per second, as of a real one.
const ARM_HZ: f64 = 200.0;
/// Longest episode, s.
const LONGEST_S: f64 = 3600.0;

/// Event at a moment. Events of one moment follow the order of the variants.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Tick {
    /// Measurement of the arm.
    Arm,
    /// Frame of the camera, by number.
    Camera(u64),
    /// Observation by number, and the action after it.
    Step(usize),
    /// Frame of the measured track, by number.
    Compare(usize),
    /// Frame of the video, by number.
    Frame(u64),
    /// Moment for the picture.
    Moment,
}

/// Rates of the outputs.
pub struct Rates {
    /// Frames of the camera per second.
    pub camera_hz: f64,
    /// Frames of the video per second, if there is one.
    pub video_hz: Option<f64>,
    /// Number of moments in the picture, including the first and the last of the episode.
    pub moments: u32,
}

/// All events of an episode with their times in ns, in order.
///
/// # Errors
/// An episode longer than an hour.
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
        Motion::Actions { task, .. } => {
            ticks.extend((0..=motion.steps().unwrap_or(0)).map(|k| (ns(k as f64 * task.step_period_s), Tick::Step(k))));
        }
        Motion::Measured(m) => {
            let frames = m.track.frames.iter().enumerate().filter(|(_, f)| f.time_s >= 0.0 && f.time_s <= duration_s);
            ticks.extend(frames.map(|(i, f)| (ns(f.time_s), Tick::Compare(i))));
        }
    }
    // At least one interval: a single moment is the start.
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
    fn an_observation_follows_the_camera_frame_of_its_moment() {
        let model = Model::from_yaml(crate::inputs::model_file::SOFT_BAR).unwrap();
        let motion = Motion::Actions { task: model.task.unwrap(), actions: vec![[0.0; 2]; 16] };
        let all = ticks(&motion, &Rates { camera_hz: 60.0, video_hz: Some(25.0), moments: 5 }).unwrap();
        let count = |f: fn(&Tick) -> bool| all.iter().filter(|(_, t)| f(t)).count();
        // 8 s at 200, 60 and 25 Hz, both ends included.
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
