//! Additions to the help: examples of every command, and the values that an option takes.
//!
//! Both are lists that tests walk: every command has examples that parse, and every list of values
//! belongs to an option that exists.

mod values;

use std::sync::LazyLock;

use clap::{Command, CommandFactory, Id};

use super::{Cli, numbers};
use values::VALUES;

/// Examples of a command: its words, and lines that follow `omnilife`.
type Examples = (&'static str, Vec<&'static str>);

/// Examples of every command, in the order of the help. In the file, indented lines follow the words of a command.
pub(crate) static EXAMPLES: LazyLock<Vec<Examples>> = LazyLock::new(|| {
    let mut examples: Vec<Examples> = Vec::new();
    for line in include_str!("examples.txt").lines() {
        match (line.strip_prefix("  "), examples.last_mut()) {
            (Some(example), Some((_, lines))) => lines.push(example),
            _ => examples.push((line, Vec::new())),
        }
    }
    examples
});

/// The command line with examples and lists of values.
pub(crate) fn command() -> Command {
    with_guide(Cli::command(), "")
}

/// Returns the command line for completions, which propose the values of [`VALUES`].
pub(crate) fn command_with_values() -> Command {
    values::as_possible_values(command())
}

fn with_guide(mut command: Command, words: &str) -> Command {
    let names: Vec<String> = command
        .get_subcommands()
        .map(|inner| inner.get_name().to_owned())
        .collect();
    for name in names {
        let below = match words {
            "" => name.clone(),
            words => format!("{words} {name}"),
        };
        command = command.mut_subcommand(&name, |inner| with_guide(inner, &below));
    }
    for (_, option, values) in VALUES.iter().filter(|(of, ..)| *of == words) {
        command = command.mut_arg(*option, |argument| {
            let help = argument.get_help().map(ToString::to_string);
            let list = values().join(", ");
            argument.help(format!("{} [one of: {list}]", help.unwrap_or_default()))
        });
    }
    // `--width -4` gets the error of the number, not the tip to write `-- -4`.
    command = command.mut_args(|argument| {
        let is_number = numbers::is_number(&argument);
        argument.allow_negative_numbers(is_number)
    });
    let hidden = hidden_in_short_help(&command);
    for id in &hidden {
        command = command.mut_arg(id, |argument| argument.hide_short_help(true));
    }
    let Some((_, lines)) = EXAMPLES.iter().find(|(of, _)| *of == words) else {
        return command;
    };
    let shown = |lines: &[&str]| {
        let lines: String = lines
            .iter()
            .map(|line| format!("  omnilife {line}\n"))
            .collect();
        lines.trim_end().to_owned()
    };
    let more = match hidden.len() {
        0 => String::new(),
        count => format!("\n\n{count} more options: omnilife {words} --help"),
    };
    command
        .after_help(format!("Example:\n{}{more}", shown(&lines[..1])))
        .after_long_help(format!("Examples:\n{}", shown(lines)))
}

/// Options under a heading that a first run is likely to need.
const IN_SHORT_HELP: [&str; 6] = [
    "method",
    "iterations",
    "budget",
    "poses",
    "protocol",
    "width",
];

/// Options that `-h` leaves to `--help`: those under headings of their own, where there are many.
fn hidden_in_short_help(command: &Command) -> Vec<Id> {
    const MANY: usize = 12;
    let arguments = || command.get_arguments();
    if arguments().count() < MANY {
        return Vec::new();
    }
    let hidden = arguments().filter(|argument| {
        let is_kept = IN_SHORT_HELP.contains(&argument.get_id().as_str());
        argument.get_help_heading().is_some() && !is_kept
    });
    hidden.map(|argument| argument.get_id().clone()).collect()
}

/// All commands by their words, hidden ones left out.
pub(crate) fn all_words(command: &Command) -> Vec<String> {
    let mut found = Vec::new();
    for inner in command
        .get_subcommands()
        .filter(|inner| !inner.is_hide_set())
    {
        let name = inner.get_name();
        let below = all_words(inner);
        // `omnilife curate` is a command and a group.
        if below.is_empty() || EXAMPLES.iter().any(|(of, _)| *of == name) {
            found.push(name.to_owned());
        }
        found.extend(below.into_iter().map(|words| format!("{name} {words}")));
    }
    found
}

#[cfg(test)]
mod tests;
