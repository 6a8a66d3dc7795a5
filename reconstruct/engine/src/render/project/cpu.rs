//! Projection on the CPU: 8 Gaussians at once; those with cones as footprints one by one.

use fearless_simd::{Level, Simd, dispatch, f32x8, mask32x8, prelude::*};
use glam::Vec3;
use rayon::prelude::*;

use crate::render::project::{
    ConeGradient, Ellipse, Shape, Splat, SplatGradient, Splats, axes_vjp,
    cone::Conic,
    ellipse::Linearization,
    largest_q,
    place::{CameraGaussian, CameraGaussians8, eight},
    sh,
};
use crate::{
    camera::{
        CONE_RHO, CONE_WIDTH, Camera, CameraLanes, PixelBox, View,
        lanes::{LANES, Vec3x8, horizontal},
    },
    gaussians::{ActivatedGaussians, SH_C0, sh_rest_count},
    render::{
        bin::{TileLists, learning::LearningEntries},
        project::Cone,
        raster::EntryGradients,
        settings::{ALPHA_MIN, Footprint, RenderSettings},
    },
};

/// Gaussians per parallel piece of work.
const BATCH: usize = 512;

const _: () = assert!(BATCH.is_multiple_of(LANES));

/// Distance of a Gaussian that is not drawn.
pub const NOT_DRAWN: f32 = f32::INFINITY;

/// Projects all Gaussians: `splats` and `distances` receive one entry per Gaussian. The distance of a
/// Gaussian that is not drawn is [`NOT_DRAWN`], and its splat is arbitrary.
pub fn forward(
    view: &View,
    gaussians: &ActivatedGaussians,
    settings: &RenderSettings,
    splats: &mut Splats,
    distances: &mut Vec<f32>,
) {
    splats.resize(gaussians.len());
    distances.resize(gaussians.len(), NOT_DRAWN);
    let projector = Projector {
        view,
        gaussians,
        settings,
    };
    let level = Level::new();
    (
        splats.all.par_chunks_mut(BATCH),
        splats.cones.par_chunks_mut(BATCH),
        distances.par_chunks_mut(BATCH),
    )
        .into_par_iter()
        .enumerate()
        .for_each(|(batch, (splats, cones, distances))| {
            distances.fill(NOT_DRAWN);
            let groups = splats
                .chunks_mut(LANES)
                .zip(cones.chunks_mut(LANES))
                .zip(distances.chunks_mut(LANES));
            dispatch!(level, simd => {
                for (group, ((splats, cones), distances)) in groups.enumerate() {
                    let first = batch * BATCH + group * LANES;
                    projector.project(simd, first, splats, cones, distances);
                }
            });
        });
}

#[derive(Clone, Copy)]
struct Projector<'a> {
    view: &'a View,
    gaussians: &'a ActivatedGaussians,
    settings: &'a RenderSettings,
}

