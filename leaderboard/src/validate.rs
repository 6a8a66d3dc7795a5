//! Validation before any table is made: impossible numbers, and results that contradict each other.

use std::{collections::BTreeMap, path::PathBuf};

use omnilife_schemas::{
    names,
    records::{Direction, ResultRecord},
};

use crate::{error::LeaderboardError, quantity::ViewKind};

/// Results with their source files.
type Results = [(PathBuf, ResultRecord)];

/// Checks all results; files are named in the order of collection.
pub(crate) fn validate(results: &Results) -> Result<(), LeaderboardError> {
    for (path, result) in results {
        if let Some(reason) = impossible(result) {
            return Err(LeaderboardError::Impossible {
                path: path.clone(),
                reason,
            });
        }
    }
    refuse_duplicates(results)?;
    refuse_different_scenes(results)?;
    refuse_missing_views(results)?;
    refuse_contradicting_directions(results)
}

fn impossible(result: &ResultRecord) -> Option<String> {
    for (what, text) in [
        ("method", &result.method),
        ("scene", &result.scene),
        ("protocol", &result.protocol),
        ("protocol hash", &result.protocol_hash),
    ] {
        if text.trim().is_empty() {
            return Some(format!("the {what} has no name"));
        }
        if !names::is_plain(text) {
            return Some(format!(
                "the name of the {what} must be of one line, without spaces around it, got {text:?}"
            ));
        }
    }
    for kind in ViewKind::ALL {
        for (metric, summary) in kind.scores(result) {
            if !summary.mean.is_finite() {
                let mean = summary.mean;
                return Some(format!("{metric} of the {} views is {mean}", kind.name()));
            }
            if summary.views == 0 {
                let kind = kind.name();
                return Some(format!(
                    "{metric} of the {kind} views is a mean of no views"
                ));
            }
        }
    }
    [
        ("training time", result.training_seconds),
        ("rendering time", result.rendering_seconds),
    ]
    .into_iter()
    .find_map(|(what, seconds)| {
        let seconds = seconds?;
        (!seconds.is_finite() || seconds < 0.0).then(|| format!("the {what} is {seconds} seconds"))
    })
}

fn refuse_duplicates(results: &Results) -> Result<(), LeaderboardError> {
    let mut rows = BTreeMap::new();
    for (path, result) in results {
        let key = (
            &result.protocol,
            &result.protocol_hash,
            &result.scene,
            &result.method,
            result.seed,
        );
        if let Some(first) = rows.insert(key, path) {
            return Err(LeaderboardError::Duplicate {
                method: result.method.clone(),
                scene: result.scene.clone(),
                protocol: result.protocol.clone(),
                first: first.clone(),
                second: path.clone(),
            });
        }
    }
    Ok(())
}

fn refuse_different_scenes(results: &Results) -> Result<(), LeaderboardError> {
    // Another protocol scores other frames, so only results of one protocol can contradict.
    let mut known: BTreeMap<(&str, &str), (&PathBuf, &str)> = BTreeMap::new();
    for (path, result) in results {
        let (first, sha256) = *known
            .entry((&result.protocol_hash, &result.scene))
            .or_insert((path, &result.scene_sha256));
        if sha256 != result.scene_sha256 {
            return Err(LeaderboardError::SceneDiffers {
                scene: result.scene.clone(),
                first: first.clone(),
                second: path.clone(),
            });
        }
    }
    Ok(())
}

/// Refuses a result that accounts for fewer views, scored and failed, than another one of its scene has scores of: the
/// missing ones would be an omission, and its means are of other views.
fn refuse_missing_views(results: &Results) -> Result<(), LeaderboardError> {
    for kind in ViewKind::ALL {
        let mut most: BTreeMap<(&str, &str), (u32, &PathBuf)> = BTreeMap::new();
        for (path, result) in results {
            let scored = scored_views(kind, result);
            let known = most.entry(scene_of(result)).or_insert((scored, path));
            if scored > known.0 {
                *known = (scored, path);
            }
        }
        for (path, result) in results {
            let scored = scored_views(kind, result);
            let failures = result.failures.iter();
            let failed = failures.filter(|failure| failure.view == kind.name());
            let all = scored.saturating_add(failed.count() as u32);
            let Some((most, other)) = most.get(&scene_of(result)) else {
                continue;
            };
            if scored > 0 && all < *most {
                let (kind, scene) = (kind.name(), &result.scene);
                return Err(LeaderboardError::Impossible {
                    path: path.clone(),
                    reason: format!(
                        "must account for every {kind} view of scene {scene}, got {all} with failures, and {} scores \
                         {most}",
                        other.display()
                    ),
                });
            }
        }
    }
    Ok(())
}

/// Returns protocol and scene of a result, which determine its views.
fn scene_of(result: &ResultRecord) -> (&str, &str) {
    (&result.protocol_hash, &result.scene)
}

/// Returns the number of views of a kind that a result has scores of, or masks that leave them undefined.
fn scored_views(kind: ViewKind, result: &ResultRecord) -> u32 {
    let summaries = kind.scores(result).values();
    let views = summaries.map(|summary| summary.views.saturating_add(summary.undefined_views));
    views.max().unwrap_or(0)
}

fn refuse_contradicting_directions(results: &Results) -> Result<(), LeaderboardError> {
    let mut known: BTreeMap<(&str, &str), Option<Direction>> = BTreeMap::new();
    for (path, result) in results {
        for (metric, summary) in result.input_views.iter().chain(&result.novel_views) {
            let first = *known
                .entry((&result.protocol_hash, metric))
                .or_insert(summary.direction);
            if first != summary.direction {
                return Err(LeaderboardError::Direction {
                    path: path.clone(),
                    metric: metric.clone(),
                    found: match summary.direction {
                        Some(Direction::HigherIsBetter) => "better when higher",
                        Some(Direction::LowerIsBetter) => "better when lower",
                        None => "neither better when higher nor when lower",
                    },
                });
            }
        }
    }
    Ok(())
}
