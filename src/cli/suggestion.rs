//! What was meant by a command that does not exist, wherever in the tree of commands it stands.

use clap::{
    Command,
    error::{ContextKind, ContextValue, ErrorKind},
};

use omnilife_schemas::names::UnknownName;

use super::guide;

/// The error with a tip where the word that was not understood names a command of another group, or
/// nearly names one of `curate`, which takes words for videos.
pub(crate) fn with_tip(error: clap::Error, command: &Command, words: &[String]) -> clap::Error {
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
    clap::Error::raw(
        ErrorKind::InvalidSubcommand,
        format!("unrecognized command '{word}'\n{lines}\n\nFor more information, try '--help'.\n"),
    )
}

/// The word that was taken for a command, or for a video of `curate` where nothing else was given.
fn unknown_word(error: &clap::Error, command: &Command, words: &[String]) -> Option<String> {
    match (error.kind(), error.get(ContextKind::InvalidSubcommand)) {
        (ErrorKind::InvalidSubcommand, Some(ContextValue::String(word))) => Some(word.clone()),
        (ErrorKind::MissingRequiredArgument, _) => {
            let after = words.iter().skip_while(|word| *word != "curate").nth(1)?;
            let is_word = after.chars().all(|letter| letter.is_ascii_lowercase());
            // What is missing is an argument of a command that exists.
            let is_command = (command.find_subcommand("curate"))
                .is_some_and(|curate| curate.find_subcommand(after).is_some());
            (is_word && !is_command && !std::path::Path::new(after).exists()).then(|| after.clone())
        }
        _ => None,
    }
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
    }
}
