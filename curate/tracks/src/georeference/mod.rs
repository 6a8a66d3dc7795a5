//! Place of a scene on the Earth: recorded positions of its frames, and the similarity from the world to east, north
//! and up.
//!
//! Positions are those of a drone's subtitles ([`telemetry`]), at the times of the frames in their video, or those that
//! stills state in EXIF.

pub mod geodesy;
pub mod similarity;
pub mod telemetry;

use std::path::Path;

use glam::DVec3;
use omnilife_schemas::{
    posed_view::PosedView,
    records::{GeoFix, GeoPoint, GeoResiduals, Georeference, Scene},
    statistics::{median, quantile},
};

use crate::error::TracksError;
use similarity::fitted;
use telemetry::Telemetry;

/// Difference of two scales that is reported: positions of satellites leave a percent over a path of some 100 m.
const LARGEST_SCALE_DIFFERENCE: f64 = 0.02;

/// Recorded positions of the frames of a scene.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordedPositions {
    /// Name of the file, or `exif`.
    pub source: String,
    /// Reference of the heights.
    pub heights: String,
    /// Numbers of frames, rising, with positions.
    pub positions: Vec<(u32, GeoPoint)>,
}

impl RecordedPositions {
    /// Reads those of the frames of a scene from the subtitles of its video.
    ///
    /// # Errors
    /// When the file cannot be read or holds no valid telemetry.
    pub fn of_telemetry(scene: &Scene, file: &Path) -> Result<Self, TracksError> {
        let telemetry = Telemetry::read(file)?;
        let frames = (0..).zip(&scene.frames);
        let name = file.file_name().unwrap_or_default();
        Ok(Self {
            source: name.to_string_lossy().into_owned(),
            heights: telemetry.heights.to_owned(),
            positions: frames
                .filter_map(|(number, frame)| Some((number, telemetry.at(frame.time_seconds)?)))
                .collect(),
        })
    }

    /// Returns those that stills state, with heights; `None` without any.
    pub fn of_stills(scene: &Scene) -> Option<Self> {
        let frames = (0..).zip(&scene.frames);
        let positions: Vec<(u32, GeoPoint)> = frames
            .filter_map(|(number, frame)| {
                let capture = frame.capture.as_ref()?;
                let point = GeoPoint {
                    latitude_degrees: capture.latitude_degrees?,
                    longitude_degrees: capture.longitude_degrees?,
                    altitude_metres: capture.altitude_metres?,
                };
                Some((number, point))
            })
            .collect();
        (!positions.is_empty()).then(|| Self {
            source: "exif".to_owned(),
            heights: "exif".to_owned(),
            positions,
        })
    }

    /// Fits the similarity from the world of a scene.
    ///
    /// # Errors
    /// When fewer than four frames have both, or their cameras are on a line.
    pub fn georeference(&self, scene: &Scene) -> Result<Georeference, String> {
        let frames: Vec<u32> = self.positions.iter().map(|(frame, _)| *frame).collect();
        let views = PosedView::of_scene(scene, &frames);
        let point = |view: &PosedView| {
            let mut positions = self.positions.iter();
            let found = positions.find(|(frame, _)| *frame == view.frame);
            found.map(|(_, point)| *point)
        };
        let points: Vec<GeoPoint> = views.iter().filter_map(point).collect();
        let origin =
            middle(&points).ok_or("must have recorded positions at posed frames, got none")?;
        let centres: Vec<DVec3> = views.iter().map(|view| view.centre).collect();
        let recorded: Vec<DVec3> = points
            .iter()
            .map(|point| geodesy::enu(&origin, point))
            .collect();
        let fit = fitted(&centres, &recorded)?;
        let residuals = fit.residuals.iter().zip(&fit.is_used);
        let used: Vec<f64> = residuals
            .clone()
            .filter_map(|(&residual, &is_used)| is_used.then_some(residual))
            .collect();
        let [x, y, z, w] = fit.rotation.to_array();
        let fixes = views.iter().zip(points).zip(residuals);
        Ok(Georeference {
            scene: scene.id.clone(),
            source: self.source.clone(),
            heights: self.heights.clone(),
            origin,
            utm: geodesy::utm(&origin),
            metres_per_unit: fit.scale,
            rotation_wxyz: [w, x, y, z],
            offset: fit.offset.to_array(),
            residuals: GeoResiduals {
                used: used.len() as u32,
                rejected: (centres.len() - used.len()) as u32,
                median_metres: median(&used).unwrap_or(0.0),
                p90_metres: quantile(&used, 0.9).unwrap_or(0.0),
                largest_metres: quantile(&used, 1.0).unwrap_or(0.0),
            },
            fixes: fixes
                .map(|((view, point), (&residual_metres, &is_used))| GeoFix {
                    frame: view.frame,
                    point,
                    residual_metres,
                    is_used,
                })
                .collect(),
        })
    }
}

/// Returns the median of each coordinate.
fn middle(points: &[GeoPoint]) -> Option<GeoPoint> {
    let along = |coordinate: fn(&GeoPoint) -> f64| {
        let values: Vec<f64> = points.iter().map(coordinate).collect();
        median(&values)
    };
    Some(GeoPoint {
        latitude_degrees: along(|point| point.latitude_degrees)?,
        longitude_degrees: along(|point| point.longitude_degrees)?,
        altitude_metres: along(|point| point.altitude_metres)?,
    })
}

/// Returns a line on a georeference for readers.
pub fn words(georeference: &Georeference) -> String {
    let (residuals, utm) = (&georeference.residuals, &georeference.utm);
    // The third number of `GPS(..)` has no name.
    let doubt = match georeference.heights.as_str() {
        "gps" => "; heights without a name may be numbers of satellites",
        _ => "",
    };
    format!(
        "georeferenced by {} ({}): {} positions, {} left out, {:.2} m off in the median, {:.2} m in 90 %, {:.2} m at \
         most; {:.4} m per unit; origin in UTM {}{} {:.1} E {:.1} N{doubt}",
        georeference.source,
        georeference.heights,
        residuals.used,
        residuals.rejected,
        residuals.median_metres,
        residuals.p90_metres,
        residuals.largest_metres,
        georeference.metres_per_unit,
        utm.zone,
        if utm.is_north { "N" } else { "S" },
        utm.easting,
        utm.northing
    )
}

/// Returns a line where tracks have another scale than the place of their scene, metres per unit of the world; `None`
/// where they agree.
pub fn scale_note(of_place: f64, of_tracks: f64) -> Option<String> {
    let ratio = of_tracks / of_place;
    ((ratio - 1.0).abs() > LARGEST_SCALE_DIFFERENCE).then(|| {
        format!(
            "tracks.json has {of_tracks:.4} m per unit, and recorded positions say {of_place:.4}: lengths by it are {:.1} \
             % too {}; --metres-per-unit {of_place:.4} makes tracks of that scale",
            100.0 * (ratio - 1.0).abs(),
            if ratio > 1.0 { "long" } else { "short" }
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scales_that_contradict_each_other_are_reported() {
        assert_eq!(scale_note(10.0, 10.1), None);
        let short = scale_note(10.0, 9.0312);
        assert!(short.is_some_and(|line| line.contains("9.7 % too short")));
        assert!(scale_note(1.0, 1.1).is_some_and(|line| line.contains("10.0 % too long")));
    }
}
