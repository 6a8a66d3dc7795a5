//! Walk over every command, by clap's definition, with slips of the keyboard: the error names the true cause, and
//! never denies what exists.

use clap::{Arg, ArgMatches, Command, error::ErrorKind};

use super::{guide, numbers, suggestion::with_tip};

/// A command with its words and its first example.
struct CommandCase<'a> {
    words: &'static str,
    definition: &'a Command,
    example: Vec<String>,
}

fn commands(root: &Command) -> Vec<CommandCase<'_>> {
    let walked = guide::EXAMPLES.iter().map(|&(words, ref lines)| {
        let definition = words.split(' ').fold(root, |command, word| {
            let inner = command.find_subcommand(word);
            inner.unwrap_or_else(|| panic!("there is no command {words}"))
        });
        let line = lines[0].replace("\"out of memory\"", "memory");
        let line = line.split(" > ").next().unwrap_or_default();
        CommandCase {
            words,
            definition,
            example: line.split(' ').map(str::to_owned).collect(),
        }
    });
    walked.collect()
}

/// Returns the error of a command line; `None` where it is understood.
fn refusal(root: &Command, words: &[String]) -> Option<(ErrorKind, String)> {
    let line = with_program(words);
    let error = root.clone().try_get_matches_from(&line).err()?;
    let told = with_tip(error, root, &line);
    Some((told.kind(), told.to_string()))
}

fn with_program(words: &[String]) -> Vec<String> {
    let program = std::iter::once("omnilife".to_owned());
    program.chain(words.iter().cloned()).collect()
}

fn words_of(line: &str) -> Vec<String> {
    line.split(' ').map(str::to_owned).collect()
}

fn required(command: &Command) -> impl Iterator<Item = &Arg> {
    command
        .get_arguments()
        .filter(|argument| argument.is_required_set())
}

/// `--out`, `<SCENE>`.
fn token(argument: &Arg) -> String {
    let names = argument.get_value_names().unwrap_or_default();
    let name = names.first().map(ToString::to_string).unwrap_or_default();
    argument
        .get_long()
        .map_or(format!("<{name}>"), |long| format!("--{long}"))
}

/// Returns the words of an example without an argument.
fn without(example: &[String], argument: &Arg, matches: &ArgMatches) -> Vec<String> {
    let mut words = example.to_vec();
    let Some(long) = argument.get_long() else {
        let values = matches.get_raw(argument.get_id().as_str());
        for value in values.into_iter().flatten() {
            let at = words.iter().rposition(|word| value == word.as_str());
            words.remove(at.unwrap_or_else(|| panic!("{value:?} is not in {example:?}")));
        }
        return words;
    };
    let option = format!("--{long}");
    let at = words
        .iter()
        .position(|word| word.split('=').next() == Some(option.as_str()));
    let at = at.unwrap_or_else(|| panic!("{option} is not in {example:?}"));
    let takes_next = argument.get_action().takes_values() && words[at] == option;
    words.drain(at..=at + usize::from(takes_next));
    words
}

#[test]
fn without_arguments_every_required_one_is_named() {
    let root = guide::command();
    for command in commands(&root) {
        let Some((kind, text)) = refusal(&root, &words_of(command.words)) else {
            assert_eq!(required(command.definition).count(), 0, "{}", command.words);
            continue;
        };
        assert_eq!(
            kind,
            ErrorKind::MissingRequiredArgument,
            "{}: {text}",
            command.words
        );
        for argument in required(command.definition) {
            assert!(text.contains(&token(argument)), "{}: {text}", command.words);
        }
    }
}

#[test]
fn one_missing_argument_is_named() {
    let root = guide::command();
    for command in commands(&root) {
        let parsed = root
            .clone()
            .try_get_matches_from(with_program(&command.example));
        let parsed = parsed.unwrap_or_else(|error| panic!("{}: {error}", command.words));
        let mut matches = &parsed;
        for word in command.words.split(' ') {
            matches = matches.subcommand_matches(word).unwrap_or(matches);
        }
        for argument in required(command.definition) {
            let words = without(&command.example, argument, matches);
            let refused = refusal(&root, &words);
            let (kind, text) = refused.unwrap_or_else(|| panic!("{words:?} was understood"));
            assert_eq!(
                kind,
                ErrorKind::MissingRequiredArgument,
                "{words:?}: {text}"
            );
            // A positional argument takes the place of the one before it.
            let is_alike = |other: &&Arg| match argument.get_long() {
                Some(_) => other.get_id() == argument.get_id(),
                None => other.get_long().is_none(),
            };
            let mut named = required(command.definition).filter(is_alike);
            assert!(
                named.any(|one| text.contains(&token(one))),
                "{words:?}: {text}"
            );
        }
    }
}

