//! Episode with its outputs: each moment is written to the bag, the video and the picture.

use super::args::SimulateArgs;
use super::eyes::Eyes;
use super::picture::{self, Sheet};
use super::player::{Motion, Player};
use super::recording::Recording;
use super::staged::Staged;
use super::summary::Episode;
use super::timeline::{Rates, Tick};
use super::video::Video;
use anyhow::Result;
use catenary_core::camera::Pinhole;
use catenary_core::task::{Judge, Moment, Phase, Referee};
use catenary_core::{KeypointOrder, Keypoints, Model};
use simulated_cell::render::Renderer;

/// Outputs of an episode.
pub struct Sinks {
    /// Bag, and its place.
    pub recording: Option<(Staged, Recording)>,
    /// Renderer of the camera's pictures, with sensor noise.
    pub pictures: Option<Renderer>,
    /// Segmenter and tracker that take the keypoints from the pictures; none: they are exact.
    pub eyes: Option<Eyes>,
    /// Video, and its place.
    pub video: Option<(Staged, Video)>,
    /// Renderer of the video.
    pub frames: Option<Renderer>,
    /// Picture of moments.
    pub sheet: Option<Sheet>,
}

/// Episode with its outputs.
pub struct Show<'a> {
    player: Player<'a>,
    model: &'a Model,
    motion: &'a Motion,
    referee: Option<Referee>,
    sinks: Sinks,
    episode: Episode,
    /// Keypoints of the camera's last frame.
    seen: Keypoints,
    /// Renderer and camera of the moments.
    moments: Option<(Renderer, Pinhole)>,
}

impl<'a> Show<'a> {
    /// Episode before its start.
    pub fn new(
        model: &'a Model,
        motion: &'a Motion,
        mut player: Player<'a>,
        mut sinks: Sinks,
        episode: Episode,
        laboratory: Option<u64>,
    ) -> Self {
        let moments = sinks.sheet.as_mut().map(|sheet| {
            sheet.begin_row();
            let camera = picture::oversampled(player.camera());
            let renderer = Renderer::new(camera.image_width_px, camera.image_height_px, 0.0, 0);
            (renderer.in_laboratory(laboratory), camera)
        });
        let referee = Judge::of(model).map(|judge| judge.referee());
        Self { seen: player.keypoints(), player, referee, model, motion, sinks, episode, moments }
    }

    /// Rates that the outputs need.
    pub fn rates(&self, arguments: &SimulateArgs) -> Rates {
        Rates {
            camera_hz: self.model.camera.rate_hz,
            video_hz: self.sinks.video.is_some().then_some(arguments.video_rate),
            moments: if self.sinks.sheet.is_some() { arguments.moments } else { 0 },
        }
    }

    /// Advances the simulation to `at_ns` and executes one event.
    pub fn tick(&mut self, at_ns: i64, tick: Tick) -> Result<()> {
        let time_s = 1e-9 * at_ns as f64;
        self.player.advance(time_s);
        if let Some((_, recording)) = &mut self.sinks.recording {
            recording.set_time(at_ns);
        }
        match tick {
            Tick::Arm => self.sinks.recording.as_mut().map_or(Ok(()), |(_, recording)| recording.arm(&mut self.player)),
            Tick::Camera(frame) => self.see(frame),
            Tick::Step(step) => self.step(time_s, step),
            Tick::Compare(frame) => {
                self.compare(frame);
                Ok(())
            }
            Tick::Frame(frame) => {
                let (Some((_, video)), Some(renderer)) = (&mut self.sinks.video, &mut self.sinks.frames) else {
                    return Ok(());
                };
                let camera = *self.player.camera();
                self.player.draw(renderer, &camera, frame);
                video.push(&renderer.image)
            }
            Tick::Moment => {
                if let (Some((renderer, camera)), Some(sheet)) = (&mut self.moments, &mut self.sinks.sheet) {
                    self.player.draw(renderer, camera, 0);
                    sheet.push(&renderer.image, &renderer.labels);
                }
                Ok(())
            }
        }
    }

    fn see(&mut self, frame: u64) -> Result<()> {
        if self.sinks.eyes.is_none() {
            self.seen = self.player.keypoints();
        }
        let Sinks { recording, pictures, eyes, .. } = &mut self.sinks;
        if let Some(renderer) = pictures {
            let camera = *self.player.camera();
            self.player.draw(renderer, &camera, frame);
            if let Some((_, recording)) = recording
                && eyes.as_ref().is_none_or(|e| e.are_recorded)
            {
                recording.picture(&renderer.image)?;
            }
            if let Some(eyes) = eyes {
                let found = eyes.keypoints(&renderer.image, self.player.true_keypoints_px())?;
                if let Some((_, recording)) = recording {
                    recording.keypoints(&found)?;
                }
                // Whoever acts on keypoints holds the last ones that were seen, as the runner does.
                let held = if found.dlo_seen() { found } else { self.seen };
                let target_px = found.target_px.or(self.seen.target_px);
                self.seen = Keypoints { target_px, ..held };
                self.episode.keypoints_m = self.player.plane_m(&self.seen);
                return Ok(());
            }
        }
        self.episode.keypoints_m = self.player.plane_m(&self.seen);
        let Some((_, recording)) = recording else { return Ok(()) };
        recording.keypoints(&self.seen)
    }

    fn step(&mut self, time_s: f64, step: usize) -> Result<()> {
        let observation = self.player.observation(&self.seen);
        let phase = match self.motion {
            Motion::Actions { task, actions } => Phase::of(step, actions.len(), task.rest_after(actions.len())),
            Motion::Measured(_) => Phase::Action,
        };
        let referee = self.referee.as_mut().filter(|_| step > 0);
        let reward = referee.map(|referee| referee.verdict(&Moment::of(&observation, false, phase)).reward);
        self.episode.step(time_s, reward, self.player.is_inside());
        let taken = self.player.act(step);
        let Some((_, recording)) = &mut self.sinks.recording else { return Ok(()) };
        recording.observation(step, observation, reward)?;
        match taken {
            Some((target_m, delta_m)) => recording.action(step, delta_m, target_m, self.player.grip()),
            None => Ok(()),
        }
    }

    fn compare(&mut self, frame: usize) {
        let Motion::Measured(m) = self.motion else { return };
        let measured = m.track.frames[frame].dlo.map(|p| self.model.camera.view.plane_from_scaled(p));
        let simulated = self.player.keypoints();
        let order = KeypointOrder::of(self.model.observation.drive);
        self.episode.compare(self.player.plane_m(&simulated), measured, order);
    }

    /// Ends the episode, and returns it with its outputs.
    pub fn finish(mut self) -> (Episode, Sinks) {
        self.episode.finish(self.motion.duration_s(), self.player.counters());
        self.episode.sight = self.sinks.eyes.as_ref().and_then(Eyes::sight);
        (self.episode, self.sinks)
    }
}
