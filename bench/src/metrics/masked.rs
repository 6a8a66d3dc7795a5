//! PSNR and SSIM of a part of the image: static content, moving content, the objects of a class.

use omnilife_schemas::{records::Direction, rgb::Mask};

use super::{Metric, Need, Sample, Undefined, decibels};

/// People, the class of `psnr-human`.
const HUMAN: &str = "human";
/// Cars and other vehicles, the class of `psnr-vehicle`.
const VEHICLE: &str = "vehicle";

const PSNR_SOURCE: &str = "-10 log10(MSE), MSE over the channels of the pixels inside the mask \
                           alone (images multiplied with a mask would count the black rest as \
                           right), 8-bit images in [0, 1], MSE floored at 1e-10; undefined where \
                           no pixel is inside";
const SSIM_SOURCE: &str = "mean of the map of ssim, which is computed on the whole images, over \
                           channels and the pixels inside the mask; undefined where no pixel is \
                           inside";

pub(super) const PSNR_STATIC: Metric = psnr(
    "psnr-static",
    "PSNR (static)",
    &[Need::DynamicMask],
    |sample| masked_psnr(sample, outside(sample.dynamic()?)),
);
pub(super) const SSIM_STATIC: Metric = ssim(
    "ssim-static",
    "SSIM (static)",
    &[Need::DynamicMask],
    |sample| masked_ssim(sample, outside(sample.dynamic()?)),
);
pub(super) const PSNR_DYNAMIC: Metric = psnr(
    "psnr-dynamic",
    "PSNR (dynamic)",
    &[Need::DynamicMask],
    |sample| masked_psnr(sample, inside(sample.dynamic()?)),
);
pub(super) const SSIM_DYNAMIC: Metric = ssim(
    "ssim-dynamic",
    "SSIM (dynamic)",
    &[Need::DynamicMask],
    |sample| masked_ssim(sample, inside(sample.dynamic()?)),
);
pub(super) const PSNR_HUMAN: Metric = psnr(
    "psnr-human",
    "PSNR (human)",
    &[Need::ClassMask(HUMAN)],
    |sample| masked_psnr(sample, inside(sample.class(HUMAN)?)),
);
pub(super) const SSIM_HUMAN: Metric = ssim(
    "ssim-human",
    "SSIM (human)",
    &[Need::ClassMask(HUMAN)],
    |sample| masked_ssim(sample, inside(sample.class(HUMAN)?)),
);
pub(super) const PSNR_VEHICLE: Metric = psnr(
    "psnr-vehicle",
    "PSNR (vehicle)",
    &[Need::ClassMask(VEHICLE)],
    |sample| masked_psnr(sample, inside(sample.class(VEHICLE)?)),
);
pub(super) const SSIM_VEHICLE: Metric = ssim(
    "ssim-vehicle",
    "SSIM (vehicle)",
    &[Need::ClassMask(VEHICLE)],
    |sample| masked_ssim(sample, inside(sample.class(VEHICLE)?)),
);

const fn psnr(
    id: &'static str,
    title: &'static str,
    needs: &'static [Need],
    function: super::Function,
) -> Metric {
    Metric {
        id,
        title,
        unit: "dB",
        direction: Some(Direction::HigherIsBetter),
        range: [0.0, 100.0],
        source: PSNR_SOURCE,
        needs,
        function,
    }
}

const fn ssim(
    id: &'static str,
    title: &'static str,
    needs: &'static [Need],
    function: super::Function,
) -> Metric {
    Metric {
        id,
        title,
        unit: "",
        direction: Some(Direction::HigherIsBetter),
        range: [-1.0, 1.0],
        source: SSIM_SOURCE,
        needs,
        function,
    }
}

const EMPTY: Undefined = Undefined("no pixel is inside the mask");

fn inside(mask: &Mask) -> impl Iterator<Item = bool> {
    mask.data.iter().map(|&value| value != 0)
}

fn outside(mask: &Mask) -> impl Iterator<Item = bool> {
    mask.data.iter().map(|&value| value == 0)
}

fn masked_psnr(
    sample: &Sample<'_>,
    is_inside: impl Iterator<Item = bool>,
) -> Result<f64, Undefined> {
    match sample.pair.squared_errors_inside(is_inside) {
        (_, 0) => Err(EMPTY),
        (sum, pixels) => Ok(decibels(sum as f64 / ((3 * pixels) as f64 * 255.0 * 255.0))),
    }
}

fn masked_ssim(
    sample: &Sample<'_>,
    is_inside: impl Iterator<Item = bool>,
) -> Result<f64, Undefined> {
    let map = sample.ssim_map().zero_padded.iter();
    let (sum, pixels) = map
        .zip(is_inside)
        .enumerate()
        .filter(|&(pixel, (_, is_inside))| is_inside && sample.pair.counts(pixel))
        .fold((0.0, 0_u64), |(sum, count), (_, (value, _))| {
            (sum + value, count + 1)
        });
    if pixels == 0 {
        return Err(EMPTY);
    }
    Ok(sum / pixels as f64)
}
