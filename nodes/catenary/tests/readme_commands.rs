//! Commands in the documents of the repository: the command line must accept each of them. A renamed option or command
//! would otherwise survive in the documents.
#![allow(
    clippy::disallowed_methods,
    clippy::unwrap_used,
    reason = "a test reads the workspace, and a failure is a panic"
)]

use catenary::check_command_line;
use clap::error::ErrorKind;
use std::path::{Path, PathBuf};

/// Command of this program in a document.
#[derive(Debug, PartialEq)]
struct Command {
    /// Arguments, with placeholders replaced.
    words: Vec<String>,
    /// True for a line of a code block. A command within a sentence may leave out required arguments.
    is_whole: bool,
}

/// Commands of this program in a Markdown text.
fn commands(text: &str) -> Vec<Command> {
    let mut found = Vec::new();
    let mut prose = String::new();
    let mut block = String::new();
    let mut in_fence = false;
    for line in text.lines() {
        let is_fence = line.trim_start().starts_with("```");
        in_fence ^= is_fence;
        // Lists continue with an indentation, too, but no command of this program starts such a line.
        let is_code = !is_fence && (in_fence || line.starts_with("    "));
        let (own, other) = if is_code { (&mut block, &mut prose) } else { (&mut prose, &mut block) };
        own.push_str(if is_fence { "" } else { line });
        own.push('\n');
        other.push('\n');
    }
    for line in block.replace("\\\n", " ").lines() {
        found.extend(of_line(line, true));
    }
    // Code spans are the odd parts between back quotes, and may be broken over lines.
    for paragraph in prose.split("\n\n") {
        for span in paragraph.split('`').skip(1).step_by(2) {
            found.extend(of_line(&span.replace('\n', " "), false));
        }
    }
    found
}

/// Commands of this program in a line of shell.
fn of_line(line: &str, is_whole: bool) -> Vec<Command> {
    // A dollar sign marks a prompt, and a number sign after blanks a comment.
    let line = line.trim().trim_start_matches("$ ");
    let line = line.split(" # ").next().unwrap_or(line);
    let line = line.split_once("  #").map_or(line, |(before, _)| before);
    let parts = line.split("&&").flat_map(|part| part.split(';')).flat_map(|part| part.split(" | "));
    let command = |words: Vec<String>| {
        // Dots stand for further arguments.
        let is_whole = is_whole && !words.iter().any(|word| word == "...");
        let words = words.iter().map(|word| substituted(word)).filter(|word| word != "...").collect();
        Command { words, is_whole }
    };
    parts.filter_map(arguments).map(command).collect()
}

/// Arguments of a shell command, if it runs this program.
fn arguments(command: &str) -> Option<Vec<String>> {
    let words = shlex::split(command)?;
    let mut words = words.into_iter().skip_while(|word| word.split_once('=').is_some_and(|(name, _)| is_name(name)));
    match words.next()?.as_str() {
        program if program == "catenary" || program.ends_with("release/catenary") => {}
        "cargo" => {
            let rest: Vec<String> = words.by_ref().take_while(|word| word != "--").collect();
            let is_ours = rest.first().is_some_and(|word| word == "run") && rest.iter().all(|word| word != "-p");
            if !is_ours {
                return None;
            }
        }
        _ => return None,
    }
    Some(words.collect())
}

/// True for the name of an environment variable.
fn is_name(text: &str) -> bool {
    !text.is_empty() && text.chars().all(|c| c.is_ascii_uppercase() || c.is_ascii_digit() || c == '_')
}

/// Word without the brackets of an optional argument, and with a placeholder of a command or a number replaced.
fn substituted(word: &str) -> String {
    match word.trim_matches(['<', '>', '[', ']']) {
        "COMMAND" => "infer".to_owned(),
        "NAME=VALUE" => "name=1".to_owned(),
        "N" | "NUMBER" | "SEED" => "1".to_owned(),
        other => other.to_owned(),
    }
}

/// Error of the command line for a command, if it is an error of the document.
fn refusal(command: &Command) -> Option<String> {
    let words = std::iter::once("catenary".to_owned()).chain(command.words.iter().cloned());
    let error = check_command_line(words).err()?;
    let is_incomplete = matches!(
        error.kind(),
        ErrorKind::MissingRequiredArgument
            | ErrorKind::MissingSubcommand
            | ErrorKind::InvalidValue
            | ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand
    );
    let is_fine = matches!(error.kind(), ErrorKind::DisplayHelp | ErrorKind::DisplayVersion)
        // Within a sentence, an option may stand without its value, and a command without its arguments.
        || !command.is_whole && is_incomplete;
    (!is_fine).then(|| format!("catenary {}: {error}", command.words.join(" ")))
}

/// Markdown files below a folder, without those of build outputs and of other projects.
fn documents(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        // Other folders with a leading dot hold environments and builds.
        let is_ours = name == ".github" || !name.starts_with('.') && name != "target";
        if path.is_dir() && is_ours {
            found.extend(documents(&path));
        } else if name.ends_with(".md") {
            found.push(path);
        }
    }
    found
}

#[test]
fn every_command_of_a_document_is_accepted() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let (mut all, mut refused) = (0, Vec::new());
    for path in documents(&root) {
        for command in commands(&std::fs::read_to_string(&path).unwrap()) {
            all += 1;
            refused.extend(refusal(&command).map(|error| format!("{}: {error}", path.display())));
        }
    }
    assert!(refused.is_empty(), "{}", refused.join("\n"));
    // Far more than one document has: the extractor finds the commands of all.
    assert!(all > 50, "found {all} commands");
}

#[test]
fn commands_are_found_in_blocks_and_spans_with_their_placeholders() {
    let text = "Run `catenary COMMAND --help`, or\n\n```sh\nA=1 catenary infer BAG --model m \\\n  --out o   # note\n\
                cargo build && cargo run --release -- effects\ncargo run -p other -- effects\n```\n\n\
                Then `catenary simulate --model m\n--theta NAME=VALUE`.\n\n    $ catenary status\n    other catenary\n";
    let words = |text: &str| text.split(' ').map(str::to_owned).collect::<Vec<_>>();
    let found: Vec<(Vec<String>, bool)> = commands(text).into_iter().map(|c| (c.words, c.is_whole)).collect();
    let expected = [
        (words("infer BAG --model m --out o"), true),
        (words("effects"), true),
        (words("status"), true),
        (words("infer --help"), false),
        (words("simulate --model m --theta name=1"), false),
    ];
    assert_eq!(found, expected);
}

#[test]
fn a_wrong_option_or_command_is_refused() {
    let refused = |text: &str| commands(text).iter().filter_map(refusal).count();
    assert_eq!(refused("    catenary infer BAG --modle m --out o\n"), 1, "a misspelt option in a block");
    assert_eq!(refused("    catenary infer BAG --model m\n"), 1, "a missing argument in a block");
    assert_eq!(refused("`catenary infer --modle m`"), 1, "a misspelt option in a sentence");
    assert_eq!(refused("`catenary inferr`"), 1, "a misspelt command in a sentence");
    assert_eq!(refused("`catenary infer --node`, `catenary replay BAG --clock`"), 0);
    assert_eq!(refused("    catenary find-effects BAG [MORE ...] [--verify UNSEEN] --model M --out o\n"), 0);
    assert_eq!(refused("    catenary infer A B ...\n"), 0);
}
