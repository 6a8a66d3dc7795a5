//! Coverage of the sphere: bands of latitude with their share of points and of masks.

use glam::DVec3;
use omnilife_schemas::{
    camera::{Camera, ErpCamera},
    points::PointCloud,
    records::Scene,
};

use super::{marks::Mark, parts::Records, sheet::Sheet};

/// Bands of equal height from the top to the bottom, 20 degrees each.
pub(super) const BANDS: usize = 9;
/// Largest number of cameras and of points that are looked at, evenly spaced.
const MOST_CAMERAS: usize = 16;
const MOST_POINTS: usize = 4000;

/// Numbers of one band.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Band {
    /// Share of all directions to points, or of all viewing directions of perspective cameras, 0 to 1.
    pub(super) directions: f64,
    /// Share of the band's pixels that each kind of mask marks, 0 to 1.
    pub(super) moving: f64,
    pub(super) ignored: f64,
}

/// Coverage of a sequence.
pub(super) struct Coverage {
    /// Bands from the top to the bottom.
    pub(super) bands: [Band; BANDS],
    /// Meaning of the directions; `None` without directions to count.
    pub(super) directions: Option<&'static str>,
    /// True where the sheet has masks.
    pub(super) has_masks: bool,
}

/// Returns the latitudes of a band in degrees, the upper one first.
pub(super) fn latitudes(band: usize) -> [i32; 2] {
    let height = 180 / BANDS as i32;
    let upper = 90 - band as i32 * height;
    [upper, upper - height]
}

/// Returns the share of the sphere that a band has.
pub(super) fn share_of_sphere(band: usize) -> f64 {
    let [upper, lower] = latitudes(band).map(|degrees| f64::from(degrees).to_radians().sin());
    (upper - lower) / 2.0
}

impl Coverage {
    /// Measures a sequence; masks are those of its contact sheet.
    ///
    /// # Errors
    /// The reason in one line, when its points cannot be read.
    pub(super) fn of(records: &Records, sheet: &Sheet) -> Result<Self, String> {
        let mut bands = [Band::default(); BANDS];
        let (directions, counts) = match &records.scene {
            Some(scene) => directions(records, scene)?,
            None => (None, [0; BANDS]),
        };
        let all: usize = counts.iter().sum();
        for (band, count) in bands.iter_mut().zip(counts) {
            band.directions = count as f64 / all.max(1) as f64;
        }
        // Rows of perspective frames are not latitudes.
        let has_masks = !records.is_pinhole() && sheet.marks().any(|mark| mark != Mark::Overlay);
        if has_masks {
            for (index, band) in bands.iter_mut().enumerate() {
                band.moving = marked_share(sheet, Mark::Moving, index);
                band.ignored = marked_share(sheet, Mark::Ignored, index);
            }
        }
        Ok(Self {
            bands,
            directions: directions.filter(|_| all > 0),
            has_masks,
        })
    }
}

/// Returns the meaning of the directions, and their number in each band.
fn directions(
    records: &Records,
    scene: &Scene,
) -> Result<(Option<&'static str>, [usize; BANDS]), String> {
    let poses: Vec<_> = (scene.frames.iter())
        .filter_map(|frame| frame.pose.as_ref())
        .filter_map(|pose| Some((pose.rotation()?, pose.centre())))
        .collect();
    let mut counts = [0; BANDS];
    if matches!(scene.camera, Camera::Pinhole(_)) {
        for (rotation, _) in &poses {
            counts[band_of(*rotation * DVec3::Z)] += 1;
        }
        return Ok((Some("viewing directions"), counts));
    }
    let Some(file) = &scene.points else {
        return Ok((None, counts));
    };
    let cloud = PointCloud::read_ply(&records.path.join(file));
    let cloud = cloud.map_err(|error| error.without_folders())?;
    for (rotation, centre) in poses.iter().step_by(step(poses.len(), MOST_CAMERAS)) {
        let points = cloud
            .positions
            .iter()
            .step_by(step(cloud.len(), MOST_POINTS));
        for point in points {
            let direction = rotation.inverse() * (DVec3::from_array(*point) - *centre);
            if direction.is_finite() && direction != DVec3::ZERO {
                counts[band_of(direction)] += 1;
            }
        }
    }
    Ok((Some("points as the cameras see them"), counts))
}

/// Returns the step that leaves at most `most` of `count`, at least 1.
fn step(count: usize, most: usize) -> usize {
    count.div_ceil(most).max(1)
}

fn band_of(direction: DVec3) -> usize {
    let latitude = ErpCamera::longitude_latitude(direction).y.to_degrees();
    let band = (90.0 - latitude) / 180.0 * BANDS as f64;
    (band as usize).min(BANDS - 1)
}

/// Returns the share of a band's pixels that masks of a kind mark in the frames of a sheet; frames without a mask
/// count as unmarked.
fn marked_share(sheet: &Sheet, mark: Mark, band: usize) -> f64 {
    let (mut marked, mut all) = (0, 0);
    for shown in sheet
        .frames
        .iter()
        .filter_map(|frame| frame.shown.as_ref().ok())
    {
        let rows = band * shown.height / BANDS..(band + 1) * shown.height / BANDS;
        all += rows.len() * shown.width;
        for (_, mask) in shown.masks.iter().filter(|(of, _)| *of == mark) {
            let pixels = &mask.data[rows.start * mask.width..rows.end * mask.width];
            marked += pixels.iter().filter(|&&value| value != 0).count();
        }
    }
    marked as f64 / all.max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_share_the_sphere_from_top_to_bottom() {
        assert_eq!(latitudes(0), [90, 70]);
        assert_eq!(latitudes(BANDS - 1), [-70, -90]);
        let all: f64 = (0..BANDS).map(share_of_sphere).sum();
        assert!((all - 1.0).abs() < 1e-12, "{all}");
        assert_eq!(band_of(-DVec3::Y), 0);
        assert_eq!(band_of(DVec3::Z), BANDS / 2);
        assert_eq!(band_of(DVec3::Y), BANDS - 1);
    }

    #[test]
    fn samples_are_at_most_as_many_as_asked_for() {
        for count in [0, 1, 16, 17, 4001] {
            assert!((0..count).step_by(step(count, 16)).count() <= 16, "{count}");
        }
    }
}
