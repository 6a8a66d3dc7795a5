//! Layouts of a sphere in the frames of a video, other than one equirectangular image.

use std::{fmt, str::FromStr};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A way to store the sphere; as text `stereo-top-bottom`, `stereo-left-right`, `half-erp`, `half-erp-left-right`,
/// `half-erp-top-bottom`, `eac`, `cubemap-COLUMNSxROWS:FACES` or `dual-fisheye:DEGREES`, with circles `dual-fisheye:DEGREES@X,Y,RADIUS;X,Y,RADIUS`.
///
/// Faces and halves lie as `FFmpeg`'s filter `v360` has them (`libavfilter/vf_v360.c`).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(try_from = "String", into = "String")]
#[schemars(with = "String")]
pub enum SphereLayout {
    /// An equirectangular image per eye, the left eye's above the right eye's.
    StereoTopBottom,
    /// An equirectangular image per eye, the left eye's beside the right eye's.
    StereoLeftRight,
    /// The half of the sphere ahead, equirectangular: half a turn of longitude across.
    HalfErp,
    /// The same per eye, the left eye's on the left (VR180).
    HalfErpLeftRight,
    /// The same per eye, the left eye's on top.
    HalfErpTopBottom,
    /// Six faces in three columns and two rows whose pixels have equal angles, as `YouTube` stores them: left,
    /// front and right above down, back and up, which are turned so that neighbours fit.
    EquiangularCubemap,
    /// Six faces of perspective images.
    Cubemap {
        /// Three, six or one; 6 / columns rows.
        columns: u8,
        /// Which face lies where, by rows.
        faces: FaceOrder,
    },
    /// The circles of two lenses back to back, side by side: that of the camera's back on the left, that of its
    /// front on the right. Distances from a circle's middle are proportional to the angle.
    DualFisheye {
        /// Angle that a circle shows from edge to edge, 180 to 300 degrees.
        field_of_view_degrees: f64,
        /// The left circle and the right one.
        circles: [FisheyeCircle; 2],
    },
}

impl SphereLayout {
    /// Returns the width in pixels of the equirectangular image with the horizontal resolution of a frame of `width` x
    /// `height` pixels at the horizon.
    pub fn erp_width(self, (width, height): (u32, u32)) -> u32 {
        match self {
            Self::StereoTopBottom => width,
            Self::StereoLeftRight => width / 2,
            Self::HalfErp | Self::HalfErpTopBottom => 2 * width,
            Self::HalfErpLeftRight => width,
            Self::EquiangularCubemap => width / 3 * 4,
            Self::Cubemap { columns, .. } => width / u32::from(columns.max(1)) * 4,
            Self::DualFisheye {
                field_of_view_degrees,
                circles,
            } => {
                let radius = circles.iter().fold(0.0, |sum, circle| sum + circle.radius) / 2.0;
                let diameter = 2.0 * radius * f64::from(height.min(width / 2));
                (diameter * 360.0 / field_of_view_degrees) as u32
            }
        }
    }
}

/// Circle of a lens in its half of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FisheyeCircle {
    /// Its centre, shares of the half's width and height from the half's corner.
    pub centre: [f64; 2],
    /// Its radius, share of the half's width across and of its height down.
    pub radius: f64,
}

impl FisheyeCircle {
    /// Largest circle in the half.
    pub const WHOLE: Self = Self {
        centre: [0.5, 0.5],
        radius: 0.5,
    };
}

impl FromStr for FisheyeCircle {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Option<Vec<f64>> = text.split(',').map(|word| word.parse().ok()).collect();
        let numbers = numbers.and_then(|numbers| <[f64; 3]>::try_from(numbers).ok());
        numbers
            .filter(|[x, y, radius]| {
                let is_inside = |value: &f64| (0.0..=1.0).contains(value);
                is_inside(x) && is_inside(y) && (0.1..=1.0).contains(radius)
            })
            .map(|[x, y, radius]| Self {
                centre: [x, y],
                radius,
            })
            .ok_or_else(|| {
                format!("{text}: a circle is X,Y,RADIUS in shares of its half of the frame")
            })
    }
}

