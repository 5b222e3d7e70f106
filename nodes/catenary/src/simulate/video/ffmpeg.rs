//! MP4 files, written by an ffmpeg process from raw frames.

use anyhow::{Context, Result, bail};
use std::ffi::OsString;
use std::io::{ErrorKind, Read, Write};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

/// Filter that pads to even sizes: the pixel format of players shares one colour among four pixels.
const EVEN: &str = "pad=ceil(iw/2)*2:ceil(ih/2)*2";

/// Running ffmpeg process. Dropped without [`Ffmpeg::finish`], it is killed.
pub struct Ffmpeg {
    child: Child,
    named: PathBuf,
}

impl Ffmpeg {
    /// Starts the process.
    pub fn start(file: &Path, named: &Path, [width, height]: [u32; 2], rate_hz: f64) -> Result<Self> {
        // The prefix is needed because ffmpeg takes the part of a name before a colon for a protocol.
        let mut out = OsString::from("file:");
        out.push(file);
        let mut command = Command::new("ffmpeg");
        command
            .args(["-loglevel", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24"])
            .args(["-s", &format!("{width}x{height}"), "-r", &rate_hz.to_string(), "-i", "-", "-an"])
            .args(["-vf", EVEN, "-pix_fmt", "yuv420p", "-movflags", "+faststart"])
            .arg(out)
            // In its own process group, because Ctrl-C ends this program, which then ends ffmpeg.
            .process_group(0)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped());
        match command.spawn() {
            Ok(child) => Ok(Self { child, named: named.to_path_buf() }),
            Err(e) if e.kind() == ErrorKind::NotFound => bail!(
                "--video {}: expected the program ffmpeg on the PATH, which makes .mp4 files, found none; a name that ends in .gif needs no other program",
                named.display()
            ),
            Err(e) => Err(e).context("ffmpeg"),
        }
    }

    /// Sends a frame of RGB bytes.
    pub fn push(&mut self, rgb: &[u8]) -> Result<()> {
        let sent = self.child.stdin.as_mut().map_or(Err(ErrorKind::BrokenPipe.into()), |pipe| pipe.write_all(rgb));
        match sent {
            Ok(()) => Ok(()),
            Err(e) => {
                let said = self.first_words().unwrap_or_else(|| e.to_string());
                bail!("--video {}: ffmpeg: {said}", self.named.display())
            }
        }
    }

    /// Closes the input and waits for the file.
    pub fn finish(mut self) -> Result<()> {
        drop(self.child.stdin.take());
        let said = self.first_words();
        let status = self.child.wait().context("ffmpeg")?;
        if !status.success() {
            bail!("--video {}: ffmpeg: {}", self.named.display(), said.unwrap_or_else(|| status.to_string()));
        }
        Ok(())
    }

    /// First line of its error output, which names the cause of the later ones.
    fn first_words(&mut self) -> Option<String> {
        drop(self.child.stdin.take());
        let mut said = String::new();
        self.child.stderr.take()?.read_to_string(&mut said).ok()?;
        said.lines().find(|l| !l.trim().is_empty()).map(str::to_owned)
    }
}

impl Drop for Ffmpeg {
    fn drop(&mut self) {
        // After a success the process has ended already, and both calls fail without harm.
        let _ended = self.child.kill();
        let _waited = self.child.wait();
    }
}
