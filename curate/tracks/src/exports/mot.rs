//! `mot`: boxes as the result files of the MOT challenge (<https://motchallenge.net/instructions/>):
//! `frame,id,left,top,width,height,confidence,-1,-1,-1`, frames from 1 on in the order of the scene's frames, boxes in
//! pixels of its images. The detector `files` reads it.

use std::fmt::Write as _;

use super::{Content, TrackExport, TrackFormat};

/// The format.
pub const FORMAT: TrackFormat = TrackFormat {
    id: "mot",
    about: "boxes of the tracked vehicles, as results of the MOT challenge",
    file: "tracks.mot.txt",
    content: Content::Text(write),
};

fn write(export: &TrackExport<'_>) -> Result<String, String> {
    let detections = export.tracks.detections.iter();
    let mut rows: Vec<_> = detections
        .filter_map(|one| Some((one.frame, one.track?, one)))
        .collect();
    rows.sort_by_key(|&(frame, id, _)| (frame, id));
    let mut text = String::new();
    for (frame, id, detection) in rows {
        let [left, top, width, height] = detection.box_pixels;
        let confidence = detection.confidence;
        let number = u64::from(frame) + 1;
        let _ = writeln!(
            text,
            "{number},{id},{left},{top},{width},{height},{confidence},-1,-1,-1"
        );
    }
    Ok(text)
}
