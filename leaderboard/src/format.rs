//! Numbers and names as tables print them.

use omnilife_schemas::{
    provenance::Hardware,
    records::{Backend, Direction},
};

use crate::quantity::ViewKind;

/// Returns a metric's column title from its id.
pub(crate) fn metric_title(id: &str) -> String {
    if id == PUBLISHED_LPIPS {
        return "LPIPS (published)".to_owned();
    }
    id.to_uppercase()
}

/// The metric of published LPIPS columns: the papers do not state the network.
pub(crate) const PUBLISHED_LPIPS: &str = "lpips";

/// Returns the heading over the columns of one kind of view.
pub(crate) fn kind_title(kind: ViewKind) -> String {
    match kind {
        ViewKind::Input => "Input",
        ViewKind::Novel => "Novel",
    }
    .to_owned()
}

/// Returns an arrow that points to the better scores.
pub(crate) fn arrow(direction: Direction) -> &'static str {
    match direction {
        Direction::HigherIsBetter => "↑",
        Direction::LowerIsBetter => "↓",
    }
}

/// Returns the decimals that a metric is printed with: 3 for decibels, else 4.
pub(crate) fn decimals(metric: &str) -> usize {
    let decibels = metric.split('-').any(|part| part == "psnr");
    if decibels { 3 } else { 4 }
}

/// Returns the name of a run's processor.
pub(crate) fn backend(backend: &Backend) -> String {
    match backend {
        Backend::Cpu { threads } => format!("CPU, {threads} threads"),
        Backend::Gpu { adapter, .. } => adapter.clone(),
    }
}

pub(crate) fn machine(hardware: &Hardware) -> String {
    let processor = hardware.processor.as_deref().unwrap_or(&hardware.system);
    let threads = hardware.threads;
    hardware.memory_bytes.map_or_else(
        || format!("{processor}, {threads} threads"),
        |bytes| {
            format!(
                "{processor}, {threads} threads, {:.0} GB",
                bytes as f64 / 1e9
            )
        },
    )
}

/// Returns the first digits of a commit, with later changes.
pub(crate) fn short_commit(commit: &str) -> String {
    const DIGITS: usize = 10;
    match commit.split_once('-') {
        Some((hash, change)) => format!("{hash:.DIGITS$}-{change}"),
        None => format!("{commit:.DIGITS$}"),
    }
}

/// Returns a rounded number with groups of three digits: `1,234,567`.
pub(crate) fn grouped(value: f64) -> String {
    let digits = format!("{:.0}", value.abs());
    let mut text = String::with_capacity(digits.len() + digits.len() / 3 + 1);
    if value < 0.0 && digits != "0" {
        text.push('-');
    }
    for (position, digit) in digits.chars().enumerate() {
        if position > 0 && (digits.len() - position).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// Formats a count: `1 scene`, `1,234 scenes`.
pub(crate) fn counted(count: usize, what: &str) -> String {
    let plural = if count == 1 { "" } else { "s" };
    format!("{} {what}{plural}", grouped(count as f64))
}

/// Returns a name for files: lower-case letters, digits and hyphens.
pub(crate) fn slug(text: &str) -> String {
    let mut slug = String::with_capacity(text.len());
    for character in text.chars() {
        if character.is_ascii_alphanumeric() {
            slug.push(character.to_ascii_lowercase());
        } else if !slug.ends_with('-') && !slug.is_empty() {
            slug.push('-');
        }
    }
    slug.truncate(60);
    slug.trim_end_matches('-').to_owned()
}
