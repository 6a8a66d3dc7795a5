//! Kinds of finding, each with its line.

use std::fmt;

use super::{border::Border, distances::DistanceMistake, encoding::Encoding, order::FrameOrder};

/// A mistake of convention, or a fact about views that the method did not cause.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum DiagnosisKind {
    /// The views fit better rotated.
    Turned {
        /// With their columns in reverse.
        is_mirrored: bool,
        /// With their rows in reverse.
        is_upside_down: bool,
        /// Then moved to the right by this angle, degrees in (-180, 180].
        degrees_right: f64,
    },
    /// The views lie beside the ground truth.
    Shifted {
        /// Half pixels to the right.
        right: i32,
        /// Half pixels down.
        down: i32,
    },
    /// The channels are stored in another order.
    Channels(ChannelOrder),
    /// The values have another encoding or range.
    Encoded(Encoding),
    /// The files state other colours than sRGB, which nothing applies.
    OtherColours {
        /// Number of such files.
        files: usize,
        /// Number of examined views.
        views: usize,
    },
    /// Values of arrays lie outside of [0, 1] and are cut.
    OutsideRange {
        /// Share of the values below -0.02 or above 1.02.
        share: f64,
    },
    /// The views show other frames than their names state.
    Order(FrameOrder),
    /// The files are named by the index among the views instead of the frame, counted from this number.
    NamedByPlace {
        /// 0 or 1.
        first: u32,
    },
    /// Every pixel is doubled in both directions: the views were enlarged from half the size.
    DoubledPixels,
    /// Predicted distances have another unit, or are inverse ones.
    Distances(DistanceMistake),
    /// Pixels with a true distance have no predicted one.
    DistancesMissing {
        /// Their share of the pixels with a true distance, the mean over views.
        share: f64,
    },
    /// All views have the same border of a single colour on opposite sides.
    Bordered(Border),
    /// All views are one image, byte for byte.
    OneImage,
    /// Views are copies of given views, as in baselines.
    CopiesOfGivenViews {
        /// Number of copies.
        copies: usize,
        /// Number of examined views.
        views: usize,
    },
    /// Novel frames of the data are the same image as a given frame.
    RepeatedFrames {
        /// Novel frames that equal it byte for byte.
        identical: usize,
        /// Novel frames that nearly equal it.
        similar: usize,
        /// Number of examined novel frames.
        frames: usize,
    },
}

impl DiagnosisKind {
    /// Returns true if predictions must be corrected.
    pub fn is_mistake(self) -> bool {
        !matches!(
            self,
            Self::CopiesOfGivenViews { .. }
                | Self::RepeatedFrames { .. }
                | Self::DistancesMissing { .. }
        )
    }
}

