//! Numbers and names as tables print them.

use omnilife_schemas::records::Direction;

/// A metric's column title from its id.
pub(crate) fn metric_title(id: &str) -> String {
    id.to_uppercase()
}

/// An arrow that points to the better scores.
pub(crate) fn arrow(direction: Direction) -> &'static str {
    match direction {
        Direction::HigherIsBetter => "↑",
        Direction::LowerIsBetter => "↓",
    }
}

/// A score with the decimals that its metric is published with: 3 for decibels, else 4.
pub(crate) fn score(id: &str, value: f64) -> String {
    let decibels = id.split('-').any(|part| part == "psnr");
    if decibels {
        format!("{value:.3}")
    } else {
        format!("{value:.4}")
    }
}

/// The number of decimals of scores in CSV, which programs read.
pub(crate) fn csv_score(value: f64) -> String {
    format!("{value:.6}")
}

/// A whole number with groups of three digits: `1,234,567`.
pub(crate) fn grouped(value: u64) -> String {
    let digits = value.to_string();
    let mut text = String::with_capacity(digits.len() + digits.len() / 3);
    for (position, digit) in digits.chars().enumerate() {
        if position > 0 && (digits.len() - position).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// Text that cannot break a Markdown table or its line: ids and reasons come from others.
pub(crate) fn cell(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '|' | '*' | '`' | '<' | '\\' => {
                escaped.push('\\');
                escaped.push(character);
            }
            character if character.is_control() => escaped.push(' '),
            character => escaped.push(character),
        }
    }
    escaped
}
