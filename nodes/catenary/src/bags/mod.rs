//! `catenary record`, `catenary replay`, `catenary info` and `catenary reindex`.

pub mod args;
pub mod info;
mod node;
pub mod order;
pub mod record;
pub mod reindex;
pub mod replay;
