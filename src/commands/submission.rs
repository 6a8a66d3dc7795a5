//! `omnilife leaderboard submit` and `add`: submitted results, and scoring a sample of them again.

use std::{
    env,
    path::Path,
    time::{SystemTime, UNIX_EPOCH},
};

use omnilife_bench::{
    DEFAULT_MEMORY_BYTES, MetricChoice, Predictions, ScoreRequest, Statement, protocols, score,
    split_scene_under, validate,
};
use omnilife_leaderboard::submission::{self, PackRequest, VerifiedSubmission};
use omnilife_schemas::{
    layout::SPLIT_FILE,
    lock::FolderLock,
    plain_text::counted,
    progress::Progress,
    provenance,
    records::{Protocol, ResultRecord, SplitRule, SubmittedResult, Verification},
    store::{self, Unfinished},
};

use crate::{
    cli::{AddArguments, SubmitResultsArguments},
    exit::{self, BadRequest},
    plans,
};

/// Largest accepted difference from a submitted score: processors round sums differently.
const TOLERANCE: f64 = 1e-6;

pub(crate) fn submit(
    arguments: &SubmitResultsArguments,
    progress: &dyn Progress,
) -> anyhow::Result<()> {
    // Read first, so that the output cannot be taken for it.
    submission::read_card(&arguments.card)?;
    let _lock = FolderLock::take(&arguments.out, progress)?;
    let packed = submission::pack(&PackRequest {
        results: arguments.results.clone(),
        card: arguments.card.clone(),
        out: arguments.out.clone(),
        with_failures: arguments.with_failures,
    })?;
    let files: usize = packed.results.iter().map(|result| result.files.len()).sum();
    exit::print(&format!(
        "{}: {} of {}, {}\n",
        arguments.out.display(),
        counted(packed.results.len(), "result"),
        packed.card.method,
        counted(files, "file")
    ))
}

pub(crate) fn add(arguments: &AddArguments, progress: &dyn Progress) -> anyhow::Result<()> {
    let verified = submission::verify(&arguments.submission)?;
    if arguments.audit > 0 {
        let Some(scenes) = &arguments.scenes else {
            return Err(BadRequest("--audit needs the --scenes".to_owned()).into());
        };
        let seed = arguments.audit_seed.unwrap_or_else(|| {
            let now = SystemTime::now().duration_since(UNIX_EPOCH);
            now.map_or(0, |time| u64::from(time.subsec_nanos()))
        });
        audit(&verified, scenes, arguments.audit, seed, progress)?;
    }
    let _lock = FolderLock::take(&arguments.results, progress)?;
    let scored_again = arguments.audit.min(verified.results.len());
    let now = provenance::utc(SystemTime::now());
    let verification = Verification {
        method: verified.submission.card.method.clone(),
        // The day of `2026-11-25 07:00:00 UTC`.
        date_utc: now.split(' ').next().unwrap_or(&now).to_owned(),
        results: verified.results.len() as u32,
        scored_again: scored_again as u32,
    };
    let target = submission::add(&verified, &verification, &arguments.results)?;
    exit::print(&format!(
        "{}: {} of {} added, {} of them scored again\n",
        target.display(),
        counted(verified.results.len(), "result"),
        verified.submission.card.method,
        scored_again
    ))
}

/// Scores a sample of a submission's predictions again. The submitter cannot know the sample without the seed.
fn audit(
    verified: &VerifiedSubmission,
    scenes: &Path,
    count: usize,
    seed: u64,
    progress: &dyn Progress,
) -> anyhow::Result<()> {
    let scenes = plans::benchmark::scenes(&[scenes.to_owned()])?;
    let entries = verified.submission.results.iter();
    let mut order: Vec<(String, &SubmittedResult, &ResultRecord)> = entries
        .zip(&verified.results)
        .map(|(entry, (_, result))| {
            let draw = store::sha256_bytes(format!("{seed} {}", entry.folder).as_bytes());
            (draw, entry, result)
        })
        .collect();
    order.sort_by(|a, b| a.0.cmp(&b.0));
    progress.note(&format!(
        "auditing {} of {}, audit seed {seed}",
        count.min(order.len()),
        counted(order.len(), "result")
    ));
    for (_, entry, result) in order.into_iter().take(count) {
        let scene = scenes
            .iter()
            .find(|(id, _)| *id == entry.scene)
            .map(|(_, file)| file)
            .ok_or_else(|| {
                BadRequest(format!("scene {}: is not among the --scenes", entry.scene))
            })?;
        let name = format!("omnilife-audit-{}", entry.folder.replace('/', "-"));
        let work = Unfinished::folder_beside(&env::temp_dir().join(name))?;
        let rules = result.rules.as_ref();
        let again = score_again(verified, entry, rules, scene, work.path(), progress)?;
        if let Some(reason) = difference(result, &again) {
            let folder = verified.folder.join(&entry.folder);
            return Err(BadRequest(format!("{}: {reason}", folder.display())).into());
        }
    }
    Ok(())
}

