//! COLMAP's models of cameras with a lens (`src/colmap/sensor/models.h`).

use omnilife_schemas::camera::PinholeCamera;

use super::{Distortion, Lens, Projection};

/// A model: focal lengths, principal point and terms, in the order of its parameters.
pub(in crate::poses) struct LensModel {
    /// Name in text files.
    pub(in crate::poses) name: &'static str,
    /// `CameraModelId` in binary files.
    number: i32,
    /// Parameters in all.
    pub(in crate::poses) parameters: usize,
    /// 1 or 2.
    focal_lengths: usize,
    /// Reads the parameters after the principal point.
    distortion: fn(&[f64]) -> Option<Distortion>,
}

const fn model(
    name: &'static str,
    number: i32,
    parameters: usize,
    focal_lengths: usize,
    distortion: fn(&[f64]) -> Option<Distortion>,
) -> LensModel {
    LensModel {
        name,
        number,
        parameters,
        focal_lengths,
        distortion,
    }
}

/// All models with an image plane; the sphere has none.
const MODELS: [LensModel; 17] = [
    model("SIMPLE_PINHOLE", 0, 3, 1, radial),
    model("PINHOLE", 1, 4, 2, radial),
    model("SIMPLE_RADIAL", 2, 4, 1, radial),
    model("RADIAL", 3, 5, 1, radial),
    model("OPENCV", 4, 8, 2, opencv),
    model("OPENCV_FISHEYE", 5, 8, 2, fisheye),
    model("FULL_OPENCV", 6, 12, 2, full_opencv),
    model("FOV", 7, 5, 2, field_of_view),
    model("SIMPLE_RADIAL_FISHEYE", 8, 4, 1, fisheye),
    model("RADIAL_FISHEYE", 9, 5, 1, fisheye),
    model("THIN_PRISM_FISHEYE", 10, 12, 2, thin_prism_fisheye),
    model("RAD_TAN_THIN_PRISM_FISHEYE", 11, 16, 2, sequential_fisheye),
    model("SIMPLE_DIVISION", 12, 4, 1, division),
    model("DIVISION", 13, 5, 2, division),
    model("SIMPLE_FISHEYE", 14, 3, 1, fisheye),
    model("FISHEYE", 15, 4, 2, fisheye),
    model("EUCM", 16, 6, 2, extended_unified),
];

impl LensModel {
    pub(in crate::poses) fn of_name(name: &str) -> Option<&'static Self> {
        MODELS.iter().find(|model| model.name == name)
    }

    pub(in crate::poses) fn of_number(number: i32) -> Option<&'static Self> {
        MODELS.iter().find(|model| model.number == number)
    }

    /// Returns all names, for messages.
    pub(in crate::poses) fn names() -> String {
        MODELS.map(|model| model.name).join(", ")
    }

    /// Returns the lens of a camera; `None` for parameters that do not belong to the model, are not finite, or have a
    /// focal length that is not positive.
    pub(in crate::poses) fn lens(
        &self,
        [width, height]: [u32; 2],
        parameters: &[f64],
    ) -> Option<Lens> {
        let (focal, rest) = parameters.split_at_checked(self.focal_lengths)?;
        let (&[cx, cy], terms) = rest.split_first_chunk::<2>()?;
        let (&fx, &fy) = (focal.first()?, focal.last()?);
        let is_sound = parameters.len() == self.parameters
            && parameters.iter().all(|value| value.is_finite())
            && fx > 0.0
            && fy > 0.0;
        let distortion = (self.distortion)(terms)?;
        is_sound.then_some(Lens {
            camera: PinholeCamera::new([width, height], [fx, fy], [cx, cy]),
            distortion,
        })
    }
}

/// Returns the first terms, 0 for missing ones.
fn first<const N: usize>(terms: &[f64]) -> [f64; N] {
    std::array::from_fn(|at| terms.get(at).copied().unwrap_or(0.0))
}

fn radial(terms: &[f64]) -> Option<Distortion> {
    Some(Distortion {
        radial: first(terms),
        ..Distortion::default()
    })
}

fn fisheye(terms: &[f64]) -> Option<Distortion> {
    Some(Distortion {
        projection: Projection::Equidistant,
        radial: first(terms),
        ..Distortion::default()
    })
}

fn opencv(terms: &[f64]) -> Option<Distortion> {
    let [k1, k2, p1, p2] = first(terms);
    Some(Distortion {
        radial: first(&[k1, k2]),
        tangential: [p1, p2],
        ..Distortion::default()
    })
}

fn full_opencv(terms: &[f64]) -> Option<Distortion> {
    let [k1, k2, p1, p2, k3, k4, k5, k6] = first(terms);
    Some(Distortion {
        radial: first(&[k1, k2, k3]),
        divisor: [k4, k5, k6],
        tangential: [p1, p2],
        ..Distortion::default()
    })
}

fn field_of_view(terms: &[f64]) -> Option<Distortion> {
    let &[omega] = terms else { return None };
    // COLMAP's own limit for a perspective image.
    let is_perspective = omega.abs() < 1e-9;
    (0.0..std::f64::consts::PI)
        .contains(&omega)
        .then(|| Distortion {
            projection: if is_perspective {
                Projection::Perspective
            } else {
                Projection::FieldOfView { omega }
            },
            ..Distortion::default()
        })
}

fn thin_prism_fisheye(terms: &[f64]) -> Option<Distortion> {
    let [k1, k2, p1, p2, k3, k4, sx1, sy1] = first(terms);
    Some(Distortion {
        projection: Projection::Equidistant,
        radial: first(&[k1, k2, k3, k4]),
        tangential: [p1, p2],
        prism: [sx1, 0.0, sy1, 0.0],
        ..Distortion::default()
    })
}

fn sequential_fisheye(terms: &[f64]) -> Option<Distortion> {
    let [k1, k2, k3, k4, k5, k6, p0, p1, s0, s1, s2, s3] = first(terms);
    Some(Distortion {
        projection: Projection::Equidistant,
        radial: [k1, k2, k3, k4, k5, k6],
        // In reverse order of the other models.
        tangential: [p1, p0],
        prism: [s0, s1, s2, s3],
        is_sequential: true,
        ..Distortion::default()
    })
}

fn division(terms: &[f64]) -> Option<Distortion> {
    let &[k] = terms else { return None };
    Some(Distortion {
        projection: Projection::Division { k },
        ..Distortion::default()
    })
}

fn extended_unified(terms: &[f64]) -> Option<Distortion> {
    let &[alpha, beta] = terms else { return None };
    let is_sound = (0.0..=1.0).contains(&alpha) && beta > 0.0;
    is_sound.then(|| Distortion {
        projection: Projection::ExtendedUnified { alpha, beta },
        ..Distortion::default()
    })
}
