//! Label Studio's JSON of a project with video timeline labels: a list of tasks, whose annotations
//! hold results of type `timelinelabels` with frame ranges, numbered from 1.

use omnilife_schemas::records::Boundary;
use serde::Deserialize;
use serde_json::{Value, json};

use super::{Format, Frames, kind};

pub(super) const FORMAT: Format = Format {
    id: "label-studio",
    summary: "Label Studio's export of video timeline labels, in JSON.",
    recognises: |text| text.trim_start().starts_with('[') && text.contains("\"timelinelabels\""),
    read,
    write,
};

#[derive(Deserialize)]
struct Task {
    #[serde(default)]
    data: Value,
    #[serde(default)]
    annotations: Vec<Annotation>,
}

#[derive(Deserialize)]
struct Annotation {
    result: Vec<LabelledTask>,
}

#[derive(Deserialize)]
struct LabelledTask {
    #[serde(rename = "type")]
    kind: String,
    value: Value,
}

#[derive(Deserialize)]
struct Timeline {
    ranges: Vec<FrameRange>,
    timelinelabels: Vec<String>,
}

/// First and last frame, both inside, from 1.
#[derive(Deserialize)]
struct FrameRange {
    start: usize,
    end: usize,
}

fn read(text: &str, frames: &Frames<'_>) -> Result<Vec<Boundary>, String> {
    let tasks: Vec<Task> = serde_json::from_str(text).map_err(|error| error.to_string())?;
    let is_ours = |task: &&Task| {
        let video = task
            .data
            .get("video")
            .and_then(Value::as_str)
            .unwrap_or_default();
        // Label Studio puts a prefix before the names of uploaded files.
        tasks.len() == 1 || video.ends_with(frames.video)
    };
    let task = tasks
        .iter()
        .find(is_ours)
        .ok_or_else(|| format!("no task is about {}", frames.video))?;
    let mut boundaries = Vec::new();
    for labelled in task
        .annotations
        .iter()
        .flat_map(|annotation| &annotation.result)
    {
        if labelled.kind != "timelinelabels" {
            continue;
        }
        let timeline: Timeline =
            serde_json::from_value(labelled.value.clone()).map_err(|error| error.to_string())?;
        let label = timeline
            .timelinelabels
            .first()
            .ok_or("a range has no label")?;
        for range in &timeline.ranges {
            let first = range
                .start
                .checked_sub(1)
                .ok_or("frames are numbered from 1")?;
            let last = range
                .end
                .checked_sub(1)
                .ok_or("frames are numbered from 1")?;
            // One frame marks the first of a new shot.
            let begin = if last == first {
                first.saturating_sub(1)
            } else {
                first
            };
            let end = last.max(begin.saturating_add(1));
            let mut boundary = frames.between(begin, end)?;
            boundary.kind = kind(label)?;
            boundaries.push(boundary);
        }
    }
    Ok(boundaries)
}

fn write(boundaries: &[Boundary], frames: &Frames<'_>) -> Result<String, String> {
    let mut results = Vec::new();
    for (index, boundary) in boundaries.iter().enumerate() {
        let first = frames.nearest(boundary.begin_seconds)?.saturating_add(1);
        let last = frames.nearest(boundary.end_seconds)?.saturating_add(1);
        results.push(json!({
            "id": format!("boundary-{index}"),
            "type": "timelinelabels",
            "from_name": "boundaries",
            "to_name": "video",
            "value": {
                "ranges": [{ "start": first, "end": last }],
                "timelinelabels": [boundary.kind.name()],
            },
        }));
    }
    let tasks = json!([{
        "data": { "video": frames.video },
        "annotations": [{ "result": results }],
    }]);
    serde_json::to_string_pretty(&tasks)
        .map(|text| text + "\n")
        .map_err(|error| error.to_string())
}
