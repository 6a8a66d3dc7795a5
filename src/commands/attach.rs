//! `omnilife curate attach`.

use std::collections::BTreeSet;

use omnilife_schemas::{
    progress::Progress,
    records::{Scene, SceneFrame},
};

use crate::{cli::AttachArguments, exit, termination};

pub(crate) fn execute(arguments: &AttachArguments, progress: &dyn Progress) -> anyhow::Result<()> {
    termination::take_programs_along()?;
    let scene = omnilife_curate::attach(&arguments.scene, &arguments.request()?, progress)?;
    exit::print(&format!("{}: {}\n", scene.id, summary(&scene)))
}

/// What the frames of a scene have, counted.
fn summary(scene: &Scene) -> String {
    let frames = &scene.frames;
    let kinds: [(&str, fn(&SceneFrame) -> bool); 5] = [
        ("posed", |frame| frame.pose.is_some()),
        ("with masks", |frame| frame.mask.is_some()),
        ("with ignore masks", |frame| frame.ignore_mask.is_some()),
        ("with distances", |frame| frame.depth.is_some()),
        ("with estimated distances", |frame| {
            frame.depth_prior.is_some()
        }),
    ];
    let counts = kinds.iter().map(|(kind, has)| {
        let count = frames.iter().filter(|frame| has(frame)).count();
        format!("{count} {kind}")
    });
    let classes: BTreeSet<&String> = frames.iter().flat_map(|f| f.classes.keys()).collect();
    let classes = classes.iter().map(|class| format!("class {class}"));
    let words: Vec<String> = counts.chain(classes).collect();
    format!("{} frames: {}", frames.len(), words.join(", "))
}
