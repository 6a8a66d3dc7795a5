//! Feed-forward methods, which reproduce no input views: OmniLife360, Table 3.

use super::views;
use crate::{
    group::{Group, ViewKind},
    published::{Paper, PublishedLayout},
    table::Table,
};

/// One table, where novel views alone were scored.
pub(super) fn tables(group: &Group<'_>, papers: &[Paper]) -> Vec<Table> {
    if group.has(ViewKind::Input) || !group.has(ViewKind::Novel) {
        return Vec::new();
    }
    let title = format!("Novel views alone, protocol {}", group.protocol);
    vec![views::table(
        group,
        papers,
        title,
        &[ViewKind::Novel],
        &PublishedLayout::FeedForward,
    )]
}
