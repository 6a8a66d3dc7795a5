//! Mistakes of convention in predicted views: axes, pixel centres, channels, encodings, order of frames.
//!
//! Some views of each kind are compared with ground truth once more after changes that undo common mistakes. They are
//! also compared with the ground truth of other frames. A reported change fits much better in (nearly) every examined
//! view. Thresholds were chosen by `scripts/calibrate/diagnosis.py` so that views of honest methods, however poor, have
//! no finding. Views made only of the frame before are an exception: they look like views that are numbered one off. No
//! score is ever taken from a changed view.

mod border;
mod colour;
mod copies;
mod distances;
mod encoding;
mod geometry;
mod images;
mod kind;
mod look;
mod order;
mod shifts;
#[cfg(test)]
mod tests;

use std::{collections::BTreeSet, fmt};

use omnilife_schemas::records::DIAGNOSIS_PREFIX;

use self::{
    copies::Truths,
    images::mean,
    look::ViewFacts,
    order::{Comparison, frames_to_compare},
};
use crate::{
    error::BenchError,
    job::{ScoreRequest, ScoringJob, View, ViewKind},
};

pub(crate) use self::copies::{Look, repeated_frames};
pub use self::{
    border::Border,
    distances::DistanceMistake,
    encoding::Encoding,
    kind::{ChannelOrder, DiagnosisKind},
    order::FrameOrder,
};

/// Number of examined views of a kind, evenly spaced.
const VIEWS: usize = 6;
/// Approximate number of frames beside the views' own whose ground truth is compared.
const OTHER_FRAMES: usize = 32;
/// Number of novel frames that are compared with the given ones beside them.
const NOVEL_FRAMES: usize = 8;

/// Likely mistakes in views, and facts for readers of their scores.
#[derive(Debug, Clone, PartialEq)]
pub struct Diagnosis {
    /// Number of examined views, without unreadable ones.
    pub views: usize,
    /// Their mean PSNR without changes, dB; 100 dB for equal images. `None` without views.
    pub psnr_db: Option<f64>,
    /// Findings, mistakes first.
    pub findings: Vec<DiagnosisFinding>,
}

/// A finding.
#[derive(Debug, Clone, PartialEq)]
pub struct DiagnosisFinding {
    /// `input` or `novel`; `None` for a fact about the data.
    pub view: Option<String>,
    /// The mistake or fact.
    pub kind: DiagnosisKind,
    /// Mean gain in PSNR of the examined views without the mistake, dB; `None` if it cannot be undone.
    pub gain_db: Option<f64>,
}

impl fmt::Display for DiagnosisFinding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(view) = &self.view {
            write!(f, "{view} views: ")?;
        }
        f.write_str(&self.without_view())
    }
}

impl DiagnosisFinding {
    /// Returns its line without the kind of views.
    pub fn without_view(&self) -> String {
        let gain = self
            .gain_db
            .map(|gain| format!(" ({gain:.1} dB better; scores are of the views as they are)"));
        format!("{}{}", self.kind, gain.unwrap_or_default())
    }
}

impl Diagnosis {
    /// Returns one line for every mistake, prefixed by [`DIAGNOSIS_PREFIX`], and without it one for frames of the data
    /// that are given and held out, and for missing distances. Copies of given views, as in baselines, make no warning.
    pub fn warnings(&self) -> Vec<String> {
        let mistakes = self
            .mistakes()
            .map(|mistake| format!("{DIAGNOSIS_PREFIX}{mistake}"));
        let is_told = |finding: &&DiagnosisFinding| {
            !matches!(finding.kind, DiagnosisKind::CopiesOfGivenViews { .. })
        };
        let others = self.notes().filter(is_told);
        mistakes.chain(others.map(ToString::to_string)).collect()
    }

    /// Returns the findings that are not mistakes: facts about views and data.
    pub fn notes(&self) -> impl Iterator<Item = &DiagnosisFinding> {
        self.findings
            .iter()
            .filter(|finding| !finding.kind.is_mistake())
    }

    /// Returns the mistakes among the findings.
    pub fn mistakes(&self) -> impl Iterator<Item = &DiagnosisFinding> {
        self.findings
            .iter()
            .filter(|finding| finding.kind.is_mistake())
    }
}

