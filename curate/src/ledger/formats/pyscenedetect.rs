//! PySceneDetect's list of scenes (`scenedetect list-scenes`): a table of shots with frames from 1,
//! whose first line may list timecodes.

use std::fmt::Write;

use omnilife_schemas::records::Boundary;

use super::{Format, Frames};

const HEADER: &str = "Scene Number,Start Frame,Start Timecode,Start Time (seconds),End Frame,\
                      End Timecode,End Time (seconds),Length (frames),Length (timecode),\
                      Length (seconds)";

pub(super) const FORMAT: Format = Format {
    id: "pyscenedetect",
    summary: "PySceneDetect's CSV of scenes (list-scenes).",
    recognises: |text| {
        text.lines()
            .take(2)
            .any(|line| line.contains("Start Frame"))
    },
    read,
    write,
};

fn read(text: &str, frames: &Frames<'_>) -> Result<Vec<Boundary>, String> {
    let table = text
        .find("Scene Number")
        .and_then(|at| text.get(at..))
        .ok_or("the column Scene Number is missing")?;
    let mut reader = csv::Reader::from_reader(table.as_bytes());
    let headers = reader.headers().map_err(|error| error.to_string())?.clone();
    let column = |name: &str| {
        headers
            .iter()
            .position(|header| header == name)
            .ok_or_else(|| format!("the column {name} is missing"))
    };
    let (start, end) = (column("Start Frame")?, column("End Frame")?);
    let mut shots = Vec::new();
    for record in reader.records() {
        let record = record.map_err(|error| error.to_string())?;
        let frame = |at: usize| {
            record
                .get(at)
                .and_then(|field| field.trim().parse::<usize>().ok())
                .and_then(|frame| frame.checked_sub(1))
                .ok_or_else(|| {
                    format!(
                        "scene {}: no frame number from 1",
                        shots.len().saturating_add(1)
                    )
                })
        };
        shots.push((frame(start)?, frame(end)?));
    }
    frames.boundaries(&shots)
}

#[expect(
    clippy::arithmetic_side_effects,
    reason = "numbers of frames that are there"
)]
fn write(boundaries: &[Boundary], frames: &Frames<'_>) -> Result<String, String> {
    let mut text = format!("{HEADER}\n");
    // Their times count from the first frame, their ends are the first instant outside.
    let origin = frames.time(0)?;
    let interval = 1.0 / frames.frames_per_second();
    for (index, (first, last)) in frames.shots(boundaries)?.into_iter().enumerate() {
        let begin = frames.time(first)? - origin;
        let end = frames
            .time(last + 1)
            .unwrap_or(frames.time(last)? + interval)
            - origin;
        writeln!(
            text,
            "{},{},{},{begin:.3},{},{},{end:.3},{},{},{:.3}",
            index + 1,
            first + 1,
            timecode(begin),
            last + 1,
            timecode(end),
            last + 1 - first,
            timecode(end - begin),
            end - begin
        )
        .map_err(|error| error.to_string())?;
    }
    Ok(text)
}

/// Formats `HH:MM:SS.mmm`.
fn timecode(seconds: f64) -> String {
    let milliseconds = (seconds * 1000.0).round().max(0.0) as u64;
    let (hours, rest) = (milliseconds / 3_600_000, milliseconds % 3_600_000);
    format!(
        "{hours:02}:{:02}:{:02}.{:03}",
        rest / 60_000,
        rest / 1000 % 60,
        rest % 1000
    )
}
