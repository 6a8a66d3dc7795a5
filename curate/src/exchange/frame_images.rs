//! Images of imported frames: copied byte for byte if every program shows them alike, otherwise rewritten.
//!
//! Transparent pixels become black and ignored. Images are turned by their EXIF orientation, unless the format's program
//! ignores it: poses and masks then refer to the images as stored, which are written without it.

use std::path::Path;

use omnilife_schemas::{
    RgbImage,
    camera::PinholeCamera,
    image_file::{ImageFile, ShownImage},
    layout::FRAMES_FOLDER,
    plain_text,
    rgb::{self, Mask},
    store,
};

use super::{
    ForeignFrame, FramePixels,
    driving::{self, OwnCamera},
};
use crate::{
    error::CurateError,
    poses::lens::Straightening,
    stills::{Colours, Placement, colour_notes},
};

/// The image of a frame in the scene's folder.
pub(super) struct FrameImage {
    /// The file, relative to the folder.
    pub(super) file: String,
    /// Marks pixels without content in the source image: transparent ones, or those outside of its part of the sphere.
    pub(super) ignored: Option<Mask>,
    /// True if the source image is transparent in places.
    pub(super) is_transparent: bool,
    /// True if it was turned or mirrored.
    pub(super) is_turned: bool,
    /// True if it asks to be, and stays as stored.
    pub(super) stays_as_stored: bool,
    /// True if it shows nothing.
    pub(super) is_single_colour: bool,
    /// Colours of the source image.
    pub(super) colours: Colours,
}

impl FrameImage {
    /// Resamples the image of a frame from its camera to that of the scene; what it does not show there is ignored.
    ///
    /// # Errors
    /// When it is damaged, transparent in places, to be turned, or cannot be written.
    pub(super) fn resampled(
        frame: &ForeignFrame,
        name: &str,
        (own, common): (&OwnCamera, &PinholeCamera),
        out: &Path,
    ) -> Result<Self, CurateError> {
        let (image, outside) = driving::resampled(&RgbImage::read(&frame.image)?, own, common);
        let file = format!("{FRAMES_FOLDER}/{name}");
        let path = out.join(&file);
        super::refuse_second(&path)?;
        image.write_png(&path)?;
        Ok(Self {
            file,
            is_transparent: false,
            ignored: outside.marks_anything().then_some(outside),
            is_turned: false,
            stays_as_stored: false,
            is_single_colour: rgb::is_single_colour(&image.to_rgb8()),
            colours: Colours::of(&mut ImageFile::open(&frame.image)?)?,
        })
    }

    /// Copies the image of a frame into the folder of a scene, rewrites it as an opaque RGB PNG, or undistorts it.
    ///
    /// # Errors
    /// When it is damaged, cannot be written, or has a lens and is transparent in places or to be turned.
    pub(super) fn import(
        frame: &ForeignFrame,
        name: &str,
        (straightening, placement, pixels): (
            Option<&Straightening>,
            Option<&Placement>,
            FramePixels,
        ),
        out: &Path,
    ) -> Result<Self, CurateError> {
        let mut source = ImageFile::open(&frame.image)?;
        let colours = Colours::of(&mut source)?;
        let ShownImage {
            size: [mut width, mut height],
            mut rgb,
            mut transparent,
            is_turned: asks_for_turn,
        } = pixels.decoded(source)?;
        let is_turned = asks_for_turn && pixels == FramePixels::Shown;
        let is_transparent = transparent.is_some();
        if let Some(placement) = placement {
            [width, height] = placement.full().map(|side| side as usize);
            let (whole, ignored) = placement.whole(&rgb, transparent.as_ref());
            (rgb, transparent) = (whole, Some(ignored));
        }
        let is_single_colour = rgb::is_single_colour(&rgb);
        let mut file = format!("{FRAMES_FOLDER}/{name}");
        if let Some(lens) = straightening {
            if transparent.is_some() || is_turned {
                let reason = "is transparent in places or to be turned by its EXIF data, and its lens is to be taken \
                              out: give opaque and upright images";
                return Err(CurateError::input(&frame.image, reason));
            }
            let straight = lens.image(&RgbImage::from_rgb8(width, height, &rgb));
            straight.write_png(&out.join(&file))?;
        } else if transparent.is_some() || asks_for_turn {
            file = format!("{FRAMES_FOLDER}/{}.png", super::stem(name));
            let path = out.join(&file);
            super::refuse_second(&path)?;
            rgb::write_rgb8_png(&path, width, height, &rgb)?;
        } else {
            let path = out.join(&file);
            super::refuse_second(&path)?;
            store::copy_atomically(&frame.image, &path)?;
        }
        Ok(Self {
            file,
            is_transparent,
            ignored: transparent,
            is_turned,
            stays_as_stored: asks_for_turn && !is_turned,
            is_single_colour,
            colours,
        })
    }
}

/// Frames whose images needed special treatment.
#[derive(Default)]
pub(super) struct UnusualFrames {
    transparent: Vec<String>,
    turned: Vec<String>,
    as_stored: Vec<String>,
    single_colour: Vec<String>,
    colours: Vec<(String, Colours)>,
}

impl UnusualFrames {
    pub(super) fn add(&mut self, name: &str, image: &FrameImage) {
        for (frames, is_one) in [
            (&mut self.transparent, image.is_transparent),
            (&mut self.turned, image.is_turned),
            (&mut self.as_stored, image.stays_as_stored),
            (&mut self.single_colour, image.is_single_colour),
        ] {
            frames.extend(is_one.then(|| name.to_owned()));
        }
        self.colours.push((name.to_owned(), image.colours));
    }

    /// Returns a line for each kind that occurs.
    pub(super) fn notes(&self) -> Vec<String> {
        let kinds = [
            (
                &self.transparent,
                "are transparent in places, which are ignored regions",
            ),
            (
                &self.turned,
                "were turned or mirrored as their EXIF data ask",
            ),
            (
                &self.as_stored,
                "ask by their EXIF data to be turned or mirrored, and stay as stored, as the format's program reads them",
            ),
            (
                &self.single_colour,
                "are of a single colour and show nothing",
            ),
        ];
        kinds
            .into_iter()
            .filter(|(frames, _)| !frames.is_empty())
            .map(|(frames, what)| {
                format!(
                    "{} frames {what}: {}",
                    frames.len(),
                    plain_text::first_of(frames)
                )
            })
            .chain(colour_notes(&self.colours))
            .collect()
    }
}
