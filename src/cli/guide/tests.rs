use std::collections::BTreeSet;

use clap::Parser;
use omnilife_bench::PROTOCOLS;

use super::*;

#[test]
fn every_command_has_examples_that_parse() {
    let examples: BTreeSet<String> = EXAMPLES.iter().map(|(of, _)| (*of).to_owned()).collect();
    assert_eq!(examples.len(), EXAMPLES.len(), "a command is there twice");
    let commands: BTreeSet<String> = all_words(&Cli::command()).into_iter().collect();
    assert_eq!(examples, commands);
    for (of, lines) in &*EXAMPLES {
        for line in lines {
            assert!(line.starts_with(of), "{line} must be an example of {of}");
            let line = line.split(" > ").next().unwrap_or(line);
            let line = line.replace("\"out of memory\"", "memory");
            let words = ["omnilife"].into_iter().chain(line.split(' '));
            if let Err(error) = Cli::try_parse_from(words) {
                panic!("{line}: {error}");
            }
        }
    }
}

/// Parses every command that the status of a dataset advises.
#[test]
fn commands_that_make_missing_parts_parse() {
    for line in omnilife_curate::overview::COMMANDS {
        let words: Vec<&str> = line.split(' ').collect();
        let parsed = Cli::try_parse_from(["omnilife"].iter().chain(&words));
        assert!(parsed.is_ok(), "{line}: {:?}", parsed.err());
        let mut options = words.windows(2).filter(|pair| pair[0] == "--protocol");
        assert!(
            options.all(|pair| PROTOCOLS.iter().any(|known| known.id == pair[1])),
            "{line}"
        );
    }
}

#[test]
fn short_help_leaves_options_under_headings_to_the_long_one() {
    let run = command().find_subcommand("run").cloned();
    let mut run = run.unwrap_or_else(|| panic!("there is no command run"));
    let (short, long) = (run.render_help(), run.render_long_help());
    let (short, long) = (short.to_string(), long.to_string());
    for option in ["--out", "--iterations"] {
        assert!(short.contains(option) && long.contains(option), "{option}");
    }
    for option in ["--sampling", "--checkpoint-every"] {
        assert!(!short.contains(option), "{short}");
    }
    assert!(
        short.contains("more options: omnilife run --help"),
        "{short}"
    );
    assert!(short.lines().count() < long.lines().count() / 2, "{short}");
}

#[test]
fn every_list_of_values_is_in_the_help() {
    for (of, option, values) in VALUES {
        let mut found = command();
        for word in of.split(' ') {
            let inner = found.find_subcommand(word).cloned();
            found = inner.unwrap_or_else(|| panic!("there is no command {of}"));
        }
        let help = found.render_long_help().to_string();
        let words: Vec<&str> = help.split_whitespace().collect();
        let list = format!("[one of: {}]", values().join(", "));
        assert!(words.join(" ").contains(&list), "{of} --{option}: {help}");
    }
}
