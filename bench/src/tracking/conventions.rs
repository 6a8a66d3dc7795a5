//! Conventions of boxes and frame numbers, told by a reading of the same numbers in which boxes fit the true ones much
//! better.
//!
//! A record of tracks has boxes as left, top, width and height in pixels of its own images, and frames from 0. Other
//! tools write corners, middles or shares of the image, and count from 1. Scores are always of the boxes as they are.

use std::{collections::BTreeMap, fmt};

use omnilife_schemas::records::{DIAGNOSIS_PREFIX, Detection};

use super::boxes::overlap;

/// Least gain in the mean overlap of true boxes by another form of boxes, and by another frame.
const LEAST_GAIN: f64 = 0.2;
const LEAST_SHIFT_GAIN: f64 = 0.03;
/// Largest share of the missing overlap that a reading leaves.
const MOST_LEFT: f64 = 0.5;

/// Meaning of the numbers of boxes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Reading {
    AsTheyAre,
    /// Boxes stand at a frame so many behind their own.
    FramesOn(i32),
    /// Left, top, right, bottom.
    Corners,
    /// Middle across and down, width, height.
    Middle,
    /// Shares of the width and height of the image.
    Shares,
    /// Corners as shares.
    CornerShares,
    /// Middle, width and height as shares.
    MiddleShares,
    /// Pixels of the scene's images, where the record states another size.
    SceneImages,
}

impl Reading {
    const OTHERS: [Self; 8] = [
        Self::FramesOn(1),
        Self::FramesOn(-1),
        Self::Corners,
        Self::Middle,
        Self::Shares,
        Self::CornerShares,
        Self::MiddleShares,
        Self::SceneImages,
    ];

    /// Returns the frame at which boxes of `frame` stand.
    fn holder(self, frame: u32) -> Option<u32> {
        match self {
            Self::FramesOn(steps) => frame.checked_add_signed(steps),
            _ => Some(frame),
        }
    }

    /// Returns left, top, width and height of a box in pixels.
    fn box_pixels(self, [a, b, c, d]: [f64; 4], sizes: &Sizes) -> [f64; 4] {
        let [width, height] = sizes.image;
        let in_pixels = [a * width, b * height, c * width, d * height];
        match self {
            Self::AsTheyAre | Self::FramesOn(_) => [a, b, c, d],
            Self::Corners => [a, b, c - a, d - b],
            Self::Middle => [a - 0.5 * c, b - 0.5 * d, c, d],
            Self::Shares => in_pixels,
            Self::CornerShares => Self::Corners.box_pixels(in_pixels, sizes),
            Self::MiddleShares => Self::Middle.box_pixels(in_pixels, sizes),
            Self::SceneImages => {
                let [across, down] = [width / sizes.scene[0], height / sizes.scene[1]];
                [a * across, b * down, c * across, d * down]
            }
        }
    }

    /// Returns the mean over the true boxes of their largest overlap with a found box.
    fn fit(self, truth: &[Detection], found: &BTreeMap<u32, Vec<[f64; 4]>>, sizes: &Sizes) -> f64 {
        let best = |one: &Detection| {
            let holder = self.holder(one.frame);
            let boxes = holder.and_then(|frame| found.get(&frame));
            let overlaps = boxes
                .into_iter()
                .flatten()
                .map(|&other| overlap(one.box_pixels, self.box_pixels(other, sizes)));
            overlaps.fold(0.0, f64::max)
        };
        truth.iter().map(best).sum::<f64>() / truth.len().max(1) as f64
    }

    fn least_gain(self) -> f64 {
        match self {
            Self::FramesOn(_) => LEAST_SHIFT_GAIN,
            _ => LEAST_GAIN,
        }
    }
}

impl fmt::Display for Reading {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::AsTheyAre => "as they are",
            Self::FramesOn(steps) if *steps > 0 => {
                "as those of the frame before their own (count frames from 0)"
            }
            Self::FramesOn(_) => "as those of the frame behind their own (count frames from 0)",
            Self::Corners => "as left, top, right, bottom in place of left, top, width, height",
            Self::Middle => "with their middle in place of left and top",
            Self::Shares => "as shares of the image in place of pixels",
            Self::CornerShares => {
                "as left, top, right, bottom in shares of the image in place of left, top, width, height in pixels"
            }
            Self::MiddleShares => {
                "with their middle in place of left and top, in shares of the image in place of pixels"
            }
            Self::SceneImages => "in pixels of the scene's images, whose size `image_size` must have",
        })
    }
}

