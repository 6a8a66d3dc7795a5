//! Constants of Omni4DGS as options: the paper gives neither weights nor first values, so that each has the reason
//! for its value here.

use omnilife_engine::{
    gaussians::omni4dgs::{Decomposition, DirectionOrigin, VelocityForm},
    model::dynamic_settings::{DynamicLoss, MotionForm, MotionLoss},
};
use omnilife_training::options::{Constant, MethodOption, Options};

use super::{DYNAMIC_MASK, MOTION_REGULARIZATION, VELOCITY_DECOMPOSITION, VELOCITY_REGULARIZATION};
use crate::dynamic::{CYCLE_FRAMES, TEMPORAL_MOTION, TEMPORAL_OPACITY};

/// Unit of weights of losses.
const OF_PHOTOMETRIC: &str = "of the photometric loss";

/// `gamma`: weights "increase more smoothly in the equatorial region and decay more rapidly in the polar regions",
/// a flat top, so below 1.
const GAMMA_VALUE: f32 = 0.5;
pub(crate) const GAMMA: MethodOption = MethodOption::number(
    (
        "gamma",
        "exponent of the cosine of the latitude in the weights of the two velocities",
    ),
    [0.0, 8.0],
    "0.5",
    Constant {
        unit: "",
        source: "Omni4DGS, Eq. 3",
        component: Some(VELOCITY_DECOMPOSITION),
        is_weight: false,
    },
);
/// Literal: under Adam the two velocities step as one.
pub(crate) const VELOCITY_FORM: MethodOption = MethodOption::form(
    (
        "velocity-form",
        "velocity: the radial part of one vector and the tangential part of another, or literally the weighted \
         sum of two free vectors, which under Adam step as one",
    ),
    &["projected", "literal"],
    "Omni4DGS, Eq. 3",
    VELOCITY_DECOMPOSITION,
);
/// World: a velocity must not depend on the camera.
pub(crate) const VELOCITY_ORIGIN: MethodOption = MethodOption::form(
    (
        "velocity-origin",
        "origin of latitudes and radial directions: the mean camera, or the camera of the view",
    ),
    &["world", "camera"],
    "Omni4DGS, Eq. 3",
    VELOCITY_DECOMPOSITION,
);
/// `theta_dgm`, as PVG separates static from dynamic on Waymo (`separate_scaling_t` 0.2 over the cycle's 0.2),
/// with the staticness `rho = beta / l`. The paper's `beta / tau` is singular at `tau = 0` and changes with the
/// origin of time.
const DYNAMIC_BELOW_STATICNESS: f32 = 1.0;
pub(crate) const DYNAMIC_BELOW: MethodOption = MethodOption::number(
    (
        "dynamic-below",
        "staticness below which a Gaussian is dynamic",
    ),
    [0.01, 100.0],
    "1",
    Constant {
        unit: "cycles of lifespan",
        source: "Omni4DGS, theta_dgm before Eq. 4",
        component: Some(TEMPORAL_OPACITY),
        is_weight: false,
    },
);
/// Cycle of the motion.
pub(crate) const CYCLE: MethodOption = MethodOption::number(
    ("cycle", "length of the cycle in which Gaussians vibrate"),
    [1.0, 1e6],
    "10",
    Constant {
        unit: "frames",
        source: "Omni4DGS, Eq. 1; PVG configs/",
        component: Some(TEMPORAL_MOTION),
        is_weight: false,
    },
);
/// `lambda_dyn`: the dynamic region is small. A weight above that of the photometric loss pulls the dynamic
/// Gaussians away from the image that static and dynamic ones make together.
pub(crate) const DYNAMIC_WEIGHT: f32 = 0.1;
/// [`DYNAMIC_WEIGHT`] as an option.
pub(crate) const DYNAMIC_LOSS: MethodOption = MethodOption::number(
    (
        "dynamic-weight",
        "weight of the loss of the dynamic Gaussians alone",
    ),
    [0.0, 100.0],
    "0.1",
    Constant {
        unit: OF_PHOTOMETRIC,
        source: "Omni4DGS, Eq. 12",
        component: Some(DYNAMIC_MASK),
        is_weight: true,
    },
);
/// `lambda_d`, as `lambda` of 3DGS.
const DYNAMIC_SSIM_WEIGHT: f32 = 0.2;
pub(crate) const DYNAMIC_SSIM: MethodOption = MethodOption::number(
    (
        "dynamic-ssim",
        "share of 1 - SSIM in the loss of the dynamic Gaussians alone",
    ),
    [0.0, 1.0],
    "0.2",
    Constant {
        unit: "",
        source: "Omni4DGS, Eq. 4",
        component: Some(DYNAMIC_MASK),
        is_weight: false,
    },
);
/// `lambda_v`, as PVG on Waymo.
const VELOCITY_WEIGHT: f32 = 0.01;
pub(crate) const VELOCITY_LOSS: MethodOption = MethodOption::number(
    (
        "velocity-weight",
        "weight of the loss on velocities outside the masks",
    ),
    [0.0, 100.0],
    "0.01",
    Constant {
        unit: OF_PHOTOMETRIC,
        source: "Omni4DGS, Eq. 12",
        component: Some(VELOCITY_REGULARIZATION),
        is_weight: true,
    },
);
/// `lambda_m`, as `lambda_v`: a direction that changes by a pixel per frame costs as much as an error of 0.01 in
/// the pixel.
const MOTION_WEIGHT: f32 = 0.01;
pub(crate) const MOTION_LOSS: MethodOption = MethodOption::number(
    (
        "motion-weight",
        "weight of the loss on changes of the directions of static Gaussians",
    ),
    [0.0, 100.0],
    "0.01",
    Constant {
        unit: OF_PHOTOMETRIC,
        source: "Omni4DGS, Eq. 12",
        component: Some(MOTION_REGULARIZATION),
        is_weight: true,
    },
);
/// Sum over the static Gaussians.
pub(crate) const MOTION_FORM: MethodOption = MethodOption::form(
    (
        "motion-form",
        "that loss: each Gaussian in the image, in its pixels, counts as one pixel; or a mean over all, in \
         radians, which is too small to act",
    ),
    &["seen", "mean"],
    "Omni4DGS, Eq. 11",
    MOTION_REGULARIZATION,
);

