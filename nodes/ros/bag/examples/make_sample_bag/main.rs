//! Program that writes the sample bag into a new folder: `make_sample_bag FOLDER`.

mod swing;

use std::path::PathBuf;
use std::process::ExitCode;

#[allow(clippy::disallowed_methods, reason = "a main reads the command line")]
#[allow(clippy::print_stdout, reason = "results go to stdout")]
fn main() -> ExitCode {
    let Some(folder) = std::env::args_os().nth(1).map(PathBuf::from) else {
        eprintln!("usage: make_sample_bag FOLDER");
        return ExitCode::from(2);
    };
    match swing::write_bag(&folder) {
        Ok(summary) => {
            println!("{}: {} messages", summary.path.display(), summary.messages);
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("make_sample_bag: {error}");
            ExitCode::FAILURE
        }
    }
}
