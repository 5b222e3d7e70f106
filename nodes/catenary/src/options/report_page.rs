//! Option `--report`: a page of the results.

use crate::exit::WrongInput;
use crate::report::Page;
use crate::terminal::output;
use anyhow::Result;
use catenary_shell::files;
use clap::Args;
use std::path::{Path, PathBuf};

/// Page of the results.
#[derive(Debug, Args)]
pub struct ReportPage {
    /// Page with pictures of the results to write (HTML)
    #[arg(long)]
    pub report: Option<PathBuf>,
}

impl ReportPage {
    /// Returns an error unless the page can be written, before the work that it tells of. It may replace none of `others`, the command's other
    /// files.
    pub fn prepare<'a>(&self, others: impl IntoIterator<Item = &'a Path>) -> Result<()> {
        let Some(path) = self.report.as_deref() else { return Ok(()) };
        let whole = |path: &Path| std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
        if others.into_iter().any(|other| whole(other) == whole(path)) {
            let shown = path.display();
            return Err(WrongInput::error(format!(
                "--report {shown}: expected a file of its own, got another file of the command"
            )));
        }
        output::prepare_file("report", path)
    }

    /// Writes the page, if one was asked for.
    pub fn write(&self, page: impl FnOnce() -> Result<Page>) -> Result<()> {
        let Some(path) = &self.report else { return Ok(()) };
        files::write(path, page()?.finish())?;
        output::tell(&format!("report: {}", path.display()));
        Ok(())
    }
}
