//! The projection on the CPU.

use glam::Vec3;
use rayon::prelude::*;

use crate::render::project::{
    Shape, Splat, SplatGradient, axes, axes_vjp, cone::Conic, ellipse::Linearization, largest_q, sh,
};
use crate::{
    camera::{CONE_RHO, CONE_WIDTH, Camera, CameraKernels, View, horizontal},
    gaussians::{ActivatedGaussians, SH_C0, sh_rest_count},
    render::{
        bin::TileLists,
        raster::EntryGradients,
        settings::{ALPHA_MIN, Footprint, RenderSettings},
    },
};

/// Gaussians per parallel piece of work.
const BATCH: usize = 512;

/// Gaussians whose entries are summed one after another, so that their cache misses overlap.
const GATHER: usize = 16;

/// Distance of a Gaussian that is not drawn.
pub const NOT_DRAWN: f32 = f32::INFINITY;

/// Projects all Gaussians: `splats` and `distances` receive one entry per Gaussian; a distance is
/// [`NOT_DRAWN`] where there is nothing to draw, and the splat arbitrary.
pub fn forward(
    view: &View,
    gaussians: &ActivatedGaussians,
    settings: &RenderSettings,
    splats: &mut Vec<Splat>,
    distances: &mut Vec<f32>,
) {
    splats.resize(gaussians.len(), Splat::default());
    distances.resize(gaussians.len(), NOT_DRAWN);
    let one = Projector {
        view,
        gaussians,
        settings,
    };
    splats
        .par_iter_mut()
        .zip(distances.par_iter_mut())
        .enumerate()
        .with_min_len(BATCH)
        .for_each(|(index, (splat, distance))| {
            *distance = NOT_DRAWN;
            if let Some((projected, at)) = one.project(index) {
                *splat = projected;
                *distance = at;
            }
        });
}

/// A Gaussian in front of the camera.
pub(super) struct Placed {
    /// Centre in the camera frame.
    pub(super) point: Vec3,
    /// Its length.
    pub(super) distance: f32,
    /// `M = R S` in world coordinates.
    pub(super) axes: [Vec3; 3],
}

/// The two ways to a shape.
enum Path {
    Ellipse(Linearization),
    Cone(Conic),
}

struct Projector<'a> {
    view: &'a View,
    gaussians: &'a ActivatedGaussians,
    settings: &'a RenderSettings,
}

