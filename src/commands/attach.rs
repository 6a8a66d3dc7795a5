//! `omnilife curate attach`.

use std::collections::BTreeSet;

use omnilife_schemas::{
    plain_text::counted,
    progress::Progress,
    records::{Scene, SceneFrame},
};

use crate::{cli::AttachArguments, exit, termination};

pub(crate) fn execute(arguments: &AttachArguments, progress: &dyn Progress) -> anyhow::Result<()> {
    termination::take_programs_along()?;
    let scene = omnilife_curate::attach(&arguments.scene, &arguments.request()?, progress)?;
    exit::print(&format!("{}: {}\n", scene.id, summary(&scene)))
}

/// Counts the attached data of a scene's frames.
fn summary(scene: &Scene) -> String {
    let frames = &scene.frames;
    let count = |has: fn(&SceneFrame) -> bool| frames.iter().filter(|frame| has(frame)).count();
    let counts = [
        (count(|frame| frame.pose.is_some()), "posed"),
        (count(|frame| frame.mask.is_some()), "with masks"),
        (
            count(|frame| frame.ignore_mask.is_some()),
            "with ignore masks",
        ),
        (count(|frame| frame.depth.is_some()), "with distances"),
        (
            count(|frame| frame.depth_prior.is_some()),
            "with estimated distances",
        ),
    ];
    let counts = counts.iter().map(|(count, kind)| format!("{count} {kind}"));
    let classes: BTreeSet<&String> = frames.iter().flat_map(|f| f.classes.keys()).collect();
    let classes = classes.iter().map(|class| format!("class {class}"));
    let words: Vec<String> = counts.chain(classes).collect();
    format!("{}: {}", counted(frames.len(), "frame"), words.join(", "))
}