/// Scores the predictions of an entry again, under the known protocol with the choices that `rules`, those of its
/// result, have.
fn score_again(
    verified: &VerifiedSubmission,
    entry: &SubmittedResult,
    rules: Option<&Protocol>,
    scene: &Path,
    work: &Path,
    progress: &dyn Progress,
) -> anyhow::Result<ResultRecord> {
    let split = work.join(SPLIT_FILE);
    let protocol = entry.protocol.split('/').next().unwrap_or_default();
    let mut protocol = protocols::protocol(protocol)?;
    if let Some(rules) = rules {
        choose_as(&mut protocol, rules);
    }
    let made = split_scene_under(scene, &protocol, &split)?;
    if made.protocol_hash != entry.protocol_hash {
        let (id, folder) = (&entry.protocol, &entry.folder);
        return Err(BadRequest(format!(
            "{folder}: protocol {id} has other rules here than where it was scored"
        ))
        .into());
    }
    let folder = verified.folder.join(&entry.folder);
    let views = |name: &Option<String>| name.as_ref().map(|name| folder.join(name));
    let predictions = Predictions::Folders {
        input_views: views(&entry.input_views),
        novel_views: views(&entry.novel_views),
    };
    // Finds faults that scoring would not notice, such as ground truth that is submitted as a prediction.
    for finding in validate(scene, &split, &predictions, progress)?.findings {
        progress.note(&format!("{}: {}", entry.folder, finding.reason));
    }
    Ok(score(
        &ScoreRequest {
            scene: scene.to_owned(),
            split,
            predictions,
            method: verified.submission.card.method.clone(),
            statement: Statement::default(),
            out: work.join("score"),
            memory_bytes: DEFAULT_MEMORY_BYTES,
            metrics: MetricChoice::All,
        },
        progress,
    )?)
}

/// Sets what `bench split` lets users choose, padding and named input frames, to the choices of a result's rules.
fn choose_as(protocol: &mut Protocol, rules: &Protocol) {
    protocol.padding = rules.padding;
    if matches!(protocol.split, SplitRule::EvenlyGiven { .. })
        && matches!(rules.split, SplitRule::Given { .. })
    {
        protocol.split = rules.split.clone();
    }
}

/// Returns the first difference of a result from the scores of its predictions, in words.
fn difference(stated: &ResultRecord, again: &ResultRecord) -> Option<String> {
    if stated.scene_sha256 != again.scene_sha256 {
        return Some("was scored on other frames or poses".to_owned());
    }
    if stated.failures.len() != again.failures.len() {
        let (stated, again) = (stated.failures.len(), again.failures.len());
        return Some(format!("states {stated} failures, scoring gives {again}"));
    }
    // A metric whose weights are not installed here does not count against a submitter who had them, nor does one
    // that the submitter states as unavailable.
    let is_missing = |result: &ResultRecord, kind: &str, metric: &str| {
        let mut missing = result.unavailable.iter();
        missing.any(|missing| missing.view == kind && missing.metric == metric)
    };
    let is_judged = |kind: &str, metric: &str, is_stated: bool| {
        !is_missing(again, kind, metric) && (is_stated || !is_missing(stated, kind, metric))
    };
    let kinds = [
        ("input", &stated.input_views, &again.input_views),
        ("novel", &stated.novel_views, &again.novel_views),
    ];
    kinds.into_iter().find_map(|(kind, stated, again)| {
        let metrics = stated.keys().chain(again.keys());
        let mut judged =
            metrics.filter(|&metric| is_judged(kind, metric, stated.contains_key(metric)));
        judged.find_map(|metric| {
            let means = [stated, again].map(|scores| scores.get(metric).map(|score| score.mean));
            let agree = match means {
                [Some(a), Some(b)] => (a - b).abs() <= TOLERANCE * b.abs().max(1.0),
                _ => false,
            };
            let word = |mean: Option<f64>| mean.map_or("nothing".to_owned(), |m| m.to_string());
            (!agree).then(|| {
                let [stated, again] = means.map(word);
                format!("states {stated} for {metric} of the {kind} views, scoring gives {again}")
            })
        })
    })
}
