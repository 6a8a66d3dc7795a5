//! Walk over every command with paths of the wrong kind. It begins without arguments and follows the errors, as a
//! newcomer does: they name what is missing until the command starts, and then the path that is wrong.

use std::{
    fs,
    path::Path,
    sync::atomic::{AtomicUsize, Ordering},
    thread,
};

use crate::support::{Ended, files, omnilife, scratch};

/// Commands that run at a time.
const THREADS: usize = 2;
/// Errors that are followed until a command has all of its arguments.
const MOST_STEPS: usize = 6;

/// A command with its help.
struct Command {
    words: Vec<String>,
    help: String,
}

/// Returns the commands below `words`, by their help.
fn commands(words: &[String]) -> Vec<Command> {
    let help = omnilife(words.iter().map(String::as_str).chain(["--help"])).succeeded();
    let help = help.stdout;
    let list = help.split("\nCommands:\n").nth(1).unwrap_or_default();
    let names = list.lines().take_while(|line| line.starts_with("  "));
    let names = names.filter_map(|line| line.strip_prefix("  ")?.split(' ').next());
    let names = names.filter(|name| !name.is_empty() && *name != "help");
    let mut found = Vec::new();
    for name in names {
        let below: Vec<String> = words.iter().cloned().chain([name.to_owned()]).collect();
        found.extend(commands(&below));
    }
    // `curate` is a command and a group.
    if needs_arguments(&help) && !words.is_empty() {
        found.push(Command {
            words: words.to_vec(),
            help,
        });
    }
    found
}

/// Returns whether the usage has an argument that is not a command: others would do their work.
fn needs_arguments(help: &str) -> bool {
    let usage = help.split("Usage:").nth(1).unwrap_or_default();
    let usage = usage.split("\n\n").next().unwrap_or_default();
    usage.replace("<COMMAND>", "").contains('<')
}

/// Returns the first of the values that the help lists for an option.
fn listed_value(help: &str, option: &str) -> Option<String> {
    let about = help.split("\n      --").find(|about| {
        let name = about.split([' ', '=', '\n']).next();
        name == option.strip_prefix("--")
    })?;
    let words: Vec<&str> = about.split_whitespace().collect();
    let about = words.join(" ");
    let list = ["[one of: ", "[possible values: "]
        .iter()
        .find_map(|begin| about.split(begin).nth(1))?;
    list.split([',', ']']).next().map(str::to_owned)
}

/// Follows the errors that name missing arguments; every value is `path`, unless the help lists values.
fn followed(command: &Command, path: &str) -> (Vec<String>, Ended) {
    let mut line = command.words.clone();
    for _ in 0..MOST_STEPS {
        let ended = omnilife(&line);
        if !ended
            .stderr
            .contains("required arguments were not provided")
        {
            return (line, ended);
        }
        let before = line.len();
        let named = ended
            .stderr
            .lines()
            .filter_map(|line| line.strip_prefix("  "));
        for missing in named.filter(|line| line.starts_with(['<', '-'])) {
            let missing = missing.trim_start_matches('<');
            let name: String = missing
                .chars()
                .take_while(|letter| letter.is_ascii_lowercase() || *letter == '-')
                .collect();
            if !name.starts_with("--") {
                line.push(path.to_owned());
            } else if missing.contains('<') {
                let value = listed_value(&command.help, &name);
                line.push(format!("{name}={}", value.as_deref().unwrap_or(path)));
            } else {
                line.push(name);
            }
        }
        assert!(line.len() > before, "{line:?}: {}", ended.stderr);
    }
    panic!("{line:?} lacks arguments still");
}

/// Checks that a command names a path of the wrong kind, denies nothing that exists, and leaves nothing.
fn check(line: &[String], ended: &Ended, folder: &Path, path: &str) {
    let said = format!("{line:?}: {:?}: {}", ended.code, ended.stderr);
    assert_eq!(ended.code, Some(2), "{said}");
    assert!(ended.stderr.contains(path), "{said}");
    assert!(!ended.stderr.contains("unrecognized"), "{said}");
    assert!(!ended.stderr.contains("panicked"), "{said}");
    assert_eq!(files(folder), ["file"], "{said}");
    let folders = fs::read_dir(folder).unwrap().count();
    assert_eq!(folders, 2, "{said}");
}

#[test]
fn every_command_names_a_path_of_the_wrong_kind() {
    let all = commands(&[]);
    assert!(all.len() > 50, "{} commands", all.len());
    let next = AtomicUsize::new(0);
    thread::scope(|scope| {
        for _ in 0..THREADS {
            scope.spawn(|| {
                while let Some(command) = all.get(next.fetch_add(1, Ordering::Relaxed)) {
                    walk(command);
                }
            });
        }
    });
}

fn walk(command: &Command) {
    let folder = scratch();
    let [missing, file, empty] =
        ["missing", "file", "empty"].map(|name| folder.path().join(name).display().to_string());
    fs::write(&file, "some words\n").unwrap();
    fs::create_dir(&empty).unwrap();
    let (line, ended) = followed(command, &missing);
    check(&line, &ended, folder.path(), &missing);
    // A folder that is missing must not have been made on the way.
    assert!(
        !ended.stderr.contains("Is a directory"),
        "{line:?}: {}",
        ended.stderr
    );
    for wrong in [&file, &empty] {
        let line: Vec<String> = line
            .iter()
            .map(|word| word.replace(&missing, wrong))
            .collect();
        check(&line, &omnilife(&line), folder.path(), wrong);
    }
}
