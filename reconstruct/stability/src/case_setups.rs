//! Setups of the catalogue's cases: the difficult Gaussians, with mild ones around them.

use glam::{DQuat, DVec3, dvec3};
use omnilife_engine::render::settings::Footprint;
use omnilife_schemas::Similarity;

use crate::setup::{RawGaussian, Setup, mild};

fn straight(special: impl IntoIterator<Item = RawGaussian>) -> Setup {
    let mut gaussians: Vec<RawGaussian> = special.into_iter().collect();
    gaussians.extend(mild());
    Setup::straight(gaussians)
}

pub(super) fn poles() -> Setup {
    straight([
        RawGaussian::new(dvec3(0.0, -1.0, 0.0), 2.0, [0.2, 0.1, 0.3], 0.6, 1),
        RawGaussian::new(dvec3(0.0, 1.0, 0.0), 1.5, [0.1, 0.2, 0.15], 0.5, 2),
        RawGaussian::new(dvec3(1e-6, -1.0, 0.0), 3.0, [0.5, 0.2, 0.25], 0.4, 3),
        RawGaussian::new(dvec3(0.0, 1.0, -1e-6), 2.5, [0.05, 0.6, 0.02], 0.6, 4),
        RawGaussian::new(dvec3(0.05, -1.0, 0.02), 2.2, [0.4, 0.3, 0.2], 0.5, 5),
    ])
}

pub(super) fn many_tiles() -> Setup {
    let turn = DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -1.1, 0.2);
    Setup::seen(mild(), turn, dvec3(0.05, -0.02, 0.04), 192)
}

pub(super) fn beside_the_pinhole() -> Setup {
    straight([
        RawGaussian::new(dvec3(1.0, 0.2, 0.0), 2.0, [0.2, 0.1, 0.3], 0.6, 1),
        RawGaussian::new(dvec3(1.0, 0.2, 1e-6), 2.0, [0.2, 0.1, 0.3], 0.6, 2),
        RawGaussian::new(dvec3(-1.0, 0.1, -1e-6), 2.0, [0.2, 0.1, 0.3], 0.6, 3),
        RawGaussian::new(dvec3(-0.2, 0.5, 0.05), 1.5, [0.1, 0.2, 0.1], 0.6, 4),
    ])
    .through(150.0, [0.0; 2])
}

pub(super) fn seam() -> Setup {
    straight([
        RawGaussian::new(dvec3(0.0, 0.1, -1.0), 2.0, [0.2, 0.3, 0.25], 0.6, 1),
        RawGaussian::new(dvec3(1e-7, -0.2, -1.0), 3.0, [0.5, 0.1, 0.2], 0.5, 2),
        RawGaussian::new(dvec3(-1e-7, 0.4, -1.0), 2.5, [0.3, 0.6, 0.2], 0.5, 3),
        RawGaussian::new(dvec3(0.0, -3.0, -1.0), 2.7, [0.3, 0.4, 0.2], 0.5, 4),
    ])
}

pub(super) fn camera_inside(footprint: Footprint) -> Setup {
    straight([RawGaussian::new(
        dvec3(0.3, 0.2, 1.0),
        0.7,
        [1.5, 0.9, 1.2],
        0.3,
        1,
    )])
    .with_footprint(footprint)
}

/// Returns needles with the longest axis a third of the distance.
pub(super) fn needles(ratio: f64) -> Setup {
    let thin = 0.9 / ratio;
    straight([
        RawGaussian::new(dvec3(-1.0, 0.2, 0.7), 3.0, [0.9, thin, thin], 0.7, 1),
        RawGaussian::new(dvec3(0.3, 0.6, 1.0), 2.7, [thin, 0.9, thin], 0.6, 2),
        RawGaussian::new(dvec3(0.5, -0.8, -0.6), 2.8, [thin, thin, 0.9], 0.6, 3),
    ])
}

pub(super) fn discs(ratio: f64) -> Setup {
    let thin = 0.6 / ratio;
    let mut edge_on = RawGaussian::new(dvec3(0.0, 0.0, 1.0), 2.4, [0.6, thin, 0.6], 0.7, 3);
    edge_on.quaternion = [1.0, 0.0, 0.0, 0.0];
    straight([
        RawGaussian::new(dvec3(-1.0, 0.2, 0.7), 3.0, [0.6, 0.6, thin], 0.7, 1),
        RawGaussian::new(dvec3(0.3, 0.6, 1.0), 2.7, [thin, 0.6, 0.6], 0.6, 2),
        edge_on,
    ])
}

