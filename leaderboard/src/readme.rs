//! The table within a page of other content, between two marker lines.

use std::{fs, path::Path};

use omnilife_schemas::{
    plain_text::for_markdown,
    store::{self, StoreError},
};

use crate::{aids, error::LeaderboardError, group::Group, layouts, render, repeats, tables};

/// Line before the table.
const BEGIN: &str = "<!-- leaderboard: begin -->";

/// Line after it.
const END: &str = "<!-- leaderboard: end -->";

/// Returns the page with the tables of the groups between its markers; `None` if it has them already.
pub(crate) fn updated(
    path: &Path,
    groups: &[Group<'_>],
) -> Result<Option<String>, LeaderboardError> {
    let page = fs::read_to_string(path).map_err(|source| StoreError::read(path, source))?;
    let missing = |marker| LeaderboardError::NoMarker {
        path: path.to_owned(),
        marker,
    };
    let begin = page.find(BEGIN).ok_or_else(|| missing(BEGIN))? + BEGIN.len();
    let end = begin + page[begin..].find(END).ok_or_else(|| missing(END))?;
    let tables: Vec<String> = groups
        .iter()
        .map(|group| {
            let table = tables::short_table(group, layouts::all_results(group));
            let mut lines = Vec::new();
            for (class, body) in render::markdown::blocks(&table) {
                lines.extend(class.map(|class| format!("**{class}**\n")));
                lines.extend(body);
                lines.push(String::new());
            }
            let serious = layouts::remarks_of(group);
            lines.extend(serious.serious().map(|line| for_markdown(line) + "\n"));
            let of_aids = [aids::warning(group), aids::note(group)];
            lines.extend(
                repeats::warnings(group)
                    .iter()
                    .chain(of_aids.iter().flatten())
                    .map(|line| for_markdown(line) + "\n"),
            );
            lines.push(format!("{}.", for_markdown(&table.title)));
            lines.join("\n")
        })
        .collect();
    let new = format!(
        "{}\n{}\n{}",
        &page[..begin],
        tables.join("\n\n"),
        &page[end..]
    );
    Ok((new != page).then_some(new))
}

/// Puts the tables into the page.
pub(crate) fn write(path: &Path, groups: &[Group<'_>]) -> Result<(), LeaderboardError> {
    if let Some(new) = updated(path, groups)? {
        store::write_bytes(path, new.as_bytes())?;
    }
    Ok(())
}

/// Compares the tables in the page with those of the groups.
pub(crate) fn check(path: &Path, groups: &[Group<'_>]) -> Result<(), LeaderboardError> {
    match updated(path, groups)? {
        None => Ok(()),
        Some(_) => Err(LeaderboardError::OutOfDate {
            path: path.to_owned(),
            reason: "its table is not what the results give".to_owned(),
        }),
    }
}
