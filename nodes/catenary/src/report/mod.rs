//! HTML reports: one page each, with every picture inside it.

pub mod aim;
mod estimate;
mod fit;
mod html;
pub mod number;
pub mod palette;
pub mod plots;
pub mod posterior;
pub mod quantity;
mod svg;
mod ticks;

pub use estimate::Estimate;
pub use fit::RecordedFit;
pub use html::{Mark, Page, Picture};