impl Projector<'_> {
    /// Returns the degree of harmonics that is drawn.
    fn degree(&self) -> usize {
        self.gaussians.sh_degree.min(self.settings.sh_degree)
    }

    /// Returns the non-constant coefficients of one Gaussian.
    fn rest(&self, index: usize) -> &[[f32; 3]] {
        let count = sh_rest_count(self.gaussians.sh_degree);
        &self.gaussians.sh_rest[index * count..(index + 1) * count]
    }

    /// Returns the ellipses of footprints with the given largest `q`; `None` if all are cones.
    #[inline(always)]
    fn ellipses<S: Simd>(
        &self,
        placed: &CameraGaussians8<S>,
        q_max: f32x8<S>,
    ) -> Option<Ellipses<S>> {
        if self.settings.footprint == Footprint::Ray {
            return None;
        }
        let camera = &self.view.camera;
        let linear = Linearization::new(self.view, placed);
        let (shapes, is_regular) = linear.ellipses();
        let is_cone = match camera {
            Camera::Erp(camera) => {
                let is_polar = horizontal(placed.point).simd_lt(placed.distance * CONE_RHO);
                is_polar | linear.is_wider(CONE_WIDTH * camera.width as f32)
            }
            Camera::Pinhole(_) => mask32x8::splat(q_max.simd, false),
        };
        Some(Ellipses {
            shapes,
            centre: camera.pixels(placed.point.times(placed.inverse_distance)),
            extent: linear.extents(q_max),
            is_regular,
            is_cone,
        })
    }

    /// Projects the Gaussians from `first` on, as many as there are splats.
    #[inline(always)]
    fn project<S: Simd>(
        &self,
        simd: S,
        first: usize,
        splats: &mut [Splat],
        cones: &mut [Cone],
        distances: &mut [f32],
    ) {
        let placed = CameraGaussians8::new(simd, self.view, self.gaussians, first);
        let opacity = f32x8::simd_from(simd, eight(&self.gaussians.opacities, first));
        // NaN fails the comparison and is not drawn.
        let is_seen = placed.is_seen(self.view, self.settings) & opacity.simd_ge(ALPHA_MIN);
        if !is_seen.any_true() {
            return;
        }
        let log2_opacity: [f32; LANES] = <[f32; LANES]>::from(opacity).map(f32::log2);
        let q_max = f32x8::simd_from(simd, log2_opacity.map(largest_q));
        let ellipses = self.ellipses(&placed, q_max);
        for (lane, ((splat, cone), distance)) in
            splats.iter_mut().zip(cones).zip(distances).enumerate()
        {
            if !is_seen.test(lane) {
                continue;
            }
            let index = first + lane;
            let ellipse = ellipses.as_ref().filter(|all| !all.is_cone.test(lane));
            let (shape, bounds, is_finite) = if let Some(all) = ellipse {
                let bounds = PixelBox {
                    centre: [all.centre[0][lane], all.centre[1][lane]],
                    extent: [all.extent[0][lane], all.extent[1][lane]],
                };
                let shape = Shape::Ellipse(all.shapes[lane]);
                (shape, bounds, all.is_regular.test(lane))
            } else {
                let conic = self.conic(index, &placed.lane(lane));
                *cone = conic.cone();
                let sum = cone.across[0] + cone.across[1] + cone.along;
                (
                    Shape::Cone,
                    conic.bounds(self.view, largest_q(log2_opacity[lane])),
                    sum.is_finite() && cone.depth_variance.is_finite(),
                )
            };
            if !is_finite || !self.is_inside(&bounds) {
                continue;
            }
            let direction = self.direction(placed.point.lane(lane), placed.distance[lane]);
            *splat = Splat {
                centre: bounds.centre,
                extent: bounds.extent,
                log2_opacity: log2_opacity[lane],
                colour: sh::colour(
                    self.degree(),
                    direction,
                    self.gaussians.sh_constant[index],
                    self.rest(index),
                ),
                shape,
            };
            *distance = placed.distance[lane];
        }
    }

    /// Returns true if a rectangle is finite and has rows in the image.
    fn is_inside(&self, bounds: &PixelBox) -> bool {
        let [top, bottom] = [-1.0, 1.0].map(|side| bounds.centre[1] + side * bounds.extent[1]);
        bottom >= 0.5
            && top <= self.view.camera.height() as f32 - 0.5
            && bounds.extent[0].is_finite()
    }

    fn conic(&self, index: usize, placed: &CameraGaussian) -> Conic {
        let scale = self.gaussians.scales[index];
        Conic::new(self.view, placed, scale, self.settings.footprint)
    }

    /// Returns the unit direction from the camera to a centre (given in the camera frame), in world
    /// coordinates.
    fn direction(&self, point: Vec3, distance: f32) -> Vec3 {
        self.view.rotation.transpose() * (point / distance)
    }

    /// Computes the gradients of the Gaussians from `first` on by the inputs of their footprints.
    #[inline(always)]
    fn shapes_vjp<S: Simd>(
        &self,
        simd: S,
        first: usize,
        sums: &EightSums,
        drawn: &TiledGaussians<'_>,
        entries: &EntryGradients,
    ) -> ShapeGradients {
        let placed = CameraGaussians8::new(simd, self.view, self.gaussians, first);
        let mut out = if self.settings.footprint == Footprint::Ray {
            ShapeGradients::default()
        } else {
            let linear = Linearization::new(self.view, &placed);
            let by_ellipse = [0, 1, 2, 3, 4].map(|at: usize| f32x8::simd_from(simd, sums.rows[at]));
            let (by_point, by_axes) = linear.vjp(self.view, &placed, by_ellipse);
            let (by_scale, by_rotation) = placed.axes_vjp(&by_axes);
            let position: Vec3x8<S> = by_point.transformed(&self.view.rotation.transpose());
            let by_rotation: [[f32; LANES]; 4] = by_rotation.map(Into::into);
            ShapeGradients {
                positions: position.scatter(),
                scales: by_scale.scatter(),
                rotations: std::array::from_fn(|lane| by_rotation.map(|row| row[lane])),
                centres: std::array::from_fn(|lane| [sums.rows[0][lane], sums.rows[1][lane]]),
            }
        };
        for lane in 0..LANES.min(drawn.learning.gaussians().end - first) {
            let index = first + lane;
            if drawn.ranks[index] != u32::MAX && drawn.splats.all[index].shape == Shape::Cone {
                let by_cone = sum_cones(drawn, entries, drawn.ranks[index]);
                self.cone_vjp(index, &placed.lane(lane), &by_cone, lane, &mut out);
            }
        }
        out
    }

    /// Sets one lane of `out` for a cone.
    fn cone_vjp(
        &self,
        index: usize,
        placed: &CameraGaussian,
        by_cone: &ConeGradient,
        lane: usize,
        out: &mut ShapeGradients,
    ) {
        let (rotation, scale) = (
            self.gaussians.rotations[index],
            self.gaussians.scales[index],
        );
        let (shape, direct) = self
            .conic(index, placed)
            .vjp(self.view, placed, scale, by_cone);
        let (by_scale, by_rotation) = axes_vjp(rotation, scale, &shape.axes);
        out.positions[lane] = (self.view.rotation.transpose() * shape.point).to_array();
        out.scales[lane] = std::array::from_fn(|axis| by_scale[axis] + direct[axis]);
        out.rotations[lane] = by_rotation;
        out.centres[lane] = shape.centre;
    }
}

