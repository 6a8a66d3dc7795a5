//! Colours of image files that no reader keeps: those of a profile other than sRGB, and the lower half of 16 bits.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use omnilife_schemas::{
    colour_profile::is_srgb, image_file::ImageFile, plain_text, store::StoreError,
};

/// Colours of an image file by its header.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Colours {
    /// True where the file has a colour profile other than sRGB.
    has_other_profile: bool,
    /// True for 16 bits per value.
    is_deep: bool,
}

impl Colours {
    /// Reads them from the header of a file.
    ///
    /// # Errors
    /// When its colour profile cannot be read.
    pub(crate) fn of(file: &mut ImageFile<'_>) -> Result<Self, StoreError> {
        let profile = file.colour_profile()?;
        Ok(Self {
            has_other_profile: profile.is_some_and(|profile| !is_srgb(&profile)),
            is_deep: file.is_deep(),
        })
    }
}

/// Returns a line for each kind of colours that is lost, with the number of frames and the first names.
pub(crate) fn notes(frames: &[(String, Colours)]) -> Vec<String> {
    let line = |is_one: fn(&Colours) -> bool, loss: &str| {
        let of_kind = frames.iter().filter(|(_, colours)| is_one(colours));
        let names: Vec<String> = of_kind.map(|(name, _)| name.clone()).collect();
        let first = plain_text::first_of(&names);
        let frames = plain_text::counted(names.len(), "frame");
        (!names.is_empty()).then(|| format!("{frames} {loss}: {first}"))
    };
    let profiles = line(
        |colours| colours.has_other_profile,
        "with a colour profile other than sRGB, which is not applied",
    );
    let depths = line(
        |colours| colours.is_deep,
        "with 16 bits per value, which are rounded to 8 where they are read",
    );
    profiles.into_iter().chain(depths).collect()
}
