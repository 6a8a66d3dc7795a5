//! Motion between neighbouring frames of a sequence, by their pixels.

use std::path::Path;

use glam::Vec3;
use omnilife_schemas::{
    RgbImage,
    camera::{CameraModel, ErpCamera},
    progress::Progress,
    records::{FrameEntry, Sequence},
};

use crate::{
    error::CurateError,
    motion::{
        GreySphere, PairMotion,
        pairs::{LARGEST_GAP_SECONDS, MOST_PAIRS},
        register,
    },
};

/// Columns of the images that are compared.
const IMAGE_WIDTH: usize = 256;
/// Directions at which flow is measured.
const GRID: ErpCamera = ErpCamera::new(64, 32);
/// Flow that the camera's motion does not explain is motion of the scene from this length on, pixels.
const LEAST_MOVED_PIXELS: f32 = 1.0;
/// Neighbours of a moving direction, of eight, that must move too: single ones are errors of the flow.
const LEAST_NEIGHBOURS: usize = 3;

/// Motion of all pairs of frames that could be registered.
#[derive(Debug, Default)]
pub(super) struct FrameMotion {
    pub(super) compared: usize,
    /// Speeds of rotation, degrees per second.
    pub(super) turns: Vec<f64>,
    /// Median flow of static content after rotation is undone, degrees per second.
    pub(super) parallaxes: Vec<f64>,
    /// Shares of the sphere that move by themselves.
    pub(super) dynamic_shares: Vec<f64>,
}

impl FrameMotion {
    /// Returns the share of pairs that could be registered; 0 without pairs.
    pub(super) fn registered_share(&self) -> f64 {
        self.turns.len() as f64 / self.compared.max(1) as f64
    }
}

/// Returns the pairs of frames that show the motion: those taken for it, else sampled neighbours that are close.
pub(super) fn pairs_of(sequence: &Sequence) -> Vec<[&FrameEntry; 2]> {
    let entries = &sequence.frames.entries;
    let is_close = |pair: &[&FrameEntry; 2]| {
        let seconds = pair[1].time_seconds - pair[0].time_seconds;
        seconds > 0.0 && seconds <= LARGEST_GAP_SECONDS
    };
    let (taken, _) = sequence.motion_frames.as_chunks::<2>();
    let taken: Vec<[&FrameEntry; 2]> = taken.iter().map(|[a, b]| [a, b]).filter(is_close).collect();
    if !taken.is_empty() {
        return taken;
    }
    let near: Vec<[&FrameEntry; 2]> = entries
        .windows(2)
        .map(|pair| [&pair[0], &pair[1]])
        .filter(is_close)
        .collect();
    let count = near.len().min(MOST_PAIRS);
    (0..count)
        .map(|number| near[number * near.len() / count])
        .collect()
}

/// Compares the pairs of a sequence's frames.
///
/// # Errors
/// When a frame cannot be read.
pub(super) fn compare(
    folder: &Path,
    sequence: &Sequence,
    progress: &dyn Progress,
) -> Result<FrameMotion, CurateError> {
    let pairs = pairs_of(sequence);
    let directions: Vec<Vec3> = (0..GRID.height)
        .flat_map(|row| (0..GRID.width).map(move |column| (column, row)))
        .map(|(column, row)| {
            let pixel = glam::dvec2(f64::from(column) + 0.5, f64::from(row) + 0.5);
            GRID.unproject(pixel).as_vec3()
        })
        .collect();
    let read = |entry: &FrameEntry| -> Result<GreySphere, CurateError> {
        let image = RgbImage::read(&folder.join(&entry.file))?;
        let width = IMAGE_WIDTH.min(image.width);
        Ok(GreySphere::new(&image, width))
    };
    let mut found = FrameMotion::default();
    progress.begin(
        &format!("measuring {}", sequence.id),
        Some(pairs.len() as u64),
    );
    let measured = pairs
        .into_iter()
        .try_for_each(|[first, second]| -> Result<(), CurateError> {
            let seconds = second.time_seconds - first.time_seconds;
            let (from, to) = (read(first)?, read(second)?);
            found.compared += 1;
            progress.advance(1);
            let Some(registered) = register(&from, &to, &directions) else {
                return Ok(());
            };
            let (_, angle) = registered.rotation.to_axis_angle();
            let angle = f64::from(angle.min(std::f32::consts::TAU - angle));
            let parallax = registered.motion.parallax_radians;
            found.turns.push(angle.to_degrees() / seconds);
            found.parallaxes.push(parallax.to_degrees() / seconds);
            let share = dynamic_share(&registered.motion, from.pixel_radians(0));
            found.dynamic_shares.extend(share);
            Ok(())
        });
    progress.end();
    measured.map(|()| found)
}

/// Returns the share of the sphere, as far as flow is known, that moves by itself together with its surroundings.
fn dynamic_share(motion: &PairMotion, pixel_radians: f32) -> Option<f64> {
    let (width, height) = (GRID.width as usize, GRID.height as usize);
    let limit = (motion.limit_radians as f32).max(LEAST_MOVED_PIXELS * pixel_radians);
    let moves: Vec<bool> = motion
        .unexplained
        .iter()
        .map(|length| length.is_some_and(|length| length > limit))
        .collect();
    let neighbours = |row: usize, column: usize| {
        let rows = row.saturating_sub(1)..(row + 2).min(height);
        rows.flat_map(|y| (0..3).map(move |x| (y, (column + width + x - 1) % width)))
            .filter(|&(y, x)| (y, x) != (row, column) && moves[y * width + x])
            .count()
    };
    let (mut moving, mut seen) = (0.0, 0.0);
    for row in 0..height {
        let weight = GRID.pixel_solid_angle(row as u32);
        for column in 0..width {
            let at = row * width + column;
            if motion.unexplained[at].is_some() {
                seen += weight;
                if moves[at] && neighbours(row, column) >= LEAST_NEIGHBOURS {
                    moving += weight;
                }
            }
        }
    }
    (seen > 0.0).then(|| moving / seen)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn motion(moving: impl Fn(usize, usize) -> bool) -> PairMotion {
        let (width, height) = (GRID.width as usize, GRID.height as usize);
        PairMotion {
            heading: None,
            turn: Vec3::ZERO,
            parallax_radians: 0.0,
            unexplained: (0..width * height)
                .map(|at| {
                    Some(if moving(at / width, at % width) {
                        0.2
                    } else {
                        0.0
                    })
                })
                .collect(),
            limit_radians: 0.01,
        }
    }

    #[test]
    fn bodies_count_across_the_seam_and_single_directions_do_not() {
        let share = |moving: &dyn Fn(usize, usize) -> bool| dynamic_share(&motion(moving), 0.02);
        let body = share(&|row, column| (14..18).contains(&row) && !(2..62).contains(&column));
        // 4 of 64 columns over 22.5 degrees around the equator.
        let expected = 4.0 / 64.0 * 11.25_f64.to_radians().sin();
        assert!(body.is_some_and(|share| (share - expected).abs() < 1e-6));
        let specks = share(&|row, column| row % 3 == 0 && column % 3 == 0 && column < 60);
        assert_eq!(specks, Some(0.0));
        // Less than a pixel.
        assert_eq!(dynamic_share(&motion(|_, _| true), 0.3), Some(0.0));
    }
}