impl fmt::Display for FisheyeCircle {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y] = self.centre;
        write!(formatter, "{x},{y},{}", self.radius)
    }
}

/// Order of six faces, a permutation of the letters r, l, u, d, f and b.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FaceOrder([u8; 6]);

/// Letters of `v360`, in the order of [`CUBE_FACES`](crate::camera::cube::CUBE_FACES): front, right, back, left, up,
/// down.
const FACE_LETTERS: [u8; 6] = *b"frblud";

impl FaceOrder {
    /// Order of `v360`: right, left, up, down, front, back.
    pub const STANDARD: Self = Self(*b"rludfb");

    /// Returns the position in the order, 0 to 5, of a face of [`CUBE_FACES`](crate::camera::cube::CUBE_FACES).
    pub fn position(&self, face: usize) -> usize {
        let letter = FACE_LETTERS.get(face);
        let found = self.0.iter().position(|other| Some(other) == letter);
        found.unwrap_or_default()
    }
}

impl FromStr for FaceOrder {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let order = <[u8; 6]>::try_from(text.as_bytes()).ok();
        order
            .filter(|order| FACE_LETTERS.iter().all(|letter| order.contains(letter)))
            .map(Self)
            .ok_or_else(|| {
                format!(
                    "{text}: must name each of the faces r, l, u, d, f and b once (rludfb is usual)"
                )
            })
    }
}

impl fmt::Display for FaceOrder {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let letters = self.0.iter().map(|&letter| char::from(letter));
        formatter.write_str(&letters.collect::<String>())
    }
}

/// Reads the text behind `dual-fisheye:`.
fn dual_fisheye(detail: &str) -> Result<SphereLayout, String> {
    let (degrees, circles) = match detail.split_once('@') {
        None => (detail, [FisheyeCircle::WHOLE; 2]),
        Some((degrees, circles)) => {
            let (left, right) = circles.split_once(';').ok_or_else(|| {
                format!("{circles}: expected the left circle and the right one, divided by ;")
            })?;
            (degrees, [left.parse()?, right.parse()?])
        }
    };
    let field_of_view_degrees = degrees.parse().ok();
    let field_of_view_degrees = field_of_view_degrees
        .filter(|degrees| (180.0..=300.0).contains(degrees))
        .ok_or_else(|| {
            format!("{degrees}: a circle shows 180 to 300 degrees; with less a part of the sphere is missing")
        })?;
    Ok(SphereLayout::DualFisheye {
        field_of_view_degrees,
        circles,
    })
}

impl SphereLayout {
    /// Name of every layout without its details.
    pub const NAMES: [&'static str; 10] = [
        "stereo-top-bottom",
        "stereo-left-right",
        "half-erp",
        "half-erp-left-right",
        "half-erp-top-bottom",
        "eac",
        "cubemap-3x2",
        "cubemap-6x1",
        "cubemap-1x6",
        "dual-fisheye",
    ];
}

impl FromStr for SphereLayout {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (name, detail) = match text.split_once(':') {
            Some((name, detail)) => (name, Some(detail)),
            None => (text, None),
        };
        let cubemap = |columns| {
            let faces = detail.map_or(Ok(FaceOrder::STANDARD), str::parse)?;
            Ok(Self::Cubemap { columns, faces })
        };
        let layout = match name {
            "cubemap-3x2" => return cubemap(3),
            "cubemap-6x1" => return cubemap(6),
            "cubemap-1x6" => return cubemap(1),
            "dual-fisheye" => {
                return dual_fisheye(detail.ok_or_else(|| {
                    format!("{text} needs the lenses' field of view in degrees: {text}:190")
                })?);
            }
            "stereo-top-bottom" => Self::StereoTopBottom,
            "stereo-left-right" => Self::StereoLeftRight,
            "half-erp" => Self::HalfErp,
            "half-erp-left-right" => Self::HalfErpLeftRight,
            "half-erp-top-bottom" => Self::HalfErpTopBottom,
            "eac" => Self::EquiangularCubemap,
            _ => {
                return Err(format!(
                    "{text}: must be a layout of the sphere, one of {}",
                    Self::NAMES.join(", ")
                ));
            }
        };
        match detail {
            None => Ok(layout),
            Some(detail) => Err(format!(
                "{name} has no detail, and {detail} stands behind it"
            )),
        }
    }
}