impl Projector<'_> {
    /// The degree of harmonics that is drawn.
    fn degree(&self) -> usize {
        self.gaussians.sh_degree.min(self.settings.sh_degree)
    }

    /// Coefficients of one Gaussian beside the constant ones.
    fn rest(&self, index: usize) -> &[[f32; 3]] {
        let count = sh_rest_count(self.gaussians.sh_degree);
        &self.gaussians.sh_rest[index * count..(index + 1) * count]
    }

    fn place(&self, index: usize) -> Option<Placed> {
        let centre = Vec3::from_array(self.gaussians.positions[index]);
        let scale = self.gaussians.scales[index];
        let point = self.view.rotation * (centre - self.view.centre);
        let distance = point.length();
        let largest = scale[0].max(scale[1]).max(scale[2]);
        // Written so that NaN culls; what `max` hides of it is caught with the footprint.
        let is_drawn = self.view.camera.sees(point, distance, self.settings.near)
            && (largest < distance || self.settings.footprint == Footprint::Ray);
        is_drawn.then(|| Placed {
            point,
            distance,
            axes: axes(self.gaussians.rotations[index], scale),
        })
    }

    fn path(&self, index: usize, placed: &Placed) -> Path {
        let footprint = self.settings.footprint;
        let cone = || {
            Path::Cone(Conic::new(
                self.view,
                placed,
                self.gaussians.scales[index],
                footprint,
            ))
        };
        if footprint == Footprint::Ray {
            return cone();
        }
        let Camera::Erp(camera) = self.view.camera else {
            return Path::Ellipse(Linearization::new(self.view, placed));
        };
        if horizontal(placed.point) < CONE_RHO * placed.distance {
            return cone();
        }
        let linear = Linearization::new(self.view, placed);
        if linear.width() > CONE_WIDTH * camera.width as f32 {
            return cone();
        }
        Path::Ellipse(linear)
    }

    fn project(&self, index: usize) -> Option<(Splat, f32)> {
        let opacity = self.gaussians.opacities[index];
        // Written so that NaN is left out.
        let is_seen = opacity >= ALPHA_MIN;
        if !is_seen {
            return None;
        }
        let placed = self.place(index)?;
        let log2_opacity = opacity.log2();
        let q_max = largest_q(log2_opacity);
        let (shape, bounds, is_finite) = match self.path(index, &placed) {
            Path::Ellipse(linear) => {
                let ellipse = linear.ellipse();
                let sum = ellipse.variance + ellipse.slope + ellipse.inverse_variance;
                (
                    Shape::Ellipse(ellipse),
                    linear.bounds(q_max),
                    sum.is_finite(),
                )
            }
            Path::Cone(conic) => {
                let cone = conic.cone();
                let sum = cone.across[0] + cone.across[1] + cone.along;
                let is_finite = sum.is_finite() && cone.depth_variance.is_finite();
                (Shape::Cone(cone), conic.bounds(self.view, q_max), is_finite)
            }
        };
        let [top, bottom] = [-1.0, 1.0].map(|side| bounds.centre[1] + side * bounds.extent[1]);
        let is_inside = bottom >= 0.5 && top <= self.view.camera.height() as f32 - 0.5;
        if !is_finite || !is_inside || !bounds.extent[0].is_finite() {
            return None;
        }
        let splat = Splat {
            centre: bounds.centre,
            extent: bounds.extent,
            log2_opacity,
            colour: sh::colour(
                self.degree(),
                self.direction(&placed),
                self.gaussians.sh_constant[index],
                self.rest(index),
            ),
            shape,
        };
        Some((splat, placed.distance))
    }

    /// Unit direction from the camera to the centre, in world coordinates.
    fn direction(&self, placed: &Placed) -> Vec3 {
        self.view.rotation.transpose() * (placed.point / placed.distance)
    }

    /// The gradient of one Gaussian from that of its splat.
    fn backward(&self, index: usize, splat: &Splat, gradient: &SplatGradient) -> OneGradient {
        let Some(placed) = self.place(index) else {
            // A splat exists only where the Gaussian is drawn.
            return OneGradient::default();
        };
        let (rotation, scale) = (
            self.gaussians.rotations[index],
            self.gaussians.scales[index],
        );
        let (shape, direct) = match self.path(index, &placed) {
            Path::Ellipse(linear) => (linear.vjp(self.view, &placed, &gradient.shape), [0.0; 3]),
            Path::Cone(conic) => conic.vjp(self.view, &placed, scale, &gradient.shape),
        };
        let (mut by_scale, by_rotation) = axes_vjp(rotation, scale, &shape.axes);
        for (sum, direct) in by_scale.iter_mut().zip(direct) {
            *sum += direct;
        }
        let direction = self.direction(&placed);
        // The clamp of the colour at 0 stops the gradient.
        let colour: [f32; 3] = std::array::from_fn(|channel| {
            if splat.colour[channel] > 0.0 {
                gradient.colour[channel]
            } else {
                0.0
            }
        });
        let offset = direction * placed.distance;
        let through_colour = sh::position_vjp(self.degree(), offset, self.rest(index), colour);
        OneGradient {
            position: (self.view.rotation.transpose() * shape.point + through_colour).to_array(),
            scale: by_scale,
            rotation: by_rotation,
            opacity: gradient.log_opacity / self.gaussians.opacities[index],
            colour,
            direction,
            centre: shape.centre,
        }
    }
}

#[derive(Default)]
struct OneGradient {
    position: [f32; 3],
    scale: [f32; 3],
    rotation: [f32; 4],
    opacity: f32,
    /// By the colour before its clamp.
    colour: [f32; 3],
    /// Where the harmonics were evaluated.
    direction: Vec3,
    centre: [f32; 2],
}

/// The result of [`forward`] and what was made of it.
#[derive(Debug, Clone, Copy)]
pub struct Drawn<'a> {
    /// Splats, one per Gaussian.
    pub splats: &'a [Splat],
    /// Place of each Gaussian in the order near to far; `u32::MAX` where it was not drawn.
    pub ranks: &'a [u32],
    /// Where each splat's entries are.
    pub lists: &'a TileLists,
}

