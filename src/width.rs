//! Width of the terminal, and tables that fit into it.

#[cfg(unix)]
use std::io;

/// Columns of a terminal that does not state its width.
const USUAL_COLUMNS: usize = 80;

/// Returns the columns of the terminal at standard error.
pub(crate) fn of_stderr() -> usize {
    #[cfg(unix)]
    if let Ok(size) = rustix::termios::tcgetwinsize(io::stderr()) {
        return stated(size.ws_col);
    }
    USUAL_COLUMNS
}

/// Returns the columns of the terminal at standard output.
pub(crate) fn of_stdout() -> usize {
    #[cfg(unix)]
    if let Ok(size) = rustix::termios::tcgetwinsize(io::stdout()) {
        return stated(size.ws_col);
    }
    USUAL_COLUMNS
}

/// Returns the width that a terminal states; some state 0.
#[cfg(unix)]
fn stated(columns: u16) -> usize {
    match columns {
        0 => USUAL_COLUMNS,
        columns => usize::from(columns),
    }
}

/// Returns a text whose Markdown tables are `columns` wide at most: wider ones become several below each other, each
/// with the columns of names.
pub(crate) fn folded(text: &str, columns: usize) -> String {
    let mut folded = String::new();
    let mut table: Vec<&str> = Vec::new();
    for line in text.lines() {
        if line.starts_with('|') {
            table.push(line);
            continue;
        }
        folded += &fold_table(&table, columns);
        table.clear();
        folded += line;
        folded.push('\n');
    }
    folded + &fold_table(&table, columns)
}

/// Returns the lines of one table, in parts where it is too wide and can be taken apart.
fn fold_table(lines: &[&str], columns: usize) -> String {
    let rows: Vec<Vec<&str>> = lines.iter().map(|line| cells(line)).collect();
    let widths: Vec<usize> = rows.first().map_or_else(Vec::new, |row| {
        row.iter().map(|cell| cell.chars().count() + 1).collect()
    });
    let width = |part: &[usize]| 1 + part.iter().map(|&at| widths[at]).sum::<usize>();
    let all: Vec<usize> = (0..widths.len()).collect();
    // A cell with a bar of its own cannot be told from two.
    let is_regular = rows.iter().all(|row| row.len() == widths.len());
    if !is_regular || width(&all) <= columns {
        return lines.iter().map(|line| format!("{line}\n")).collect();
    }
    // Below the headings, columns of numbers end in a colon.
    let is_name = |at: &usize| {
        rows.get(1)
            .is_some_and(|rule| !rule[*at].trim_end().ends_with(':'))
    };
    let names: Vec<usize> = all.iter().copied().take_while(is_name).collect();
    let mut parts = vec![names.clone()];
    for &at in &all[names.len()..] {
        let last = parts.len() - 1;
        let is_full = width(&parts[last]) + widths[at] > columns && parts[last].len() > names.len();
        if is_full {
            parts.push(names.clone());
        }
        let last = parts.len() - 1;
        parts[last].push(at);
    }
    let shown = parts.iter().map(|part| {
        let line = |row: &Vec<&str>| {
            let cells: Vec<&str> = part.iter().map(|&at| row[at]).collect();
            format!("|{}|\n", cells.join("|"))
        };
        rows.iter().map(line).collect::<String>()
    });
    shown.collect::<Vec<_>>().join("\n")
}

fn cells(line: &str) -> Vec<&str> {
    let line = line.trim_end();
    let inner = line.strip_prefix('|').unwrap_or(line);
    inner
        .strip_suffix('|')
        .unwrap_or(inner)
        .split('|')
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const TABLE: &str = "Scores\n\n\
        | Method |   PSNR |   SSIM |  LPIPS |\n\
        | ------ | -----: | -----: | -----: |\n\
        | odgs   | **25** |    0.9 |    0.1 |\n\nbelow\n";

    #[test]
    fn wide_tables_become_several_and_lose_nothing() {
        assert_eq!(folded(TABLE, 80), TABLE);
        let folded = folded(TABLE, 30);
        assert!(
            folded.lines().all(|line| line.chars().count() <= 30),
            "{folded}"
        );
        assert_eq!(folded.matches("| odgs   |").count(), 2);
        for cell in ["**25**", "0.9", "0.1", "LPIPS", "below"] {
            assert_eq!(folded.matches(cell).count(), 1, "{folded}");
        }
    }

    #[test]
    fn a_column_wider_than_the_terminal_stays_whole() {
        assert!(folded(TABLE, 5).contains("**25**"));
        let irregular = "| a | b |\n| --- | ---: |\n| x | y | z |\n";
        assert_eq!(folded(irregular, 5), irregular);
    }
}
