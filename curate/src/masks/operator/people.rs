//! People who keep their place in the camera's frame: who does so over a whole shot, while the camera moves, carries it.
//!
//! Skin and clothes move a little, and change with the light, so that they leave less evidence than a helmet. A network
//! knows them by what they are, in frames spread over the sequence.

use std::path::Path;

use omnilife_schemas::{RgbImage, progress::Progress, records::Sequence, rgb::Mask};

use super::{
    super::deeplab::{self, Views, network::Network},
    evidence::WIDTH,
};
use crate::error::CurateError;

/// Number of frames that the network looks at.
const MOST_FRAMES: usize = 8;
/// Least share of these frames in which a pixel shows a person.
const LEAST_SHARE: f64 = 0.6;

/// Marks where people stay, at the size of the evidence.
///
/// # Errors
/// When the network or a frame cannot be read.
pub(super) fn staying(
    folder: &Path,
    sequence: &Sequence,
    progress: &dyn Progress,
) -> Result<Mask, CurateError> {
    let network = Network::load(&deeplab::published_weights()?)?;
    let entries = &sequence.frames.entries;
    let step = entries.len().div_ceil(MOST_FRAMES).max(1);
    progress.begin("people who stay", None);
    let shown = entries.iter().skip(step / 2).step_by(step).map(|entry| {
        let panorama = RgbImage::read(&folder.join(&entry.file))?;
        let views = Views::all(false, [panorama.width, panorama.height]);
        let likelihoods = views.likelihoods(&network, &panorama, [WIDTH, WIDTH / 2]);
        let kinds = likelihoods.of_kinds.iter();
        let people = kinds.map(|kinds| kinds[deeplab::PERSON] >= deeplab::PROBABILITY);
        Ok(people.collect())
    });
    let shown: Result<Vec<Vec<bool>>, CurateError> = shown.collect();
    progress.end();
    Ok(common(&shown?))
}

/// Marks the pixels at which most frames show a person.
fn common(shown: &[Vec<bool>]) -> Mask {
    let least = LEAST_SHARE * shown.len() as f64;
    let mark = |pixel: usize| {
        let count = shown.iter().filter(|people| people[pixel]).count();
        255 * u8::from(count > 0 && count as f64 >= least)
    };
    Mask::new(WIDTH, WIDTH / 2, (0..WIDTH * WIDTH / 2).map(mark).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn people_stay_where_most_frames_show_them() {
        let counts = [8, 5, 4, 1];
        let frame = |frame: usize| {
            let mut people = vec![false; WIDTH * WIDTH / 2];
            for (person, count) in people.iter_mut().zip(counts) {
                *person = frame < count;
            }
            people
        };
        let shown: Vec<Vec<bool>> = (0..8).map(frame).collect();
        assert_eq!(common(&shown).data[..5], [255, 255, 0, 0, 0]);
        assert!(!common(&[]).marks_anything());
    }
}