/// Sizes of images, width and height in pixels.
pub(super) struct Sizes {
    /// Size of the images of the tracks.
    pub(super) image: [f64; 2],
    /// Size of the images of the scene.
    pub(super) scene: [f64; 2],
}

/// Returns a line on the reading in which found boxes fit true ones much better; `None` without one.
pub(super) fn note(truth: &[Detection], found: &[Detection], sizes: &Sizes) -> Option<String> {
    let mut by_frame: BTreeMap<u32, Vec<[f64; 4]>> = BTreeMap::new();
    for one in found {
        by_frame.entry(one.frame).or_default().push(one.box_pixels);
    }
    let own = Reading::AsTheyAre.fit(truth, &by_frame, sizes);
    let judged = Reading::OTHERS.into_iter().filter_map(|reading| {
        let fit = reading.fit(truth, &by_frame, sizes);
        let tells = fit - own >= reading.least_gain() && 1.0 - fit <= MOST_LEFT * (1.0 - own);
        tells.then_some((reading, fit))
    });
    // The first one of equals.
    let best = judged.reduce(|best, next| if next.1 > best.1 { next } else { best });
    best.map(|(reading, fit)| {
        format!(
            "{DIAGNOSIS_PREFIX}the boxes fit much better {reading} (mean overlap of the true boxes {fit:.2} instead of \
             {own:.2}; scores are of the boxes as they are)"
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZES: Sizes = Sizes {
        image: [320.0, 180.0],
        scene: [640.0, 360.0],
    };

    /// Returns three objects that drive through 20 frames.
    fn drive() -> Vec<Detection> {
        let one = |frame: u32, object: u32| {
            let (at, place) = (f64::from(frame), f64::from(object));
            Detection {
                frame,
                box_pixels: [
                    10.0 + 80.0 * place + 3.0 * at,
                    30.0 + 40.0 * place,
                    30.0,
                    16.0,
                ],
                confidence: 1.0,
                class: "vehicle".to_owned(),
                distance: None,
                position: None,
                track: Some(object),
            }
        };
        (0..20)
            .flat_map(|frame| (0..3).map(move |object| one(frame, object)))
            .collect()
    }

    /// Returns the line on boxes that `change` makes of the true ones.
    fn line(change: impl Fn(&mut Detection)) -> Option<String> {
        let truth = drive();
        let mut found = truth.clone();
        found.iter_mut().for_each(change);
        note(&truth, &found, &SIZES)
    }

    #[test]
    fn every_mistake_is_named() {
        let boxed = |form: fn([f64; 4]) -> [f64; 4]| {
            line(move |one: &mut Detection| one.box_pixels = form(one.box_pixels))
        };
        for (found, expected) in [
            (
                boxed(|[l, t, w, h]| [l, t, l + w, t + h]),
                "left, top, right, bottom in place",
            ),
            (
                boxed(|[l, t, w, h]| [l + w / 2.0, t + h / 2.0, w, h]),
                "their middle in place",
            ),
            (
                boxed(|[l, t, w, h]| [l / 320.0, t / 180.0, w / 320.0, h / 180.0]),
                "as shares of the image",
            ),
            (
                boxed(|[l, t, w, h]| [l / 320.0, t / 180.0, (l + w) / 320.0, (t + h) / 180.0]),
                "right, bottom in shares",
            ),
            (
                boxed(|[l, t, w, h]| {
                    [
                        (l + w / 2.0) / 320.0,
                        (t + h / 2.0) / 180.0,
                        w / 320.0,
                        h / 180.0,
                    ]
                }),
                "left and top, in shares",
            ),
            (
                boxed(|sides| sides.map(|side| 2.0 * side)),
                "pixels of the scene's images",
            ),
            (line(|one| one.frame += 1), "the frame before their own"),
        ] {
            let found = found.unwrap_or_default();
            assert!(found.starts_with(DIAGNOSIS_PREFIX), "{expected}: {found}");
            assert!(found.contains(expected), "{expected}: {found}");
        }
    }

    #[test]
    fn boxes_of_a_tracker_have_no_line() {
        assert_eq!(line(|_| ()), None);
        // Too large, beside their objects, or of half of the frames.
        assert_eq!(line(|one| one.box_pixels[2] *= 1.3), None);
        assert_eq!(line(|one| one.box_pixels[1] += 5.0), None);
        let truth = drive();
        let half: Vec<Detection> = truth
            .iter()
            .filter(|one| one.frame % 2 == 0)
            .cloned()
            .collect();
        assert_eq!(note(&truth, &half, &SIZES), None);
        assert_eq!(note(&truth, &[], &SIZES), None);
        assert_eq!(note(&[], &truth, &SIZES), None);
    }
}
