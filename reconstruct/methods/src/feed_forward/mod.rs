//! Methods without training: from two views of a group, those between them.
//!
//! One file each. They follow any split. A protocol with groups says which views belong together; under others
//! every novel view is predicted from the input views before and after it.

pub mod cross_fade;
pub mod infinity;
pub mod nearest;
pub mod sweep;

use omnilife_schemas::records::Split;

/// Frame numbers: two input views and the novel views to predict from them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GroupFrames {
    /// Input views, the earlier one first.
    pub context: [u32; 2],
    /// Novel views to predict.
    pub novel_views: Vec<u32>,
}

/// Returns the groups of a split: its own, or the novel views between two consecutive input views. Novel views
/// before the first input view or after the last are predicted from the two nearest input views. `None` with
/// fewer than two input views.
pub fn groups(split: &Split) -> Option<Vec<GroupFrames>> {
    if !split.groups.is_empty() {
        return split
            .groups
            .iter()
            .map(|group| {
                Some(GroupFrames {
                    context: [*group.context.first()?, *group.context.last()?],
                    novel_views: group.novel_views.clone(),
                })
            })
            .collect();
    }
    let inputs = &split.input_views;
    let last_pair = inputs.len().checked_sub(2)?;
    let mut groups: Vec<GroupFrames> = Vec::new();
    for &frame in &split.novel_views {
        let before = inputs.partition_point(|&input| input < frame);
        let pair = before.saturating_sub(1).min(last_pair);
        let context = [inputs[pair], inputs[pair + 1]];
        match groups.last_mut() {
            Some(group) if group.context == context => group.novel_views.push(frame),
            _ => groups.push(GroupFrames {
                context,
                novel_views: vec![frame],
            }),
        }
    }
    Some(groups)
}
