//! Level of dynamic content, by masks where there are any.

use std::path::Path;

use omnilife_schemas::{
    layout::{DYNAMIC_MASKS_FILE, DYNAMIC_MASKS_FOLDER},
    records::{Dynamics, Masks, Scene},
    rgb::Mask,
    store,
};

use super::{LIMITS, evidence, from_frames::FrameMotion, unknown};
use crate::error::CurateError;

/// Classes, from little motion to much.
pub(crate) const LEVELS: [&str; 3] = ["low", "medium", "high"];

/// Returns the shares of the sphere that masks mark as moving, with the source of the masks: those of the scene, else
/// those that were computed. `None` without masks.
///
/// # Errors
/// When a mask or its record cannot be read.
pub(super) fn masked_shares(
    folder: &Path,
    scene: Option<&Scene>,
) -> Result<Option<(Vec<f64>, &'static str)>, CurateError> {
    if let Some(scene) = scene {
        let masks = scene.frames.iter().filter_map(|frame| frame.mask.as_ref());
        let shares = masks
            .map(|file| Ok(Mask::read(&folder.join(file))?.marked_share(&scene.camera)))
            .collect::<Result<Vec<f64>, CurateError>>()?;
        if !shares.is_empty() {
            return Ok(Some((shares, "masks of the scene")));
        }
    }
    let record = folder.join(DYNAMIC_MASKS_FOLDER).join(DYNAMIC_MASKS_FILE);
    if !record.is_file() {
        return Ok(None);
    }
    let masks: Masks = store::read_record(&record)?;
    let shares: Vec<f64> = (masks.frames.iter())
        .map(|frame| frame.dynamic_share)
        .collect();
    Ok((!shares.is_empty()).then_some((shares, "masks")))
}

/// Returns the level from the shares of masks, else from the flow of frames that were registered.
pub(super) fn level(
    masks: Option<(Vec<f64>, &'static str)>,
    frames: Option<&FrameMotion>,
) -> Dynamics {
    let (shares, from) = match (masks, frames) {
        (Some(masks), _) => masks,
        (None, Some(frames)) => {
            if frames.registered_share() < LIMITS.least_registered {
                return unknown(Some(frames));
            }
            (frames.dynamic_shares.clone(), "frames")
        }
        (None, None) => return unknown(None),
    };
    if shares.is_empty() {
        return unknown(frames);
    }
    let mean = shares.iter().sum::<f64>() / shares.len() as f64;
    let [low, medium, high] = LEVELS;
    let class = match mean {
        share if share > LIMITS.high_dynamics => high,
        share if share > LIMITS.low_dynamics => medium,
        _ => low,
    };
    Dynamics {
        class: class.to_owned(),
        from: from.to_owned(),
        evidence: vec![
            evidence(
                "dynamic_share_mean",
                mean,
                LIMITS.low_dynamics,
                "above is medium",
            ),
            evidence(
                "dynamic_share_mean",
                mean,
                LIMITS.high_dynamics,
                "above is high",
            ),
        ],
    }
}
