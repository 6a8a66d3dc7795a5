//! Boundaries in the formats of other tools, in and out.
//!
//! Most of them count frames and know no timestamps, so reading and writing need the timestamps of all frames of the
//! video; times in files are put on the nearest frame. Frames are numbered from 0 here. Only `csv`, `json` and
//! `label-studio` keep the kinds of boundary; elsewhere a boundary between neighbouring frames is a cut and a longer
//! one is gradual.
//!
//! To add a format: one file, and one line in [`FORMATS`].
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

mod csv_table;
mod edl;
mod json;
mod label_studio;
mod pyscenedetect;
mod transnetv2_scenes;

use omnilife_schemas::{
    names,
    records::{Boundary, BoundaryKind},
};

/// A file format for boundaries.
pub struct Format {
    /// Unique id.
    pub id: &'static str,
    /// Description in one sentence.
    pub summary: &'static str,
    /// Returns true if a text looks like this format.
    pub recognises: fn(&str) -> bool,
    /// Reads boundaries; errors are one line.
    pub read: fn(&str, &Frames<'_>) -> Result<Vec<Boundary>, String>,
    /// Writes boundaries in order of time.
    pub write: fn(&[Boundary], &Frames<'_>) -> Result<String, String>,
}

/// All formats, in the order in which they are tried on a text; tests walk it.
pub static FORMATS: &[Format] = &[
    label_studio::FORMAT,
    json::FORMAT,
    pyscenedetect::FORMAT,
    csv_table::FORMAT,
    edl::FORMAT,
    transnetv2_scenes::FORMAT,
];

/// Returns the format with this id; the error lists the known ones.
pub fn format(id: &str) -> Result<&'static Format, String> {
    names::find("format", id, FORMATS, |format| format.id).map_err(|unknown| unknown.to_string())
}

/// Reads boundaries from a text of any known format.
///
/// # Errors
/// One line without the file's name.
pub fn read_any(text: &str, frames: &Frames<'_>) -> Result<Vec<Boundary>, String> {
    let text = text.trim_start_matches('\u{feff}');
    let known = FORMATS.iter().find(|format| (format.recognises)(text));
    let known = known.ok_or_else(|| {
        let ids: Vec<_> = FORMATS.iter().map(|format| format.id).collect();
        format!("holds boundaries in none of the formats {}", ids.join(", "))
    })?;
    (known.read)(text, frames).map_err(|reason| format!("as {}: {reason}", known.id))
}

/// The timestamps of all frames of a video, in order, with the name of the video.
#[derive(Debug, Clone, Copy)]
pub struct Frames<'a> {
    /// Seconds.
    pub times: &'a [f64],
    /// File name of the video, for formats that state it.
    pub video: &'a str,
}

impl Frames<'_> {
    /// Returns the frame nearest to an instant. Instants more than one frame outside the video are errors.
    fn nearest(&self, seconds: f64) -> Result<usize, String> {
        let (Some(&first), Some(&last)) = (self.times.first(), self.times.last()) else {
            return Err("the video has no frames".to_owned());
        };
        let slack = 1.0 / self.frames_per_second();
        if !(first - slack..=last + slack).contains(&seconds) {
            return Err(format!(
                "{seconds} s lies outside the video, which lasts from {first} to {last} s"
            ));
        }
        let after = self.times.partition_point(|&time| time < seconds);
        let before = after.saturating_sub(1);
        let after = after.min(self.times.len().saturating_sub(1));
        let is_before = seconds - self.time(before)? <= self.time(after)? - seconds;
        Ok(if is_before { before } else { after })
    }

    fn time(&self, frame: usize) -> Result<f64, String> {
        self.times.get(frame).copied().ok_or_else(|| {
            format!(
                "frame {frame} lies outside the video of {} frames",
                self.times.len()
            )
        })
    }

    /// Returns the mean frame rate.
    fn frames_per_second(&self) -> f64 {
        match (self.times.first(), self.times.last()) {
            (Some(first), Some(last)) if last > first => {
                self.times.len().saturating_sub(1) as f64 / (last - first)
            }
            _ => 1.0,
        }
    }

    /// Returns the boundary between the last frame of the old shot and the first of the new one.
    fn between(&self, last: usize, first: usize) -> Result<Boundary, String> {
        if first <= last {
            return Err(format!(
                "frame {first} begins a shot and frame {last} ends the one before"
            ));
        }
        Ok(Boundary {
            begin_seconds: self.time(last)?,
            end_seconds: self.time(first)?,
            kind: if first.checked_sub(1) == Some(last) {
                BoundaryKind::Cut
            } else {
                BoundaryKind::Gradual
            },
            score: 1.0,
        })
    }

    /// Returns the boundary on whole frames between two instants; for one instant, the first frame of the new shot.
    fn between_seconds(&self, begin: f64, end: f64) -> Result<Boundary, String> {
        let first = self.nearest(end)?;
        let last = self.nearest(begin)?;
        if begin == end || last >= first {
            let first = first.max(1);
            return self.between(first.saturating_sub(1), first);
        }
        self.between(last, first)
    }

    /// Returns first and last frames, both inside, of the shots between boundaries.
    fn shots(&self, boundaries: &[Boundary]) -> Result<Vec<(usize, usize)>, String> {
        let mut shots = Vec::new();
        let mut begin = 0;
        for boundary in boundaries {
            let last = self.nearest(boundary.begin_seconds)?;
            if last >= begin {
                shots.push((begin, last));
            }
            begin = self.nearest(boundary.end_seconds)?;
        }
        shots.push((begin, self.times.len().saturating_sub(1).max(begin)));
        Ok(shots)
    }

    /// Boundaries between consecutive shots, given by their first and last frames. Other tools may
    /// count one frame more than the video has.
    fn boundaries(&self, shots: &[(usize, usize)]) -> Result<Vec<Boundary>, String> {
        for &(first, last) in shots {
            if last < first {
                return Err(format!("a shot from frame {first} to {last} has no frames"));
            }
            self.time(last.saturating_sub(1))?;
        }
        shots
            .iter()
            .zip(shots.iter().skip(1))
            .map(|((_, last), (first, _))| self.between(*last, *first))
            .collect()
    }
}

fn kind(name: &str) -> Result<BoundaryKind, String> {
    BoundaryKind::ALL
        .into_iter()
        .find(|kind| kind.name() == name.trim())
        .ok_or_else(|| {
            let known = BoundaryKind::ALL.map(BoundaryKind::name);
            format!("kind {name:?} is not known; there is {}", known.join(", "))
        })
}