/// VJP of [`forward`]: sums each splat's entries in a fixed order and writes the gradients of all
/// Gaussians, zero for those that were not drawn. `centres` receives the gradients by the centres'
/// images ([`crate::render::Visible::centre_gradient`]).
pub fn backward(
    view: &View,
    gaussians: &ActivatedGaussians,
    settings: &RenderSettings,
    drawn: Drawn<'_>,
    entries: &EntryGradients,
    centres: &mut Vec<[f32; 2]>,
    out: &mut ActivatedGaussians,
) {
    let len = gaussians.len();
    out.reshape(len, gaussians.sh_degree, gaussians.feature_count);
    centres.resize(len, [0.0; 2]);
    let one = Projector {
        view,
        gaussians,
        settings,
    };
    let stored = sh_rest_count(gaussians.sh_degree);
    let used = sh_rest_count(one.degree());
    let features = gaussians.feature_count;
    (
        out.positions.par_chunks_mut(BATCH),
        out.scales.par_chunks_mut(BATCH),
        out.rotations.par_chunks_mut(BATCH),
        out.opacities.par_chunks_mut(BATCH),
        out.sh_constant.par_chunks_mut(BATCH),
        centres.par_chunks_mut(BATCH),
        chunks_of_rows(&mut out.sh_rest, stored, len),
        chunks_of_rows(&mut out.features, features, len),
    )
        .into_par_iter()
        .enumerate()
        .for_each(
            |(
                batch,
                (positions, scales, rotations, opacities, constants, centres, rest, by_feature),
            )| {
                let mut sums = [SplatGradient::default(); GATHER];
                for at in 0..positions.len() {
                    let index = batch * BATCH + at;
                    if at % GATHER == 0 {
                        let end = positions.len().min(at + GATHER);
                        let ranks = &drawn.ranks[index..batch * BATCH + end];
                        let by_feature = &mut by_feature[at * features..end * features];
                        sum_entries(drawn.lists, entries, ranks, &mut sums, by_feature);
                    }
                    let rest = &mut rest[at * stored..(at + 1) * stored];
                    let gradient = if drawn.ranks[index] == u32::MAX {
                        OneGradient::default()
                    } else {
                        one.backward(index, &drawn.splats[index], &sums[at % GATHER])
                    };
                    positions[at] = gradient.position;
                    scales[at] = gradient.scale;
                    rotations[at] = gradient.rotation;
                    opacities[at] = gradient.opacity;
                    constants[at] = gradient.colour.map(|by_colour| SH_C0 * by_colour);
                    centres[at] = gradient.centre;
                    if stored > 0 {
                        let values = sh::basis(one.degree(), gradient.direction);
                        for (rest, value) in rest.iter_mut().zip(&values[..used]) {
                            *rest = gradient.colour.map(|by_colour| by_colour * value);
                        }
                        rest[used..].fill([0.0; 3]);
                    }
                }
            },
        );
}

/// Sums the entries' gradients of Gaussians with the places `ranks` in the order, each in the order
/// of its entries; features of Gaussians that were not drawn are 0.
fn sum_entries(
    lists: &TileLists,
    entries: &EntryGradients,
    ranks: &[u32],
    sums: &mut [SplatGradient; GATHER],
    by_feature: &mut [f32],
) {
    let features = by_feature.len() / ranks.len();
    by_feature.fill(0.0);
    for (at, (&rank, sum)) in ranks.iter().zip(sums).enumerate() {
        if rank == u32::MAX {
            continue;
        }
        let by_feature = &mut by_feature[at * features..(at + 1) * features];
        let mut total = SplatGradient::default();
        for &place in lists.places(rank) {
            total.accumulate(&entries.splats[place as usize]);
            let from = place as usize * features;
            let entry = &entries.features[from..from + features];
            for (sum, value) in by_feature.iter_mut().zip(entry) {
                *sum += value;
            }
        }
        *sum = total;
    }
}

/// Pieces of [`BATCH`] rows of `width` values; empty pieces where the width is 0.
fn chunks_of_rows<T: Send>(
    values: &mut [T],
    width: usize,
    rows: usize,
) -> impl IndexedParallelIterator<Item = &mut [T]> {
    let pieces = rows.div_ceil(BATCH);
    let mut rest = values;
    let slices: Vec<&mut [T]> = (0..pieces)
        .map(|_| {
            let count = (BATCH * width).min(rest.len());
            let (piece, others) = std::mem::take(&mut rest).split_at_mut(count);
            rest = others;
            piece
        })
        .collect();
    slices.into_par_iter()
}
