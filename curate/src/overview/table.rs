//! State of a dataset as text for a terminal.

use omnilife_schemas::records::{DatasetStatus, PartState, PartStatus, SequencePart};

/// Rows of the short table.
const SHORT_ROWS: usize = 20;

/// Table of a state, and its form for a small screen.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StatusTable {
    /// The first sequences, and one command for each kind of missing part.
    pub short: String,
    /// Every sequence and every command.
    pub whole: String,
}

/// Returns the state of a dataset as text; parts that are missing stand as `-`.
pub fn table(status: &DatasetStatus) -> StatusTable {
    StatusTable {
        short: text(status, SHORT_ROWS, 1),
        whole: text(status, usize::MAX, usize::MAX),
    }
}

fn text(status: &DatasetStatus, most_rows: usize, most_commands: usize) -> String {
    let count = status.sequences.len();
    let mut text = rows(status, most_rows);
    if count > most_rows {
        text += &format!("and {} more sequences\n", count - most_rows);
    }
    for lost in &status.lost {
        text += &format!("{}: {}: {}\n", lost.file, lost.outcome, lost.reason);
    }
    text + &missing(status, most_commands)
}

/// Returns the aligned table.
fn rows(status: &DatasetStatus, most: usize) -> String {
    if status.sequences.is_empty() {
        return "no sequences\n".to_owned();
    }
    let head = ["sequence", "seconds"].into_iter();
    let head = head.chain(SequencePart::ALL.map(SequencePart::name));
    let mut rows = vec![head.map(str::to_owned).collect::<Vec<_>>()];
    for sequence in status.sequences.iter().take(most) {
        let mut row = vec![
            sequence.id.clone(),
            format!("{:.1}", sequence.duration_seconds),
        ];
        row.extend(SequencePart::ALL.map(|part| cell(sequence.part(part))));
        rows.push(row);
    }
    let width = |column: usize| {
        let cells = rows.iter().map(|row| row[column].chars().count());
        cells.max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..rows[0].len()).map(width).collect();
    let mut text = String::new();
    for row in &rows {
        let mut line = String::new();
        for (column, (cell, &width)) in row.iter().zip(&widths).enumerate() {
            // Names stand at the left, numbers at the right.
            line += &match column {
                0 => format!("{cell:<width$}"),
                _ => format!("  {cell:>width$}"),
            };
        }
        text += line.trim_end();
        text.push('\n');
    }
    text
}

fn cell(status: Option<&PartStatus>) -> String {
    let Some(PartStatus {
        state, count, of, ..
    }) = status
    else {
        return String::new();
    };
    match state {
        PartState::Present if *of == 1 => "yes".to_owned(),
        PartState::Present => count.to_string(),
        PartState::Incomplete => format!("{count}/{of}"),
        PartState::Missing => "-".to_owned(),
    }
}

/// Returns the commands for missing parts, at most `most` of each.
fn missing(status: &DatasetStatus, most: usize) -> String {
    let mut text = String::new();
    let (optional, needed): (Vec<_>, Vec<_>) =
        (SequencePart::ALL.into_iter()).partition(|part| part.is_optional());
    for part in needed.into_iter().chain(optional) {
        let states = status.sequences.iter().filter_map(|one| one.part(part));
        let commands = states.filter_map(|state| state.command.as_deref());
        let mut commands: Vec<&str> = commands.collect();
        let lacking = commands.len();
        // One of the whole dataset stands for all of its sequences.
        commands.dedup();
        if lacking == 0 {
            continue;
        }
        let optional = if part.is_optional() { ", optional" } else { "" };
        let name = part.name();
        text += &format!("\n{name} missing or incomplete in {lacking}{optional}:\n");
        for command in commands.iter().take(most) {
            text += &format!("  {command}\n");
        }
        if commands.len() > most {
            text += &format!("  and {} more\n", commands.len() - most);
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use omnilife_schemas::records::{LostVideo, SequenceStatus};

    use super::*;

    fn status(sequences: usize) -> DatasetStatus {
        let part = |part: SequencePart, count: u64, command: Option<&str>| PartStatus {
            part,
            state: if count == 0 {
                PartState::Missing
            } else {
                PartState::Present
            },
            count,
            of: 30,
            note: String::new(),
            command: command.map(str::to_owned),
        };
        let sequence = |index: usize| SequenceStatus {
            id: format!("walk/seq-{index:03}"),
            folder: format!("videos/walk/seq-{index:03}"),
            duration_seconds: 12.34,
            parts: vec![
                part(SequencePart::Frames, 30, None),
                part(
                    SequencePart::Poses,
                    0,
                    Some(&format!("omnilife curate poses {index}")),
                ),
                part(
                    SequencePart::Annotation,
                    0,
                    Some("omnilife curate annotate ."),
                ),
            ],
        };
        DatasetStatus {
            sequences: (0..sequences).map(sequence).collect(),
            lost: vec![LostVideo {
                file: "flat.mp4".to_owned(),
                outcome: "rejected".to_owned(),
                reason: "projection is rectilinear".to_owned(),
            }],
        }
    }

    #[test]
    fn columns_are_aligned_and_commands_gathered() {
        let StatusTable { short, whole } = table(&status(2));
        let lines: Vec<&str> = whole.lines().collect();
        assert!(
            lines[0].starts_with("sequence      seconds  frames  poses"),
            "{whole}"
        );
        assert!(
            lines[1].starts_with("walk/seq-000     12.3      30      -"),
            "{whole}"
        );
        assert_eq!(lines[3], "flat.mp4: rejected: projection is rectilinear");
        assert!(
            whole.contains("poses 0\n  omnilife curate poses 1\n"),
            "{whole}"
        );
        assert!(short.contains("poses 0\n  and 1 more\n"), "{short}");
        assert_eq!(whole.matches("annotate").count(), 1, "{whole}");
    }

    #[test]
    fn short_tables_stay_short() {
        let StatusTable { short, whole } = table(&status(500));
        assert!(short.lines().count() < 40 && whole.lines().count() > 1000);
        assert!(short.contains("and 480 more sequences\n"), "{short}");
        assert!(
            table(&DatasetStatus::default())
                .whole
                .starts_with("no sequences\n")
        );
    }
}
