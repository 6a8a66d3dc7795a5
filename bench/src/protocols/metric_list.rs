//! The metrics of the protocols.

/// All metrics of the tables of OmniLife360 and of related papers. Metrics without their data on a scene or a machine
/// (masks, depth, weights) are unavailable in the result, with the reason.
const METRICS: [&str; 25] = [
    "psnr",
    "psnr-channels",
    "ssim",
    "ssim-skimage",
    "lpips-vgg",
    "lpips-alex",
    "lpips-vgg-unscaled",
    "lpips-alex-unscaled",
    "ws-psnr",
    "ws-ssim",
    "cube-psnr",
    "cube-ssim",
    "psnr-static",
    "ssim-static",
    "psnr-dynamic",
    "ssim-dynamic",
    "psnr-human",
    "ssim-human",
    "psnr-vehicle",
    "ssim-vehicle",
    "temporal-lpips",
    "temporal-lpips-truth",
    "temporal-lpips-error",
    "depth-abs-rel",
    "depth-delta",
];

/// Further metrics of papers on UAV video and on the decomposition of clips: SSIM in the variant of each of them, and
/// single objects.
const OF_INPUT_VIEWS: [&str; 6] = [
    "ssim-4dgf",
    "ssim-skimage-uniform",
    "psnr-object",
    "psnr-object-masked",
    "ssim-object",
    "ssim-object-masked",
];

/// Returns all metrics with those of papers that score input views.
pub(super) fn of_input_views() -> Vec<String> {
    let names = METRICS.iter().chain(&OF_INPUT_VIEWS);
    names.map(|&id| id.to_owned()).collect()
}

/// Returns their ids, in the form of a protocol.
pub(super) fn all() -> Vec<String> {
    METRICS.map(str::to_owned).to_vec()
}