/// Returns the form of velocities.
pub(super) fn decomposition(options: &Options) -> Decomposition {
    Decomposition {
        gamma: options.number(&GAMMA).unwrap_or(GAMMA_VALUE),
        form: match options.word(&VELOCITY_FORM) {
            Some("literal") => VelocityForm::Literal,
            _ => VelocityForm::Projected,
        },
        origin: match options.word(&VELOCITY_ORIGIN) {
            Some("camera") => DirectionOrigin::Camera,
            _ => DirectionOrigin::World,
        },
    }
}

/// Returns the cycle of motion, frames.
pub(super) fn cycle_frames(options: &Options) -> f32 {
    options.number(&CYCLE).unwrap_or(CYCLE_FRAMES)
}

/// Returns `theta_dgm`.
pub(super) fn dynamic_below_staticness(options: &Options) -> f32 {
    let asked = options.number(&DYNAMIC_BELOW);
    asked.unwrap_or(DYNAMIC_BELOW_STATICNESS)
}

/// Returns the loss of the dynamic Gaussians alone.
pub(super) fn dynamic_loss(options: &Options) -> DynamicLoss {
    let ssim_weight = options.number(&DYNAMIC_SSIM);
    DynamicLoss {
        weight: options.number(&DYNAMIC_LOSS).unwrap_or(DYNAMIC_WEIGHT),
        ssim_weight: ssim_weight.unwrap_or(DYNAMIC_SSIM_WEIGHT),
        begin_iteration: 0,
    }
}

/// Returns `lambda_v`.
pub(super) fn velocity_weight(options: &Options) -> f32 {
    options.number(&VELOCITY_LOSS).unwrap_or(VELOCITY_WEIGHT)
}

/// Returns the loss on the motion of static Gaussians.
pub(super) fn motion_loss(options: &Options) -> MotionLoss {
    MotionLoss {
        weight: options.number(&MOTION_LOSS).unwrap_or(MOTION_WEIGHT),
        form: match options.word(&MOTION_FORM) {
            Some("mean") => MotionForm::Mean,
            _ => MotionForm::Seen,
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_in_the_list_are_those_of_a_run() {
        for (option, usual) in [
            (GAMMA, GAMMA_VALUE),
            (DYNAMIC_BELOW, DYNAMIC_BELOW_STATICNESS),
            (CYCLE, CYCLE_FRAMES),
            (DYNAMIC_LOSS, DYNAMIC_WEIGHT),
            (DYNAMIC_SSIM, DYNAMIC_SSIM_WEIGHT),
            (VELOCITY_LOSS, VELOCITY_WEIGHT),
            (MOTION_LOSS, MOTION_WEIGHT),
        ] {
            assert_eq!(option.default.parse(), Ok(usual), "{}", option.id);
        }
        let none = Options::default();
        assert_eq!(decomposition(&none).form, VelocityForm::Projected);
        assert_eq!(motion_loss(&none).form, MotionForm::Seen);
    }
}
