//! Our own JSON: a list of boundaries as in `boundaries.json`, or such a file.

use omnilife_schemas::records::Boundary;
use serde::Deserialize;

use super::{Format, Frames};

pub(super) const FORMAT: Format = Format {
    id: "json",
    summary: "A list of boundaries as omnilife prints it, or a boundaries.json.",
    recognises: |text| text.trim_start().starts_with(['[', '{']),
    read,
    write,
};

#[derive(Deserialize)]
#[serde(untagged)]
enum File {
    List(Vec<Boundary>),
    Record { boundaries: Vec<Boundary> },
}

fn read(text: &str, frames: &Frames<'_>) -> Result<Vec<Boundary>, String> {
    let file: File = serde_json::from_str(text)
        .map_err(|_| "is neither a list of boundaries nor a record with one".to_owned())?;
    let (File::List(list) | File::Record { boundaries: list }) = file;
    list.into_iter()
        .map(|boundary| {
            let placed = frames.between_seconds(boundary.begin_seconds, boundary.end_seconds)?;
            Ok(Boundary {
                begin_seconds: placed.begin_seconds,
                end_seconds: placed.end_seconds,
                ..boundary
            })
        })
        .collect()
}

fn write(boundaries: &[Boundary], _: &Frames<'_>) -> Result<String, String> {
    serde_json::to_string_pretty(boundaries)
        .map(|text| text + "\n")
        .map_err(|error| error.to_string())
}
