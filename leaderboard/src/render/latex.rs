//! LaTeX with booktabs: best bold, second best underlined.

use super::marked_names;
use crate::{
    class::MethodClass,
    format,
    table::{Cell, Row, ScoreRank, Table},
};

/// Returns a whole `table` environment.
pub(crate) fn render(table: &Table) -> String {
    let width = table.names.len() + table.columns.len();
    let mut text = String::from("% Needs \\usepackage{booktabs}.\n\\begin{table}\n  \\centering\n");
    text.push_str(&format!("  \\caption{{{}}}\n", escape(&table.title)));
    text.push_str(&format!(
        "  \\begin{{tabular}}{{{}{}}}\n    \\toprule\n",
        "l".repeat(table.names.len()),
        "r".repeat(table.columns.len())
    ));
    text.push_str(&group_header(table));
    let columns = table.columns.iter().map(|column| match column.direction {
        Some(direction) => format!("{} {}", column.name, format::arrow(direction)),
        None => column.name.clone(),
    });
    let header: Vec<String> = table.names.iter().cloned().chain(columns).collect();
    let header: Vec<String> = header.iter().map(|heading| escape(heading)).collect();
    text.push_str(&line(&header));
    for rows in table.blocks() {
        let class = rows.first().and_then(|row| row.class);
        text.push_str(&block(rows, class.map(MethodClass::title), width));
    }
    for published in &table.published {
        text.push_str(&block(&published.rows, Some(&published.source), width));
    }
    text.push_str("    \\bottomrule\n  \\end{tabular}\n");
    let published = table.published.iter().flat_map(|block| &block.notes);
    for note in table.notes.iter().chain(published) {
        text.push_str(&format!("  \\par\\footnotesize {}\n", escape(note)));
    }
    text.push_str("\\end{table}\n");
    text
}

/// Returns rows below a rule, under their heading if they have one.
fn block(rows: &[Row], heading: Option<&str>, width: usize) -> String {
    let mut text = String::from("    \\midrule\n");
    if let Some(heading) = heading {
        let heading = escape(heading);
        text.push_str(&format!(
            "    \\multicolumn{{{width}}}{{l}}{{\\emph{{{heading}}}}} \\\\\n"
        ));
    }
    text.extend(rows.iter().map(|row| line(&cells(row))));
    text
}

/// Returns the line of headings over several columns, with their rules; nothing without any.
fn group_header(table: &Table) -> String {
    if table.columns.iter().all(|column| column.group.is_none()) {
        return String::new();
    }
    let mut cells = vec![String::new(); table.names.len()];
    let mut rules = String::new();
    let mut column = table.names.len() + 1;
    for same in table.columns.chunk_by(|a, b| a.group == b.group) {
        let last = column + same.len() - 1;
        match &same[0].group {
            Some(group) => {
                let span = same.len();
                cells.push(format!("\\multicolumn{{{span}}}{{c}}{{{}}}", escape(group)));
                rules.push_str(&format!("\\cmidrule(lr){{{column}-{last}}}"));
            }
            None => cells.extend(vec![String::new(); same.len()]),
        }
        column = last + 1;
    }
    format!("{}    {rules}\n", line(&cells))
}

/// Returns a row. After the end of the row above, a star or a bracket would be taken as its argument.
fn line(cells: &[String]) -> String {
    let row = cells.join(" & ");
    let guard = if row.starts_with(['[', '*']) {
        "{}"
    } else {
        ""
    };
    format!("    {guard}{row} \\\\\n")
}

fn cells(row: &Row) -> Vec<String> {
    let names = marked_names(row);
    let mut cells: Vec<String> = names.iter().map(|name| escape(name)).collect();
    cells.extend(row.cells.iter().map(cell));
    cells
}

fn cell(cell: &Cell) -> String {
    let Cell::Score(score) = cell else {
        return escape(&cell.plain());
    };
    let value = score.value();
    let value = match score.standing {
        ScoreRank::Best => format!("\\textbf{{{value}}}"),
        ScoreRank::Second => format!("\\underline{{{value}}}"),
        ScoreRank::Other => value,
    };
    match score.interval {
        Some(_) => format!("{value} {{\\scriptsize{}}}", score.interval()),
        None => value,
    }
}

/// Escapes text so that nothing is a command.
fn escape(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '&' | '%' | '$' | '#' | '_' | '{' | '}' => {
                escaped.push('\\');
                escaped.push(character);
            }
            '\\' => escaped.push_str("\\textbackslash{}"),
            '~' => escaped.push_str("\\textasciitilde{}"),
            '^' => escaped.push_str("\\textasciicircum{}"),
            '<' => escaped.push_str("\\textless{}"),
            '>' => escaped.push_str("\\textgreater{}"),
            '|' => escaped.push_str("\\textbar{}"),
            '↑' => escaped.push_str("$\\uparrow$"),
            '↓' => escaped.push_str("$\\downarrow$"),
            '–' => escaped.push_str("--"),
            '†' => escaped.push_str("\\dag{}"),
            '‡' => escaped.push_str("\\ddag{}"),
            '§' => escaped.push_str("\\S{}"),
            '‖' => escaped.push_str("$\\|$"),
            '¶' => escaped.push_str("\\P{}"),
            '≥' => escaped.push_str("$\\geq$"),
            '±' => escaped.push_str("$\\pm$"),
            '°' => escaped.push_str("$^\\circ$"),
            character if character.is_control() => escaped.push(' '),
            character => escaped.push(character),
        }
    }
    escaped
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_is_no_argument_of_the_line_break_above() {
        for name in ["[2cm]", "*"] {
            let row = line(&[escape(name), "1".to_owned()]);
            assert_eq!(row, format!("    {{}}{name} & 1 \\\\\n"));
        }
        assert_eq!(line(&[escape("a[1]")]), "    a[1] \\\\\n");
    }
}
