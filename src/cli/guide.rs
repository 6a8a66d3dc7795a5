//! Additions to the help: examples of every command, and the values that an option takes.
//!
//! Both are slices that tests walk: every command has examples that parse, and every list of values
//! belongs to an option that exists.

mod values;

use clap::{Command, CommandFactory, Id};

use super::{Cli, numbers};
use values::VALUES;

/// Examples of a command: its words, and lines that follow `omnilife`.
type Examples = (&'static str, &'static [&'static str]);

/// Examples of every command, in the order of the help.
pub(crate) const EXAMPLES: &[Examples] = &[
    (
        "run",
        &[
            "run walk.mp4 --out OUT",
            "run walk.mp4 --poses poses.json --method omni4dgs-plus --iterations 8000 --out OUT",
            "run flight.mp4 --projection pinhole --method object-graph --vehicle-detector command --program yolo.toml --out OUT",
        ],
    ),
    (
        "curate",
        &[
            "curate videos/ --out DATASET",
            "curate walk.mp4 --criteria none --fps 2 --slices --out DATASET",
            "curate videos/ --sources sources.csv --out DATASET",
        ],
    ),
    (
        "curate build",
        &[
            "curate build videos/ --out DATASET",
            "curate build walk.mp4 --criteria none --fps 2 --out DATASET",
        ],
    ),
    (
        "curate video",
        &["curate video walk.mp4 --folder DATASET/videos/walk"],
    ),
    ("curate probe", &["curate probe walk.mp4"]),
    ("curate projection", &["curate projection walk.mp4"]),
    (
        "curate boundaries",
        &[
            "curate boundaries walk.mp4",
            "curate boundaries walk.mp4 --detector transnetv2 --signals signals.parquet",
        ],
    ),
    (
        "curate ledger merge",
        &[
            "curate ledger merge DATASET/videos/walk decisions.json",
            "curate ledger merge DATASET/videos/walk cuts.csv --author kim --role annotator",
        ],
    ),
    (
        "curate ledger show",
        &["curate ledger show DATASET/videos/walk"],
    ),
    (
        "curate ledger agreement",
        &["curate ledger agreement DATASET/videos/walk --tolerance 0.2"],
    ),
    (
        "curate ledger export",
        &["curate ledger export DATASET/videos/walk --format edl"],
    ),
    (
        "curate audit",
        &["curate audit DATASET/videos/walk --video walk.mp4 --out audit.html"],
    ),
    (
        "curate slice",
        &["curate slice walk.mp4 --begin 12.5 --end 40 --out slice.mp4"],
    ),
    (
        "curate annotate",
        &[
            "curate annotate DATASET --tags tags.csv",
            "curate annotate DATASET --caption-command ./caption.py",
            "curate annotate DATASET --caption-endpoint http://localhost:8000/v1 --caption-model qwen3-vl",
        ],
    ),
    (
        "curate poses",
        &[
            "curate poses SEQUENCE",
            "curate poses SEQUENCE --poses poses.json",
            "curate poses SEQUENCE --poses poses.json --depth-prior DIR --depth-prior-unit 0.0025",
        ],
    ),
    (
        "curate attach",
        &[
            "curate attach SCENE --masks masks/ --class human=people/",
            "curate attach SCENE --depth-prior depth/ --depth-prior-unit 0.001 --depth-prior-source PanoVGGT",
            "curate attach SCENE --poses all_poses.npy --poses-convention camera-to-world",
        ],
    ),
    (
        "curate masks",
        &[
            "curate masks SEQUENCE",
            "curate masks SEQUENCE --from masks/",
        ],
    ),
    ("curate operator", &["curate operator SEQUENCE"]),
    (
        "curate dense",
        &[
            "curate dense SEQUENCE --split split.json",
            "curate dense SEQUENCE --width 480 --out DENSE",
        ],
    ),
    (
        "curate tracks",
        &[
            "curate tracks SEQUENCE --split split.json",
            "curate tracks SEQUENCE --split split.json --detector files --detections boxes.txt",
            "curate tracks SEQUENCE --detector files --detections boxes.txt --association deepsort",
            "curate tracks SEQUENCE --split split.json --detector command --program yolo.toml",
            "curate tracks SEQUENCE --split split.json --every-frame --video flight.mp4",
            "curate tracks SEQUENCE --split split.json --plan",
        ],
    ),
    (
        "curate export",
        &["curate export SEQUENCE --format nerfstudio --split split.json --out OUT"],
    ),
    (
        "curate import",
        &["curate import COLMAP --format colmap --fps 30 --out SEQUENCE"],
    ),
    (
        "curate publish",
        &[
            "curate publish DATASET --name Streets --licence CC-BY-4.0",
            "curate publish DATASET --about about.toml --strict",
            "curate publish DATASET --shards 1000",
        ],
    ),
    (
        "curate select",
        &["curate select DATASET --count 111 --stratify scene,ego-motion --seed 0 --out SUBSET"],
    ),
    (
        "curate status",
        &["curate status DATASET", "curate status DATASET --json"],
    ),
    ("curate overview", &["curate overview DATASET"]),
    ("curate verify", &["curate verify DATASET"]),
    (
        "reconstruct train",
        &[
            "reconstruct train SEQUENCE --split split.json --out RUN",
            "reconstruct train SEQUENCE --split split.json --method omni4dgs-plus --backend gpu --out RUN",
        ],
    ),
    (
        "reconstruct prepare",
        &["reconstruct prepare SEQUENCE --split split.json --methods object-graph"],
    ),
    (
        "reconstruct plan",
        &["reconstruct plan SEQUENCE --split split.json --method omni4dgs-plus"],
    ),
    (
        "reconstruct render",
        &[
            "reconstruct render RUN --poses SEQUENCE --out VIEWS --video views.mp4",
            "reconstruct render RUN --poses SEQUENCE --layer dynamic --out VIEWS",
            "reconstruct render THEIRS.spz --poses SEQUENCE --projection erp --out VIEWS --video views.mp4",
        ],
    ),
    (
        "reconstruct export",
        &[
            "reconstruct export RUN --lod 1M,5M,full --page --out ASSET",
            "reconstruct export gaussians.ply --up 0,-1,0 --out ASSET",
            "reconstruct export RUN --lod 500k,full --format spz --out ASSET",
            "reconstruct export RUN --format gtime --page --out ASSET",
        ],
    ),
    ("reconstruct atlas", &["reconstruct atlas RUN --out ATLAS"]),
    (
        "reconstruct edit",
        &[
            "reconstruct edit RUN --script edit.toml --out EDITED",
            "reconstruct edit RUN --script edit.toml --poses SEQUENCE --preview 12 --out PREVIEW",
            "reconstruct edit RUN --script edit.toml --poses SEQUENCE --video edited.mp4 --out EDITED",
        ],
    ),
    (
        "reconstruct methods",
        &["reconstruct methods", "reconstruct methods --json"],
    ),
    ("reconstruct backends", &["reconstruct backends"]),
    (
        "bench split",
        &["bench split SEQUENCE --protocol per-scene --out split.json"],
    ),
    (
        "bench external",
        &["bench external method.toml --scene SEQUENCE --split split.json --out RUN"],
    ),
    (
        "bench failed",
        &[
            "bench failed mine --scene SEQUENCE --split split.json --reason \"out of memory\" --out RUN",
        ],
    ),
    (
        "bench score",
        &[
            "bench score --scene SEQUENCE --split split.json --run RUN --out SCORE",
            "bench score --scene SEQUENCE --split split.json --novel-views VIEWS --method mine --out SCORE",
        ],
    ),
    (
        "bench tracks",
        &[
            "bench tracks tracks.json --truth truth.json --scene SEQUENCE",
            "bench tracks tracks.json --truth truth.json --scene SEQUENCE --true-poses poses.json",
        ],
    ),
    (
        "bench poses",
        &[
            "bench poses sparse/0 --scene SEQUENCE",
            "bench poses all_poses.npy --poses-convention camera-to-world --scene SEQUENCE --truth truth.txt",
        ],
    ),
    (
        "bench validate",
        &["bench validate VIEWS --scene SEQUENCE --split split.json"],
    ),
    ("bench compare", &["bench compare SCORES-A SCORES-B"]),
    (
        "bench video",
        &["bench video EDITED/views --reference VIEWS"],
    ),
    (
        "bench run",
        &[
            "bench run DATASET --out OUT",
            "bench run DATASET --methods odgs,method.toml --protocols per-scene --seeds 0,1,2 --out OUT",
        ],
    ),
    (
        "bench diagnose",
        &["bench diagnose --scene SEQUENCE --split split.json --novel-views VIEWS"],
    ),
    (
        "bench adapter",
        &["bench adapter gsplat-faces --out CHECKOUT"],
    ),
    (
        "bench stability",
        &[
            "bench stability --out REPORT",
            "bench stability --backend cpu",
        ],
    ),
    (
        "bench curve",
        &["bench curve SCORE-A SCORE-B --clock cpu --out CURVES"],
    ),
    (
        "bench ablate",
        &["bench ablate SEQUENCE --method omni4dgs --paper --out ABLATION"],
    ),
    ("bench list", &["bench list", "bench list --json"]),
    (
        "leaderboard build",
        &["leaderboard build RESULTS --dataset DATASET/dataset.json --out BOARD"],
    ),
    (
        "leaderboard query",
        &[
            "leaderboard query RESULTS --by video --metric psnr,ssim",
            "leaderboard query RESULTS --table views --by third --where view=novel",
            "leaderboard query RESULTS --by ego-motion --dataset DATASET/dataset.json --format csv",
        ],
    ),
    (
        "leaderboard datasets",
        &[
            "leaderboard datasets DATASET",
            "leaderboard datasets STREETS INDOORS --format latex",
        ],
    ),
    (
        "leaderboard figure",
        &["leaderboard figure RESULTS --methods omni4dgs,odgs --out FIGURE"],
    ),
    (
        "leaderboard gallery",
        &["leaderboard gallery DATASET --most 8 --out FIGURE"],
    ),
    (
        "leaderboard submit",
        &["leaderboard submit RESULTS --card card.toml --out SUBMISSION"],
    ),
    (
        "leaderboard add",
        &["leaderboard add SUBMISSION --results RESULTS --audit 3 --scenes DATASET"],
    ),
    (
        "sweep plan curate",
        &["sweep plan curate videos/ --dataset DATASET --out SWEEP"],
    ),
    (
        "sweep plan bench",
        &[
            "sweep plan bench DATASET --methods odgs,omni4dgs-plus --results RESULTS --out SWEEP -- --iterations 8000",
        ],
    ),
    (
        "sweep plan commands",
        &["sweep plan commands lines.txt --out SWEEP"],
    ),
    (
        "sweep run",
        &["sweep run SWEEP", "sweep run SWEEP --cores 8 --memory 24"],
    ),
    (
        "sweep status",
        &[
            "sweep status SWEEP",
            "sweep status SWEEP --csv",
            "sweep status SWEEP --json",
        ],
    ),
    ("sweep retry", &["sweep retry SWEEP"]),
    ("sweep reduce", &["sweep reduce SWEEP"]),
    (
        "sweep submit",
        &["sweep submit SWEEP --slurm --sbatch=--partition=cpu --throttle 40"],
    ),
    (
        "completions",
        &["completions bash > ~/.local/share/bash-completion/completions/omnilife"],
    ),
    ("doctor", &["doctor", "doctor --json"]),
];

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
