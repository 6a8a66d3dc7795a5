//! Paths from views to a leaderboard that a second machine verifies: every command uses only the outputs of the
//! previous one.

use std::{
    fs,
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    records::{ResultRecord, StatedClock, TrainingKind, Verification},
    store,
};
use tempfile::TempDir;

use crate::support::{Ended, SEQUENCE, files, omnilife, sample, scratch, small_run};

/// Folder of a user, beside the scene of the sample.
struct Road {
    folder: TempDir,
    scene: PathBuf,
}

impl Road {
    fn new() -> Self {
        let road = Self {
            folder: scratch(),
            scene: small_run().out.join(SEQUENCE),
        };
        let card = "method = \"mine\"\ntitle = \"My method\"\nauthors = [\"A. Author\"]\n\
                    code = \"https://example.org/mine\"\nhardware = \"one graphics card\"\n\
                    training = \"per-scene\"\niterations = 7000\n";
        fs::write(road.at("card.toml"), card).unwrap();
        road.omnilife("bench split SCENE --out split.json")
            .succeeded();
        road
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Runs a command with its paths in the folder; `SCENE` is the scene.
    fn omnilife(&self, words: &str) -> Ended {
        let mut previous = "";
        omnilife(words.split(' ').map(|word| {
            let is_place =
                word.contains('/') || word.contains('.') || word.chars().all(char::is_uppercase);
            match std::mem::replace(&mut previous, word) {
                _ if word == "SCENE" => self.scene.clone(),
                "--training-seconds" => PathBuf::from(word),
                _ if is_place => self.at(word),
                _ => PathBuf::from(word),
            }
        }))
    }

    /// Packs `SCORES`, checks and adds it on a machine that made the scene itself, and builds tables there.
    fn reaches_the_leaderboard(&self) -> String {
        self.omnilife("leaderboard submit SCORES --card card.toml --out SUB")
            .succeeded();
        // The other machine has the submission, and nothing beside it.
        let other = scratch();
        let moved = other.path().join("handed-in");
        fs::rename(self.at("SUB"), &moved).unwrap();
        for gone in ["SCORES", "VIEWS", "RUN"] {
            let path = self.at(gone);
            if path.exists() {
                fs::remove_dir_all(path).unwrap();
            }
        }
        let held = files(&moved);
        assert!(
            held.iter()
                .any(|file| file.contains("predictions/novel/000004.")),
            "{held:?}"
        );
        let result = fs::read_to_string(moved.join("results/0000/result.json")).unwrap();
        let place = self.folder.path().file_name().unwrap().to_str().unwrap();
        assert!(
            !result.contains(place),
            "a place of the first machine is told"
        );
        let text = |path: &Path| path.to_str().unwrap().to_owned();
        let (results, board) = (other.path().join("results"), other.path().join("board"));
        let scenes = text(&small_run().out);
        let (moved, results, board) = (text(&moved), text(&results), text(&board));
        let add = [
            "leaderboard",
            "add",
            &moved,
            "--results",
            &results,
            "--scenes",
            &scenes,
            "--audit",
            "1",
        ];
        let added = omnilife(add).succeeded();
        assert!(
            added.stdout.contains("1 of them scored again"),
            "{}",
            added.stdout
        );
        let kept = files(Path::new(&results));
        let record = kept
            .iter()
            .find(|file| file.ends_with("verified.json"))
            .unwrap();
        let verification: Verification =
            store::read_record(&Path::new(&results).join(record)).unwrap();
        assert_eq!((verification.results, verification.scored_again), (1, 1));
        assert_eq!(verification.date_utc.len(), "2026-11-25".len());
        omnilife(["leaderboard", "build", &results, "--out", &board]).succeeded();
        let pages = files(&Path::new(&board).join("site/methods"));
        let page = Path::new(&board).join("site/methods").join(&pages[0]);
        let page = fs::read_to_string(page).unwrap();
        assert!(
            page.contains("verified") && page.contains(&verification.date_utc),
            "{page}"
        );
        // The rules of the protocol came with the result.
        let index = fs::read_to_string(Path::new(&board).join("site/index.html")).unwrap();
        assert!(!index.contains("no split.json has its hash"));
        fs::read_to_string(Path::new(&board).join("table.md")).unwrap()
    }
}

/// Returns a command that scores, with the further words.
fn scoring(further: &str) -> String {
    format!("bench score --scene SCENE --split split.json {further}")
}

/// Writes slightly changed frames 4 and 9 of the scene into a folder.
fn write_views(scene: &Path, folder: &Path) {
    fs::create_dir_all(folder).unwrap();
    for name in ["000004.png", "000009.png"] {
        let mut image = image::open(scene.join("frames").join(name))
            .unwrap()
            .into_rgb8();
        for (at, pixel) in image.pixels_mut().enumerate() {
            pixel[0] = pixel[0].saturating_add((at % 7) as u8);
        }
        image.save(folder.join(name)).unwrap();
    }
}

#[test]
fn from_folders_of_views() {
    let road = Road::new();
    write_views(&road.scene, &road.at("VIEWS"));
    road.omnilife("bench validate VIEWS --scene SCENE --split split.json")
        .succeeded();
    let score = scoring(
        "--novel-views VIEWS --about card.toml --training-seconds 612.5 --clock gpu --out SCORES/mine",
    );
    road.omnilife(&score).succeeded();
    let result: ResultRecord = store::read_record(&road.at("SCORES/mine/result.json")).unwrap();
    assert_eq!(result.training, Some(TrainingKind::PerScene));
    assert_eq!(
        (result.training_seconds, result.iterations),
        (Some(612.5), Some(7000))
    );
    let statement = result.statement.unwrap();
    assert_eq!(statement.numbers, ["iterations", "training_seconds"]);
    assert_eq!(statement.clock, Some(StatedClock::Gpu));
    assert_eq!(result.predictions.unwrap().files.len(), 2);
    let table = road.reaches_the_leaderboard();
    assert!(table.contains("612.5"), "{table}");
}

#[test]
fn from_an_external_method() {
    let road = Road::new();
    write_views(&road.scene, &road.at("method"));
    let manifest = "id = \"mine\"\n[train]\ncommand = [\"true\"]\n[render]\ncommand = [\"true\"]\n\
                    [predictions]\nnovel = \"{folder}/{frame:06}.png\"\n";
    fs::write(road.at("method/method.toml"), manifest).unwrap();
    let external = "bench external method/method.toml --scene SCENE --split split.json --out RUN";
    road.omnilife(external).succeeded();
    let score = scoring("--run RUN --about card.toml --out SCORES");
    road.omnilife(&score).succeeded();
    let result: ResultRecord = store::read_record(&road.at("SCORES/result.json")).unwrap();
    // The time was measured, the iterations are stated.
    assert!(result.training_seconds.is_some());
    assert_eq!(result.statement.unwrap().numbers, ["iterations"]);
    road.reaches_the_leaderboard();
}

/// Scores arrays in a folder with other files, from elsewhere and without a card.
#[test]
fn from_a_folder_of_arrays() {
    let road = Road::new();
    fs::create_dir_all(road.at("VIEWS")).unwrap();
    fs::write(road.at("VIEWS/notes.txt"), "mine").unwrap();
    for name in ["000004", "000009"] {
        let image = image::open(road.scene.join(format!("frames/{name}.png")))
            .unwrap()
            .into_rgb8();
        let (width, height) = image.dimensions();
        let head = format!(
            "{{'descr': '<f4', 'fortran_order': False, 'shape': ({height}, {width}, 3), }}"
        );
        let padding = 64 - (10 + head.len() + 1) % 64;
        let head = format!("{head}{}\n", " ".repeat(padding));
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((head.len() as u16).to_le_bytes());
        bytes.extend(head.as_bytes());
        for value in image.as_raw() {
            bytes.extend((f32::from(*value) / 255.0 * 0.97).to_le_bytes());
        }
        fs::write(road.at(&format!("VIEWS/{name}.npy")), bytes).unwrap();
    }
    let score = scoring("--novel-views VIEWS --method mine --class without-training --out SCORES");
    road.omnilife(&score).succeeded();
    let table = road.reaches_the_leaderboard();
    assert!(table.contains("mine"));
}

#[test]
fn what_is_not_what_was_scored_is_not_handed_in() {
    let road = Road::new();
    write_views(&road.scene, &road.at("VIEWS"));
    let score = scoring("--novel-views VIEWS --method mine --out SCORES");
    road.omnilife(&score).succeeded();
    fs::copy(sample("masks/000000.png"), road.at("VIEWS/000004.png")).unwrap();
    let submit = "--quiet leaderboard submit SCORES --card card.toml --out SUB";
    let message = road.omnilife(submit).failed_quietly(2).to_owned();
    assert!(
        message.contains("000004.png") && message.contains("changed"),
        "{message}"
    );
    assert!(!road.at("SUB").exists());
    // Results with failures are refused too, unless they are accepted explicitly.
    write_views(&road.scene, &road.at("VIEWS"));
    fs::remove_file(road.at("VIEWS/000009.png")).unwrap();
    let scored = road.omnilife(&score);
    assert_eq!(scored.code, Some(2));
    assert!(scored.stdout.starts_with("warning") || scored.stdout.starts_with("failed"));
    let message = road.omnilife(submit).failed_quietly(2).to_owned();
    assert!(message.contains("000009.png is missing"), "{message}");
    road.omnilife(&format!("{submit} --with-failures"))
        .succeeded();
}

#[test]
fn facts_that_a_record_has_are_not_stated_again() {
    let road = Road::new();
    let run = small_run().out.join(crate::support::METHOD).join("run");
    let run = run.to_str().unwrap();
    for (option, value, expected) in [
        ("--training-seconds", "3", "training time"),
        ("--iterations", "30000", "iterations"),
        ("--seed", "4", "seed"),
    ] {
        let split = small_run().out.join(SEQUENCE).join("per-scene/split.json");
        let message = road.omnilife(&format!(
            "--quiet bench score --scene SCENE --out SCORES --split {} --run {run} {option} {value}",
            split.display()
        ));
        let message = message.failed_quietly(2);
        assert!(
            message.contains("run.json") && message.contains(expected),
            "{message}"
        );
    }
}
