//! People who keep their place in the camera's frame: who does so over a whole shot, while the camera moves, carries it.
//!
//! Skin and clothes move a little, and change with the light, so that they leave less evidence than a helmet. A network
//! knows them by what they are, in frames spread over the sequence. They sway: a place is kept to some degrees, and a
//! pixel belongs to them if it often shows them.

use std::path::Path;

use omnilife_schemas::{RgbImage, progress::Progress, records::Sequence, rgb::Mask};

use super::{
    super::{
        deeplab::{self, Views, network::Network},
        vote,
    },
    attached,
    evidence::WIDTH,
};
use crate::{error::CurateError, opencv_images::grown};

/// Number of frames that the network looks at.
const MOST_FRAMES: usize = 8;
/// Least share of these frames in which people are near a pixel, for those who stay.
const LEAST_STAY: f64 = 0.6;
/// Distance that counts as near, pixels: 5.6 degrees.
const SWAY_PIXELS: usize = 4;
/// Least share of these frames in which a pixel itself shows people, for the mask.
const LEAST_SHARE: f64 = 0.35;

/// Returns the limits in words, for records.
pub(super) fn settings() -> String {
    format!(
        "near a place in {LEAST_STAY} of up to {MOST_FRAMES} frames, shown by {LEAST_SHARE}, {}",
        attached::settings()
    )
}

/// A frame that the network looked at, at the size of the evidence.
#[derive(Debug, Clone)]
pub(super) struct Seen {
    pub(super) image: RgbImage,
    /// 255 where it shows people, 0 elsewhere.
    pub(super) people: Vec<u8>,
}

/// Marks people who stay, with what they wear and stand on, at the size of the evidence.
///
/// # Errors
/// When the network or a frame cannot be read.
pub(super) fn staying(
    folder: &Path,
    sequence: &Sequence,
    progress: &dyn Progress,
) -> Result<Mask, CurateError> {
    let network = Network::load(&deeplab::published_weights()?)?;
    let (entries, views) = (&sequence.frames.entries, Views::of(sequence));
    let step = entries.len().div_ceil(MOST_FRAMES).max(1);
    progress.begin("people who stay", None);
    let seen = entries.iter().skip(step / 2).step_by(step).map(|entry| {
        let panorama = views.read(&folder.join(&entry.file))?;
        let size = [WIDTH, WIDTH / 2];
        let likelihoods = views.likelihoods(&views.all(), &network, &panorama, size);
        let kinds = likelihoods.of_kinds.iter();
        let people = kinds.map(|kinds| kinds[deeplab::PERSON] >= deeplab::PROBABILITY);
        Ok(Seen {
            people: people.map(|is_person| 255 * u8::from(is_person)).collect(),
            image: panorama.resized_by_area(WIDTH, WIDTH / 2),
        })
    });
    let seen: Result<Vec<Seen>, CurateError> = seen.collect();
    progress.end();
    let seen = seen?;
    let internal = |error: opencv::Error| CurateError::internal(folder, error);
    let core = core(&seen).map_err(internal)?;
    attached::grown_from(&core, &seen).map_err(internal)
}

/// Marks people who are near one place in most frames, at the pixels that show them often.
fn core(seen: &[Seen]) -> opencv::Result<Mask> {
    let shown: Vec<&[u8]> = seen.iter().map(|frame| frame.people.as_slice()).collect();
    let near = shown.iter().map(|people| grown(people, WIDTH, SWAY_PIXELS));
    let near: Vec<Vec<u8>> = near.collect::<opencv::Result<_>>()?;
    let near: Vec<&[u8]> = near.iter().map(Vec::as_slice).collect();
    let stays = marked_in(&near, LEAST_STAY);
    let mut data = vec![0; WIDTH * WIDTH / 2];
    for region in vote::regions(&marked_in(&shown, LEAST_SHARE), WIDTH, true) {
        if region.iter().any(|&pixel| stays[pixel]) {
            for pixel in region {
                data[pixel] = 255;
            }
        }
    }
    Ok(Mask::new(WIDTH, WIDTH / 2, data))
}

/// Returns for each pixel true if at least this share of the marks, and any of them, mark it.
pub(super) fn marked_in(marks: &[&[u8]], least: f64) -> Vec<bool> {
    let least = least * marks.len() as f64;
    let is_marked = |pixel: usize| {
        let count = marks.iter().filter(|marks| marks[pixel] != 0).count();
        count > 0 && count as f64 >= least
    };
    (0..WIDTH * WIDTH / 2).map(is_marked).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Frames with a person of 3x3 pixels in this row, at a column of each frame; `None` without a person.
    fn seen(columns: &[Option<usize>]) -> Vec<Seen> {
        let frame = |column: &Option<usize>| {
            let mut people = vec![0; WIDTH * WIDTH / 2];
            for (row, reach) in (60..63).flat_map(|row| (0..3).map(move |reach| (row, reach))) {
                if let Some(column) = column {
                    people[row * WIDTH + (column + reach) % WIDTH] = 255;
                }
            }
            Seen {
                image: RgbImage::black(WIDTH, WIDTH / 2),
                people,
            }
        };
        columns.iter().map(frame).collect()
    }

    fn columns_of(core: &Mask) -> Vec<usize> {
        (0..WIDTH)
            .filter(|column| core.data[61 * WIDTH + column] != 0)
            .collect()
    }

    #[test]
    fn people_who_sway_stay_where_frames_often_show_them() {
        // Across the seam, in six of eight frames.
        let places = [254, 0, 254, 0, 1, 255].map(Some);
        let mut swaying = seen(&places);
        swaying.extend(seen(&[None, None]));
        let core = core(&swaying).expect("filtered");
        assert_eq!(columns_of(&core), [0, 1, 2, 255]);
    }

    #[test]
    fn people_who_pass_or_show_rarely_do_not_stay() {
        let passing: Vec<Option<usize>> = (0..8).map(|frame| Some(30 * frame)).collect();
        assert!(!core(&seen(&passing)).expect("filtered").marks_anything());
        // In three of eight frames each pixel shows them, and no more frames have them near.
        let rare: Vec<Option<usize>> = (0..8).map(|frame| (frame < 3).then_some(40)).collect();
        assert!(!core(&seen(&rare)).expect("filtered").marks_anything());
        assert!(!core(&[]).expect("filtered").marks_anything());
    }

    #[test]
    fn marks_count_from_their_least_share_on() {
        let counts = [8, 5, 4, 1];
        let marks: Vec<Vec<u8>> = (0..8)
            .map(|frame| {
                let mut marks = vec![0; WIDTH * WIDTH / 2];
                for (mark, count) in marks.iter_mut().zip(counts) {
                    *mark = 255 * u8::from(frame < count);
                }
                marks
            })
            .collect();
        let marks: Vec<&[u8]> = marks.iter().map(Vec::as_slice).collect();
        assert_eq!(
            marked_in(&marks, 0.6)[..5],
            [true, true, false, false, false]
        );
    }
}
