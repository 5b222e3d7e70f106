//! `catenary import-track`: a bag from a track in a CSV file.

pub mod args;

use crate::exit::Given;
use crate::inputs::model_file;
use crate::terminal::output;
use anyhow::Result;
use args::ImportArgs;
use serde::Serialize;
use std::path::PathBuf;

/// Result of `catenary import-track`.
#[derive(Debug, Serialize)]
struct Imported {
    bag: PathBuf,
    messages: u64,
    duration_s: f64,
    /// Doubts about the track.
    warnings: Vec<String>,
}

/// Reads the track and writes the bag.
pub fn run(arguments: &ImportArgs) -> Result<()> {
    let model = model_file::read(&arguments.model)?;
    let name = arguments.track.display().to_string();
    let text = catenary_shell::files::read_text("track", &arguments.track).given()?;
    let catenary_bag::Imported { bag: summary, warnings } =
        catenary_bag::import_track(&name, &text, &model, &arguments.out)?;
    let imported = Imported {
        bag: arguments.out.clone(),
        messages: summary.messages,
        duration_s: summary.span_ns.map_or(0.0, |(first, last)| (last - first) as f64 * 1e-9),
        warnings,
    };
    output::result(&arguments.output, &imported, |i| {
        let made = format!("{}: {} messages over {:.2} s", i.bag.display(), i.messages, i.duration_s);
        [made].into_iter().chain(i.warnings.iter().map(|w| format!("warning: {w}"))).collect::<Vec<_>>().join("\n")
    })
}
