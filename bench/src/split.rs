//! Which frames of a scene a method is given and which it has to predict.

use std::path::Path;

use omnilife_schemas::{
    records::{Protocol, Scene, Split, SplitRule},
    store,
};

use crate::{error::BenchError, protocols};

/// Applies a protocol's split rule to a scene's posed frames.
///
/// Frames are counted among the posed ones only, in the scene's order, so that an unposed frame
/// changes neither the shares nor the rule. The numbers in the split count all frames of the scene.
///
/// # Errors
/// When fewer frames than one cycle of the rule have a pose, when a pose is not usable (zero
/// quaternion, non-finite entries) or when frames are not in order of time.
pub fn split(scene: &Scene, protocol: &Protocol) -> Result<Split, BenchError> {
    check_frames(scene)?;
    let SplitRule::EveryNth { period, offset } = protocol.split;
    let cannot = |reason: String| BenchError::Protocol {
        scene: scene.id.clone(),
        protocol: protocols::title(protocol),
        reason,
    };
    if period < 2 || offset >= period {
        return Err(cannot(format!(
            "its split rule holds out offset {offset} of every {period} frames"
        )));
    }
    let (posed, unposed): (Vec<u32>, Vec<u32>) = (0..scene.frames.len() as u32)
        .partition(|&frame| scene.frames[frame as usize].pose.is_some());
    if posed.len() < period as usize {
        return Err(cannot(format!(
            "{} of {} frames have a pose, at least {period} are needed",
            posed.len(),
            scene.frames.len()
        )));
    }
    let mut input_views = Vec::new();
    let mut novel_views = Vec::new();
    for (position, &frame) in posed.iter().enumerate() {
        if position % period as usize == offset as usize {
            novel_views.push(frame);
        } else {
            input_views.push(frame);
        }
    }
    Ok(Split {
        scene: scene.id.clone(),
        protocol: protocol.clone(),
        protocol_hash: protocol.hash(),
        input_views,
        novel_views,
        unposed,
    })
}

/// Splits the scene of a `scene.json` under a known protocol and writes the split to the file
/// `out`, whose folder is made where it is missing. The bytes depend on the scene and the protocol
/// alone.
///
/// # Errors
/// Those of [`split`] and [`protocols::protocol`], and when a file cannot be read or written.
pub fn split_scene(scene: &Path, protocol_id: &str, out: &Path) -> Result<Split, BenchError> {
    let protocol = protocols::protocol(protocol_id)?;
    let split = split(&store::read_record(scene)?, &protocol)?;
    if let Some(folder) = out.parent() {
        store::create_folder(folder)?;
    }
    store::write_record(out, &split)?;
    Ok(split)
}

/// Checks that a split is the one that this program makes of a scene, by rules that it can score.
///
/// # Errors
/// When it is of another scene, was edited, is outdated or asks for an unknown mask rule.
pub(crate) fn check_split(file: &Path, split: &Split, scene: &Scene) -> Result<(), BenchError> {
    if split.scene != scene.id {
        return Err(BenchError::mismatch(
            file,
            format!("is of scene {}, not {}", split.scene, scene.id),
        ));
    }
    // A split is a function of scene and protocol, so an edited or outdated one is found out.
    if *split != self::split(scene, &split.protocol)? {
        return Err(BenchError::mismatch(
            file,
            format!(
                "is not the split of scene {} under protocol {}: make it again",
                scene.id,
                protocols::title(&split.protocol)
            ),
        ));
    }
    if split.protocol.mask_rule != "none" {
        return Err(BenchError::mismatch(
            file,
            format!("mask rule {} is not known", split.protocol.mask_rule),
        ));
    }
    Ok(())
}

fn check_frames(scene: &Scene) -> Result<(), BenchError> {
    let broken = |reason: String| BenchError::Scene {
        scene: scene.id.clone(),
        reason,
    };
    for (number, frame) in scene.frames.iter().enumerate() {
        if frame.pose.is_some_and(|pose| !pose.is_valid()) {
            return Err(broken(format!("frame {number} has an unusable pose")));
        }
        if !frame.time_seconds.is_finite() {
            return Err(broken(format!("frame {number} has no finite time")));
        }
    }
    for (number, pair) in scene.frames.windows(2).enumerate() {
        if pair[1].time_seconds < pair[0].time_seconds {
            return Err(broken(format!(
                "frame {} is earlier than frame {number}",
                number + 1
            )));
        }
    }
    Ok(())
}