/// Returns Gaussians with standard deviations of a share of the distance; small ones of a share of a pixel.
pub(super) fn sized(share: f64) -> Setup {
    let pixel = std::f64::consts::PI / 24.0;
    let unit = if share < 0.1 { pixel } else { 1.0 };
    straight([
        RawGaussian::new(dvec3(-1.0, 0.2, 0.7), 3.0, [3.0 * unit * share; 3], 0.7, 1),
        RawGaussian::new(dvec3(0.3, 0.6, 1.0), 1.7, [1.7 * unit * share; 3], 0.6, 2),
        RawGaussian::new(dvec3(0.1, -2.0, -0.6), 2.8, [2.8 * unit * share; 3], 0.6, 3),
    ])
}

pub(super) fn near_limit() -> Setup {
    straight([
        RawGaussian::new(
            dvec3(0.3, 0.2, 1.0),
            0.01 * (1.0 + 1e-6),
            [0.002; 3],
            0.5,
            1,
        ),
        RawGaussian::new(
            dvec3(-0.6, 0.1, -0.4),
            0.01 * (1.0 - 1e-6),
            [0.002; 3],
            0.5,
            2,
        ),
    ])
}

pub(super) fn shifted_out(distance: f64) -> Setup {
    straight([
        RawGaussian::new(dvec3(-1.0, 0.2, 0.7), distance, [0.1 * distance; 3], 0.7, 1),
        RawGaussian::new(dvec3(0.4, -0.7, 0.3), distance, [0.2 * distance; 3], 0.5, 2),
    ])
}

/// Returns layers with an opacity of about 1/64, one behind the other; the gradients of some are judged.
pub(super) fn layers(count: usize) -> Setup {
    let gaussians = (0..count)
        .map(|index| {
            let distance = 2.0 + 3.0 * index as f64 / count as f64;
            let jitter = 0.02 * (index as f64 * 0.7).sin();
            RawGaussian::new(
                dvec3(0.3 + jitter, 0.2 - jitter, 1.0),
                distance,
                [0.3 * distance; 3],
                1.0 / 64.0,
                index,
            )
        })
        .collect();
    let mut setup = Setup::seen(gaussians, DQuat::IDENTITY, DVec3::ZERO, 12);
    setup.judged = vec![0, count / 100, count / 20];
    setup.judged.dedup();
    setup
}

/// Returns the mild Gaussians in a world far away, or of another size: `scale` makes it normalized.
pub(super) fn in_world(offset: [f64; 3], scale: f64) -> Setup {
    let turn = DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -1.1, 0.2);
    let similarity = Similarity { offset, scale };
    Setup::in_world(mild(), turn, dvec3(0.05, -0.02, 0.04), 48, similarity)
}

pub(super) fn quaternions(quaternion: [f64; 4]) -> Setup {
    let mut gaussians = mild();
    for gaussian in gaussians.iter_mut().take(3) {
        gaussian.quaternion = quaternion;
    }
    Setup::new(gaussians)
}

pub(super) fn saturated() -> Setup {
    let mut gaussians = mild();
    for (gaussian, logit) in gaussians.iter_mut().zip([-100.0, -20.0, 20.0, 100.0]) {
        gaussian.opacity_logit = logit;
    }
    Setup::new(gaussians)
}

pub(super) fn extreme_scales() -> Setup {
    let mut gaussians = mild();
    gaussians[0].log_scale = [-100.0; 3];
    gaussians[1].log_scale = [100.0; 3];
    gaussians[2].log_scale = [-100.0, -1.0, -2.0];
    Setup::new(gaussians)
}

pub(super) fn non_finite() -> Setup {
    let mut gaussians = mild();
    let good = gaussians.len();
    let degenerate = RawGaussian::new(dvec3(0.2, 0.1, 1.0), 2.0, [0.3; 3], 0.5, 1);
    gaussians.extend([degenerate; 4]);
    gaussians[good].position[0] = f64::NAN;
    gaussians[good + 1].position[2] = f64::INFINITY;
    gaussians[good + 2].log_scale[1] = f64::NAN;
    gaussians[good + 3].quaternion[3] = f64::NAN;
    Setup::new(gaussians)
}

pub(super) fn at_the_camera() -> Setup {
    let mut gaussians = mild();
    let mut there = gaussians[0];
    there.position = [0.0; 3];
    gaussians.push(there);
    Setup::straight(gaussians)
}
