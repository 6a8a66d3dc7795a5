//! Choice of the frames of every sequence of a video.

use omnilife_schemas::{
    layout::sequence_name,
    records::{SharpFrames, TimeRange, VideoProjection},
};

use super::Sequencing;
use crate::{
    error::CurateError, frames, motion::pairs::choose_pairs, settings::FrameSelection, sharpness,
};

pub(super) struct PlannedSequence {
    pub(super) name: String,
    pub(super) range: TimeRange,
    /// Timestamps of its frames, seconds.
    pub(super) times: Vec<f64>,
    /// Reasons for the frames, where they are the sharpest ones.
    pub(super) sharpest: Option<SharpFrames>,
    /// Timestamps of the frames in which its motion is measured, seconds; none where its frames will do.
    pub(super) motion_times: Vec<f64>,
}

impl Sequencing<'_> {
    /// Chooses the frames of every kept shot.
    pub(super) fn planned(&self) -> Result<Vec<PlannedSequence>, CurateError> {
        let video_times = &self.signals.times;
        // Motion is measured on the whole sphere.
        let is_sphere = self.projection.projection != VideoProjection::Rectilinear;
        let kept = self.list.shots.kept.iter().enumerate();
        kept.map(|(index, &range)| {
            let even = frames::choose(video_times, range, self.settings.sampling);
            let (times, sharpest) = self.selected(even, range)?;
            let pairs = match is_sphere {
                true => choose_pairs(video_times, range, &times),
                false => Vec::new(),
            };
            Ok(PlannedSequence {
                name: sequence_name(index),
                range,
                times,
                sharpest,
                motion_times: pairs.into_flattened(),
            })
        })
        .collect()
    }

    /// Returns the selected frames around evenly spaced ones, and the reasons where these are the sharpest.
    fn selected(
        &self,
        even: Vec<f64>,
        range: TimeRange,
    ) -> Result<(Vec<f64>, Option<SharpFrames>), CurateError> {
        if self.settings.select == FrameSelection::Even {
            return Ok((even, None));
        }
        let values = self.signals.column(sharpness::COLUMN);
        let values = values.map_err(|missing| CurateError::internal(self.video, missing))?;
        let chosen = sharpness::sharpest(&self.signals.times, values, range, &even);
        let (times, frames) = chosen.into_iter().unzip();
        let measure = self.settings.view().description().to_owned();
        Ok((times, Some(SharpFrames { measure, frames })))
    }
}
