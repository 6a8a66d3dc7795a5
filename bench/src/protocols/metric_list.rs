//! The metrics that the protocols ask for.

/// All that a table of OmniLife360 or of the papers beside it needs. What a scene or a machine
/// cannot give (masks, depth, weights) is unavailable in the result, with the reason.
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

/// What papers on UAV video and on the decomposition of clips add: SSIM as each of them computes it, and
/// single objects.
const OF_INPUT_VIEWS: [&str; 6] = [
    "ssim-4dgf",
    "ssim-skimage-uniform",
    "psnr-object",
    "psnr-object-masked",
    "ssim-object",
    "ssim-object-masked",
];

/// The same with those that papers which score input views add.
pub(super) fn of_input_views() -> Vec<String> {
    let names = METRICS.iter().chain(&OF_INPUT_VIEWS);
    names.map(|&id| id.to_owned()).collect()
}

/// Their ids, as a protocol holds them.
pub(super) fn all() -> Vec<String> {
    METRICS.map(str::to_owned).to_vec()
}
