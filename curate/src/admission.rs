//! The two gates of curation: the ERP verdict and the admission criteria.

use std::path::Path;

use omnilife_schemas::{
    progress::Progress,
    records::{Admission, CheckOutcome, ErpVerdict, Verdict, VideoAnalysis},
};

use crate::{attrition, criteria, error::CurateError, settings::CurateSettings, verdict};

/// Rejects a video that misses enforced criteria.
pub(crate) fn enforce(video: &Path, admission: &Admission) -> Result<(), CurateError> {
    match criteria::failures(admission) {
        Some(failures) if admission.enforced => Err(CurateError::rejected(
            video,
            format!(
                "{failures} (criteria {}; --criteria none admits it)",
                admission.profile
            ),
            criteria::failed(admission).cloned().collect(),
        )),
        _ => Ok(()),
    }
}

/// The verdict in force, after the user's override.
///
/// Without enforced criteria an undecided video goes through when it is stored at 2:1, with a note:
/// nobody has said that it is not ERP.
pub(crate) fn effective_verdict(
    video: &Path,
    analysis: &VideoAnalysis,
    settings: &CurateSettings,
    progress: &dyn Progress,
) -> Result<ErpVerdict, CurateError> {
    let found = analysis.verdict.clone();
    if let Some(disagreement) = &found.disagreement {
        progress.note(&format!("{}: {disagreement}", video.display()));
    }
    match settings.accept {
        Some(accepted) if accepted != found.verdict => {
            progress.note(&format!(
                "{}: the evidence says {}, taken as {} as asked",
                video.display(),
                found.verdict.name(),
                accepted.name()
            ));
            return Ok(ErpVerdict {
                verdict: accepted,
                overridden: Some(found.verdict),
                ..found
            });
        }
        _ => {}
    }
    if found.verdict.is_monoscopic_erp() {
        return Ok(found);
    }
    let is_two_to_one = verdict::aspect::is_two_to_one(&analysis.probe);
    if found.verdict == Verdict::Unsure && !settings.enforce && is_two_to_one {
        progress.note(&format!(
            "{}: the evidence does not decide whether this is ERP; taken as ERP for its 2:1 size",
            video.display()
        ));
        return Ok(found);
    }
    let has_border = found
        .evidence
        .iter()
        .any(|evidence| evidence.test.starts_with("black-") && evidence.value > evidence.limit);
    let hint = if found.verdict == Verdict::Unsure && has_border {
        "cut its black border off first: ffmpeg -i IN -vf crop=W:H:X:Y OUT, with W:H:X:Y from \
         ffmpeg -i IN -vf cropdetect -f null -"
    } else {
        hint(found.verdict)
    };
    Err(CurateError::rejected(
        video,
        format!("its picture is {}; {hint}", found.verdict.name()),
        vec![CheckOutcome {
            check: attrition::PROJECTION.to_owned(),
            passed: false,
            value: found.verdict.name().to_owned(),
            threshold: "erp or erp-squeezed".to_owned(),
        }],
    ))
}

/// What the user can do about a verdict.
fn hint(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::ErpStereoTb => "extract one eye first: ffmpeg -i IN -vf crop=iw:ih/2:0:0 OUT",
        Verdict::ErpStereoLr => "extract one eye first: ffmpeg -i IN -vf crop=iw/2:ih:0:0 OUT",
        Verdict::Eac => "convert it first: ffmpeg -i IN -vf v360=eac:equirect OUT",
        Verdict::Fisheye => {
            "convert it first: ffmpeg -i IN -vf v360=dfisheye:equirect:ih_fov=DEGREES:iv_fov=DEGREES \
             OUT (fisheye for one circle), with the lens's field of view"
        }
        Verdict::Erp | Verdict::ErpSqueezed | Verdict::Rectilinear | Verdict::Unsure => {
            "if it is monoscopic ERP all the same, pass --accept erp"
        }
    }
}
