//! The simulated camera: a picture at every frame, on a thread of its own so that the arm's loop keeps its pace.

use crate::cell::Cell;
use crate::convert;
use crate::render::Renderer;
use anyhow::Result;
use catenary_msgs::sensor_msgs::msg::{CameraInfo, Image};
use catenary_msgs::tf2_msgs::msg::TFMessage;
use catenary_shell::{contract, stamp};
use panda_bridge::gate::BASE_FRAME;
use panda_bridge::node::front::Front;
use std::sync::Arc;
use std::time::Duration;

/// Frame of the camera, as realsense2_camera calls it.
const OPTICAL_FRAME: &str = "camera_color_optical_frame";
/// How often the thread looks whether a frame is due.
const LOOK: Duration = Duration::from_millis(2);

/// Starts the camera at `rate_hz`, with image noise in grey levels.
pub fn start(front: &Arc<Front<Cell>>, rate_hz: f64, noise_levels: f64, noise_seed: u64) -> Result<()> {
    let node = front.node();
    let images = node.publisher::<Image>(contract::IMAGE.name, contract::IMAGE.qos)?;
    let infos = node.publisher::<CameraInfo>(contract::CAMERA_INFO.name, contract::CAMERA_INFO.qos)?;
    let tf = node.publisher::<TFMessage>(contract::TF_STATIC.name, contract::TF_STATIC.qos)?;
    let (camera, mut scene) = {
        let arm = front.arm();
        (*arm.plant().camera(), arm.plant().scene())
    };
    let header = stamp::header(front.stamp(0.0), BASE_FRAME);
    tf.send(TFMessage { transforms: vec![convert::camera_transform(&camera, header, OPTICAL_FRAME)] });
    let front = Arc::clone(front);
    node.spawn("camera", move || {
        // The latched transform lives as long as its publisher.
        let _latched = tf;
        let mut renderer = Renderer::new(camera.image_width_px, camera.image_height_px, noise_levels, noise_seed);
        let mut next: u64 = 0;
        while !front.node().is_shutdown() {
            let (time_s, snapshot) = {
                let arm = front.arm();
                let time_s = arm.plant().time_s();
                (time_s, (time_s * rate_hz >= next as f64).then(|| arm.plant().snapshot()))
            };
            let Some(snapshot) = snapshot else {
                #[allow(clippy::disallowed_methods, reason = "the camera's pace is that of the cell")]
                std::thread::sleep(LOOK);
                continue;
            };
            scene.update(snapshot.grip, &snapshot.nodes);
            renderer.draw(&scene, &camera, next);
            next = (time_s * rate_hz).floor() as u64 + 1;
            let header = stamp::header(front.stamp(time_s), OPTICAL_FRAME);
            infos.send(convert::camera_info(&camera, header.clone()));
            images.send(convert::image(&renderer.image, header));
        }
    })?;
    Ok(())
}
