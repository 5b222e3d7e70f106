//! Option `--report`: a page of the results.

use crate::exit::Given;
use crate::report::Page;
use crate::terminal::output;
use anyhow::{Context, Result};
use clap::Args;
use std::path::PathBuf;

/// Page of the results.
#[derive(Debug, Args)]
pub struct ReportPage {
    /// Page with pictures of the results to write (HTML)
    #[arg(long)]
    pub report: Option<PathBuf>,
}

impl ReportPage {
    /// Returns an error unless the page can be written, before the work that it tells of.
    pub fn prepare(&self) -> Result<()> {
        self.report.as_deref().map_or(Ok(()), |path| output::prepare_file("report", path)).given()
    }

    /// Writes the page, if one was asked for.
    pub fn write(&self, page: impl FnOnce() -> Result<Page>) -> Result<()> {
        let Some(path) = &self.report else { return Ok(()) };
        std::fs::write(path, page()?.finish()).with_context(|| path.display().to_string())?;
        output::tell(&format!("report: {}", path.display()));
        Ok(())
    }
}
