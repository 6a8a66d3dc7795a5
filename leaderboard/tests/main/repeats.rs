//! Data that would count several times.

use std::path::PathBuf;

use crate::support::result;
use omnilife_leaderboard::{Tables, build};
use omnilife_schemas::records::{ResultRecord, ScoredFile, ScoredPredictions, TrainingKind};

fn tables(results: Vec<ResultRecord>) -> Tables {
    let out = tempfile::tempdir().unwrap();
    let numbered = results.into_iter().enumerate();
    let results: Vec<_> = numbered
        .map(|(number, result)| (PathBuf::from(format!("{number}/result.json")), result))
        .collect();
    build(&results, out.path()).unwrap()
}

const SCENES: &str = "One scene under several names";
const SEEDS: &str = "The same views, byte for byte, under several seeds";

#[test]
fn one_scene_under_two_names_is_told() {
    let scenes = ["hall", "street", "street again"];
    let results = scenes.map(|scene| result(scene, "odgs", 25.0, 0.8));
    let apart = tables(results.to_vec());
    let mut results = results;
    results[2].scene_sha256 = results[1].scene_sha256.clone();
    let repeated = tables(results.to_vec());
    for text in [&apart.markdown, &apart.short] {
        assert!(!text.contains(SCENES), "{text}");
    }
    for text in [&repeated.markdown, &repeated.short] {
        assert!(text.contains(SCENES), "{text}");
        assert!(text.contains("street and street again"), "{text}");
    }
}

/// Seeds by other options or versions are no repetitions; nor do runs on other points compare methods.
#[test]
fn seeds_of_other_runs_and_runs_on_other_files_are_told() {
    let seed = |seed: u64, option: &str, commit: &str| ResultRecord {
        seed: Some(seed),
        options: vec![option.to_owned()],
        run_versions: [("omnilife commit".to_owned(), commit.to_owned())].into(),
        ..result("street", "mine", 25.0, 0.8)
    };
    let cases = [
        (
            "max-gaussians=9",
            "aaaa",
            "with other options",
            "max-gaussians=5 and max-gaussians=9",
        ),
        ("max-gaussians=5", "bbbb", "other versions", "aaaa and bbbb"),
    ];
    for (option, commit, kind, words) in cases {
        let same = tables(vec![
            seed(0, "max-gaussians=5", "aaaa"),
            seed(1, "max-gaussians=5", "aaaa"),
        ]);
        assert!(!same.markdown.contains(kind), "{}", same.markdown);
        let other = tables(vec![
            seed(0, "max-gaussians=5", "aaaa"),
            seed(1, option, commit),
        ]);
        for text in [&other.markdown, &other.short] {
            assert!(text.contains(kind) && text.contains(words), "{text}");
        }
    }
    let on = |method: &str, points: &str| ResultRecord {
        run_inputs: [("points.ply".to_owned(), points.to_owned())].into(),
        ..result("street", method, 25.0, 0.8)
    };
    let other_files = "Runs that began with other files";
    let same = tables(vec![on("mine", "1"), on("odgs", "1")]);
    assert!(!same.markdown.contains(other_files));
    let other = tables(vec![on("mine", "1"), on("odgs", "2"), on("pvg", "2")]);
    for text in [&other.markdown, &other.short] {
        assert!(text.contains(other_files), "{text}");
        assert!(
            text.contains("points.ply (mine against odgs and pvg)"),
            "{text}"
        );
    }
}

#[test]
fn one_run_under_several_seeds_is_told() {
    let seed = |seed: u64, sha256: &str| {
        let novel = ScoredFile {
            view: "novel".to_owned(),
            file: "000004.png".to_owned(),
            sha256: sha256.to_owned(),
        };
        ResultRecord {
            seed: Some(seed),
            predictions: Some(ScoredPredictions {
                input_views: None,
                novel_views: Some("views".to_owned()),
                files: vec![novel],
            }),
            ..result("street", "mine", 25.0, 0.8)
        }
    };
    let repetitions = tables(vec![seed(0, "a"), seed(1, "b"), seed(2, "c")]);
    assert!(!repetitions.markdown.contains(SEEDS));
    let repeated = vec![seed(0, "a"), seed(1, "a"), seed(2, "a")];
    let found = tables(repeated.clone());
    for text in [&found.markdown, &found.short] {
        assert!(text.contains(SEEDS), "{text}");
        assert!(text.contains("street, mine (2 seeds again)"), "{text}");
    }
    // Interpolation and sweeps have no random numbers.
    let untrained = repeated.into_iter().map(|result| ResultRecord {
        training: Some(TrainingKind::WithoutTraining),
        ..result
    });
    assert!(!tables(untrained.collect()).markdown.contains(SEEDS));
}
