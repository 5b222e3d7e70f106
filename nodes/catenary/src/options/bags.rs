//! Bags on the command line: `BAG ...`, `--bag BAG ...`, or a mixture of the two.

use anyhow::Result;
use clap::{Arg, ArgAction, ArgMatches, Args, Command, Error, FromArgMatches, value_parser};
use std::path::{Path, PathBuf};

use crate::exit::WrongInput;

/// Identifier of the positional argument.
const PLAIN: &str = "bags";
/// Identifier of the option `--bag`.
const OPTION: &str = "bag";

/// One or more bags, in the order of the command line.
#[derive(Debug, Clone)]
pub struct Bags(Vec<PathBuf>);

impl Bags {
    /// All bags; at least one.
    pub fn all(&self) -> &[PathBuf] {
        &self.0
    }

    /// The only bag. Returns an error if there are several; `what` names the command in its message.
    pub fn one(&self, what: &str) -> Result<&Path> {
        match self.0.as_slice() {
            [bag] => Ok(bag),
            bags => {
                let names: Vec<String> = bags.iter().map(|bag| bag.display().to_string()).collect();
                let (count, names) = (bags.len(), names.join(", "));
                Err(WrongInput::error(format!("{what}: expected one bag, got {count}: {names}")))
            }
        }
    }
}

impl FromArgMatches for Bags {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, Error> {
        let of = |name: &str| {
            let places = matches.indices_of(name).into_iter().flatten();
            places.zip(matches.get_many::<PathBuf>(name).into_iter().flatten().cloned()).collect::<Vec<_>>()
        };
        let mut bags = of(PLAIN);
        bags.extend(of(OPTION));
        // clap keeps the positional argument and the option apart; the indices restore their common order.
        bags.sort_by_key(|(place, _)| *place);
        Ok(Self(bags.into_iter().map(|(_, bag)| bag).collect()))
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

impl Args for Bags {
    fn augment_args(command: Command) -> Command {
        let path = |name| {
            let parser = value_parser!(PathBuf);
            Arg::new(name).value_name("BAG").value_parser(parser).action(ArgAction::Append)
        };
        let help = "Bag: a folder of rosbag2, or an .mcap or .db3 file of one";
        command
            .arg(path(PLAIN).num_args(0..).required_unless_present(OPTION).help(help))
            .arg(path(OPTION).long(OPTION).help("BAG, given as an option"))
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Debug, Parser)]
    struct Line {
        #[command(flatten)]
        bags: Bags,
        #[arg(long)]
        model: Option<String>,
    }

    fn bags(words: &str) -> Result<Vec<String>, Error> {
        let line = Line::try_parse_from(std::iter::once("x").chain(words.split_whitespace()))?;
        Ok(line.bags.all().iter().map(|bag| bag.display().to_string()).collect())
    }

    #[test]
    fn bags_may_stand_alone_or_behind_their_option_and_keep_their_order() {
        assert_eq!(bags("a").unwrap(), ["a"]);
        assert_eq!(bags("--bag a").unwrap(), ["a"]);
        assert_eq!(bags("a b --model m").unwrap(), ["a", "b"]);
        assert_eq!(bags("--bag b --model m a").unwrap(), ["b", "a"]);
        assert_eq!(bags("--bag b --bag c a --bag d").unwrap(), ["b", "c", "a", "d"]);
        assert!(bags("--model m").is_err());
    }

    #[test]
    fn a_command_of_one_bag_names_all_that_it_got() {
        // The error must name every bag: the usual cause is a glob that matched more than expected.
        let bags = Bags(vec!["a".into(), "b".into()]);
        assert_eq!(bags.one("replay").unwrap_err().to_string(), "replay: expected one bag, got 2: a, b");
    }
}
