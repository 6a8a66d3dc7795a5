//! Suggestions for commands and options that do not exist.

use std::path::Path;

use clap::{
    Arg, Command,
    builder::StyledStr,
    error::{ContextKind, ContextValue, ErrorKind},
};
use omnilife_schemas::names::UnknownName;

use super::guide;

/// The error with a tip where the word that was not understood names a command of another group, or
/// nearly names one of `curate`, which takes words for videos. A short option that is not known gets the long ones
/// with its letter.
pub(crate) fn with_tip(error: clap::Error, command: &Command, words: &[String]) -> clap::Error {
    if let Some(letter) = unknown_letter(&error) {
        return with_long_options(error, letter, command, words);
    }
    let Some(word) = unknown_word(&error, command, words) else {
        return error;
    };
    let tips = commands_like(&word, command);
    if tips.is_empty() {
        return error;
    }
    let lines: String = tips
        .iter()
        .map(|tip| format!("\n  tip: there is a command 'omnilife {tip}'"))
        .collect();
    // The command formats it, in its own colours.
    command.clone().error(
        ErrorKind::InvalidSubcommand,
        format!("unrecognized command '{word}'\n{lines}"),
    )
}

/// Returns the tip for a video of `curate` that is not a file, and may be a slip of the keys for a command.
pub(crate) fn tip_for_video(video: &Path) -> Option<String> {
    let word = video.to_str().filter(|word| is_bare_word(word))?;
    if video.exists() {
        return None;
    }
    let tips = commands_like(word, &guide::command());
    let tip = tips.iter().find(|tip| tip.starts_with("curate "))?;
    Some(format!(
        "{word}: does not exist; there is a command 'omnilife {tip}'"
    ))
}

fn is_bare_word(word: &str) -> bool {
    word.chars().all(|letter| letter.is_ascii_lowercase())
}

/// The word that was taken for a command, or for a video of `curate` where nothing else was given.
fn unknown_word(error: &clap::Error, command: &Command, words: &[String]) -> Option<String> {
    match (error.kind(), error.get(ContextKind::InvalidSubcommand)) {
        (ErrorKind::InvalidSubcommand, Some(ContextValue::String(word))) => Some(word.clone()),
        (ErrorKind::MissingRequiredArgument, _) => {
            let after = words.iter().skip_while(|word| *word != "curate").nth(1)?;
            // What is missing is an argument of a command that exists.
            let is_command = (command.find_subcommand("curate"))
                .is_some_and(|curate| curate.find_subcommand(after).is_some());
            (is_bare_word(after) && !is_command && !Path::new(after).exists())
                .then(|| after.clone())
        }
        _ => None,
    }
}

/// Returns the letter of a short option that is not known, as in `-o`.
fn unknown_letter(error: &clap::Error) -> Option<char> {
    let Some(ContextValue::String(option)) = error.get(ContextKind::InvalidArg) else {
        return None;
    };
    let mut letters = option.strip_prefix('-')?.chars();
    let letter = letters.next().filter(char::is_ascii_alphabetic)?;
    (error.kind() == ErrorKind::UnknownArgument && letters.next().is_none()).then_some(letter)
}

/// Names the long options with this first letter, in place of the advice to pass the letter as a value.
fn with_long_options(
    mut error: clap::Error,
    letter: char,
    command: &Command,
    words: &[String],
) -> clap::Error {
    let mut asked = command;
    for word in words.iter().skip(1) {
        asked = asked.find_subcommand(word).unwrap_or(asked);
    }
    let options = asked.get_arguments().filter_map(Arg::get_long);
    let mut tips = options
        .filter(|long| long.starts_with(letter))
        .map(|long| StyledStr::from(format!("options have long names: '--{long}'")))
        .peekable();
    if tips.peek().is_some() {
        error.insert(
            ContextKind::Suggested,
            ContextValue::StyledStrs(tips.collect()),
        );
    }
    error
}

/// Commands whose last word is this one, or else those that it may be a slip of the keys for.
fn commands_like(word: &str, command: &Command) -> Vec<String> {
    let all = guide::all_words(command);
    let last = |words: &String| words.rsplit(' ').next().unwrap_or_default().to_owned();
    let names: Vec<String> = all.iter().map(last).collect();
    let meant = UnknownName::new("command", word, names.iter().map(String::as_str)).meant;
    let name = meant.unwrap_or_else(|| word.to_owned());
    all.into_iter()
        .filter(|words| last(words) == name)
        .collect()
}

#[cfg(test)]
mod tests {
    use clap::FromArgMatches;

    use super::*;
    use crate::cli::Cli;

    fn told(line: &str) -> String {
        let words: Vec<String> = line.split(' ').map(str::to_owned).collect();
        let command = guide::command();
        let parsed = command
            .clone()
            .try_get_matches_from(&words)
            .and_then(|matches| Cli::from_arg_matches(&matches));
        match parsed {
            Ok(cli) => panic!("{line} was understood: {cli:?}"),
            Err(error) => with_tip(error, &command, &words).to_string(),
        }
    }

    #[test]
    fn commands_of_other_groups_are_named() {
        assert!(told("omnilife train").contains("'omnilife reconstruct train'"));
        assert!(told("omnilife score").contains("'omnilife bench score'"));
        assert!(told("omnilife rnu").contains("'omnilife run'"));
        assert!(told("omnilife bench render").contains("'omnilife reconstruct render'"));
    }

    /// An error about a command's arguments never denies the command.
    #[test]
    fn what_is_missing_of_any_command_is_named() {
        let command = guide::command();
        for words in guide::all_words(&command) {
            let line = format!("omnilife {words}");
            let parts: Vec<String> = line.split(' ').map(str::to_owned).collect();
            let parsed = command.clone().try_get_matches_from(&parts);
            if let Err(error) = parsed {
                let text = with_tip(error, &command, &parts).to_string();
                assert!(!text.contains("unrecognized"), "{line}: {text}");
            }
        }
    }

    #[test]
    fn a_mistyped_command_of_curate_is_no_video() {
        assert!(told("omnilife curate probbe").contains("'omnilife curate probe'"));
        assert!(told("omnilife curate verfy").contains("'omnilife curate verify'"));
        // What has nothing to do with any command is a missing option, as it was.
        assert!(told("omnilife curate xyz").contains("--out"));
        let tip = tip_for_video(Path::new("verfy")).unwrap_or_default();
        assert!(tip.contains("'omnilife curate verify'"), "{tip}");
        for video in ["xyz", "verfy.mp4", "Cargo.toml"] {
            assert_eq!(tip_for_video(Path::new(video)), None, "{video}");
        }
    }

    #[test]
    fn short_options_get_their_long_names() {
        let text = told("omnilife run a.mp4 -o x");
        assert!(
            text.contains("'--out'") && !text.contains("-- -o"),
            "{text}"
        );
    }
}
