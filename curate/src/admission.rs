//! The two gates of curation: the ERP projection and the admission criteria.

use std::path::Path;

use omnilife_schemas::{
    progress::Progress,
    records::{
        Admission, CheckOutcome, DetectedProjection, SphereLayout, VideoAnalysis, VideoProjection,
    },
};

use crate::{criteria, error::CurateError, projection, settings::CurateSettings, sphere_layouts};

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

/// Least share of the shots' time that must be spherical for a video that is not ERP as a whole.
const LEAST_SPHERE_SHARE: f64 = 0.5;

/// Returns the projection in force, after the user's override. It is that of the video as stored, even if a `layout`
/// makes its frames equirectangular.
///
/// A video of another kind is taken as ERP if `sphere_share` exceeds one half: the share of its shots' time whose own
/// frames are spheres. The rest is left out shot by shot.
///
/// Without enforced criteria an undecided video is accepted when stored at 2:1, with a note that its projection is
/// assumed.
pub(crate) fn effective_projection(
    video: &Path,
    analysis: &VideoAnalysis,
    layout: Option<SphereLayout>,
    settings: &CurateSettings,
    sphere_share: f64,
    progress: &dyn Progress,
) -> Result<DetectedProjection, CurateError> {
    let found = analysis.projection.clone();
    if let Some(disagreement) = &found.disagreement {
        progress.note(&format!("{}: {disagreement}", video.display()));
    }
    if let Some(layout) = layout {
        let stored = sphere_layouts::projection(layout);
        let asked = if settings.layout.is_some() {
            "as asked"
        } else {
            "by the evidence"
        };
        progress.note(&format!(
            "{}: frames are made equirectangular from {layout}, {asked}",
            video.display()
        ));
        return Ok(DetectedProjection {
            projection: stored,
            overridden: (found.projection != stored).then_some(found.projection),
            ..found
        });
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
    if sphere_share > LEAST_SPHERE_SHARE && may_be_mixed(analysis) {
        let by_shots = if is_two_to_one {
            VideoProjection::Erp
        } else {
            VideoProjection::ErpSqueezed
        };
        progress.note(&format!(
            "{}: its image as a whole is {}; taken as {} because {:.0} % of the time of its shots is",
            video.display(),
            found.projection.name(),
            by_shots.name(),
            100.0 * sphere_share
        ));
        return Ok(DetectedProjection {
            projection: by_shots,
            overridden: Some(found.projection),
            ..found
        });
    }
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
    let hint = if analysis.probe.rotation_degrees.rem_euclid(180.0) != 0.0 {
        "its container gives it a quarter turn; if the stored image is upright, take that out: \
         ffmpeg -display_rotation 0 -i IN -c copy OUT"
    } else if found.projection == VideoProjection::Unsure && has_border {
        "cut its black border off first: ffmpeg -i IN -vf crop=W:H:X:Y OUT, with W:H:X:Y from \
         ffmpeg -i IN -vf cropdetect -f null -"
    } else if analysis
        .probe
        .spherical
        .as_ref()
        .is_some_and(|stated| stated.is_cropped)
    {
        "if it is the half of the sphere ahead (VR180), pass --projection half-erp, half-erp-left-right \
         or half-erp-top-bottom"
    } else {
        hint(found.projection)
    };
    Err(CurateError::rejected(
        video,
        format!("its image is {}; {hint}", found.projection.name()),
        vec![CheckOutcome {
            check: criteria::PROJECTION.to_owned(),
            passed: false,
            value: found.projection.name().to_owned(),
            threshold: "erp or erp-squeezed".to_owned(),
        }],
    ))
}

/// Returns true if a video that is not ERP as a whole may mix spheres with shots of another kind. Halves of one scene
/// are not a mixture; overlays were searched for only if some frames are spheres.
fn may_be_mixed(analysis: &VideoAnalysis) -> bool {
    let found = &analysis.projection;
    let is_stereo = found
        .evidence
        .iter()
        .any(|evidence| evidence.test.starts_with("stereo-") && evidence.value > evidence.limit);
    let is_open = matches!(
        found.projection,
        VideoProjection::Rectilinear | VideoProjection::Unsure
    );
    is_open && !is_stereo && analysis.overlays.is_some()
}

/// Returns advice to the user about a projection.
fn hint(projection: VideoProjection) -> &'static str {
    match projection {
        VideoProjection::ErpStereoTb => "pass --projection stereo-top-bottom",
        VideoProjection::ErpStereoLr => "pass --projection stereo-left-right",
        VideoProjection::HalfErp => {
            "pass --projection half-erp, half-erp-left-right or half-erp-top-bottom"
        }
        VideoProjection::Eac => {
            "pass --projection eac, as YouTube stores it, or cubemap-3x2, cubemap-6x1 or cubemap-1x6"
        }
        VideoProjection::Fisheye => {
            "if it is two circles side by side, pass --projection dual-fisheye"
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
