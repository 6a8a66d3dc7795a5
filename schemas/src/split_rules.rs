//! Rules of protocols that split the frames of a scene into input views and novel views.
//!
//! A split follows from scene and protocol alone. Training and scoring check that ([`check`]), because an edited
//! split reveals novel views.

use crate::records::{IncompleteGroup, Protocol, Scene, Split, SplitRule, ViewGroup};

/// Reason why a scene has no split under a protocol.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SplitError {
    /// The frames are not a usable sequence.
    #[error("{reason}")]
    Frames {
        /// The frame and its fault.
        reason: String,
    },
    /// The rule is invalid, or leaves none of these frames.
    #[error("{reason}")]
    Rule {
        /// Reason in one line.
        reason: String,
    },
}

/// Applies a protocol's split rule to a scene's frames. The numbers in the split count all frames of the scene, in
/// its order.
///
/// # Errors
/// When the rule is invalid, or leaves no input view or no scored view. Also when a pose is not usable (zero
/// quaternion, non-finite entries) or frames are not in order of time.
pub fn split(scene: &Scene, protocol: &Protocol) -> Result<Split, SplitError> {
    check_frames(scene)?;
    let shares = match &protocol.split {
        SplitRule::EveryNth { period, offset } => every_nth(scene, *period, *offset),
        SplitRule::Groups { length } => groups(scene, *length),
        SplitRule::EvenlyGiven { count } => evenly_given(scene, *count),
        SplitRule::Given { frames } => given(scene, frames),
        SplitRule::AllGiven => all_given(scene),
        SplitRule::Published => published(scene),
    }
    .map_err(|reason| SplitError::Rule { reason })?;
    Ok(Split {
        scene: scene.id.clone(),
        protocol: protocol.clone(),
        protocol_hash: protocol.hash(),
        input_views: shares.input_views,
        novel_views: shares.novel_views,
        unposed: posed_and_unposed(scene).1,
        groups: shares.groups,
        incomplete: shares.incomplete,
    })
}

/// Checks that a split is the one that its protocol gives for a scene.
///
/// # Errors
/// The reason in one line: the split is of another scene, was edited, or is outdated.
pub fn check(split: &Split, scene: &Scene) -> Result<(), String> {
    if split.scene != scene.id {
        return Err(format!("is of scene {}, not {}", split.scene, scene.id));
    }
    let own = self::split(scene, &split.protocol).map_err(|error| error.to_string())?;
    if own != *split {
        let (id, version) = (&split.protocol.id, split.protocol.version);
        return Err(format!(
            "is not the split of scene {} under protocol {id}/{version}: make it again",
            scene.id
        ));
    }
    Ok(())
}

/// Shares of a scene's frames under a rule.
#[derive(Default)]
struct Shares {
    input_views: Vec<u32>,
    novel_views: Vec<u32>,
    groups: Vec<ViewGroup>,
    incomplete: Vec<IncompleteGroup>,
}

fn posed_and_unposed(scene: &Scene) -> (Vec<u32>, Vec<u32>) {
    (0..scene.frames.len() as u32).partition(|&frame| scene.frames[frame as usize].pose.is_some())
}

/// Counts among the posed frames only, so that an unposed frame changes neither the shares nor the rule.
fn every_nth(scene: &Scene, period: u32, offset: u32) -> Result<Shares, String> {
    if period < 2 || offset >= period {
        return Err(format!(
            "its split rule holds out offset {offset} of every {period} frames"
        ));
    }
    let (posed, _) = posed_and_unposed(scene);
    if posed.len() < period as usize {
        return Err(format!(
            "{} of {} frames have a pose, at least {period} are needed",
            posed.len(),
            scene.frames.len()
        ));
    }
    let mut shares = Shares::default();
    for (position, &frame) in posed.iter().enumerate() {
        if position % period as usize == offset as usize {
            shares.novel_views.push(frame);
        } else {
            shares.input_views.push(frame);
        }
    }
    Ok(shares)
}

/// Cuts groups among all frames, so that those of a group follow each other in time.
fn groups(scene: &Scene, length: u32) -> Result<Shares, String> {
    if length < 3 {
        return Err(format!(
            "a group of {length} frames has none between its first and its last"
        ));
    }
    let frames: Vec<u32> = (0..scene.frames.len() as u32).collect();
    let mut shares = Shares::default();
    for frames in frames.chunks(length as usize) {
        match incompleteness(scene, frames, length) {
            Some(reason) => shares.incomplete.push(IncompleteGroup {
                frames: frames.to_vec(),
                reason,
            }),
            None => {
                let (first, last) = (frames[0], frames[frames.len() - 1]);
                let between = frames[1..frames.len() - 1].to_vec();
                shares.input_views.extend([first, last]);
                shares.novel_views.extend(&between);
                shares.groups.push(ViewGroup {
                    context: vec![first, last],
                    novel_views: between,
                });
            }
        }
    }
    if shares.groups.is_empty() {
        return Err(format!(
            "none of its {} frames belong to a complete group of {length}",
            scene.frames.len()
        ));
    }
    Ok(shares)
}

