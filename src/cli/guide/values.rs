//! Names of the program's own lists, which options take: in the help, and for completions.

use clap::{Command, builder::PossibleValuesParser};
use omnilife_bench::{ADAPTERS, PROTOCOLS};
use omnilife_curate::{boundaries::DETECTORS, exchange, ledger, masks};
use omnilife_reconstruct::{jobs::export, methods::METHODS};

use crate::cli::ledger::ROLES;

/// An option of the commands below some words, and the values that it takes.
type Values = (&'static str, &'static str, fn() -> Vec<&'static str>);

/// Options whose values are names of the program's own lists.
pub(super) const VALUES: &[Values] = &[
    ("run", "method", method_names),
    ("reconstruct train", "method", method_names),
    ("reconstruct plan", "method", method_names),
    ("reconstruct prepare", "methods", method_names),
    ("bench ablate", "method", method_names),
    ("bench run", "methods", method_names),
    ("sweep plan bench", "methods", method_names),
    ("run", "protocol", protocol_names),
    ("bench split", "protocol", protocol_names),
    ("bench ablate", "protocol", protocol_names),
    ("bench run", "protocols", protocol_names),
    ("sweep plan bench", "protocols", protocol_names),
    ("run", "detector", detector_names),
    ("curate", "detector", detector_names),
    ("curate build", "detector", detector_names),
    ("curate video", "detector", detector_names),
    ("curate boundaries", "detector", detector_names),
    ("sweep plan curate", "detector", detector_names),
    ("curate export", "format", written_format_names),
    ("curate import", "format", format_names),
    ("curate ledger export", "format", boundary_format_names),
    ("curate ledger merge", "role", role_names),
    ("run", "masks_method", mask_method_names),
    ("curate masks", "method", mask_method_names),
    ("run", "vehicle_detector", vehicle_detector_names),
    ("run", "distance", distance_names),
    ("run", "association", association_names),
    ("curate tracks", "vehicle_detector", vehicle_detector_names),
    ("curate tracks", "distance", distance_names),
    ("curate tracks", "association", association_names),
    ("reconstruct export", "format", splat_format_names),
    ("bench adapter", "method", adapter_names),
];

fn method_names() -> Vec<&'static str> {
    METHODS.iter().map(|method| method.id).collect()
}

fn protocol_names() -> Vec<&'static str> {
    PROTOCOLS.iter().map(|protocol| protocol.id).collect()
}

fn detector_names() -> Vec<&'static str> {
    DETECTORS.iter().map(|detector| detector.id).collect()
}

fn written_format_names() -> Vec<&'static str> {
    exchange::written_formats()
        .map(|format| format.id)
        .collect()
}

fn format_names() -> Vec<&'static str> {
    exchange::FORMATS.iter().map(|format| format.id).collect()
}

fn boundary_format_names() -> Vec<&'static str> {
    let formats = ledger::formats::FORMATS.iter();
    formats.map(|format| format.id).collect()
}

fn role_names() -> Vec<&'static str> {
    ROLES.map(|(name, _)| name).to_vec()
}

fn mask_method_names() -> Vec<&'static str> {
    masks::METHODS.iter().map(|method| method.id).collect()
}

fn vehicle_detector_names() -> Vec<&'static str> {
    let detectors = omnilife_tracks::detectors::DETECTORS.iter();
    detectors.map(|detector| detector.id).collect()
}

fn distance_names() -> Vec<&'static str> {
    omnilife_tracks::distance::DISTANCES
        .map(omnilife_tracks::distance::DistanceMethod::id)
        .to_vec()
}

fn association_names() -> Vec<&'static str> {
    omnilife_tracks::association::ASSOCIATIONS
        .map(omnilife_tracks::association::Association::id)
        .to_vec()
}

fn splat_format_names() -> Vec<&'static str> {
    export::format_names()
}

fn adapter_names() -> Vec<&'static str> {
    ADAPTERS.iter().map(|adapter| adapter.id).collect()
}

/// Returns the command line with [`VALUES`] as the only values of their options, as completions need it. Parsing does
/// without, because its own errors say more.
pub(super) fn as_possible_values(command: Command) -> Command {
    VALUES
        .iter()
        .fold(command, |command, (of, option, values)| {
            let words: Vec<&str> = of.split(' ').collect();
            limited(command, &words, option, values())
        })
}

fn limited(command: Command, words: &[&str], option: &str, values: Vec<&'static str>) -> Command {
    match words {
        [] => command.mut_arg(option, |argument| {
            argument.value_parser(PossibleValuesParser::new(values))
        }),
        [first, below @ ..] => {
            command.mut_subcommand(first, |inner| limited(inner, below, option, values))
        }
    }
}

#[cfg(test)]
mod tests {
    use clap_complete::Shell;

    use super::*;
    use crate::cli;

    #[test]
    fn completions_propose_every_value() {
        let mut script = Vec::new();
        clap_complete::generate(
            Shell::Bash,
            &mut cli::command_with_values(),
            "omnilife",
            &mut script,
        );
        let script = String::from_utf8_lossy(&script);
        for (of, option, values) in VALUES {
            assert!(script.contains(&values().join(" ")), "{of} --{option}");
        }
    }
}
