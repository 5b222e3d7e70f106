//! Output of commands. Results go to stdout, as text or as JSON, and to files that are tested before the work begins.
//! Everything else goes to stderr.

use crate::exit::{Given, WrongInput, is_of_machine};
use crate::options::Output;
use anyhow::{Context, Result};
use catenary_shell::files;
use serde::Serialize;
use std::fs;
use std::io::{IsTerminal, Write};
use std::path::Path;

/// Prints a result: as one JSON document with `--json`, else as text.
pub fn result<T: Serialize>(output: &Output, value: &T, text: impl FnOnce(&T) -> String) -> Result<()> {
    let is_terminal = std::io::stdout().is_terminal();
    let words = match output.json {
        true => serde_json::to_string_pretty(value)?,
        false => fitted(&text(value), is_terminal),
    };
    print(&words)
}

/// Prints a text and a line break.
pub fn print(words: &str) -> Result<()> {
    let mut stdout = std::io::stdout().lock();
    match writeln!(stdout, "{words}") {
        // The reader of the pipe has gone: no error for the user.
        Err(e) if e.kind() == std::io::ErrorKind::BrokenPipe => Ok(()),
        other => Ok(other?),
    }
}

/// Prints results: one as [`result`] does, several as a list, or as texts separated by an empty line.
pub fn one_or_several<T: Serialize>(output: &Output, values: &[T], text: impl Fn(&T) -> String) -> Result<()> {
    match values {
        [value] => result(output, value, text),
        several => result(output, &several, |values| values.iter().map(text).collect::<Vec<_>>().join("\n\n")),
    }
}

/// Prints a warning for the user.
pub fn warn(line: &str) {
    tell(&format!("catenary: warning: {line}"));
}

/// Prints a line for the user on stderr.
pub fn tell(line: &str) {
    let is_terminal = std::io::stderr().is_terminal();
    let _closed = writeln!(std::io::stderr(), "{}", fitted(line, is_terminal));
}

/// Creates the folder of a file that is written at the end of the work. Returns an error if the file cannot be written.
/// An existing file is not changed.
pub fn prepare(file: &Path) -> Result<()> {
    // A full disk is no wrong input.
    let is_of_path = |e: &anyhow::Error| e.downcast_ref().is_none_or(|e: &std::io::Error| !is_of_machine(e));
    try_out(file).given_if(is_of_path)
}

/// Like [`prepare`], for a file that the user named by itself: a misspelt folder is an error and is not created.
pub fn prepare_file(option: &str, file: &Path) -> Result<()> {
    let folder = file.parent().filter(|folder| !folder.as_os_str().is_empty() && !folder.exists());
    if let Some(folder) = folder {
        let (hint, shown) = (catenary_shell::files::hint(folder), folder.display());
        let what = format!("--{option} {}: there is no folder {shown}{hint}", file.display());
        return Err(WrongInput::error(format!("{what}; to make it: mkdir -p {shown}")));
    }
    prepare(file)
}

fn try_out(file: &Path) -> Result<()> {
    if let Some(folder) = file.parent().filter(|f| !f.as_os_str().is_empty()) {
        fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    }
    files::check_writable(file).with_context(|| format!("{}: it cannot be written", file.display()))
}

/// Width of a terminal, columns.
const WIDTH: usize = 80;
/// Indentation of the rest of a broken line.
const REST: &str = "    ";

/// Text for people. Long lines are broken between words on a terminal. In a pipe they stay whole, for programs.
fn fitted(text: &str, is_terminal: bool) -> String {
    if !is_terminal {
        return text.to_owned();
    }
    let line = |line: &str| match line.chars().count() {
        0..=WIDTH => line.to_owned(),
        _ => wrapped(line, WIDTH - REST.len()).join(&format!("\n{REST}")),
    };
    text.split('\n').map(line).collect::<Vec<_>>().join("\n")
}

/// Lines of at most `width` columns; a longer word has its own line.
pub fn wrapped(text: &str, width: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split(' ') {
        match lines.last_mut() {
            Some(line) if line.chars().count() + 1 + word.chars().count() <= width => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_named_file_in_a_misspelt_folder_makes_no_folder() {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("policies")).unwrap();
        prepare_file("out", &folder.path().join("policies/pi0")).unwrap();
        let error = prepare_file("out", &folder.path().join("polices/pi0")).unwrap_err();
        let (text, right) = (error.to_string(), folder.path().join("policies"));
        assert!(WrongInput::is(&error) && text.contains(&format!("did you mean `{}`?", right.display())), "{text}");
        assert!(text.contains("mkdir -p") && !folder.path().join("polices").exists(), "{text}");
    }

    #[test]
    fn a_terminal_gets_lines_that_fit_and_a_pipe_whole_ones() {
        let long = format!("short\n  a  table  row\n{}", "word ".repeat(30).trim());
        assert_eq!(fitted(&long, false), long);
        let fit = fitted(&long, true);
        assert!(
            fit.starts_with("short\n  a  table  row\nword") && fit.lines().all(|line| line.len() <= WIDTH),
            "{fit}"
        );
        assert_eq!(fit.lines().count(), 4);
        assert_eq!(fit.split_whitespace().count(), long.split_whitespace().count());
    }

    #[test]
    fn long_texts_are_wrapped_between_words() {
        assert_eq!(wrapped("one two three", 7), ["one two", "three"]);
        assert_eq!(wrapped("incomprehensibilities", 7), ["incomprehensibilities"]);
        assert_eq!(wrapped("", 7), [""]);
    }

    #[test]
    fn a_file_that_cannot_be_written_is_refused_before_the_work() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("not/yet/there.json");
        prepare(&file).unwrap();
        assert!(file.parent().unwrap().is_dir() && !file.exists(), "the folder is made, the file is left to the work");
        fs::write(&file, "old").unwrap();
        prepare(&file).unwrap();
        assert_eq!(fs::read_to_string(&file).unwrap(), "old");
        let below = prepare(&file.join("x")).unwrap_err();
        assert!(format!("{below:#}").contains("there.json"), "{below:#}");
        let taken = prepare(file.parent().unwrap()).unwrap_err();
        assert!(format!("{taken:#}").contains("yet: it cannot be written"), "{taken:#}");
    }
}