impl fmt::Display for SphereLayout {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::StereoTopBottom => formatter.write_str("stereo-top-bottom"),
            Self::StereoLeftRight => formatter.write_str("stereo-left-right"),
            Self::HalfErp => formatter.write_str("half-erp"),
            Self::HalfErpLeftRight => formatter.write_str("half-erp-left-right"),
            Self::HalfErpTopBottom => formatter.write_str("half-erp-top-bottom"),
            Self::EquiangularCubemap => formatter.write_str("eac"),
            Self::Cubemap { columns, faces } => {
                let rows = 6 / (*columns).max(1);
                write!(formatter, "cubemap-{columns}x{rows}:{faces}")
            }
            Self::DualFisheye {
                field_of_view_degrees,
                circles: [left, right],
            } => {
                write!(formatter, "dual-fisheye:{field_of_view_degrees}")?;
                if [left, right] == [&FisheyeCircle::WHOLE; 2] {
                    return Ok(());
                }
                write!(formatter, "@{left};{right}")
            }
        }
    }
}

impl TryFrom<String> for SphereLayout {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<SphereLayout> for String {
    fn from(layout: SphereLayout) -> Self {
        layout.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layouts_are_read_as_they_are_written() {
        let circles = "dual-fisheye:203.5@0.5,0.49,0.48;0.51,0.5,0.47";
        let names = SphereLayout::NAMES.map(|name| match name {
            "dual-fisheye" => "dual-fisheye:190",
            name => name,
        });
        for name in names.into_iter().chain([circles]) {
            let layout: Result<SphereLayout, String> = name.parse();
            let text = layout.as_ref().map(ToString::to_string);
            assert!(
                text.as_ref().is_ok_and(|text| text.starts_with(name)),
                "{name}"
            );
            let again: Option<SphereLayout> = text.ok().and_then(|text| text.parse().ok());
            assert_eq!(again, layout.ok());
        }
        let turned: Result<SphereLayout, String> = "cubemap-6x1:frblud".parse();
        assert_eq!(
            turned.map(|layout| layout.to_string()),
            Ok("cubemap-6x1:frblud".to_owned())
        );
    }

    #[test]
    fn what_is_no_layout_is_refused() {
        for text in [
            "",
            "erp",
            "eac:3",
            "cubemap-3x2:rrrrrr",
            "cubemap-3x2:rludf",
            "cubemap-2x3",
            "dual-fisheye",
            "dual-fisheye:170",
            "dual-fisheye:190@0.5,0.5,0.5",
            "dual-fisheye:190@0.5,0.5,0.5;0.5,0.5",
            "dual-fisheye:190@0.5,0.5,0.5;0.5,2,0.5",
            "dual-fisheye:NaN",
            "dual-fisheye:wide",
            "stereo-top-bottom:",
        ] {
            assert!(text.parse::<SphereLayout>().is_err(), "{text}");
        }
    }

    #[test]
    fn faces_lie_where_their_letters_stand() {
        // Front, right, back, left, up, down.
        let positions = [0, 1, 2, 3, 4, 5].map(|face| FaceOrder::STANDARD.position(face));
        assert_eq!(positions, [4, 0, 5, 1, 2, 3]);
    }
}
