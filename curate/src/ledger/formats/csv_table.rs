//! Our own table: `begin_seconds,end_seconds,kind`; the last two are optional. A row with one instant is the first
//! frame of a new shot.

use std::fmt::Write;

use omnilife_schemas::records::Boundary;

use super::{Format, Frames, kind};

pub(super) const FORMAT: Format = Format {
    id: "csv",
    summary: "A table with the columns begin_seconds, end_seconds and kind.",
    recognises: |text| {
        text.lines()
            .next()
            .is_some_and(|line| line.contains("begin_seconds"))
    },
    read,
    write,
};

fn read(text: &str, frames: &Frames<'_>) -> Result<Vec<Boundary>, String> {
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .flexible(true)
        .from_reader(text.as_bytes());
    let headers = reader.headers().map_err(|error| error.to_string())?.clone();
    let column = |name: &str| headers.iter().position(|header| header == name);
    let begin = column("begin_seconds").ok_or("the column begin_seconds is missing")?;
    let (end, kind_column) = (column("end_seconds"), column("kind"));
    let mut boundaries = Vec::new();
    for (row, record) in reader.records().enumerate() {
        let in_row = |reason: String| format!("row {}: {reason}", row.saturating_add(1));
        let record = record.map_err(|error| in_row(error.to_string()))?;
        let field = |column: Option<usize>| {
            column
                .and_then(|at| record.get(at))
                .filter(|field| !field.is_empty())
        };
        let seconds = |text: &str| {
            text.parse::<f64>()
                .ok()
                .filter(|seconds| seconds.is_finite())
                .ok_or_else(|| in_row(format!("must be a number of seconds, got {text:?}")))
        };
        let begin = seconds(field(Some(begin)).ok_or_else(|| in_row("no begin_seconds".into()))?)?;
        let end = field(end).map_or(Ok(begin), seconds)?;
        if end < begin {
            return Err(in_row(format!(
                "ends at {end} s, before it begins at {begin} s"
            )));
        }
        let mut boundary = frames.between_seconds(begin, end).map_err(in_row)?;
        if let Some(name) = field(kind_column) {
            boundary.kind = kind(name).map_err(in_row)?;
        }
        boundaries.push(boundary);
    }
    Ok(boundaries)
}

fn write(boundaries: &[Boundary], _: &Frames<'_>) -> Result<String, String> {
    let mut text = "begin_seconds,end_seconds,kind\n".to_owned();
    for boundary in boundaries {
        writeln!(
            text,
            "{},{},{}",
            boundary.begin_seconds,
            boundary.end_seconds,
            boundary.kind.name()
        )
        .map_err(|error| error.to_string())?;
    }
    Ok(text)
}