/// Examines some of the views that a request would score. Nothing is written.
///
/// # Errors
/// Those of scoring, as far as they concern scene, split and ground truth.
pub fn diagnose(request: &ScoreRequest) -> Result<Diagnosis, BenchError> {
    of_job(&ScoringJob::prepare(request)?, request.memory_bytes)
}

/// Examines some of the views of a job. `memory_bytes` is the approximate limit of their total memory.
pub(crate) fn of_job(job: &ScoringJob, memory_bytes: u64) -> Result<Diagnosis, BenchError> {
    let given = &job.split.input_views;
    let kinds = [
        (ViewKind::Input, given),
        (ViewKind::Novel, &job.split.novel_views),
    ];
    let mut by_kind = Vec::new();
    for (kind, frames) in kinds {
        if job.folder(kind).is_some() {
            let views = spread(frames, VIEWS).map(|frame| View { kind, frame });
            let views = look::look(job, &views.collect::<Vec<_>>(), memory_bytes)?;
            by_kind.push(OfKind {
                job,
                kind,
                frames,
                views,
            });
        }
    }
    let novel: Vec<u32> = spread(&job.split.novel_views, NOVEL_FRAMES).collect();
    let truths = look::truths(job, &other_frames(&by_kind, &novel, given), memory_bytes);
    let mut findings: Vec<DiagnosisFinding> = Vec::new();
    for of_kind in &by_kind {
        findings.extend(of_kind.findings(&truths)?);
    }
    findings.sort_by_key(|finding| !finding.kind.is_mistake());
    findings.extend(
        repeated_frames(&novel, given, |frame| Some(&truths.get(&frame)?.look)).map(|kind| {
            DiagnosisFinding {
                view: None,
                kind,
                gain_db: None,
            }
        }),
    );
    let psnrs = by_kind.iter().flat_map(|of_kind| &of_kind.views);
    let psnrs: Vec<f64> = psnrs.map(|view| view.psnr_db).collect();
    Ok(Diagnosis {
        views: psnrs.len(),
        psnr_db: (!psnrs.is_empty()).then(|| mean(psnrs)),
        findings,
    })
}

/// Returns at most `count` of the frames, evenly spaced.
fn spread(frames: &[u32], count: usize) -> impl Iterator<Item = u32> {
    let count = count.min(frames.len());
    (0..count).map(move |index| frames[(2 * index + 1) * frames.len() / (2 * count)])
}

/// Returns frames whose ground truth is compared with views, and those that are compared with each other.
fn other_frames(by_kind: &[OfKind<'_>], novel: &[u32], given: &[u32]) -> BTreeSet<u32> {
    let mut frames: BTreeSet<u32> = novel.iter().copied().collect();
    for of_kind in by_kind {
        for view in &of_kind.views {
            frames.extend(frames_to_compare(view.view.frame, of_kind.frames));
        }
    }
    let shown = by_kind.iter().flat_map(|of_kind| &of_kind.views);
    let shown = shown.map(|view| view.view.frame).collect::<BTreeSet<u32>>();
    for frame in novel.iter().copied().chain(shown) {
        frames.extend(copies::given_beside(frame, given));
    }
    for of_kind in by_kind {
        let room = OTHER_FRAMES.saturating_sub(frames.len());
        frames.extend(spread(of_kind.frames, room));
    }
    frames
}

/// Views of one kind.
struct OfKind<'a> {
    job: &'a ScoringJob,
    kind: ViewKind,
    /// All frames of the kind, in the order of the split.
    frames: &'a [u32],
    /// Some of their views.
    views: Vec<ViewFacts>,
}