impl Projector<'_> {
    /// Adds the gradient through the harmonics to that by a centre, and writes that by their non-constant
    /// coefficients.
    fn harmonics_vjp(
        &self,
        index: usize,
        by_colour: [f32; 3],
        by_position: &mut [f32; 3],
        rest: &mut [[f32; 3]],
    ) {
        let offset = Vec3::from_array(self.gaussians.positions[index]) - self.view.centre;
        let through_colour = sh::position_vjp(self.degree(), offset, self.rest(index), by_colour);
        *by_position = (Vec3::from_array(*by_position) + through_colour).to_array();
        let values = sh::basis(self.degree(), offset.normalize());
        let used = sh_rest_count(self.degree());
        for (rest, value) in rest.iter_mut().zip(&values[..used]) {
            *rest = by_colour.map(|by_colour| by_colour * value);
        }
        rest[used..].fill([0.0; 3]);
    }
}

/// The footprints of 8 Gaussians as ellipses, one per lane.
struct Ellipses<S: Simd> {
    shapes: [Ellipse; LANES],
    centre: [f32x8<S>; 2],
    extent: [f32x8<S>; 2],
    /// Lanes with a finite shape.
    is_regular: mask32x8<S>,
    /// Lanes whose footprint is a cone instead.
    is_cone: mask32x8<S>,
}

/// Gradients of 8 Gaussians by the inputs of their footprints, without the path through the harmonics.
#[derive(Default)]
struct ShapeGradients {
    positions: [[f32; 3]; LANES],
    scales: [[f32; 3]; LANES],
    rotations: [[f32; 4]; LANES],
    centres: [[f32; 2]; LANES],
}

/// Gradients of 8 Gaussians, summed over their entries.
#[derive(Default)]
struct EightSums {
    /// [`SplatGradient::ellipse`], one row for each of its values.
    rows: [[f32; LANES]; 5],
    log_opacity: [f32; LANES],
    colour: [[f32; 3]; LANES],
}

/// Result of [`forward`] with its order and tile lists.
#[derive(Debug, Clone, Copy)]
pub struct TiledGaussians<'a> {
    /// Splats, one per Gaussian.
    pub splats: &'a Splats,
    /// Rank of each Gaussian in the order near to far; `u32::MAX` if it was not drawn.
    pub ranks: &'a [u32],
    /// Entries of each splat.
    pub lists: &'a TileLists,
    /// Gaussians whose gradients are computed.
    pub learning: &'a LearningEntries,
}

