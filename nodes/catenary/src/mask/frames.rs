//! Images from pictures, a bag or the running camera.

use super::args::SourceArgs;
use crate::exit::{Given, WrongInput};
use anyhow::{Context, Result, ensure};
use camera::picture::{LONGEST_SIDE_PX, decode};
use camera::{Converter, convert};
use catenary_bag::{BagMessage, BagReader};
use catenary_core::RgbImage;
use catenary_msgs::Interface;
use catenary_msgs::sensor_msgs::msg::{CompressedImage, Image};
use catenary_shell::{NodeBuilder, RosArgs, Shutdown, contract};
use std::path::Path;
use std::time::Duration;

/// Image and where it is from.
pub struct Frame {
    /// Path of the picture, or number of the image in the bag or of the camera.
    pub name: String,
    /// Pixels.
    pub image: RgbImage,
}

/// Reads the images that a command line names, in their order.
///
/// # Errors
/// A file that is no picture; a bag without images; no image from the camera in time.
pub fn read(arguments: &SourceArgs) -> Result<Vec<Frame>> {
    if arguments.live {
        return live(arguments);
    }
    match &arguments.bag {
        Some(bag) => of_bag(bag, arguments),
        None => arguments.pictures.iter().map(|path| picture(path)).collect(),
    }
}

/// Picture in a file.
pub fn picture(path: &Path) -> Result<Frame> {
    let bytes = catenary_shell::files::read_bytes("picture", path).given()?;
    let named = || format!("picture {}: expected a PNG or JPEG image", path.display());
    let pixels = decode(&bytes).map_err(anyhow::Error::msg).with_context(named).given()?.into_rgb8();
    let (width, height) = pixels.dimensions();
    if width.max(height) > LONGEST_SIDE_PX || width == 0 || height == 0 {
        let name = path.display();
        let expected = format!("sides of 1 to {LONGEST_SIDE_PX} pixels");
        return Err(WrongInput::error(format!("picture {name}: expected {expected}, got {width} x {height}")));
    }
    let image = RgbImage { width, height, data: pixels.into_raw() };
    Ok(Frame { name: path.display().to_string(), image })
}

fn of_bag(path: &Path, arguments: &SourceArgs) -> Result<Vec<Frame>> {
    let bag = BagReader::open(path).given()?;
    let name = absolute(&arguments.topic);
    let of_type = |name: &str| {
        bag.topic(name).filter(|t| is_of_images(&t.topic.type_name)).map(|t| (name.to_owned(), t.messages))
    };
    // A camera that publishes compressed images alone.
    let found = of_type(&name).or_else(|| of_type(&format!("{name}/compressed"))).filter(|(_, messages)| *messages > 0);
    let Some((name, messages)) = found else {
        let has = bag.describe_topics();
        let path = path.display();
        return Err(WrongInput::error(format!(
            "--bag {path}: expected images on {name} (another topic: --topic), got {has}"
        )));
    };
    let wanted = u64::from(arguments.frames).min(messages);
    let mut frames = Vec::new();
    for (i, message) in bag.messages_of(&[name]).enumerate() {
        // The images lie evenly in the bag, the first among them.
        let is_next = i as u64 * wanted >= frames.len() as u64 * messages;
        if (frames.len() as u64) < wanted && is_next {
            let image =
                pixels(&message.given()?).with_context(|| format!("--bag {}: image {i}", path.display())).given()?;
            frames.push(Frame { name: format!("image {i}"), image });
        }
    }
    Ok(frames)
}

fn is_of_images(type_name: &str) -> bool {
    type_name == Image::TYPE_NAME || type_name == CompressedImage::TYPE_NAME
}

fn absolute(topic: &str) -> String {
    if topic.starts_with('/') { topic.to_owned() } else { format!("/{topic}") }
}

fn pixels(message: &BagMessage) -> Result<RgbImage> {
    if message.topic.type_name == CompressedImage::TYPE_NAME {
        return Ok(convert::decompressed(&message.decode()?, false)?);
    }
    raw(&message.decode()?)
}

fn raw(message: &Image) -> Result<RgbImage> {
    let mut converter = Converter::default();
    let view = converter.rgb(convert::view(message, false)?)?;
    let data = (0..view.height()).flat_map(|v| view.row(v)).copied().collect();
    Ok(RgbImage { width: view.width(), height: view.height(), data })
}

fn live(arguments: &SourceArgs) -> Result<Vec<Frame>> {
    let wait = Duration::try_from_secs_f64(arguments.wait_s)
        .map_err(|_| WrongInput::error(format!("--wait-s: expected seconds from 0, got {}", arguments.wait_s)))?;
    let interrupted = Shutdown::new();
    catenary_shell::end_on_signals(&interrupted)?;
    let node = NodeBuilder::new("mask", &RosArgs::default())?.build()?;
    let (topic, qos, wanted) = (&arguments.topic, contract::IMAGE.qos, arguments.frames as usize);
    let mut frames: Vec<Frame> = Vec::new();
    let mut push = |image: RgbImage| {
        let name = format!("image {}", frames.len());
        frames.push(Frame { name, image });
        frames.len() >= wanted
    };
    let silent = || {
        format!(
            "--live: expected images on {topic}, got none in {} s: does the camera run in this domain?",
            arguments.wait_s
        )
    };
    // A queue of one, so that slow work skips images instead of falling behind.
    if topic.ends_with("/compressed") {
        let queue = node.queue::<CompressedImage>(topic, qos, 1)?;
        loop {
            let received = queue.next(wait).with_context(silent)?;
            if push(convert::decompressed(&received.message, false)?) || interrupted.is_triggered() {
                break;
            }
        }
    } else {
        let queue = node.queue::<Image>(topic, qos, 1)?;
        loop {
            let received = queue.next(wait).with_context(silent)?;
            if push(raw(&received.message)?) || interrupted.is_triggered() {
                break;
            }
        }
    }
    ensure!(!frames.is_empty(), "--live: interrupted before the first image");
    Ok(frames)
}
