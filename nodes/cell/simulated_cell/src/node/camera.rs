//! Simulated camera: draws a picture at every frame. In real time it has its own thread, so that the arm's loop keeps its pace.

use crate::cell::{Cell, Exposure};
use crate::convert;
use crate::render::Renderer;
use crate::scene::Scene;
use anyhow::Result;
use catenary_core::RgbImage;
use catenary_core::camera::Pinhole;
use catenary_msgs::sensor_msgs::msg::{CameraInfo, Image};
use catenary_msgs::tf2_msgs::msg::TFMessage;
use catenary_shell::{Node, Publisher, Time, contract, stamp};
use panda_bridge::gate::BASE_FRAME;
use panda_bridge::node::front::Front;
use std::sync::Arc;
use std::time::Duration;

/// Name of the camera's frame, as in realsense2_camera.
const OPTICAL_FRAME: &str = "camera_color_optical_frame";
/// Polling period of the camera's thread.
// Short against the period of a frame (33 ms at 30 Hz).
const POLL_PERIOD: Duration = Duration::from_millis(2);

/// Node that has a cell.
pub trait Holder: Send + Sync + 'static {
    /// Returns the node.
    fn node(&self) -> &Node;
    /// Returns the stamp of a time of the cell, s.
    fn stamp(&self, time_s: f64) -> Time;
    /// Calls `act` while the cell is locked.
    fn with<T>(&self, act: impl FnOnce(&mut Cell) -> T) -> T;
}

impl Holder for Front<Cell> {
    fn node(&self) -> &Node {
        Front::node(self)
    }

    fn stamp(&self, time_s: f64) -> Time {
        Front::stamp(self, time_s)
    }

    fn with<T>(&self, act: impl FnOnce(&mut Cell) -> T) -> T {
        act(self.arm().plant_mut())
    }
}

/// How the pictures look.
#[derive(Debug, Clone, Copy)]
pub struct Pictures {
    /// Standard deviation of the image noise in grey levels.
    pub noise_levels: f64,
    /// Seed of the noise.
    pub noise_seed: u64,
    /// Seed of the laboratory that is drawn; none for the plain look.
    pub laboratory: Option<u64>,
}

impl Pictures {
    fn renderer(&self, camera: &Pinhole) -> Renderer {
        Renderer::new(camera.image_width_px, camera.image_height_px, self.noise_levels, self.noise_seed)
            .in_laboratory(self.laboratory)
    }
}

/// Camera of a cell: draws the frames that are due, and publishes them.
pub struct Frames {
    images: Publisher<Image>,
    infos: Publisher<CameraInfo>,
    // The latched transform lives as long as its publisher.
    _latched: Publisher<TFMessage>,
    calibrated: Pinhole,
    camera: Pinhole,
    scene: Scene,
    renderer: Renderer,
    rate_hz: f64,
    /// Number of the next frame, from 0.
    next: u64,
    /// Stamp of the newest frame.
    newest: Time,
}

impl Frames {
    /// Creates the camera with `rate_hz`. `calibrated` is the nominal camera: camera_info and tf report it, while the pictures come from the
    /// cell's jittered one.
    ///
    /// # Errors
    /// The names after remapping, the middleware.
    pub fn new<H: Holder>(holder: &H, calibrated: &Pinhole, rate_hz: f64, pictures: Pictures) -> Result<Self> {
        let node = holder.node();
        let images = node.publisher::<Image>(contract::IMAGE.name, contract::IMAGE.qos)?;
        let infos = node.publisher::<CameraInfo>(contract::CAMERA_INFO.name, contract::CAMERA_INFO.qos)?;
        let tf = node.publisher::<TFMessage>(contract::TF_STATIC.name, contract::TF_STATIC.qos)?;
        let (camera, scene) = holder.with(|cell| (*cell.camera(), cell.scene()));
        let header = stamp::header(holder.stamp(0.0), BASE_FRAME);
        tf.send(TFMessage { transforms: vec![convert::camera_transform(calibrated, header, OPTICAL_FRAME)] });
        let renderer = pictures.renderer(&camera);
        let calibrated = *calibrated;
        Ok(Self {
            images,
            infos,
            _latched: tf,
            calibrated,
            camera,
            scene,
            renderer,
            rate_hz,
            next: 0,
            newest: Time::ZERO,
        })
    }

    /// Returns true if a frame is due at `time_s` of the cell.
    pub fn is_due(&self, time_s: f64) -> bool {
        time_s * self.rate_hz >= self.next as f64
    }

    /// Publishes the frame of the cell's present time, if one is due. Returns its stamp.
    pub fn take<H: Holder>(&mut self, holder: &H) -> Option<Time> {
        let (time_s, exposure) = holder.with(|cell| {
            let time_s = cell.time_s();
            (time_s, self.is_due(time_s).then(|| cell.exposure()))
        });
        let exposure = exposure?;
        // A dropped frame publishes the picture before; the first frame has none.
        if self.next == 0 || !exposure.dropped {
            expose(&mut self.renderer, &mut self.scene, &self.camera, &exposure, self.next);
        }
        self.next = (time_s * self.rate_hz).floor() as u64 + 1;
        self.newest = holder.stamp(time_s);
        self.send();
        Some(self.newest)
    }

    /// Publishes the newest frame, for the first time or again.
    pub fn send(&self) {
        let header = stamp::header(self.newest, OPTICAL_FRAME);
        self.infos.send(convert::camera_info(&self.calibrated, header.clone()));
        self.images.send(convert::image(&self.renderer.image, header));
    }
}

/// Starts a camera on a thread of its own: see [`Frames::new`].
///
/// # Errors
/// As [`Frames::new`].
pub fn start<H: Holder>(holder: &Arc<H>, calibrated: &Pinhole, rate_hz: f64, pictures: Pictures) -> Result<()> {
    let mut frames = Frames::new(&**holder, calibrated, rate_hz, pictures)?;
    let taken_from = Arc::clone(holder);
    holder.node().spawn("camera", move || {
        while !taken_from.node().is_shutdown() {
            if frames.take(&*taken_from).is_none() {
                #[allow(clippy::disallowed_methods, reason = "the camera's pace is that of the cell")]
                std::thread::sleep(POLL_PERIOD);
            }
        }
    })?;
    Ok(())
}

/// Draws one picture: band by band for a rolling shutter, and as a mean over moments for an exposure.
fn expose(renderer: &mut Renderer, scene: &mut Scene, camera: &Pinhole, exposure: &Exposure, frame: u64) {
    let mut draw = |renderer: &mut Renderer, snapshot: &crate::cell::Snapshot| {
        scene.update(snapshot.grip, &snapshot.nodes);
        renderer.draw(scene, camera, frame);
    };
    if let [band] = &exposure.bands[..]
        && let [moment] = &band[..]
    {
        return draw(renderer, moment);
    }
    let mut picture = RgbImage::new(camera.image_width_px, camera.image_height_px);
    let rows = (camera.image_height_px as usize).div_ceil(exposure.bands.len());
    let band_bytes = 3 * camera.image_width_px as usize * rows;
    for (i, (band, out)) in exposure.bands.iter().zip(picture.data.chunks_mut(band_bytes)).enumerate() {
        let mut sums = vec![0u16; out.len()];
        for moment in band {
            draw(renderer, moment);
            let rows = &renderer.image.data[i * band_bytes..];
            sums.iter_mut().zip(rows).for_each(|(sum, v)| *sum += u16::from(*v));
        }
        out.iter_mut().zip(&sums).for_each(|(v, sum)| *v = (sum / band.len() as u16) as u8);
    }
    renderer.image = picture;
}
