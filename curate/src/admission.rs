//! The two gates of curation: the ERP projection and the admission criteria.

use std::path::Path;

use omnilife_schemas::{
    progress::Progress,
    records::{Admission, CheckOutcome, DetectedProjection, VideoAnalysis, VideoProjection},
};

use crate::{attrition, criteria, error::CurateError, projection, settings::CurateSettings};

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

/// The projection in force, after the user's override.
///
/// Without enforced criteria an undecided video goes through when it is stored at 2:1, with a note:
/// nobody has said that it is not ERP.
pub(crate) fn effective_projection(
    video: &Path,
    analysis: &VideoAnalysis,
    settings: &CurateSettings,
    progress: &dyn Progress,
) -> Result<DetectedProjection, CurateError> {
    let found = analysis.projection.clone();
    if let Some(disagreement) = &found.disagreement {
        progress.note(&format!("{}: {disagreement}", video.display()));
    }
    match settings.accept {
        Some(accepted) if accepted != found.projection => {
            progress.note(&format!(
                "{}: the evidence says {}, taken as {} as asked",
                video.display(),
                found.projection.name(),
                accepted.name()
            ));
            return Ok(DetectedProjection {
                projection: accepted,
                overridden: Some(found.projection),
                ..found
            });
        }
        Some(_) => return Ok(found),
        None => {}
    }
    if found.projection.is_monoscopic_erp() {
        return Ok(found);
    }
    let is_two_to_one = projection::aspect::is_two_to_one(&analysis.probe);
    if found.projection == VideoProjection::Unsure && !settings.enforce && is_two_to_one {
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
    let hint = if found.projection == VideoProjection::Unsure && has_border {
        "cut its black border off first: ffmpeg -i IN -vf crop=W:H:X:Y OUT, with W:H:X:Y from \
         ffmpeg -i IN -vf cropdetect -f null -"
    } else {
        hint(found.projection)
    };
    Err(CurateError::rejected(
        video,
        format!("its image is {}; {hint}", found.projection.name()),
        vec![CheckOutcome {
            check: attrition::PROJECTION.to_owned(),
            passed: false,
            value: found.projection.name().to_owned(),
            threshold: "erp or erp-squeezed".to_owned(),
        }],
    ))
}

/// What the user can do about a projection.
fn hint(projection: VideoProjection) -> &'static str {
    match projection {
        VideoProjection::ErpStereoTb => {
            "extract one eye first: ffmpeg -i IN -vf crop=iw:ih/2:0:0 OUT"
        }
        VideoProjection::ErpStereoLr => {
            "extract one eye first: ffmpeg -i IN -vf crop=iw/2:ih:0:0 OUT"
        }
        VideoProjection::Eac => "convert it first: ffmpeg -i IN -vf v360=eac:equirect OUT",
        VideoProjection::Fisheye => {
            "convert it first: ffmpeg -i IN -vf v360=dfisheye:equirect:ih_fov=DEGREES:iv_fov=DEGREES \
             OUT (fisheye for one circle), with the lens's field of view"
        }
        VideoProjection::Rectilinear => {
            "if it is monoscopic ERP all the same, pass --accept erp; if it is to be reconstructed as \
             an ordinary perspective video, --projection pinhole"
        }
        VideoProjection::Erp | VideoProjection::ErpSqueezed | VideoProjection::Unsure => {
            "if it is monoscopic ERP all the same, pass --accept erp"
        }
    }
}
