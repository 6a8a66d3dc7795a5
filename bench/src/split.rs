//! Split of a scene's frames into those given to a method and those it must predict.

use std::path::Path;

use omnilife_schemas::{
    padded_frame::PaddedFrame,
    plain_text,
    records::{Protocol, Resampling, Scene, Split},
    split_rules::{self, SplitError},
    store::{self, StoreError},
};

use crate::{error::BenchError, protocols};

/// Prefix of the schemas of all versions.
const ANY_SPLIT: &str = "omnilife/split/";

/// Applies a protocol's split rule to a scene's frames. The numbers in the split count all frames of
/// the scene, in its order.
///
/// # Errors
/// When the rule is invalid, it leaves no frame to give or to score, a pose is not usable (zero quaternion, non-finite
/// entries) or frames are not in order of time.
pub fn split(scene: &Scene, protocol: &Protocol) -> Result<Split, BenchError> {
    split_rules::split(scene, protocol).map_err(|error| {
        let scene = scene.id.clone();
        match error {
            SplitError::Frames { reason } => BenchError::Scene { scene, reason },
            SplitError::Rule { reason } => BenchError::Protocol {
                scene,
                protocol: protocols::title(protocol),
                reason,
            },
        }
    })
}

/// Splits the scene of a `scene.json` under a known protocol and writes the split to the file `out`, whose folder is
/// created if missing. The bytes depend on the scene and the protocol alone.
///
/// # Errors
/// Those of [`split`] and [`protocols::protocol`], and when a file cannot be read or written.
pub fn split_scene(scene: &Path, protocol_id: &str, out: &Path) -> Result<Split, BenchError> {
    split_scene_under(scene, &protocols::protocol(protocol_id)?, out)
}

/// Splits a scene like [`split_scene`], under rules that may differ from those of a known protocol, such as its
/// padding.
///
/// # Errors
/// Those of [`split`], when no frame could be scored at the protocol's size, and when a file cannot be read or written.
pub fn split_scene_under(
    scene: &Path,
    protocol: &Protocol,
    out: &Path,
) -> Result<Split, BenchError> {
    let scene: Scene = store::read_record(scene)?;
    let split = split(&scene, protocol)?;
    sizes(&scene, &split)?;
    if out.exists() && !store::schema_of(out).is_ok_and(|schema| schema.starts_with(ANY_SPLIT)) {
        return Err(StoreError::refused(
            out,
            "holds something else than a split; choose another name",
        )
        .into());
    }
    if let Some(folder) = out.parent() {
        store::create_folder(folder)?;
        if folder.is_dir() {
            store::remove_abandoned(folder)?;
        }
    }
    store::write_record(out, &split)?;
    Ok(split)
}

/// Returns a line on frames whose ground truth is of a single colour; `None` without any.
pub(crate) fn without_content(frames: impl Iterator<Item = u32>) -> Option<String> {
    let frames: Vec<String> = frames.map(|frame| frame.to_string()).collect();
    (!frames.is_empty()).then(|| {
        format!(
            "{} ground-truth images are of a single colour and show nothing: frames {}",
            frames.len(),
            plain_text::first_of(&frames)
        )
    })
}

/// Returns width and height of the scored images of a scene, in pixels, and the frames given to methods, if they are
/// padded.
///
/// # Errors
/// When no frame could be scored at the protocol's size.
pub(crate) fn sizes(
    scene: &Scene,
    split: &Split,
) -> Result<([u32; 2], Option<PaddedFrame>), BenchError> {
    let protocol = &split.protocol;
    let Resampling::Area = protocol.resampling;
    let sizes = || -> Result<_, String> {
        let frame = protocol.padded_frame(&scene.camera)?;
        Ok((protocol.scored_size(&scene.camera)?, frame))
    };
    sizes().map_err(|reason| BenchError::Protocol {
        scene: scene.id.clone(),
        protocol: protocols::title(protocol),
        reason,
    })
}

/// Checks that a split is the one that this program computes for a scene, by rules that it can score.
///
/// # Errors
/// When it belongs to another scene, was edited, is outdated or has an unknown mask rule.
pub(crate) fn check_split(file: &Path, split: &Split, scene: &Scene) -> Result<(), BenchError> {
    split_rules::check(split, scene).map_err(|reason| BenchError::mismatch(file, reason))?;
    if split.protocol.mask_rule != "none" {
        return Err(BenchError::mismatch(
            file,
            format!("mask rule {} is not known", split.protocol.mask_rule),
        ));
    }
    Ok(())
}
