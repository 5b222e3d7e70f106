//! The report: one HTML page with every picture inside it.

mod html;
pub mod plots;

pub use html::{Mark, Page, Picture};
