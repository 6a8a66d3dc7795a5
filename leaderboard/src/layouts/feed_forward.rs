//! Feed-forward methods, which reproduce no input views: OmniLife360, Table 3.

use super::views;
use crate::{
    group::Group,
    published::{OMNILIFE360, Paper, PublishedLayout},
    quantity::ViewKind,
    table::Table,
};

/// The paper's table.
pub(super) const PUBLISHED: PublishedLayout = PublishedLayout {
    paper: OMNILIFE360,
    numbers: &[3],
    protocol: "sparse-interpolation",
};

/// Returns true if the protocol is that of the paper's table, and only novel views were scored.
pub(super) fn is_of(group: &Group<'_>) -> bool {
    let is_protocol = PUBLISHED.is_of(group.protocol);
    is_protocol && group.has(ViewKind::Novel) && !group.has(ViewKind::Input)
}

pub(super) fn tables(group: &Group<'_>, papers: &[Paper]) -> Vec<Table> {
    if !is_of(group) {
        return Vec::new();
    }
    vec![views::table(group, papers, &[ViewKind::Novel], PUBLISHED)]
}
