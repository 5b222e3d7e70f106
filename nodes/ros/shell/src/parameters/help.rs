//! Text of a node's `--help`.

use super::kinds::in_words;
use super::store::Params;
use std::fmt::Write as _;
use std::io::Write as _;

/// Prints the parameters to stdout.
pub(crate) fn print_help(headline: &str, params: &Params) {
    let mut text = format!("{headline}\n\nParameters:\n");
    for description in params.names().iter().filter_map(|name| params.describe(name)) {
        let value = in_words(&description.value);
        let _ = writeln!(text, "  {} = {value}\n      {}", description.name, description.spec.in_words());
    }
    let _closed = std::io::stdout().lock().write_all(text.as_bytes());
}