#[test]
fn a_misspelt_command_gets_the_right_one() {
    let root = guide::command();
    for command in commands(&root) {
        let mut line = command.words.to_owned();
        line.pop();
        let refused = refusal(&root, &words_of(&line));
        let (kind, text) = refused.unwrap_or_else(|| panic!("{line} was understood"));
        assert_eq!(kind, ErrorKind::InvalidSubcommand, "{line}: {text}");
        assert!(
            text.contains(&format!("'omnilife {}'", command.words)),
            "{line}: {text}"
        );
    }
}

#[test]
fn a_misspelt_option_gets_the_right_one_and_an_unknown_value_is_named() {
    const VALUE: &str = "nonsense!";
    let root = guide::command();
    let mut values = 0;
    for CommandCase {
        words, definition, ..
    } in commands(&root)
    {
        let refused = |word: String| {
            let parsed = definition
                .clone()
                .try_get_matches_from(["omnilife".to_owned(), word]);
            let error = parsed.err().map(|error| (error.kind(), error.to_string()));
            error.unwrap_or((ErrorKind::DisplayHelp, String::new()))
        };
        let longs: Vec<&str> = definition
            .get_arguments()
            .filter_map(Arg::get_long)
            .collect();
        for argument in definition.get_arguments() {
            let Some(long) = argument.get_long() else {
                continue;
            };
            let option = format!("--{long}");
            let typo = &long[..long.len() - 1];
            if !longs.contains(&typo) {
                let (kind, text) = refused(format!("--{typo}"));
                assert_eq!(kind, ErrorKind::UnknownArgument, "{words} --{typo}: {text}");
                assert!(text.contains(&option), "{words} --{typo}: {text}");
            }
            if !argument.get_action().takes_values() {
                continue;
            }
            let (kind, text) = refused(format!("{option}={VALUE}"));
            if matches!(kind, ErrorKind::InvalidValue | ErrorKind::ValueValidation) {
                values += 1;
                assert!(
                    text.contains(&option) && text.contains(VALUE),
                    "{words} {option}: {text}"
                );
                for known in argument.get_possible_values() {
                    assert!(text.contains(known.get_name()), "{words} {option}: {text}");
                }
            } else {
                assert!(
                    argument.get_possible_values().is_empty(),
                    "{words} {option}: {text}"
                );
            }
        }
    }
    assert!(values > 30, "{values} options check their values");
}

#[test]
fn a_number_out_of_range_names_its_option_and_what_it_accepts() {
    let root = guide::command();
    let mut refused = 0;
    for CommandCase {
        words, definition, ..
    } in commands(&root)
    {
        let options = definition
            .get_arguments()
            .filter(|argument| numbers::is_number(argument));
        for option in options.filter_map(Arg::get_long) {
            let option = format!("--{option}");
            for value in ["-4", "nonsense!"] {
                let line = ["omnilife", option.as_str(), value];
                let Err(error) = definition.clone().try_get_matches_from(line) else {
                    panic!("{words} {option} {value} was understood");
                };
                let text = error.to_string();
                // Only times and angles are negative: then a required argument is missing.
                let is_accepted = error.kind() == ErrorKind::MissingRequiredArgument;
                if value == "-4" && is_accepted {
                    continue;
                }
                refused += 1;
                assert_eq!(error.kind(), ErrorKind::ValueValidation, "{words}: {text}");
                for part in [option.as_str(), value, "must be"] {
                    assert!(text.contains(part), "{words} {option}: {text}");
                }
            }
        }
    }
    assert!(refused > 150, "{refused} values were refused");
}
