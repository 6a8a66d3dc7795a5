//! `docs/cli.md`: every command with its options, made from the command line itself.

use std::{env, fs, path::Path};

use clap::{Arg, Command};

use super::guide;

/// Head of the page.
const HEAD: &str = "\
# Command line

Every command of `omnilife` with its options, as `omnilife COMMAND --help` prints them. Exit codes: 0, all \
went well; 2, some input is bad; 1, a failure of ours; 75, it was told to end and goes on from where it was \
when it is begun again. Errors are one line with the file and the reason.

Every command takes `--quiet`, which prints errors and results only, and `--progress json`, which writes \
progress as a JSON object per line of standard error. `--color never`, or `NO_COLOR` in the environment, leaves \
colours out.

(Made by `UPDATE_CLI_REFERENCE=1 cargo test -p omnilife --bins reference`.)
";

/// The page.
fn page() -> String {
    let mut command = guide::command();
    command.build();
    let mut text = HEAD.to_owned();
    let is_help = |words: &String| words.split(' ').any(|word| word == "help");
    let commands = guide::all_words(&command);
    for words in commands.into_iter().filter(|words| !is_help(words)) {
        let mut found = &command;
        for word in words.split(' ') {
            if let Some(inner) = found.find_subcommand(word) {
                found = inner;
            }
        }
        text += &section(&words, found);
    }
    text
}

fn section(words: &str, command: &Command) -> String {
    let about = command.get_long_about().or_else(|| command.get_about());
    let about = about.map(ToString::to_string).unwrap_or_default();
    let examples = guide::EXAMPLES.iter().find(|(of, _)| *of == words);
    let examples: String = examples
        .iter()
        .flat_map(|(_, lines)| lines.iter())
        .map(|line| format!("omnilife {line}\n"))
        .collect();
    let mut text = format!("\n## `omnilife {words}`\n\n{about}\n\n```sh\n{examples}```\n");
    let options: Vec<&Arg> = command
        .get_arguments()
        .filter(|argument| !argument.is_hide_set())
        .filter(|argument| {
            !["color", "help", "progress", "quiet", "version"].contains(&argument.get_id().as_str())
        })
        .collect();
    if !options.is_empty() {
        text += "\n| option | meaning |\n|---|---|\n";
    }
    for argument in options {
        let usage = usage(argument).replace('|', "\\|");
        text += &format!("| `{usage}` | {} |\n", meaning(argument));
    }
    text
}

/// `--out <OUT>`, `<SCENE>`.
fn usage(argument: &Arg) -> String {
    let takes_value = argument.get_action().takes_values();
    let names = argument.get_value_names().unwrap_or_default();
    let value = names.first().filter(|_| takes_value);
    match (argument.get_long(), value) {
        (Some(long), Some(value)) => format!("--{long} {value}"),
        (Some(long), None) => format!("--{long}"),
        (None, _) => value.map(ToString::to_string).unwrap_or_default(),
    }
}

fn meaning(argument: &Arg) -> String {
    let help = argument.get_long_help().or_else(|| argument.get_help());
    let help = help.map(ToString::to_string).unwrap_or_default();
    let mut text = help.split_whitespace().collect::<Vec<_>>().join(" ");
    let values: Vec<String> = argument
        .get_possible_values()
        .iter()
        .map(|value| value.get_name().to_owned())
        .collect();
    if argument.get_action().takes_values() && !values.is_empty() {
        text += &format!(" [one of: {}]", values.join(", "));
    }
    let defaults: Vec<String> = argument
        .get_default_values()
        .iter()
        .map(|value| value.to_string_lossy().into_owned())
        .collect();
    if argument.get_action().takes_values() && !defaults.is_empty() {
        text += &format!(" [default: {}]", defaults.join(","));
    }
    text.replace('|', "\\|")
}

#[test]
fn the_page_is_what_the_program_says() -> std::io::Result<()> {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/cli.md");
    if env::var_os("UPDATE_CLI_REFERENCE").is_some() {
        fs::write(&file, page())?;
    }
    assert!(
        fs::read_to_string(&file)? == page(),
        "docs/cli.md is not what the program says: UPDATE_CLI_REFERENCE=1 cargo test -p omnilife \
         --bins reference"
    );
    Ok(())
}
