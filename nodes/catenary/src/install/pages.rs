//! Shell completions and man pages, generated from the command line's definition.

use crate::cli::Cli;
use clap::{Command, CommandFactory};
use clap_complete::{Shell, generate};
use std::io::Result;

/// Name of the program.
const PROGRAM: &str = "catenary";

/// Paths below `share/` that bash-completion, zsh and fish search, and their shells.
const COMPLETIONS: [(&str, Shell); 3] = [
    (BASH, Shell::Bash),
    ("zsh/site-functions/_catenary", Shell::Zsh),
    ("fish/vendor_completions.d/catenary.fish", Shell::Fish),
];

/// Path of the bash completions below `share/`.
pub const BASH: &str = "bash-completion/completions/catenary";
/// Folder of the zsh completions below `share/`.
pub const ZSH: &str = "zsh/site-functions";

/// Completions: paths below `share/`, and contents.
pub fn completions() -> Vec<(String, Vec<u8>)> {
    let one = |(path, shell): (&str, Shell)| {
        let mut text = Vec::new();
        generate(shell, &mut Cli::command(), PROGRAM, &mut text);
        (path.to_owned(), text)
    };
    COMPLETIONS.into_iter().map(one).collect()
}

/// Man pages of the program and of each command: paths below `share/`, and contents.
pub fn man_pages() -> Result<Vec<(String, Vec<u8>)>> {
    let mut root = Cli::command();
    root.build();
    let mut pages = Vec::new();
    pages_of(&root, PROGRAM, &mut pages)?;
    Ok(pages)
}

/// Adds the pages of a command and of its subcommands.
fn pages_of(command: &Command, name: &str, pages: &mut Vec<(String, Vec<u8>)>) -> Result<()> {
    let mut text = Vec::new();
    // The page of `infer` is called `catenary-infer`, as git names the pages of its commands.
    clap_mangen::Man::new(command.clone().display_name(name)).title(name.to_uppercase()).render(&mut text)?;
    pages.push((format!("man/man1/{name}.1"), text));
    for below in command.get_subcommands().filter(|below| below.get_name() != "help") {
        pages_of(below, &format!("{name}-{}", below.get_name()), pages)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_command_has_a_page_and_is_completed() {
        let pages = man_pages().unwrap();
        let names: Vec<&str> = pages.iter().map(|(path, _)| path.as_str()).collect();
        assert!(
            names.contains(&"man/man1/catenary.1") && names.contains(&"man/man1/catenary-bench-pool.1"),
            "{names:?}"
        );
        let completions = completions();
        for command in Cli::command().get_subcommands().map(|c| c.get_name().to_owned()) {
            assert!(names.contains(&format!("man/man1/catenary-{command}.1").as_str()), "{command}");
            for (path, text) in &completions {
                assert!(String::from_utf8_lossy(text).contains(&command), "{path} lacks {command}");
            }
        }
        for (path, text) in pages {
            let text = String::from_utf8(text).unwrap();
            assert!(text.contains(".TH ") && text.contains(".SH SYNOPSIS"), "{path}: {text}");
        }
    }
}
