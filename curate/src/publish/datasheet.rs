//! The datasheet of a dataset, in Markdown: what its records say and its makers state, by the sections of Gebru et
//! al., *Datasheets for Datasets* (<https://arxiv.org/abs/1803.09010>).

use omnilife_schemas::plain_text::counted;
use serde_json::Value;

use super::{
    Release,
    statements::{QUESTIONS, SECTIONS},
    statistics::duration_in_words,
};

/// Writes the datasheet.
pub(super) fn datasheet(release: &Release<'_>) -> String {
    let mut text = format!(
        "# Datasheet of {}\n\nSections follow [Datasheets for Datasets](https://arxiv.org/abs/1803.09010).\n\n",
        release.about.name
    );
    for section in SECTIONS {
        text += &format!("## {section}\n\n");
        for question in QUESTIONS
            .iter()
            .filter(|question| question.section == section)
        {
            let answer = release.answers.get(question.key);
            let answer = answer.map_or_else(|| "*Not stated.*".to_owned(), in_words);
            text += &format!("**{}** {answer}\n\n", question.text);
        }
        text += &recorded(release, section);
    }
    text.trim_end().to_owned() + "\n"
}

/// Returns what the records say for a section.
fn recorded(release: &Release<'_>, section: &str) -> String {
    let statistics = release.statistics;
    match section {
        "Composition" => {
            let tables = release.tables.iter();
            let lines =
                tables.map(|table| format!("| `{}` | {} |\n", table.file, table.kind.about));
            format!(
                "{}, {}, {}.\n\n| table | a row is |\n|---|---|\n{}\n",
                counted(statistics.rows.len(), "sequence"),
                duration_in_words(statistics.seconds()),
                counted(statistics.rows.iter().map(|row| row.frames).sum(), "frame"),
                lines.collect::<String>()
            )
        }
        "Collection process" => {
            "The card lists every video with its outcome and origin.\n\n".to_owned()
        }
        "Preprocessing, cleaning, labelling" => {
            let activities = release
                .activities()
                .map(|activity| format!("- {activity}\n"));
            format!(
                "{}\n\n{}\n",
                release.collection(),
                activities.collect::<String>()
            )
        }
        _ => String::new(),
    }
}

/// Returns an answer as text.
fn in_words(answer: &Value) -> String {
    match answer {
        Value::Bool(true) => "Yes.".to_owned(),
        Value::Bool(false) => "No.".to_owned(),
        Value::String(text) => text.clone(),
        Value::Array(texts) => texts.iter().map(in_words).collect::<Vec<_>>().join(", "),
        other => other.to_string(),
    }
}