/// Computes the VJP of [`forward`]: sums each splat's entries in a fixed order and writes the gradients of
/// all trained Gaussians, from the first on. Those of Gaussians that were not drawn are zero. `centres`
/// receives the gradients by the centres' images ([`crate::render::Visible::centre_gradient`]).
pub fn backward(
    view: &View,
    gaussians: &ActivatedGaussians,
    settings: &RenderSettings,
    drawn: TiledGaussians<'_>,
    entries: &EntryGradients,
    centres: &mut Vec<[f32; 2]>,
    out: &mut ActivatedGaussians,
) {
    let asked = drawn.learning.gaussians();
    let len = asked.len();
    out.reshape(len, gaussians.sh_degree, gaussians.feature_count);
    centres.resize(len, [0.0; 2]);
    let projector = Projector {
        view,
        gaussians,
        settings,
    };
    let stored = sh_rest_count(gaussians.sh_degree);
    let features = gaussians.feature_count;
    let level = Level::new();
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
                for at in (0..positions.len()).step_by(LANES) {
                    let first = asked.start + batch * BATCH + at;
                    let end = positions.len().min(at + LANES);
                    let by_feature = &mut by_feature[at * features..end * features];
                    let ranks = &drawn.ranks[first..first + end - at];
                    let sums = sum_entries(&drawn, entries, ranks, by_feature);
                    let shapes = dispatch!(level, simd => {
                        projector.shapes_vjp(simd, first, &sums, &drawn, entries)
                    });
                    for lane in 0..end - at {
                        let (index, at) = (first + lane, at + lane);
                        let rest = &mut rest[at * stored..(at + 1) * stored];
                        if drawn.ranks[index] == u32::MAX {
                            positions[at] = [0.0; 3];
                            scales[at] = [0.0; 3];
                            rotations[at] = [0.0; 4];
                            opacities[at] = 0.0;
                            constants[at] = [0.0; 3];
                            centres[at] = [0.0; 2];
                            rest.fill([0.0; 3]);
                            continue;
                        }
                        positions[at] = shapes.positions[lane];
                        scales[at] = shapes.scales[lane];
                        rotations[at] = shapes.rotations[lane];
                        centres[at] = shapes.centres[lane];
                        opacities[at] = sums.log_opacity[lane] / gaussians.opacities[index];
                        // The clamp of the colour at 0 stops the gradient.
                        let splat = &drawn.splats.all[index];
                        let by_colour: [f32; 3] = std::array::from_fn(|channel| {
                            let is_free = splat.colour[channel] > 0.0;
                            if is_free {
                                sums.colour[lane][channel]
                            } else {
                                0.0
                            }
                        });
                        constants[at] = by_colour.map(|by_colour| SH_C0 * by_colour);
                        if stored > 0 {
                            projector.harmonics_vjp(index, by_colour, &mut positions[at], rest);
                        }
                    }
                }
            },
        );
}

/// Sums the entries' gradients of up to 8 Gaussians with these `ranks` in the order, each in the order of its
/// entries; 0 for Gaussians that were not drawn.
fn sum_entries(
    drawn: &TiledGaussians<'_>,
    entries: &EntryGradients,
    ranks: &[u32],
    by_feature: &mut [f32],
) -> EightSums {
    let features = by_feature.len() / ranks.len();
    by_feature.fill(0.0);
    let mut sums = EightSums::default();
    for (lane, &rank) in ranks.iter().enumerate() {
        if rank == u32::MAX {
            continue;
        }
        let by_feature = &mut by_feature[lane * features..(lane + 1) * features];
        let mut total = SplatGradient::default();
        for &place in drawn.lists.places(rank) {
            let place = drawn.learning.place(place);
            total.accumulate(&entries.splats[place]);
            let from = place * features;
            let entry = &entries.features[from..from + features];
            for (sum, value) in by_feature.iter_mut().zip(entry) {
                *sum += value;
            }
        }
        for (row, value) in sums.rows.iter_mut().zip(total.ellipse) {
            row[lane] = value;
        }
        sums.log_opacity[lane] = total.log_opacity;
        sums.colour[lane] = total.colour;
    }
    sums
}

/// Sums the entries' gradients by the cone of the splat with this rank.
fn sum_cones(drawn: &TiledGaussians<'_>, entries: &EntryGradients, rank: u32) -> ConeGradient {
    let mut total = [0.0; 10];
    for &place in drawn.lists.places(rank) {
        let place = drawn.learning.place(place);
        for (sum, value) in total.iter_mut().zip(entries.cones[place]) {
            *sum += value;
        }
    }
    total
}

/// Splits rows of `width` values into pieces of [`BATCH`] rows; pieces are empty if the width is 0.
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
