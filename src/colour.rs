//! Colour of errors, warnings and best values on a terminal.
//!
//! `--color` decides, else `NO_COLOR` (<https://no-color.org>), else whether the output is a terminal. Files and other
//! programs get plain text.

use std::{
    borrow::Cow,
    env,
    io::{self, IsTerminal},
    sync::OnceLock,
};

use clap::{
    ColorChoice,
    builder::styling::{AnsiColor, Style},
};

/// Style of errors and failures.
const ERROR: Style = AnsiColor::Red.on_default().bold();
const WARNING: Style = AnsiColor::Yellow.on_default().bold();
/// Style of the best value of a column.
const BEST: Style = AnsiColor::Green.on_default().bold();
/// First words of lines, with their styles.
const OPENINGS: [(&str, Style); 6] = [
    ("omnilife:", ERROR),
    ("error:", ERROR),
    ("failed:", ERROR),
    ("failed ", ERROR),
    ("warning:", WARNING),
    ("rejected ", WARNING),
];

/// Choice on the command line, once it is known.
static CHOICE: OnceLock<ColorChoice> = OnceLock::new();

/// Takes the choice, once for the whole process.
pub(crate) fn choose(choice: ColorChoice) {
    let _ = CHOICE.set(choice);
}

/// Finds the choice in the words of the command line before they are parsed: errors of parsing have colours too.
pub(crate) fn of_words(words: &[String]) -> ColorChoice {
    let mut words = words.iter().take_while(|word| *word != "--");
    let mut choice = ColorChoice::Auto;
    while let Some(word) = words.next() {
        let value = match word.strip_prefix("--color") {
            Some("") => words.next().map(String::as_str),
            Some(value) => value.strip_prefix('='),
            None => None,
        };
        // A wrong value is an error of parsing.
        if let Some(Ok(named)) = value.map(str::parse) {
            choice = named;
        }
    }
    choice
}

/// Returns a line for standard error, its opening in colour.
pub(crate) fn for_stderr(line: &str) -> Cow<'_, str> {
    shown(line, is_wanted(io::stderr().is_terminal()))
}

/// Returns a text for standard output: openings of lines and the best values of tables in colour.
pub(crate) fn for_stdout(text: &str) -> Cow<'_, str> {
    shown(text, is_wanted(io::stdout().is_terminal()))
}

fn is_wanted(is_terminal: bool) -> bool {
    let is_set = |name| env::var_os(name).is_some_and(|value| !value.is_empty());
    let is_dumb = env::var_os("TERM").is_some_and(|terminal| terminal == "dumb");
    match CHOICE.get() {
        Some(ColorChoice::Always) => true,
        Some(ColorChoice::Never) => false,
        Some(ColorChoice::Auto) | None => is_terminal && !is_dumb && !is_set("NO_COLOR"),
    }
}

fn shown(text: &str, in_colour: bool) -> Cow<'_, str> {
    if !in_colour {
        return Cow::Borrowed(text);
    }
    let lines = text.split_inclusive('\n').map(|line| {
        if line.starts_with('|') {
            return with_best(line);
        }
        let opening = OPENINGS.iter().find(|(words, _)| line.starts_with(words));
        match opening {
            Some((words, style)) => format!("{style}{words}{style:#}{}", &line[words.len()..]),
            None => line.to_owned(),
        }
    });
    Cow::Owned(lines.collect())
}

/// Returns a line of a Markdown table with its bold values in colour; blanks in place of the marks keep the columns.
fn with_best(line: &str) -> String {
    let mut parts = line.split("**");
    let mut text = parts.next().unwrap_or_default().to_owned();
    let rest: Vec<&str> = parts.collect();
    for pair in rest.chunks(2) {
        text += &match pair {
            [best, after] => format!("  {BEST}{best}{BEST:#}  {after}"),
            _ => format!("**{}", pair.concat()),
        };
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plain(text: &str) -> String {
        let mut shown = String::new();
        let mut parts = text.split('\u{1b}');
        shown += parts.next().unwrap_or_default();
        for part in parts {
            shown += part.split_once('m').map_or("", |(_, rest)| rest);
        }
        shown
    }

    #[test]
    fn openings_and_best_values_have_colours_and_nothing_else_changes() {
        let text = "warning: dark\n| a | **2.0** | *1.0* | **3** |\nscored x\nfailed  y\n";
        assert_eq!(shown(text, false), text);
        let coloured = shown(text, true);
        assert_eq!(plain(&coloured), text.replace("**", "  "));
        for part in [
            format!("{WARNING}warning:"),
            format!("{BEST}2.0"),
            format!("{BEST}3"),
        ] {
            assert!(coloured.contains(&part), "{coloured:?}");
        }
        assert_eq!(with_best("| a ** b |"), "| a ** b |");
    }

    #[test]
    fn the_choice_is_known_before_parsing() {
        let of = |line: &str| {
            let words: Vec<String> = line.split(' ').map(str::to_owned).collect();
            of_words(&words)
        };
        assert_eq!(of("omnilife --color never doctor"), ColorChoice::Never);
        assert_eq!(of("omnilife doctor --color=always"), ColorChoice::Always);
        for line in [
            "omnilife",
            "omnilife --color",
            "omnilife --color=x",
            "omnilife -- --color=never",
        ] {
            assert_eq!(of(line), ColorChoice::Auto, "{line}");
        }
    }
}