impl OfKind<'_> {
    fn findings(&self, truths: &Truths) -> Result<Vec<DiagnosisFinding>, BenchError> {
        let views = &self.views[..];
        let mut found: Vec<(DiagnosisKind, Option<f64>)> = Vec::new();
        let encoding = colour::encoding(views);
        let is_inverted = encoding.is_some_and(|(encoding, _)| encoding == Encoding::Inverted);
        let comparison = Comparison::new(views, self.frames, truths);
        let copied = match self.kind {
            ViewKind::Input => 0,
            ViewKind::Novel => comparison.copies(&self.job.split.input_views),
        };
        // A copy of another view need not match its own ground truth, and for inverted views some rotation always fits
        // better.
        if 2 * copied <= views.len() && !is_inverted {
            found.extend(self.placement(&comparison)?);
        }
        found.extend(
            colour::channels(views)
                .map(|(order, gain)| (DiagnosisKind::Channels(order), Some(gain))),
        );
        found.extend(encoding.map(|(encoding, gain)| {
            let gain = Some(gain).filter(|&gain| gain > 0.0);
            (DiagnosisKind::Encoded(encoding), gain)
        }));
        found.extend(
            self.without_gain(copied)
                .into_iter()
                .map(|kind| (kind, None)),
        );
        let finding = |(kind, gain_db)| DiagnosisFinding {
            view: Some(self.kind.to_string()),
            kind,
            gain_db,
        };
        Ok(found.into_iter().map(finding).collect())
    }

    /// Returns the rotation, the order of frames or the shift that explains most.
    fn placement(
        &self,
        comparison: &Comparison<'_>,
    ) -> Result<Option<(DiagnosisKind, Option<f64>)>, BenchError> {
        let turn = geometry::turn(&self.views, look::wraps(self.job));
        let order = comparison.order();
        if let Some((order, gain)) = order
            && turn.is_none_or(|(_, of_turn)| gain >= of_turn)
        {
            return Ok(Some((DiagnosisKind::Order(order), Some(gain))));
        }
        let is_small = turn.is_none_or(|(turn, _)| turn.is_small());
        if is_small && let Some(shift) = self.shift()? {
            return Ok(Some(shift));
        }
        Ok(turn.map(|(turn, gain)| {
            let kind = DiagnosisKind::Turned {
                is_mirrored: turn.is_mirrored,
                is_upside_down: turn.is_upside_down,
                degrees_right: turn.degrees_right,
            };
            (kind, Some(gain))
        }))
    }

    /// Returns the common shift of all views, and their gain without it.
    fn shift(&self) -> Result<Option<(DiagnosisKind, Option<f64>)>, BenchError> {
        let Some([right, down]) = shifts::common(&self.views) else {
            return Ok(None);
        };
        let mut gains: Vec<f64> = Vec::new();
        for view in &self.views {
            let pair = look::read(self.job, view.view)?;
            gains.extend(pair.map(|pair| shifts::gain_db(&pair, [right, down])));
        }
        let gain = shifts::telling_gain(&gains);
        Ok(gain.map(|gain| (DiagnosisKind::Shifted { right, down }, Some(gain))))
    }

    /// Returns findings that cannot be undone, or have no gain.
    fn without_gain(&self, copied: usize) -> Vec<DiagnosisKind> {
        let views = &self.views[..];
        let mut kinds = Vec::new();
        let share = mean(views.iter().filter_map(|view| view.outside));
        if share >= look::TELLING_OUTSIDE {
            kinds.push(DiagnosisKind::OutsideRange { share });
        }
        let files = (views.iter().filter(|view| view.states_other_colours)).count();
        if files > 0 {
            let views = views.len();
            kinds.push(DiagnosisKind::OtherColours { files, views });
        }
        if !views.is_empty() && views.iter().all(|view| view.is_doubled) {
            kinds.push(DiagnosisKind::DoubledPixels);
        }
        kinds.extend(distances::mistake(views).map(DiagnosisKind::Distances));
        let missing = mean(views.iter().filter_map(|view| view.distances_missing));
        if missing > 0.0 {
            kinds.push(DiagnosisKind::DistancesMissing { share: missing });
        }
        kinds.extend(border::common(views).map(DiagnosisKind::Bordered));
        if copied == 0 && copies::is_one_image(views) {
            kinds.push(DiagnosisKind::OneImage);
        }
        let strays = self.job.folder(self.kind).map(|folder| &folder.strays[..]);
        let first = copies::named_by_place(strays.unwrap_or_default(), self.frames);
        kinds.extend(first.map(|first| DiagnosisKind::NamedByPlace { first }));
        if copied > 0 {
            kinds.push(DiagnosisKind::CopiesOfGivenViews {
                copies: copied,
                views: views.len(),
            });
        }
        kinds
    }
}
