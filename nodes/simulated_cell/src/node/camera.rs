//! Simulated camera: draws a picture at every frame, on its own thread, so that the arm's loop keeps its pace.

use crate::cell::{Cell, Exposure};
use crate::convert;
use crate::render::Renderer;
use crate::scene::Scene;
use anyhow::Result;
use catenary_core::RgbImage;
use catenary_core::camera::Pinhole;
use catenary_msgs::sensor_msgs::msg::{CameraInfo, Image};
use catenary_msgs::tf2_msgs::msg::TFMessage;
use catenary_shell::{Node, Time, contract, stamp};
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

/// Starts the camera at `rate_hz`. `calibrated` is the nominal camera: camera_info and tf report it, while the pictures come from the
/// cell's jittered one.
pub fn start<H: Holder>(holder: &Arc<H>, calibrated: &Pinhole, rate_hz: f64, pictures: Pictures) -> Result<()> {
    let node = holder.node();
    let images = node.publisher::<Image>(contract::IMAGE.name, contract::IMAGE.qos)?;
    let infos = node.publisher::<CameraInfo>(contract::CAMERA_INFO.name, contract::CAMERA_INFO.qos)?;
    let tf = node.publisher::<TFMessage>(contract::TF_STATIC.name, contract::TF_STATIC.qos)?;
    let (camera, mut scene) = holder.with(|cell| (*cell.camera(), cell.scene()));
    let header = stamp::header(holder.stamp(0.0), BASE_FRAME);
    let calibrated = *calibrated;
    tf.send(TFMessage { transforms: vec![convert::camera_transform(&calibrated, header, OPTICAL_FRAME)] });
    let holder = Arc::clone(holder);
    node.spawn("camera", move || {
        // The latched transform lives as long as its publisher.
        let _latched = tf;
        let mut renderer = pictures.renderer(&camera);
        let mut next: u64 = 0;
        while !holder.node().is_shutdown() {
            let (time_s, exposure) = holder.with(|cell| {
                let time_s = cell.time_s();
                (time_s, (time_s * rate_hz >= next as f64).then(|| cell.exposure()))
            });
            let Some(exposure) = exposure else {
                #[allow(clippy::disallowed_methods, reason = "the camera's pace is that of the cell")]
                std::thread::sleep(POLL_PERIOD);
                continue;
            };
            // A dropped frame publishes the picture before; the first frame has none.
            if next == 0 || !exposure.dropped {
                expose(&mut renderer, &mut scene, &camera, &exposure, next);
            }
            next = (time_s * rate_hz).floor() as u64 + 1;
            let header = stamp::header(holder.stamp(time_s), OPTICAL_FRAME);
            infos.send(convert::camera_info(&calibrated, header.clone()));
            images.send(convert::image(&renderer.image, header));
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