/// Returns what a group lacks; `None` where it is complete.
fn incompleteness(scene: &Scene, frames: &[u32], length: u32) -> Option<String> {
    if frames.len() < length as usize {
        return Some(format!("{} of {length} frames", frames.len()));
    }
    let unposed: Vec<String> = frames
        .iter()
        .filter(|&&frame| scene.frames[frame as usize].pose.is_none())
        .map(u32::to_string)
        .collect();
    (!unposed.is_empty()).then(|| format!("no pose for {}", unposed.join(", ")))
}

/// Takes posed frame `k n / count` of `n`, rounded down, as input view `k` of `count`.
fn evenly_given(scene: &Scene, count: u32) -> Result<Shares, String> {
    if count == 0 {
        return Err("its split rule gives no frame".to_owned());
    }
    let (posed, _) = posed_and_unposed(scene);
    let (count, all) = (count as usize, posed.len());
    if all <= count {
        return Err(format!(
            "{all} of {} frames have a pose; {count} are given, and at least one more is needed to predict",
            scene.frames.len()
        ));
    }
    let mut shares = Shares::default();
    let mut given = (0..count).map(|number| number * all / count).peekable();
    for (position, &frame) in posed.iter().enumerate() {
        if given.next_if_eq(&position).is_some() {
            shares.input_views.push(frame);
        } else {
            shares.novel_views.push(frame);
        }
    }
    Ok(shares)
}

/// Splits into the named frames and all other posed ones.
fn given(scene: &Scene, frames: &[u32]) -> Result<Shares, String> {
    let (posed, _) = posed_and_unposed(scene);
    if frames.is_empty() || !frames.is_sorted_by(|a, b| a < b) {
        return Err(
            "the frames that it gives must be named in ascending order, each once".to_owned(),
        );
    }
    if let Some(missing) = frames.iter().find(|frame| !posed.contains(frame)) {
        return Err(format!(
            "input view {missing} must be the index of a frame with a pose, of {} frames",
            scene.frames.len()
        ));
    }
    let (input_views, novel_views): (Vec<u32>, Vec<u32>) =
        posed.iter().partition(|frame| frames.contains(frame));
    if novel_views.is_empty() {
        return Err(format!(
            "all {} frames with a pose are to be given, and none is left to score",
            posed.len()
        ));
    }
    Ok(Shares {
        input_views,
        novel_views,
        ..Shares::default()
    })
}

fn all_given(scene: &Scene) -> Result<Shares, String> {
    let (input_views, _) = posed_and_unposed(scene);
    if input_views.is_empty() {
        return Err("no frame has a pose".to_owned());
    }
    Ok(Shares {
        input_views,
        ..Shares::default()
    })
}

/// Applies a published split. Frames without a pose are left out of both lists, as everywhere.
fn published(scene: &Scene) -> Result<Shares, String> {
    let Some(split) = &scene.published_split else {
        return Err("no split was published with the scene".to_owned());
    };
    let listed = |views: &[u32], use_of: &str| -> Result<Vec<u32>, String> {
        if !views.is_sorted_by(|a, b| a < b) {
            return Err(format!("its published {use_of} views do not rise"));
        }
        let mut posed = Vec::new();
        for &view in views {
            let frame = (scene.frames.get(view as usize)).ok_or_else(|| {
                format!("its published {use_of} view {view} must be a frame of the scene")
            })?;
            posed.extend(frame.pose.map(|_| view));
        }
        if posed.is_empty() {
            return Err(format!("none of its published {use_of} views has a pose"));
        }
        Ok(posed)
    };
    let input_views = listed(&split.input_views, "input")?;
    let novel_views = listed(&split.novel_views, "novel")?;
    if let Some(both) = (novel_views.iter()).find(|view| input_views.contains(view)) {
        return Err(format!(
            "frame {both} is an input view and a novel view of its published split"
        ));
    }
    Ok(Shares {
        input_views,
        novel_views,
        ..Shares::default()
    })
}

fn check_frames(scene: &Scene) -> Result<(), SplitError> {
    let broken = |reason: String| SplitError::Frames { reason };
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
