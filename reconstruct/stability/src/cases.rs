//! The catalogue: difficult cases for rendering and its gradient.

use crate::{
    Limits,
    case_setups::{
        at_the_camera, beside_the_pinhole, camera_inside, discs, extreme_scales, in_world, layers,
        many_tiles, near_limit, needles, non_finite, poles, quaternions, saturated, seam,
        shifted_out, sized,
    },
    in_time,
    parameterizations::TimeDependence,
    setup::{Setup, mild},
};
use omnilife_engine::render::settings::Footprint;

/// A case.
#[derive(Debug, Clone, Copy)]
pub struct Case {
    /// Id, unique among all cases.
    pub id: &'static str,
    /// Title in words.
    pub title: &'static str,
    /// Handling in the code, in words; empty where none is needed.
    pub action: &'static str,
    /// Parameterizations of the case.
    pub about: &'static [TimeDependence],
    /// Setup of the case.
    pub setup: fn() -> Setup,
    /// Expected result.
    pub expectation: Expectation,
    /// Limits of the errors.
    pub limits: Limits,
}

/// Expected result of a case.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Expectation {
    /// Image and gradient are those of the reference.
    Agrees,
    /// The image is that of the reference; the gradient is not defined there, and finite.
    ImageAgrees,
    /// The last Gaussians are left out, and the image is to the last bit the one without them.
    LeavesOut {
        /// Number of degenerate Gaussians.
        degenerate: usize,
    },
}

impl Expectation {
    /// Returns the limits that were kept, in words.
    pub(super) fn in_words(self, limits: &Limits) -> String {
        match self {
            Self::Agrees => format!(
                "image within {:.0e}, gradient within {:.0e}",
                limits.forward, limits.gradient
            ),
            Self::ImageAgrees => format!(
                "image within {:.0e}, gradient finite: it is not defined here",
                limits.forward
            ),
            Self::LeavesOut { .. } => "the image is the one without them, bit by bit".to_owned(),
        }
    }
}

/// Several times the largest error of the cases that share them, on the CPU and on a software adapter alike.
pub(super) const PLAIN_LIMITS: Limits = Limits {
    forward: 1e-5,
    gradient: 4e-4,
};

/// Returns the plain limits with another limit for gradients that are sums of large terms of both signs.
const fn with_gradient(gradient: f64) -> Limits {
    Limits {
        gradient,
        ..PLAIN_LIMITS
    }
}

pub(super) const PLAIN: Case = Case {
    id: "",
    title: "",
    action: "",
    about: &[
        TimeDependence::Still,
        TimeDependence::Deformed,
        TimeDependence::Moving,
    ],
    setup: || Setup::new(mild()),
    expectation: Expectation::Agrees,
    limits: PLAIN_LIMITS,
};

/// Returns all cases that are rendered.
pub fn all() -> impl Iterator<Item = &'static Case> {
    CASES.iter().chain(in_time::CASES)
}

/// Ten thousand layers add up ten thousand roundings.
pub(super) const LAYERED: Limits = Limits {
    forward: 4e-4,
    gradient: 6e-3,
};