impl fmt::Display for DiagnosisKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Turned {
                is_mirrored,
                is_upside_down,
                degrees_right,
            } => write!(
                f,
                "views fit better {}; render them with the axes of the scene's camera (x right, y \
                 down, z forward; columns from left to right)",
                turn(is_mirrored, is_upside_down, degrees_right)
            ),
            Self::Shifted { right, down } => write!(
                f,
                "views are shifted {} against the ground truth; pixel centres are at half-integers (column + 0.5), \
                 and a panorama of W columns has W steps, not W - 1",
                shift(right, down)
            ),
            Self::Channels(order) => write!(
                f,
                "channels are stored as {}; write them as RGB",
                order.name()
            ),
            Self::Encoded(encoding) => write!(f, "values are {encoding}"),
            Self::OtherColours { files, views } => write!(
                f,
                "{files} of {views} files state other colours than sRGB, by a profile or a gamma, which nothing \
                 applies; write sRGB values without a profile"
            ),
            Self::OutsideRange { share } => write!(
                f,
                "{:.0} % of the values of arrays lie outside of [0, 1] and are cut; write \
                 values in [0, 1], without any normalization of a network's output",
                100.0 * share
            ),
            Self::Order(order) => write!(f, "{order}"),
            Self::NamedByPlace { first } => write!(
                f,
                "files are numbered from {first} by their place among the views; name them by the \
                 frame numbers of the split"
            ),
            Self::DoubledPixels => f.write_str(
                "every pixel stands twice in both directions, as enlarged from half the size; render \
                 at the scored size or enlarge with interpolation",
            ),
            Self::Distances(mistake) => write!(f, "{mistake}"),
            Self::DistancesMissing { share } => write!(
                f,
                "{:.2} % of the pixels with a true distance have no predicted one (0, negative, or not finite), and \
                 count as wholly wrong",
                100.0 * share
            ),
            Self::Bordered(border) => write!(
                f,
                "a border of a single colour is around the views ({border}); render the whole image at the scored size, \
                 without cropping or padding"
            ),
            Self::OneImage => f.write_str(
                "all views are one image, byte for byte, though the ground truth differs; render every \
                 view with its own pose and time",
            ),
            Self::CopiesOfGivenViews { copies, views } => write!(
                f,
                "{copies} of {views} compared are copies of input views"
            ),
            Self::RepeatedFrames {
                identical,
                similar,
                frames,
            } => write!(
                f,
                "{} of {frames} novel frames that were looked at are the same image as a given frame \
                 ({identical} byte for byte): this is of the data, not of the method, and what is given \
                 scores there",
                identical + similar
            ),
        }
    }
}

/// Describes the change that makes rotated views fit.
fn turn(is_mirrored: bool, is_upside_down: bool, degrees_right: f64) -> String {
    let mut parts = Vec::new();
    if is_mirrored {
        parts.push("mirrored".to_owned());
    }
    if is_upside_down {
        parts.push("turned upside down".to_owned());
    }
    if degrees_right.abs() >= 0.05 {
        let direction = if degrees_right > 0.0 { "right" } else { "left" };
        let degrees = degrees_right.abs();
        parts.push(format!("moved by {degrees:.1} degrees to the {direction}"));
    }
    parts.join(", ")
}

/// Returns a shift of half pixels in words.
fn shift(right: i32, down: i32) -> String {
    let of = |half_pixels: i32, [forward, back]: [&str; 2]| {
        let direction = if half_pixels > 0 { forward } else { back };
        let pixels = 0.5 * f64::from(half_pixels.abs());
        let unit = if pixels > 1.0 { "pixels" } else { "pixel" };
        (half_pixels != 0).then(|| format!("{pixels} {unit} {direction}"))
    };
    let parts = [
        of(right, ["to the right", "to the left"]),
        of(down, ["down", "up"]),
    ];
    parts
        .into_iter()
        .flatten()
        .collect::<Vec<_>>()
        .join(" and ")
}

/// An order of stored channels other than RGB.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ChannelOrder {
    /// Blue, green, red: that of `OpenCV`.
    Bgr,
    /// Red, blue, green.
    Rbg,
    /// Green, red, blue.
    Grb,
    /// Green, blue, red.
    Gbr,
    /// Blue, red, green.
    Brg,
}

impl ChannelOrder {
    pub(super) const ALL: [Self; 5] = [Self::Bgr, Self::Rbg, Self::Grb, Self::Gbr, Self::Brg];

    /// Its three letters.
    pub fn name(self) -> &'static str {
        match self {
            Self::Bgr => "BGR",
            Self::Rbg => "RBG",
            Self::Grb => "GRB",
            Self::Gbr => "GBR",
            Self::Brg => "BRG",
        }
    }

    /// Returns the places in which red, green and blue are stored.
    pub(super) fn places(self) -> [usize; 3] {
        match self {
            Self::Bgr => [2, 1, 0],
            Self::Rbg => [0, 2, 1],
            Self::Grb => [1, 0, 2],
            Self::Gbr => [2, 0, 1],
            Self::Brg => [1, 2, 0],
        }
    }
}
