//! Writing commands that are started twice at once and killed at random moments: run again, each leaves the files of
//! an undisturbed run.
//!
//! An ordinary test run kills some of the commands, always at the same moments; `scripts/reliability
//! killed` kills all of them, 200 times in all, and prints a table.

use std::{
    collections::BTreeSet,
    thread,
    time::{Duration, Instant},
};

use crate::{
    chance::Chance,
    outcomes::ExpectedContent,
    support::scratch,
    trial::{Trial, variable},
    writing_commands::Inputs,
};

/// Default number of kills, which is also the number of commands that are tested then.
const KILLS: usize = 8;

/// Counts of one command's attempts.
#[derive(Default)]
struct Outcome {
    seconds: f64,
    /// Processes that were still running when they were killed.
    killed: usize,
    rounds: usize,
    /// Processes that found the other one at work.
    refused: usize,
    faults: BTreeSet<String>,
}

fn walk(trial: &Trial<'_>, rounds: usize, chance: &mut Chance) -> Outcome {
    let mut outcome = Outcome {
        rounds,
        ..Outcome::default()
    };
    let mut undisturbed = Vec::new();
    for _ in 0..2 {
        trial.reset();
        let begun = Instant::now();
        trial.run().succeeded();
        outcome.seconds = begun.elapsed().as_secs_f64();
        undisturbed.push(trial.left());
    }
    let expected = ExpectedContent::of(undisturbed);
    // The first two run to their ends.
    for round in 0..=rounds {
        trial.reset();
        let mut both = vec![trial.start()];
        thread::sleep(Duration::from_secs_f64(0.05 * chance.share()));
        both.push(trial.start());
        if round > 0 {
            thread::sleep(Duration::from_secs_f64(
                1.3 * outcome.seconds * chance.share(),
            ));
            for child in &mut both {
                outcome.killed += usize::from(child.try_wait().unwrap().is_none());
                // It may have ended by itself in between.
                drop(child.kill());
            }
        }
        for child in both {
            let ended = child.wait_with_output().unwrap();
            let stderr = String::from_utf8_lossy(&ended.stderr);
            match ended.status.code() {
                Some(0) | None => {}
                Some(2) if stderr.lines().count() == 1 => outcome.refused += 1,
                code => {
                    outcome
                        .faults
                        .insert(format!("two at once: {code:?}: {stderr}"));
                }
            }
        }
        outcome.faults.extend(trial.run_again(&expected));
    }
    outcome
}

#[test]
fn every_command_twice_at_once_and_killed() {
    let kills = variable("OMNILIFE_KILLS").map(|kills: u64| kills as usize);
    let mut chance = Chance::new(variable("OMNILIFE_SEED").unwrap_or(1));
    let inputs = Inputs::prepare();
    let mut commands = inputs.chosen_commands();
    if kills.is_none() {
        let every = commands.len() / KILLS;
        commands = commands.into_iter().step_by(every).collect();
    }
    let rounds = kills.map_or(1, |kills| kills.div_ceil(2 * commands.len()));
    let folder = scratch();
    let mut wrong = Vec::new();
    println!(
        "| command | one run, s | pairs | killed | refused | wrong |\n|---|--:|--:|--:|--:|--:|"
    );
    for command in &commands {
        let trial = Trial {
            command,
            inputs,
            folder: folder.path().to_owned(),
        };
        let Outcome {
            seconds,
            killed,
            rounds,
            refused,
            faults,
        } = walk(&trial, rounds, &mut chance);
        println!(
            "| `{}` | {seconds:.1} | {} | {killed} | {refused} | {} |",
            command.shown(),
            rounds + 1,
            faults.len()
        );
        wrong.extend(
            faults
                .into_iter()
                .map(|fault| format!("{}: {fault}", command.shown())),
        );
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