/// Cases without time.
const CASES: &[Case] = &[
    Case {
        id: "mild",
        title: "nothing difficult, for comparison",
        ..PLAIN
    },
    Case {
        id: "poles",
        title: "on both poles, over them, and 1e-6 rad beside them",
        action: "footprints near a pole are cones on the tangent plane",
        setup: poles,
        ..PLAIN
    },
    Case {
        id: "seam",
        title: "across the seam, also at the poles",
        action: "columns wrap",
        setup: seam,
        ..PLAIN
    },
    Case {
        id: "camera-inside",
        title: "the camera stands inside a Gaussian, projected footprint",
        action: "a Gaussian longer than its distance is left out",
        setup: || camera_inside(Footprint::Projected),
        ..PLAIN
    },
    Case {
        id: "camera-inside-ray",
        title: "the camera stands inside a Gaussian, footprint along the ray",
        action: "drawn in every pixel",
        setup: || camera_inside(Footprint::Ray),
        limits: with_gradient(2e-3),
        ..PLAIN
    },
    Case {
        id: "needle-1e6",
        title: "needles a million times as long as thick",
        action: "determinants by Lagrange's identity, without cancellation",
        setup: || needles(1e6),
        ..PLAIN
    },
    Case {
        id: "disc-1e6",
        title: "discs a million times as wide as thick, seen from the edge too",
        setup: || discs(1e6),
        ..PLAIN
    },
    Case {
        id: "poles-ray",
        title: "on both poles and beside them, footprint along the ray",
        setup: || poles().with_footprint(Footprint::Ray),
        ..PLAIN
    },
    Case {
        id: "needle-ray",
        title: "needles a thousand times as long as thick, footprint along the ray",
        setup: || needles(1e3).with_footprint(Footprint::Ray),
        ..PLAIN
    },
    Case {
        id: "disc-ray",
        title: "discs a thousand times as wide as thick, seen from the edge too, footprint along the ray",
        setup: || discs(1e3).with_footprint(Footprint::Ray),
        ..PLAIN
    },
    Case {
        id: "pinhole",
        title: "through a pinhole of 100 degrees, most of it behind the camera",
        action: "what is behind is left out",
        setup: || Setup::straight(mild()).through(100.0, [0.0; 2]),
        ..PLAIN
    },
    Case {
        id: "pinhole-wide",
        title: "through a pinhole of 170 degrees",
        setup: || Setup::straight(mild()).through(170.0, [0.0; 2]),
        ..PLAIN
    },
    Case {
        id: "pinhole-off-axis",
        title: "through a pinhole whose principal point is outside of the image",
        setup: || Setup::straight(mild()).through(100.0, [30.0, 5.0]),
        ..PLAIN
    },
    Case {
        id: "pinhole-needle",
        title: "needles a million times as long as thick through a pinhole",
        setup: || needles(1e6).through(120.0, [0.0; 2]),
        ..PLAIN
    },
    Case {
        id: "pinhole-beside",
        title: "in and beside the plane of a pinhole's centre",
        action: "nearer than the nearest depth are left out",
        setup: beside_the_pinhole,
        ..PLAIN
    },
    Case {
        id: "many-tiles",
        title: "an image of 12 times 6 tiles",
        setup: many_tiles,
        ..PLAIN
    },
    Case {
        id: "dust",
        title: "a millionth of a pixel in size",
        action: "widened to a pixel by the low-pass filter",
        setup: || sized(1e-6),
        ..PLAIN
    },
    Case {
        id: "wide",
        title: "standard deviations of 90 % of the distance",
        action: "footprints too wide for the image's plane are cones",
        setup: || sized(0.9),
        ..PLAIN
    },
    Case {
        id: "near-limit",
        title: "a millionth before and behind the nearest distance that is drawn",
        action: "nearer ones are left out",
        setup: near_limit,
        ..PLAIN
    },
    Case {
        id: "far",
        title: "1e5 units away",
        setup: || shifted_out(1e5),
        limits: with_gradient(8e-4),
        ..PLAIN
    },
    Case {
        id: "layers-10000",
        title: "10,000 translucent layers in one direction",
        action: "compositing ends at a transmittance of 1e-4",
        setup: || layers(10_000),
        limits: LAYERED,
        ..PLAIN
    },
    Case {
        id: "scene-1e-6",
        title: "a scene a micrometre across",
        action: "normalized in f64 on loading",
        setup: || in_world([0.0; 3], 1e6),
        ..PLAIN
    },
    Case {
        id: "scene-1e6",
        title: "a scene a thousand kilometres across",
        action: "normalized in f64 on loading",
        setup: || in_world([0.0; 3], 1e-6),
        ..PLAIN
    },
    Case {
        id: "origin-1e6",
        title: "a scene 1e6 m from the world's origin",
        action: "normalized in f64 on loading",
        setup: || in_world([1e6, -1e6, 1e6], 1.0),
        ..PLAIN
    },
    Case {
        id: "zero-quaternion",
        title: "quaternions of length zero",
        action: "length floored at 1e-12: the identity",
        setup: || quaternions([0.0; 4]),
        expectation: Expectation::ImageAgrees,
        ..PLAIN
    },
    Case {
        id: "tiny-quaternion",
        title: "quaternions of length 1e-9",
        setup: || quaternions([0.8e-9, 0.3e-9, -0.4e-9, 0.33e-9]),
        ..PLAIN
    },
    Case {
        id: "saturated-opacity",
        title: "logits of opacity of -100, -20, 20 and 100",
        action: "opacity clamped to 0.99 in a pixel; the gradient ignores the clamp",
        setup: saturated,
        ..PLAIN
    },
    Case {
        id: "extreme-scale",
        title: "logarithms of scales of -100 and 100",
        action: "clamped to [-30, 20]",
        setup: extreme_scales,
        ..PLAIN
    },
    Case {
        id: "non-finite",
        title: "parameters that are NaN or infinite",
        action: "left out; their own gradients are refused by Adam",
        setup: non_finite,
        expectation: Expectation::LeavesOut { degenerate: 4 },
        ..PLAIN
    },
    Case {
        id: "at-the-camera",
        title: "a Gaussian exactly where the camera is",
        action: "left out",
        setup: at_the_camera,
        // A network would move it away.
        about: &[TimeDependence::Still, TimeDependence::Moving],
        expectation: Expectation::LeavesOut { degenerate: 1 },
        limits: PLAIN_LIMITS,
    },
];

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::special;

    #[test]
    fn ids_are_unique_and_titles_say_something() {
        let rendered = all().map(|case| (case.id, case.title));
        let special = special::all().map(|case| (case.id, case.title));
        let all: Vec<_> = rendered.chain(special).collect();
        let ids: BTreeSet<_> = all.iter().map(|(id, _)| id).collect();
        assert_eq!(ids.len(), all.len());
        assert!(
            all.iter()
                .all(|(id, title)| !id.is_empty() && title.len() > 10)
        );
    }
}
