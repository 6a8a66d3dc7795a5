//! TransNetV2's `*.scenes.txt`: one shot per line, its first and last frame from 0.
//!
//! The reference scores the last frame of the old shot for a cut and takes it into the shot, so
//! that a shot ends where the next begins minus one.

use std::fmt::Write;

use omnilife_schemas::records::Boundary;

use super::{Format, Frames};

pub(super) const FORMAT: Format = Format {
    id: "transnetv2",
    summary: "TransNetV2's scenes.txt: first and last frame of each shot.",
    recognises: |text| {
        text.lines()
            .next()
            .is_some_and(|line| numbers(line).is_ok())
    },
    read,
    write,
};

fn numbers(line: &str) -> Result<(usize, usize), String> {
    let words: Result<Vec<usize>, _> = line.split_whitespace().map(str::parse).collect();
    match words.as_deref() {
        Ok(&[first, last]) => Ok((first, last)),
        _ => Err(format!("{line:?} is not a first and a last frame")),
    }
}

fn read(text: &str, frames: &Frames<'_>) -> Result<Vec<Boundary>, String> {
    let shots: Result<Vec<_>, String> = text
        .lines()
        .filter(|line| !line.trim().is_empty())
        .map(numbers)
        .collect();
    frames.boundaries(&shots?)
}

fn write(boundaries: &[Boundary], frames: &Frames<'_>) -> Result<String, String> {
    let mut text = String::new();
    for (first, last) in frames.shots(boundaries)? {
        writeln!(text, "{first} {last}").map_err(|error| error.to_string())?;
    }
    Ok(text)
}
